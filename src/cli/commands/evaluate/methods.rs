//! Networks and folders of outputs that the command line names.

use super::EvaluateArgs;
use super::place::Place;
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::network::Network;
use crate::cli::output::Output;
use compose::{OutputFolder, Rules, Subject, row_names};
use plan::Stage;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use train::{ScoredOutputs, stage_folder, steps};

/// Named networks and outputs, in the order of their rows.
pub(super) struct Methods {
    pub(super) networks: Vec<(String, Network)>,
    pub(super) outputs: Vec<(ScoredOutputs, OutputFolder)>,
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
        let networks = self.networks.iter().map(|(name, _)| name.as_str());
        networks.chain(self.outputs.iter().map(|(outputs, _)| outputs.method.as_str()))
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

/// Opens the networks to score: the named ones, or the SP-net of a run.
fn networks(args: &EvaluateArgs, output: &Output) -> Result<Vec<(String, Network)>, Failure> {
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
        let stage = stage_folder(run, Stage::Separation);
        let trained = steps(&stage)
            .map_err(|e| failure!(Exit::Failed, "cannot list {}: {e}", stage.display()))?;
        if trained.is_empty() {
            output.note(&format!(
                "the run has no SP-net, so no network is scored; `glasshouse train {} --stage separation --steps S` trains one",
                run.display()
            ));
        } else {
            places.push((None, run.to_owned()));
        }
    }
    let open = |(name, path): (Option<&str>, PathBuf)| {
        let network = Network::open(&path, args.features.as_deref(), output)?;
        Ok((network.row_name(name), network))
    };
    places.into_iter().map(open).collect()
}
