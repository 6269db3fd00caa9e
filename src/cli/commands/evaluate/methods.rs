//! Networks and folders of outputs that the command line names.

use super::EvaluateArgs;
use super::place::Place;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::{Network, is_run, trainings};
use crate::cli::output::Output;
use compose::{OutputFolder, Rules, SeedGroup, Subject, row_names};
use plan::{check_training_name, name_without_seed};
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use train::{SHIPPED, ScoredOutputs};

/// Named networks and outputs, in the order of their rows.
pub(super) struct Methods {
    pub(super) networks: Vec<NamedNetwork>,
    pub(super) outputs: Vec<(ScoredOutputs, OutputFolder)>,
}

/// A network and its row.
pub(super) struct NamedNetwork {
    pub(super) row: String,
    /// Name that it shares with other seeds of the same training.
    of_seeds: String,
    pub(super) network: Network,
}

impl Methods {
    /// Opens the networks and folders.
    pub(super) fn open(
        args: &EvaluateArgs,
        subject: &dyn Subject,
        output: &Output,
    ) -> Result<Self, Failure> {
        let mut outputs = Vec::new();
        for typed in &args.outputs {
            let Some((name, folder)) = named(typed) else {
                let typed = typed.display();
                return Err(failure!(
                    Exit::Usage,
                    "--outputs {typed} has no name; give --outputs NAME={typed}"
                ));
            };
            let of_folder = OutputFolder::open(folder, subject)
                .map_err(|e| Failure::new(Exit::InvalidInput, e))?;
            let scored = ScoredOutputs { method: name.to_owned(), path: folder.to_owned() };
            outputs.push((scored, of_folder));
        }
        Ok(Self { networks: networks(args, output)?, outputs })
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        let networks = self.networks.iter().map(|named| named.row.as_str());
        let means = self.seed_names().into_iter();
        networks.chain(means).chain(self.outputs.iter().map(|(outputs, _)| outputs.method.as_str()))
    }

    /// Lists the names that several networks share.
    fn seed_names(&self) -> Vec<&str> {
        let names = || self.networks.iter().map(|named| named.of_seeds.as_str());
        let mut shared: Vec<&str> = Vec::new();
        for name in names() {
            if names().filter(|other| *other == name).count() > 1 && !shared.contains(&name) {
                shared.push(name);
            }
        }
        shared
    }

    /// Groups the networks that share a name.
    pub(super) fn seeds(&self) -> Vec<SeedGroup> {
        let group = |name: &str| {
            let members = self.networks.iter().filter(|named| named.of_seeds == name);
            let members = members.map(|named| named.row.clone()).collect();
            SeedGroup { method: name.to_owned(), members }
        };
        self.seed_names().into_iter().map(group).collect()
    }

    /// Fails unless the names of all rows are unique.
    pub(super) fn check_names(&self, rules: &Rules) -> Result<(), Failure> {
        let mut taken = row_names(rules);
        for name in self.names() {
            if name.is_empty() || taken.iter().any(|other| other == name) {
                return Err(failure!(
                    Exit::Usage,
                    "two rows would be called {name:?}; give each its own name with --checkpoint NAME=FOLDER or --outputs NAME=DIR"
                ));
            }
            taken.push(name.to_owned());
        }
        Ok(())
    }
}

/// Splits `NAME=FOLDER`. The folder may have any name.
fn named(typed: &Path) -> Option<(&str, &Path)> {
    let bytes = typed.as_os_str().as_bytes();
    let (name, folder) = bytes.split_at(bytes.iter().position(|&byte| byte == b'=')?);
    Some((std::str::from_utf8(name).ok()?, Path::new(OsStr::from_bytes(&folder[1..]))))
}

/// Opens the networks to score: the named ones, or all of a run.
fn networks(args: &EvaluateArgs, output: &Output) -> Result<Vec<NamedNetwork>, Failure> {
    let mut places: Vec<(Option<&str>, PathBuf)> = Vec::new();
    for typed in &args.checkpoints {
        // A path may contain an equals sign.
        places.push(match named(typed) {
            Some((name, path)) if !typed.exists() => (Some(name), path.to_owned()),
            _ => (None, typed.clone()),
        });
    }
    let run = Place::of_args(args).filter(|place| place.is_run).map(|place| place.folder);
    if let Some(run) = run.filter(|_| places.is_empty()) {
        if trainings(run)?.is_empty() {
            output.note(&format!(
                "the run has no SP-net, so no network is scored; `glasshouse train {} --stage separation --steps S` trains one",
                run.display()
            ));
        } else {
            places.push((None, run.to_owned()));
        }
    }
    let features = args.features.as_deref();
    let mut networks = Vec::new();
    if args.checkpoints.is_empty() && run.is_none() {
        networks.push(NamedNetwork::new(Some(SHIPPED), Network::shipped(output)?));
    }
    for (name, path) in places {
        // A run may have several trainings, which keep their own names.
        let of_run = if name.is_none() && is_run(&path) { trainings(&path)? } else { Vec::new() };
        if of_run.len() > 1 {
            for training in of_run {
                let network = Network::open(&training.folder, features, output)?;
                networks.push(NamedNetwork::new(training.name.as_deref(), network));
            }
        } else {
            let network = Network::open(&path, features, output)?;
            let of_path = name.map(str::to_owned).or_else(|| training_name(&path));
            networks.push(NamedNetwork::new(of_path.as_deref(), network));
        }
    }
    let names: Vec<String> = networks.iter().map(|named| named.row.clone()).collect();
    for named in &mut networks {
        named.network.check_tile_px(args.tile_px)?;
        if names.iter().filter(|name| **name == named.row).count() > 1 {
            named.row = format!("{} seed {}", named.row, named.network.state.settings.seed);
        }
    }
    Ok(networks)
}

/// Returns the name of the training whose folder this is, from the path `.../train/NAME`.
fn training_name(folder: &Path) -> Option<String> {
    let is_training = folder.parent()?.file_name()? == "train";
    let name = folder.file_name()?.to_str()?;
    (is_training && check_training_name(name).is_ok()).then(|| name.to_owned())
}

impl NamedNetwork {
    fn new(name: Option<&str>, network: Network) -> Self {
        let seed = network.state.settings.seed;
        let of_seeds = name.map(|name| name_without_seed(name, seed).unwrap_or(name));
        Self { row: network.row_name(name), of_seeds: network.row_name(of_seeds), network }
    }
}
