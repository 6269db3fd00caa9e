//! Reads the output of a child process line by line.

use crossbeam::channel::{Receiver, unbounded};
use std::io::{BufRead, BufReader, Read};

/// Returns the lines that a thread reads from a pipe until its end, or no lines if `pipe` is `None`.
pub(crate) fn lines(pipe: Option<impl Read + Send + 'static>) -> Receiver<String> {
    let (sender, lines) = unbounded();
    if let Some(pipe) = pipe {
        std::thread::spawn(move || {
            let mut pipe = BufReader::new(pipe);
            let mut line = Vec::new();
            while matches!(pipe.read_until(b'\n', &mut line), Ok(1..)) {
                let text = String::from_utf8_lossy(&line).trim_end().to_owned();
                line.clear();
                if sender.send(text).is_err() {
                    return;
                }
            }
        });
    }
    lines
}
