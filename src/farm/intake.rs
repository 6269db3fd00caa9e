//! The thread that takes spans from the queue and reads their scenes' files ahead of the hands.

use super::events::Event;
use super::keys;
use super::queue::{Delivery, Taken};
use super::suspect::Examined;
use super::work::Shared;
use crate::manifest::SceneLine;
use crate::scene::{LoadError, SceneFiles, read_files};
use crossbeam::channel::Sender;
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
/// Between two looks whether a pause is over.
const HOLD: Duration = Duration::from_millis(50);
/// Between two looks whether the run is over, when there is nothing to do.
const LOOK: Duration = Duration::from_secs(1);
/// Between two complaints about a queue that is away.
const COMPLAIN: Duration = Duration::from_secs(30);
/// Pauses between two questions for work, at least and at most.
const ASK: [Duration; 2] = [Duration::from_millis(20), Duration::from_secs(1)];

impl<'a> Shared<'a> {
    /// Takes spans until the queue ends, the run is over or work must stop.
    pub(super) fn take_in(&self, sender: &Sender<Loaded<'a>>) {
        let (mut looked, mut complained) = (Instant::now(), None::<Instant>);
        let mut pause = ASK[0];
        while !self.must_stop() {
            if self.beside.is_some() && self.held.has_enough(self.ahead(), self.costs()) {
                std::thread::sleep(PAUSE);
                continue;
            }
            match self.take() {
                Taken::Span(delivery) => {
                    (pause, complained) = (ASK[0], None);
                    if !self.pass_on(sender, delivery) {
                        return;
                    }
                    continue;
                }
                Taken::Nothing => complained = None,
                Taken::Ended => return,
                Taken::Lost(reason) => {
                    if complained.is_none_or(|at| at.elapsed() > COMPLAIN) {
                        complained = Some(Instant::now());
                        (self.on_event)(Event::QueueLost { reason });
                    }
                }
            }
            if self.beside.is_none() {
                continue;
            }
            if looked.elapsed() > LOOK {
                looked = Instant::now();
                if let Ok(Some(_)) = self.store.get(keys::FINISHED) {
                    return;
                }
            }
            // Only who has nothing left asks others.
            let may_ask = complained.is_none() && !self.control.is_paused();
            if may_ask && sender.is_empty() && self.is_idle() {
                if self.queue.ask() > 0 {
                    pause = ASK[0];
                } else {
                    std::thread::sleep(pause);
                    pause = (pause * 2).min(ASK[1]);
                }
            }
        }
    }

    /// The next span; while the run is paused none that another worker could have later.
    fn take(&self) -> Taken {
        if self.beside.is_none() || !self.control.is_paused() {
            return self.queue.take(WAIT);
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
                Err(error) if self.may_be_mine(&error) => {
                    self.could_not_read(line, &delivery, &error.to_string())
                }
                Ok(_) if matches!(suspect, Examined::Suspect) => self.isolate(line, &delivery),
                files => return self.send(sender, line, delivery, files),
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

    fn read(&self, line: &SceneLine) -> Result<SceneFiles, LoadError> {
        let start = Instant::now();
        let files = read_files(line, &self.run.roots, self.run.dir.root());
        self.seconds.add_read(start.elapsed());
        files
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
