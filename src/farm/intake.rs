//! The thread that takes spans from the queue and reads their scenes' files ahead of the hands.

use super::queue::{Delivery, Taken};
use super::shared::Shared;
use super::suspect::Examined;
use crate::run::events::{Event, Stopwatch};
use crate::run::keys;
use crate::store::StoreError;
use crossbeam::channel::Sender;
use render::line::SceneLine;
use render::scene::{LoadError, SceneFiles, read_files_by};
use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// A span and its scene's files.
pub(super) struct Loaded<'a> {
    pub(super) line: &'a SceneLine,
    pub(super) delivery: Delivery,
    pub(super) files: Result<SceneFiles, LoadError>,
}

/// How long one call waits for a span; a stop is noticed in between.
const WAIT: Duration = Duration::from_millis(500);
/// Between two looks whether another span is needed.
const PAUSE: Duration = Duration::from_millis(5);
/// Between two calls that do not wait.
const AGAIN: Duration = Duration::from_millis(50);
/// Between two looks whether a pause is over.
const HOLD: Duration = Duration::from_millis(50);
/// Between two looks whether the run is over, when there is nothing to do.
const LOOK: Duration = Duration::from_secs(1);
/// Between two complaints about a queue that is away.
const COMPLAIN: Duration = Duration::from_secs(30);

impl<'a> Shared<'a> {
    /// Takes spans until the queue ends, the run is over or work must stop.
    pub(super) fn take_in(&self, sender: &Sender<Loaded<'a>>) {
        let (mut looked, mut complained) = (Instant::now(), None::<Instant>);
        let mut hungry_since = None;
        while !self.must_stop() {
            let idle = sender.is_empty() && self.is_idle();
            if self.beside.is_some() && self.held.has_enough(self.ahead(), self.costs()) {
                std::thread::sleep(PAUSE);
                continue;
            }
            match self.take(self.wait(idle, hungry_since)) {
                Taken::Span(delivery) => {
                    self.hungry.store(false, Ordering::Release);
                    (complained, hungry_since) = (None, None);
                    if !self.pass_on(sender, delivery) {
                        return;
                    }
                    continue;
                }
                Taken::Nothing => {
                    complained = None;
                    self.hungry.store(idle, Ordering::Release);
                    hungry_since = idle.then(|| hungry_since.unwrap_or_else(Instant::now));
                    if self.beside.is_some() {
                        self.pause_before_looking(idle);
                    }
                }
                Taken::Ended => return,
                Taken::Lost(reason) => {
                    self.hungry.store(false, Ordering::Release);
                    if self.is_run_over() {
                        return;
                    }
                    if complained.is_none_or(|at| at.elapsed() > COMPLAIN) {
                        complained = Some(Instant::now());
                        (self.on_event)(Event::QueueLost { reason });
                    }
                }
            }
            if self.beside.is_some() && looked.elapsed() > LOOK {
                looked = Instant::now();
                if self.is_run_over() {
                    return;
                }
            }
        }
    }

    /// How long to wait at the queue for a span.
    ///
    /// Who still has work does not wait there: what is given for somebody idle would go there. Nor does who is slower than
    /// others: it would get what was given for those, and be the last. All others who are idle wait there all the time, and
    /// ask beside it; but the first times not for long, until they know how fast others are.
    fn wait(&self, idle: bool, hungry_since: Option<Instant>) -> Duration {
        match hungry_since {
            _ if self.beside.is_none() => WAIT,
            Some(since) if idle && !self.is_slower() => since.elapsed().clamp(AGAIN, WAIT),
            _ => Duration::ZERO,
        }
    }

    fn is_slower(&self) -> bool {
        self.slowness().is_some_and(|times| times > 1.0)
    }

    /// After a look at an empty queue. Who waits there looks again at once; who is slower looks when it was promised
    /// something, and now and then.
    fn pause_before_looking(&self, idle: bool) {
        if !idle {
            std::thread::sleep(AGAIN);
        } else if self.is_slower() {
            let since = Instant::now();
            while since.elapsed() < WAIT
                && !self.promised.swap(false, Ordering::AcqRel)
                && !self.must_stop()
            {
                std::thread::sleep(PAUSE);
            }
        }
    }

    /// As its coordinator says. A store that is away says nothing.
    fn is_run_over(&self) -> bool {
        let store = self.store.with_patience(Duration::ZERO);
        matches!(store.get(keys::FINISHED), Ok(Some(_)))
    }

    /// The next span; while the run is paused none that another worker could have later.
    fn take(&self, wait: Duration) -> Taken {
        if self.beside.is_none() || !self.control.is_paused() {
            return self.queue.take(wait);
        }
        std::thread::sleep(HOLD);
        Taken::Nothing
    }

    /// Looks at a span, reads its files and passes them on. False: nobody takes them any more.
    fn pass_on(&self, sender: &Sender<Loaded<'a>>, delivery: Delivery) -> bool {
        let run: &'a _ = self.run;
        let line = &run.lines[delivery.waiting.span.scene as usize];
        self.held.add(&delivery);
        let told = match self.examine(line, &delivery) {
            Ok(Examined::Over) => {
                self.let_go(delivery.ticket);
                Ok(())
            }
            Ok(suspect) => match self.read(line) {
                Err(error) => Err(error.into()),
                Ok(Err(error)) if self.may_be_mine(&error) => {
                    self.could_not_read(line, &delivery, &error.to_string())
                }
                Ok(Ok(_)) if matches!(suspect, Examined::Suspect) => self.isolate(line, &delivery),
                Ok(files) => return self.send(sender, line, delivery, files),
            },
            Err(error) => Err(error),
        };
        match told {
            Ok(()) => true,
            Err(error) => {
                self.break_down(error);
                false
            }
        }
    }

    /// A store that is away or closed is an error of this worker's, and no fault of the scene.
    fn read(&self, line: &SceneLine) -> Result<Result<SceneFiles, LoadError>, StoreError> {
        let start = Stopwatch::start();
        let open = |path: &Path| self.run.inputs.read(path);
        let files = read_files_by(line, &self.run.roots, self.run.dir.root(), &open);
        self.seconds.add_read(start.spent());
        match files {
            Ok(files) => Ok(Ok(files)),
            Err(error) => without_store(error).map(Err),
        }
    }

    /// Another machine may be able to read what this one cannot.
    fn may_be_mine(&self, error: &LoadError) -> bool {
        self.beside.is_some_and(|shared| !shared.is_child)
            && matches!(error, LoadError::Read { .. } | LoadError::Root(_))
    }

    fn send(
        &self,
        sender: &Sender<Loaded<'a>>,
        line: &'a SceneLine,
        delivery: Delivery,
        files: Result<SceneFiles, LoadError>,
    ) -> bool {
        let mut message = Loaded {
            line,
            delivery,
            files,
        };
        loop {
            if self.must_stop() {
                return false;
            }
            match sender.send_timeout(message, Duration::from_millis(50)) {
                Ok(()) => return true,
                Err(error) if error.is_disconnected() => return false,
                Err(error) => message = error.into_inner(),
            }
        }
    }
}

/// The error of a file, unless it is that of a store.
fn without_store(error: LoadError) -> Result<LoadError, StoreError> {
    match error {
        LoadError::Read { path, source } => match source.downcast::<StoreError>() {
            Ok(error) => Err(error),
            Err(source) => Ok(LoadError::Read { path, source }),
        },
        error => Ok(error),
    }
}
