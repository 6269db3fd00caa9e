//! What can be typed after the commands that look at files, at the machine, and at the program itself.

use super::args::FARM;
use clap::Args as ClapArgs;
use clap_complete::Shell;
use std::path::PathBuf;

/// `inspect`
#[derive(Debug, ClapArgs)]
pub struct InspectArgs {
    /// Files that this program wrote or reads; folders of a run, a tuple, a checkpoint
    #[arg(value_name = "FILE", required = true)]
    pub files: Vec<PathBuf>,
}

/// `doctor`
#[derive(Debug, ClapArgs)]
pub struct DoctorArgs {
    /// Folder of a run, or where one shall be [default: where you are]
    pub run: Option<PathBuf>,
    /// A store to try: a folder, file:///FOLDER, or s3://BUCKET/PREFIX; one small object is put and removed
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE", help_heading = FARM)]
    pub store: Option<String>,
    /// A NATS server to try: nats://host:4222, tls://host:4222, several with commas
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_QUEUE", hide_env_values = true, help_heading = FARM)]
    pub queue: Option<String>,
    /// File with the seed of an nkey
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_NKEY", requires = "queue", help_heading = FARM)]
    pub queue_nkey: Option<PathBuf>,
    /// File with NATS credentials, as nsc writes it
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CREDS", requires = "queue", help_heading = FARM)]
    pub queue_creds: Option<PathBuf>,
    /// File with certificates (PEM) to trust besides the system's
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CA", requires = "queue", help_heading = FARM)]
    pub queue_ca: Option<PathBuf>,
}

/// `completions`
#[derive(Debug, ClapArgs)]
pub struct CompletionsArgs {
    /// Whose
    #[arg(value_enum)]
    pub shell: Shell,
}

/// `man`
#[derive(Debug, ClapArgs)]
pub struct ManArgs {
    /// Folder for a page of each command; without it the main page is printed
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
