//! `--split`, of commands that take some of a run's scenes.

use clap::ValueEnum;
use render::line::Split;

/// `--split`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SplitName {
    /// What no training saw.
    Test,
    /// What it was trained on.
    Train,
    /// Both.
    All,
}

impl SplitName {
    /// As it is typed.
    #[cfg(feature = "train")]
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Test => "test",
            Self::Train => "train",
            Self::All => "all",
        }
    }

    /// Whether scenes of a split are among these.
    pub(super) fn has(self, split: Split) -> bool {
        match self {
            Self::Test => split == Split::Test,
            Self::Train => split == Split::Train,
            Self::All => true,
        }
    }
}
