//! What can be typed after `bench farm`.

use clap::Args as ClapArgs;

/// `bench farm`
#[derive(Debug, ClapArgs)]
pub struct BenchFarmArgs {
    /// In virtual time, without servers and tracer
    #[arg(long)]
    pub simulate: bool,
    /// Real workers, tasks that sleep: makespan over its lower bound, without faults and with one worker killed and one
    /// four times slower
    #[arg(long, conflicts_with_all = ["simulate", "resume"])]
    pub makespan: bool,
    /// Until a run of 320,000 shards that was left in the middle goes on
    #[arg(long, conflicts_with = "simulate")]
    pub resume: bool,
    /// NATS server to measure with [default: one that is started for it, if nats-server is installed]
    #[arg(long, value_name = "URL", conflicts_with = "simulate")]
    pub queue: Option<String>,
    /// --makespan, --resume: measure so often
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub passes: u32,

    /// Workers; each does one thing at a time. Real ones are doubled from 1 to this number
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub workers: u32,
    /// Scenes [default: 50; 5000 with --resume, 16 without any mode]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub scenes: Option<u32>,
    /// Shards a scene [default: 16; 64 with --resume and without any mode]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub shards: Option<u32>,
    /// Draws the costs, the jitter, who gives; 0 has the costs of the prototype that was measured on a real queue
    #[arg(long, value_name = "K", default_value_t = 0)]
    pub seed: u64,
    /// A shard of the cheapest scenes, seconds (25 % more or less); the dearest cost sixteen times as much
    #[arg(long, value_name = "S", default_value_t = 0.02, value_parser = parse_seconds)]
    pub shard_s: f64,
    /// Loading a scene, seconds
    #[arg(long, value_name = "S", default_value_t = 0.2, value_parser = parse_seconds)]
    pub load_s: f64,

    /// Lease of a span, seconds; renewed every third of it [default: 30; 2 with --makespan]
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub lease_s: Option<f64>,
    /// From a worker to the queue and back, milliseconds
    #[arg(long, value_name = "MS", default_value_t = 1.0, value_parser = parse_seconds)]
    pub round_trip_ms: f64,
    /// The coordinator lists the store at least so often, seconds
    #[arg(long, value_name = "S", default_value_t = 600.0, value_parser = parse_seconds)]
    pub reconcile_s: f64,

    /// Kill a worker at a second (0@3.1), or a share of them at times spread over the bound (5%); repeatable
    #[arg(long, value_name = "W@S|N%", value_parser = parse_kill)]
    pub kill: Vec<Kill>,
    /// Make a worker, or a share of them, so many times slower (1x4, 10%x4); repeatable
    #[arg(long, value_name = "WxF|N%xF", value_parser = parse_slow)]
    pub slow: Vec<Slow>,
    /// Stop a worker at a second for so many seconds, as SIGSTOP and SIGCONT do (2@5+60), or a share of them (1%+60); repeatable
    #[arg(long, value_name = "W@S+S|N%+S", value_parser = parse_stop)]
    pub stop: Vec<Stop>,
    /// The queue forgets everything at that second; repeatable
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    pub wipe: Vec<f64>,
    /// The queue's server is away from a second on for so many seconds (20+60); repeatable
    #[arg(long, value_name = "S+S", value_parser = parse_away)]
    pub away: Vec<(f64, f64)>,
}

/// A worker's number, or a share of all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Which {
    /// The number.
    One(u32),
    /// 0..=1.
    Share(f64),
}

/// `--kill`; a share has its times drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kill {
    /// Whom.
    pub which: Which,
    /// When.
    pub at_s: Option<f64>,
}

/// `--slow`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slow {
    /// Whom.
    pub which: Which,
    /// How much.
    pub times: f64,
}

/// `--stop`; a share has its times drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Whom.
    pub which: Which,
    /// When.
    pub at_s: Option<f64>,
    /// For how long.
    pub for_s: f64,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|s: &f64| (0.0..=1e7).contains(s))
        .ok_or_else(|| format!("{text:?} is not a number from 0 to ten million"))
}

fn parse_which(text: &str) -> Result<Which, String> {
    if let Some(percent) = text.strip_suffix('%') {
        let percent = parse_seconds(percent)?;
        if percent > 100.0 {
            return Err(format!("{text} is more than all workers"));
        }
        return Ok(Which::Share(percent / 100.0));
    }
    text.parse()
        .map(Which::One)
        .map_err(|_| format!("{text:?} is neither a worker's number, from 0, nor a share like 5%"))
}

/// A worker needs a time, a share must not have one.
fn parse_which_at(text: &str) -> Result<(Which, Option<f64>), String> {
    match text.split_once('@') {
        Some((which, at)) => match parse_which(which)? {
            Which::Share(_) => Err("the times of a share are drawn: write N% alone".to_owned()),
            one @ Which::One(_) => Ok((one, Some(parse_seconds(at)?))),
        },
        None => match parse_which(text)? {
            Which::One(_) => Err(format!("when? write {text}@SECOND")),
            share @ Which::Share(_) => Ok((share, None)),
        },
    }
}

fn parse_kill(text: &str) -> Result<Kill, String> {
    let (which, at_s) = parse_which_at(text)?;
    Ok(Kill { which, at_s })
}

fn parse_slow(text: &str) -> Result<Slow, String> {
    let (which, times) = text
        .split_once('x')
        .ok_or("how much slower? write WORKERxTIMES, like 1x4")?;
    let times = parse_seconds(times)?;
    if times < 1.0 {
        return Err("1 or more times slower".to_owned());
    }
    Ok(Slow {
        which: parse_which(which)?,
        times,
    })
}

fn parse_stop(text: &str) -> Result<Stop, String> {
    let (which, for_s) = text
        .rsplit_once('+')
        .ok_or("for how long? write WORKER@SECOND+SECONDS, like 2@5+60")?;
    let (which, at_s) = parse_which_at(which)?;
    Ok(Stop {
        which,
        at_s,
        for_s: parse_seconds(for_s)?,
    })
}

fn parse_away(text: &str) -> Result<(f64, f64), String> {
    let (at, how_long) = text
        .split_once('+')
        .ok_or("for how long? write SECOND+SECONDS, like 20+60")?;
    Ok((parse_seconds(at)?, parse_seconds(how_long)?))
}
