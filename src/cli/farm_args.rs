//! What can be typed after the commands that look at a run, or tell it something, wherever it is made.

use super::args::{FARM, RootArgs, parse_duration};
use clap::Args as ClapArgs;
use render::ids::SceneId;
use std::path::PathBuf;
use std::time::Duration;

/// Where a run's objects are.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub struct StoreArgs {
    /// Where the run's objects are, if not in the run's folder: a folder, or s3://BUCKET/PREFIX; spec and manifest are fetched from there if RUN lacks them
    #[arg(long, value_name = "URL", env = "GLASSHOUSE_STORE")]
    pub store: Option<String>,
}

/// A queue that is only looked at.
#[derive(Clone, Debug, ClapArgs)]
#[command(next_help_heading = FARM)]
pub struct ServerArgs {
    /// NATS server, to show how full the queue is: nats://host:4222, tls://host:4222, several with commas
    #[arg(
        long,
        value_name = "URL",
        env = "GLASSHOUSE_QUEUE",
        hide_env_values = true
    )]
    pub queue: Option<String>,
    /// File with the seed of an nkey
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_NKEY")]
    pub queue_nkey: Option<PathBuf>,
    /// File with NATS credentials, as nsc writes it
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CREDS")]
    pub queue_creds: Option<PathBuf>,
    /// File with certificates (PEM) to trust besides the system's
    #[arg(long, value_name = "FILE", env = "GLASSHOUSE_QUEUE_CA")]
    pub queue_ca: Option<PathBuf>,
}

/// `status`
#[derive(Debug, ClapArgs)]
pub struct StatusArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// Look again every S seconds [default: 2] until the run is over; with --json one object a line
    #[arg(long, value_name = "S", num_args = 0..=1, default_missing_value = "2", value_parser = parse_duration)]
    pub watch: Option<Duration>,
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
    /// The queue.
    #[command(flatten)]
    pub server: ServerArgs,
}

/// `pause`, `cancel`
#[derive(Debug, ClapArgs)]
pub struct HoldArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// Why, for who wonders; shown by workers, coordinator and status
    #[arg(long, value_name = "TEXT")]
    pub reason: Option<String>,
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
}

/// `resume`
#[derive(Debug, ClapArgs)]
pub struct ResumeArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
}

/// `retry`
#[derive(Debug, ClapArgs)]
pub struct RetryArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// Scenes to try again
    #[arg(value_name = "SCENE", value_parser = parse_scene, required_unless_present = "all")]
    pub scenes: Vec<SceneId>,
    /// All that are in quarantine
    #[arg(long, conflicts_with = "scenes")]
    pub all: bool,
    /// The scenes named, also those that are done: what was made of them is removed, and they are traced from nothing
    #[arg(long, conflicts_with = "all")]
    pub anew: bool,
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
}

/// `explain`
#[derive(Debug, ClapArgs)]
pub struct ExplainArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// A scene, or one of its shards: SCENE or SCENE:NUMBER
    #[arg(value_name = "SHARD", value_parser = parse_shard)]
    pub shard: (SceneId, Option<u32>),
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
}

/// `audit`
#[derive(Debug, ClapArgs)]
pub struct AuditArgs {
    /// Folder of the run
    pub run: PathBuf,
    /// Share of the scenes that are done, 0 to 1; at least one is traced again
    #[arg(long, value_name = "SHARE", default_value_t = 0.005, value_parser = parse_share)]
    pub share: f64,
    /// Which ones: the same seed, share and run give the same scenes [default: random, and said]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// This scene instead, repeatable; one that is not done is audited as far as it is there
    #[arg(long = "scene", value_name = "SCENE", value_parser = parse_scene, conflicts_with_all = ["share", "seed"])]
    pub scenes: Vec<SceneId>,
    /// Named roots.
    #[command(flatten)]
    pub roots: RootArgs,
    /// The store.
    #[command(flatten)]
    pub store: StoreArgs,
}

fn parse_scene(text: &str) -> Result<SceneId, String> {
    SceneId::new(text).map_err(|e| e.to_string())
}

fn parse_shard(text: &str) -> Result<(SceneId, Option<u32>), String> {
    let (scene, shard) = match text.split_once(':') {
        Some((scene, shard)) => {
            let number = shard.parse().map_err(|_| {
                format!("{shard:?} is no number of a shard: write SCENE or SCENE:NUMBER")
            })?;
            (scene, Some(number))
        }
        None => (text, None),
    };
    Ok((parse_scene(scene)?, shard))
}

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("a share is a number from 0 to 1".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shard_is_a_scene_and_a_number() {
        let scene = SceneId::new("train-1").unwrap();
        assert_eq!(parse_shard("train-1"), Ok((scene.clone(), None)));
        assert_eq!(parse_shard("train-1:12"), Ok((scene, Some(12))));
        for bad in ["", ":1", "train-1:", "train-1:x", "train-1:-1", "a b"] {
            assert!(parse_shard(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_share_is_a_share() {
        assert_eq!(parse_share("0.25"), Ok(0.25));
        for bad in ["-0.1", "1.1", "nan", "x"] {
            assert!(parse_share(bad).is_err(), "{bad}");
        }
    }
}
