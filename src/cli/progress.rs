//! Progress: bars on a terminal, a plain line at most every ten seconds elsewhere.

use super::args::{Global, ProgressHow};
use super::output::Output;
use crate::bench::farm::{SCENE_LOADED, WORK_BEGINS, Watcher};
use crate::run::{ControlState, Event};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Shortest time between plain lines.
const PLAIN_EVERY: Duration = Duration::from_secs(10);

pub(super) struct Progress {
    bar: Option<ProgressBar>,
    plain: Option<Mutex<Instant>>,
    what: &'static str,
    length: AtomicU64,
    done: AtomicU64,
    /// Number of units in `done` that existed before the start.
    free: AtomicU64,
    start: Instant,
    /// Scenes with photographs that do not fill the view.
    narrow: Mutex<Vec<NarrowScene>>,
}

/// A scene with a photograph that does not fill the view.
struct NarrowScene {
    /// Largest share of a layer's paths that miss the photograph.
    miss_share: f64,
    id: String,
    /// True if the intrinsics of a photograph are probably wrong.
    has_odd_view: bool,
}

/// Largest share of a layer's paths that may miss the photograph without a note.
const NARROW_SHARE: f64 = 0.1;

impl Progress {
    /// Starts a progress display of `length` units (`what`: shards, photographs, ...).
    pub(super) fn new(global: &Global, what: &'static str, length: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let how = match global.progress {
            _ if global.quiet => ProgressHow::None,
            ProgressHow::Auto if terminal => ProgressHow::Bar,
            ProgressHow::Auto => ProgressHow::Plain,
            how => how,
        };
        let bar = (how == ProgressHow::Bar).then(|| {
            let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
            let template = "{prefix:>11} [{bar:32}] {pos}/{len} {per_sec} ETA {eta} {wide_msg}";
            let style = ProgressStyle::with_template(template)
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.set_style(style.progress_chars("=> "));
            bar.set_prefix(what);
            bar.enable_steady_tick(Duration::from_millis(250));
            bar
        });
        let plain = (how == ProgressHow::Plain).then(|| Mutex::new(Instant::now()));
        Self {
            bar,
            plain,
            what,
            length: AtomicU64::new(length),
            done: AtomicU64::new(0),
            free: AtomicU64::new(0),
            start: Instant::now(),
            narrow: Mutex::new(Vec::new()),
        }
    }

    pub(super) fn set_length(&self, length: u64) {
        self.length.store(length, Ordering::Relaxed);
        if let Some(bar) = &self.bar {
            bar.set_length(length);
        }
    }

    /// Counts `count` finished units. If `free`, they existed before and do not count for the rate in plain lines.
    pub(super) fn add(&self, count: u64, free: bool) {
        self.done.fetch_add(count, Ordering::Relaxed);
        if free {
            self.free.fetch_add(count, Ordering::Relaxed);
        }
        if let Some(bar) = &self.bar {
            bar.inc(count);
        }
        if let Some(last) = &self.plain {
            let mut last = last.lock().expect("no holder of this lock panics");
            if last.elapsed() >= PLAIN_EVERY {
                *last = Instant::now();
                self.plain_line();
            }
        }
    }

    pub(super) fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    fn plain_line(&self) {
        let (done, length) =
            (self.done.load(Ordering::Relaxed), self.length.load(Ordering::Relaxed));
        let worked = done.saturating_sub(self.free.load(Ordering::Relaxed));
        let rate = worked as f64 / self.start.elapsed().as_secs_f64();
        let left = length.saturating_sub(done) as f64 / rate.max(1e-9);
        let _ = writeln!(
            std::io::stderr(),
            "{}: {done}/{length}, {rate:.2}/s, ETA {:.0} s",
            self.what,
            left
        );
    }

    pub(super) fn message(&self, text: String) {
        if let Some(bar) = &self.bar {
            bar.set_message(text);
        }
    }

    /// Calls `print` while the bar is hidden.
    pub(super) fn suspend(&self, print: impl FnOnce()) {
        match &self.bar {
            Some(bar) => bar.suspend(print),
            None => print(),
        }
    }

    /// Prints a note about scenes with views that exceed their photographs.
    pub(super) fn note_narrow_scenes(&self, output: &Output) {
        let narrow = self.narrow.lock().expect("no holder of this lock panics");
        let causes = [
            (
                true,
                "the intrinsics of a photograph are probably not its own: correct them, or their \"size\" (`glasshouse inspect` \
                 of the scene's tuple names them)",
            ),
            (false, "a longer focal length, less tilt or apex \"mirror\" keeps more paths on it"),
        ];
        for (has_odd_view, remedy) in causes {
            let scenes = narrow.iter().filter(|scene| scene.has_odd_view == has_odd_view);
            let worst = scenes.clone().max_by(|a, b| a.miss_share.total_cmp(&b.miss_share));
            if let Some(NarrowScene { miss_share, id, .. }) = worst {
                output.note(&format!(
                    "in {} scenes, over {:.0} % of a layer's paths miss the photograph (worst: {id}, {:.0} %); {remedy}",
                    scenes.count(),
                    NARROW_SHARE * 100.0,
                    miss_share * 100.0,
                ));
            }
        }
    }

    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    pub(super) fn event(&self, event: Event, output: &Output) {
        let note = |text: &str| self.suspend(|| output.note(text));
        let warning = |text: &str| self.suspend(|| output.warning(text));
        let verbose = |text: &str| {
            if output.verbose {
                note(text);
            }
        };
        match event {
            Event::Started { shards, scenes } => {
                self.set_length(shards);
                verbose(&format!("{WORK_BEGINS}{scenes} scenes"));
            }
            Event::SceneOpened { scene } => verbose(&format!("scene {scene}{SCENE_LOADED}")),
            Event::ShardDone { resumed } => self.add(1, resumed),
            Event::PartialRejected { reason } => verbose(&reason),
            Event::QueueLost { reason } => note(&format!("waiting for the queue: {reason}")),
            Event::MessageRemoved { reason } => warning(&format!(
                "removed from the queue: {reason}; the coordinator publishes its scene again; see `A stolen key` in docs/farming.md"
            )),
            Event::SceneStalled { scene, for_s } => note(&format!(
                "scene {scene} made no progress for {for_s} s although the queue has messages of it: published again"
            )),
            Event::StoreLost { reason } => note(&format!("waiting for the store: {reason}")),
            Event::Controlled { state, reason } => {
                let reason = reason.map_or_else(String::new, |reason| format!(" ({reason})"));
                match state {
                    ControlState::Running => note("the run was resumed"),
                    ControlState::Paused => warning(&format!(
                        "the run is paused{reason}: workers finish their open scenes and start no others until `glasshouse resume RUN`"
                    )),
                    ControlState::Cancelled => warning(&format!(
                        "the run is cancelled{reason}: ending after the shards in flight; `glasshouse resume RUN` undoes the cancel"
                    )),
                }
            }
            Event::SceneMerged { scene, miss_share, has_odd_view } => {
                self.message(format!("{scene} merged"));
                if miss_share > NARROW_SHARE {
                    let mut narrow = self.narrow.lock().expect("no holder of this lock panics");
                    narrow.push(NarrowScene { miss_share, id: scene.to_string(), has_odd_view });
                }
            }
            Event::Sandboxed { scene } => note(&format!(
                "scene {scene} was lost with an earlier process: a child process traces it"
            )),
            Event::Aborts { scene } => {
                warning(&format!("scene {scene} aborts this process because of --fault"));
            }
            Event::ChildLost { scene, reason } => {
                warning(&format!("scene {scene} was lost with its process: {reason}"));
            }
            Event::Drained { reason } => warning(&reason),
            Event::SceneQuarantined { scene, reason, shards } => {
                self.set_length(self.length.load(Ordering::Relaxed).saturating_sub(shards));
                warning(&format!("scene {scene} is in quarantine: {reason}"));
            }
        }
    }
}

impl Watcher for Progress {
    fn starts(&self, parts: u64) {
        self.set_length(parts);
    }

    fn measures(&self, what: &str) {
        self.message(what.to_owned());
    }

    fn part_is_done(&self) {
        self.add(1, false);
    }
}
