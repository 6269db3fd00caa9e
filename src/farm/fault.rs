//! Deliberate faults and costs of a worker, to test a farm's recovery and to measure a farm.

use super::simulate as sim;
use crate::run::Event;
use glasshouse_line::ids::SceneId;
use render::trace::TileResult;
use std::str::FromStr;
use std::time::Duration;

#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// The process aborts when it traces this scene.
    Abort(SceneId),
    /// Tracing this scene never ends.
    Hang(SceneId),
    /// Loading and tracing take this many times as long.
    Slow(f64),
    /// One value of a pixel in each shard of this scene is wrong.
    Wrong(SceneId),
    /// Loading and tracing also sleep for the time that they take in a simulated farm.
    Cost(sim::Work),
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let invalid = || {
            format!(
                "{text:?} is not a fault: use abort:SCENE, hang:SCENE, wrong:SCENE, slow:FACTOR or \
                 cost:SCENES,SHARDS,SHARD_S,DOUBLINGS,DEAREST_LAST,LOAD_S,SEED"
            )
        };
        let (kind, of) = text.split_once(':').ok_or_else(invalid)?;
        let scene = || SceneId::new(of).map_err(|e| e.to_string());
        match kind {
            "abort" => Ok(Self::Abort(scene()?)),
            "hang" => Ok(Self::Hang(scene()?)),
            "wrong" => Ok(Self::Wrong(scene()?)),
            "slow" => match of.parse() {
                Ok(factor) if (1.0..=1e6).contains(&factor) => Ok(Self::Slow(factor)),
                _ => Err(invalid()),
            },
            "cost" => cost(of).map(Self::Cost).ok_or_else(invalid),
            _ => Err(invalid()),
        }
    }
}

fn cost(text: &str) -> Option<sim::Work> {
    let fields: Vec<&str> = text.split(',').collect();
    let [scenes, shards, shard_s, doublings, last, load_s, seed] = fields.try_into().ok()?;
    let seconds = |text: &str| {
        let s = text.parse().ok();
        s.filter(|s: &f64| (0.0..=1e6).contains(s))
    };
    Some(sim::Work {
        scenes: scenes.parse().ok()?,
        shards: shards.parse().ok()?,
        cheapest_shard_s: seconds(shard_s)?,
        doublings: doublings.parse().ok().filter(|d| *d <= 10)?,
        dearest_last: last.parse().ok()?,
        load_s: seconds(load_s)?,
        seed: seed.parse().ok()?,
    })
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Abort(scene) => write!(f, "abort:{scene}"),
            Self::Hang(scene) => write!(f, "hang:{scene}"),
            Self::Slow(factor) => write!(f, "slow:{factor}"),
            Self::Wrong(scene) => write!(f, "wrong:{scene}"),
            Self::Cost(work) => {
                let sim::Work { scenes, shards, cheapest_shard_s, doublings, .. } = work;
                let sim::Work { dearest_last, load_s, seed, .. } = work;
                write!(f, "cost:{scenes},{shards},{cheapest_shard_s},{doublings},")?;
                write!(f, "{dearest_last},{load_s},{seed}")
            }
        }
    }
}

impl Fault {
    /// Injects an abort or a hang before a band of `scene` is traced.
    pub(super) fn before(&self, scene: &SceneId, on_event: &dyn Fn(Event)) {
        match self {
            Self::Abort(poison) if poison == scene => {
                on_event(Event::Aborts { scene: scene.clone() });
                std::process::abort();
            }
            Self::Hang(poison) if poison == scene => loop {
                std::thread::sleep(Duration::from_hours(1));
            },
            _ => {}
        }
    }

    /// Injects a wrong value into the result of a shard of `scene`. Before the shard's last band, `result` is `None`.
    pub(super) fn after(&self, scene: &SceneId, result: Option<&mut TileResult>) {
        if let Self::Wrong(wrong) = self
            && wrong == scene
            && let Some(pixel) = result.and_then(|result| result.pixels.first_mut())
        {
            pixel.mean[0][0] += 0.25;
        }
    }

    /// Injects one band's part of a shard's cost; the shard has `bands` bands, and `scene` is an index in the manifest.
    pub(super) fn after_band(&self, scene: u32, shard: u32, bands: u32) {
        if let Self::Cost(work) = self {
            let whole = Duration::from_micros(work.shard_us(scene, shard));
            std::thread::sleep(whole / bands.max(1));
        }
    }

    /// Injects the cost of a load after a scene was loaded.
    pub(super) fn after_load(&self) {
        if let Self::Cost(work) = self {
            std::thread::sleep(Duration::from_secs_f64(work.load_s));
        }
    }

    /// Slows down a load or a band. `took` is its time so far, including the sleeps of other faults.
    pub(super) fn slow_down(&self, took: Duration) {
        if let Self::Slow(factor) = self {
            std::thread::sleep(took.mul_f64(factor - 1.0));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_parsed_and_printed() {
        let cost = "cost:50,16,0.02,4,3,0.2,0";
        assert_eq!(cost.parse(), Ok(Fault::Cost(sim::Work::default())));
        for text in ["abort:train-00000", "hang:a", "wrong:a", "slow:4", cost] {
            assert_eq!(text.parse::<Fault>().unwrap().to_string(), text);
        }
        let wrong = [
            "abort",
            "slow:0.5",
            "slow:NaN",
            "abort:../x",
            "wobble:a",
            "cost:1,2",
            "cost:1,1,-1,0,0,0,0",
        ];
        for text in wrong {
            assert!(text.parse::<Fault>().is_err(), "{text}");
        }
    }
}
