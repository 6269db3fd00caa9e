//! Misbehaviour on order, to rehearse and to test what a farm does when a worker misbehaves.

use crate::ids::SceneId;
use crate::trace::TileResult;
use std::str::FromStr;
use std::time::Duration;

/// How a worker misbehaves.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// The process aborts when it traces this scene.
    Abort(SceneId),
    /// Tracing this scene never ends.
    Hang(SceneId),
    /// Everything takes so many times as long.
    Slow(f64),
    /// One value of a pixel in each piece of this scene is wrong.
    Wrong(SceneId),
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let invalid = || {
            format!("{text:?} is no fault: use abort:SCENE, hang:SCENE, wrong:SCENE or slow:FACTOR")
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
            _ => Err(invalid()),
        }
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Abort(scene) => write!(f, "abort:{scene}"),
            Self::Hang(scene) => write!(f, "hang:{scene}"),
            Self::Slow(factor) => write!(f, "slow:{factor}"),
            Self::Wrong(scene) => write!(f, "wrong:{scene}"),
        }
    }
}

impl Fault {
    /// Before a piece of `scene` is traced.
    #[allow(
        clippy::print_stderr,
        reason = "last words of a process, as the allocator's are"
    )]
    pub(super) fn before(&self, scene: &SceneId) {
        match self {
            Self::Abort(poison) if poison == scene => {
                eprintln!("scene {scene} aborts this process, as ordered");
                std::process::abort();
            }
            Self::Hang(poison) if poison == scene => loop {
                std::thread::sleep(Duration::from_hours(1));
            },
            _ => {}
        }
    }

    /// After a piece was traced in `took`.
    pub(super) fn after(&self, scene: &SceneId, took: Duration, result: Option<&mut TileResult>) {
        match self {
            Self::Slow(factor) => std::thread::sleep(took.mul_f64(factor - 1.0)),
            Self::Wrong(wrong) if wrong == scene => {
                if let Some(pixel) = result.and_then(|result| result.pixels.first_mut()) {
                    pixel.mean[0][0] += 0.25;
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_as_text() {
        for text in ["abort:train-00000", "hang:a", "wrong:a", "slow:4"] {
            assert_eq!(text.parse::<Fault>().unwrap().to_string(), text);
        }
        for text in ["abort", "slow:0.5", "slow:NaN", "abort:../x", "wobble:a"] {
            assert!(text.parse::<Fault>().is_err(), "{text}");
        }
    }
}
