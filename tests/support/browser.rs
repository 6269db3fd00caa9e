//! Loads pages in Debian's `chromium` in headless mode, if it is installed.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A page as rendered by a browser.
pub(crate) struct Browsed {
    /// The document after the scripts have run.
    pub(crate) dom: String,
    /// Lines of the browser's console.
    pub(crate) console: Vec<String>,
}

/// Loads a page and runs it for `virtual_ms` of the browser's virtual time; returns `None` without a browser.
pub(crate) fn browse(url: &str, virtual_ms: u32, more: &[&str]) -> Option<Browsed> {
    let profile = tempfile::tempdir().unwrap();
    let (out, log) = (profile.path().join("dom.html"), profile.path().join("log.txt"));
    let child = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-background-networking",
            "--enable-logging=stderr",
        ])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--virtual-time-budget={virtual_ms}"))
        .args(more)
        .args(["--dump-dom", url])
        .stdin(Stdio::null())
        .stdout(std::fs::File::create(&out).unwrap())
        .stderr(std::fs::File::create(&log).unwrap())
        .spawn();
    let mut child = match child {
        Ok(child) => child,
        Err(e) => {
            eprintln!("skipped: chromium does not start ({e})");
            return None;
        }
    };
    let begun = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begun.elapsed() > Duration::from_mins(2) {
            child.kill().unwrap();
            panic!("the browser does not end");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let log = std::fs::read(log).unwrap();
    let log = String::from_utf8_lossy(&log).into_owned();
    let is_console = |line: &&str| line.contains("CONSOLE");
    Some(Browsed {
        dom: std::fs::read_to_string(out).unwrap(),
        console: log.lines().filter(is_console).map(str::to_owned).collect(),
    })
}
