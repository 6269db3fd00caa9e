//! Opens a command's run and the store of its objects.

use super::exit_code::{Exit, Failure, failure};
use super::store_env::{inputs, store_options};
use crate::run::{Run, keys};
use crate::store::Store;
use render::line::Roots;
use std::path::Path;

/// Opens a run and its store: `address`, or the run's folder.
pub(super) fn open(
    folder: &Path,
    address: Option<&str>,
    roots: &Roots,
) -> Result<(Run, Store), Failure> {
    let elsewhere = address.map(|address| Store::open(address, &store_options())).transpose()?;
    if let Some(store) = &elsewhere {
        fetch(folder, store)?;
    }
    let mut run = Run::open(folder, roots)?;
    run.inputs = inputs();
    if let Some(store) = &elsewhere {
        check(&run, store)?;
    }
    // Opening a local store creates its folder, so the run must be opened first.
    let store = elsewhere.map_or_else(|| Store::local(folder), Ok)?;
    Ok((run, store))
}

/// Copies the run's spec and manifest from the store into `folder`, if `folder` has no spec.
pub(super) fn fetch(folder: &Path, store: &Store) -> Result<(), Failure> {
    if folder.join(keys::SPEC).exists() {
        return Ok(());
    }
    render::atomic_file::create_dir(folder)?;
    for key in [keys::MANIFEST, keys::SPEC] {
        let bytes = store.get(key)?.ok_or_else(|| {
            failure!(
                Exit::TryAgain,
                "{} holds no run yet (no {key}); start `glasshouse coordinate RUN --store …` first, then try again",
                store.name()
            )
        })?;
        render::atomic_file::write(&folder.join(key), &bytes)?;
    }
    Ok(())
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
    Err(failure!(
        Exit::Disagrees,
        "{} holds another run than {}: their {} files differ; give the store of this run",
        store.name(),
        run.root().display(),
        keys::SPEC
    ))
}
