//! Opens a command's run and the store of its objects.

use super::exit_code::{Exit, Failure, failure};
use super::store_env::{inputs, store_options};
use crate::run::{Run, RunError, keys};
use crate::store::Store;
use bytes::Bytes;
use glasshouse_line::Roots;
use render::shard::{Spec, manifest_digest};
use std::path::Path;

/// Opens a run to make tuples, and its store: `address`, or the run's folder.
pub(super) fn open_to_work(
    folder: &Path,
    address: Option<&str>,
    roots: &Roots,
) -> Result<(Run, Store), Failure> {
    open_by(Run::open, folder, address, roots)
}

/// Opens a run to read its tuples, and its store: `address`, or the run's folder.
pub(super) fn open(
    folder: &Path,
    address: Option<&str>,
    roots: &Roots,
) -> Result<(Run, Store), Failure> {
    open_by(Run::open_to_read, folder, address, roots)
}

fn open_by(
    open: fn(&Path, &Roots) -> Result<Run, RunError>,
    folder: &Path,
    address: Option<&str>,
    roots: &Roots,
) -> Result<(Run, Store), Failure> {
    let elsewhere = address.map(|address| Store::open(address, &store_options())).transpose()?;
    if let Some(store) = &elsewhere {
        fetch(folder, store)?;
    }
    let mut run = open(folder, roots)?;
    run.inputs = inputs();
    if let Some(store) = &elsewhere {
        check(&run, store)?;
    }
    // Opening a local store creates its folder, so the run must be opened first.
    let store = elsewhere.map_or_else(|| Store::local(folder), Ok)?;
    Ok((run, store))
}

/// Number of attempts to fetch an object without damage.
const FETCHES: u32 = 5;

/// Copies the run's spec and manifest from the store into `folder`, unless `folder` has the same ones already. A damaged
/// copy, here or on its way, is fetched again. Fails if `folder` holds another run, whole.
pub(super) fn fetch(folder: &Path, store: &Store) -> Result<(), Failure> {
    let path = folder.join(keys::SPEC);
    let here = std::fs::read(&path).ok();
    let Some(spec) = fetch_spec(store, here.as_deref())? else {
        if here.is_some() {
            return Ok(());
        }
        return Err(failure!(
            Exit::TryAgain,
            "{} holds no run yet (no {}); start `glasshouse coordinate RUN --store …` first, then try again",
            store.name(),
            keys::SPEC
        ));
    };
    let digest = serde_json::from_slice::<Spec>(&spec).ok().map(|spec| spec.manifest_blake3);
    let is_of = |manifest: &[u8]| {
        let text = std::str::from_utf8(manifest).ok();
        text.map(manifest_digest) == digest
    };
    let manifest = std::fs::read(folder.join(keys::MANIFEST)).ok();
    let has_manifest = manifest.is_some_and(|manifest| is_of(&manifest));
    if here.as_deref() == Some(&spec[..]) && has_manifest {
        return Ok(());
    }
    if here.is_some() && Run::open(folder, &Roots::default()).is_ok() {
        return Err(holds_another(folder, store));
    }
    render::atomic_file::create_dir(folder)?;
    if !has_manifest {
        let fetched = (0..FETCHES).find_map(|_| match store.get(keys::MANIFEST) {
            Ok(Some(bytes)) if is_of(&bytes) => Some(Ok(bytes)),
            Ok(_) => None,
            Err(error) => Some(Err(error)),
        });
        let bytes = fetched.transpose()?.ok_or_else(|| {
            failure!(
                Exit::TryAgain,
                "{} in {} is absent or does not have the digest in {}; if this remains, plan the run again",
                keys::MANIFEST,
                store.name(),
                keys::SPEC
            )
        })?;
        render::atomic_file::write(&folder.join(keys::MANIFEST), &bytes)?;
    }
    render::atomic_file::write(&path, &spec)?;
    Ok(())
}

/// Fetches the store's spec until two fetches agree, or one agrees with the copy `here`: a spec has no digest that would
/// show damage on its way.
fn fetch_spec(store: &Store, here: Option<&[u8]>) -> Result<Option<Bytes>, Failure> {
    let mut before = here.map(Bytes::copy_from_slice);
    for _ in 0..FETCHES {
        let Some(bytes) = store.get(keys::SPEC)? else {
            return Ok(None);
        };
        if before.as_ref() == Some(&bytes) {
            return Ok(Some(bytes));
        }
        before = Some(bytes);
    }
    Err(failure!(
        Exit::TryAgain,
        "{} in {} differs whenever it is read: the store or the network damages objects; try again",
        keys::SPEC,
        store.name()
    ))
}

/// Checks that the store belongs to this run. A store without a spec passes, because it is still empty.
fn check(run: &Run, store: &Store) -> Result<(), Failure> {
    let (Some(there), Ok(here)) =
        (store.get(keys::SPEC)?, render::input_file::read(&run.path(keys::SPEC)))
    else {
        return Ok(());
    };
    if there == here {
        return Ok(());
    }
    Err(holds_another(run.root(), store))
}

fn holds_another(folder: &Path, store: &Store) -> Failure {
    failure!(
        Exit::Disagrees,
        "{} holds another run than {}: their {} files differ; give the store of this run, or delete the folder \
         if it is only a worker's copy",
        store.name(),
        folder.display(),
        keys::SPEC
    )
}
