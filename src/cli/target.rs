//! The run that a command is about, and where its objects are.

use super::exit_code::{Exit, Failure};
use super::store_env::{inputs, store_options};
use crate::run::{Run, keys};
use crate::store::Store;
use render::line::Roots;
use std::path::Path;

/// Opens a run and its store: the folder itself, or `address`.
pub(super) fn open(
    folder: &Path,
    address: Option<&str>,
    roots: &Roots,
) -> Result<(Run, Store), Failure> {
    let elsewhere = match address {
        Some(address) => {
            let store = Store::open(address, &store_options())?;
            fetch(folder, &store)?;
            Some(store)
        }
        None => None,
    };
    let mut run = Run::open(folder, roots)?;
    run.inputs = inputs();
    // Opening a store makes its folder: not before there is a run in it.
    let store = elsewhere.map_or_else(|| Store::local(folder), Ok)?;
    if address.is_some() {
        check(&run, &store)?;
    }
    Ok((run, store))
}

/// Brings the run's rules to a machine that has only the store.
pub(super) fn fetch(folder: &Path, store: &Store) -> Result<(), Failure> {
    if folder.join(keys::SPEC).exists() {
        return Ok(());
    }
    render::atomic_file::create_dir(folder)?;
    for key in [keys::MANIFEST, keys::SPEC] {
        let bytes = store.get(key)?.ok_or_else(|| {
            let error = anyhow::anyhow!(
                "{} holds no run yet (no {key}); start `glasshouse coordinate RUN --store …` first, then try again",
                store.name()
            );
            Failure::new(Exit::TryAgain, error)
        })?;
        render::atomic_file::write(&folder.join(key), &bytes)?;
    }
    Ok(())
}

/// The store's objects are of this run. One without a spec is empty yet.
fn check(run: &Run, store: &Store) -> Result<(), Failure> {
    let (Some(there), Ok(here)) = (store.get(keys::SPEC)?, std::fs::read(run.path(keys::SPEC)))
    else {
        return Ok(());
    };
    if there == here {
        return Ok(());
    }
    let error = anyhow::anyhow!(
        "{} holds another run than {}: their {} differ; give the store of this run",
        store.name(),
        run.root().display(),
        keys::SPEC
    );
    Err(Failure::new(Exit::Disagrees, error))
}
