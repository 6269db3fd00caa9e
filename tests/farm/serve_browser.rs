//! The status page in a browser, where there is one: Debian's `chromium`.

use crate::serve_run::{HOSTILE, run, start};
use std::process::{Command, Stdio};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The page as the browser has it after `virtual_ms` of its own time; `None` without a browser.
fn dom(url: &str, virtual_ms: u32) -> Option<String> {
    let profile = tempfile::tempdir().unwrap();
    let out = profile.path().join("dom.html");
    let child = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-background-networking",
        ])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--virtual-time-budget={virtual_ms}"))
        .args(["--dump-dom", url])
        .stdin(Stdio::null())
        .stdout(std::fs::File::create(&out).unwrap())
        .stderr(Stdio::null())
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
    Some(std::fs::read_to_string(out).unwrap())
}

fn between<'a>(text: &'a str, before: &str, after: &str) -> &'a str {
    let (_, rest) = text
        .split_once(before)
        .unwrap_or_else(|| panic!("no {before} in {text}"));
    rest.split_once(after).unwrap().0
}

#[test]
fn the_script_puts_new_numbers_into_the_page() {
    let run = run();
    {
        let mut view = run.view.lock().unwrap();
        view.workers[0].name = HOSTILE.to_owned();
        view.quarantine[0].reason = HOSTILE.to_owned();
    }
    // Each look at the run finds one scene more than the one before: the first page says 1,235.
    run.goes_on.store(true, Ordering::Relaxed);
    let server = start(&run, None);
    let url = format!("http://{}/", server.address());
    let Some(dom) = dom(&url, 9000) else {
        return;
    };
    let done: u64 = between(&dom, "<b id=\"done\">", "<")
        .replace(',', "")
        .parse()
        .unwrap();
    assert!(done > 1235, "{done}: {dom}");
    assert!(dom.contains("of 5,000 scenes"));
    // The whole page follows, and what was hostile never ran, neither when loaded nor when refreshed.
    let title = between(&dom, "<title>", "<");
    assert!(
        title.contains("paper") && !title.contains("pwned"),
        "{title}"
    );
    assert!(!dom.contains("<img src=\"x\""));
    assert!(
        between(&dom, "<div id=\"note\"", ">").contains("hidden"),
        "{dom}"
    );
    assert_eq!(dom.matches("data-key=\"train-1\"").count(), 1);
    // The pictures were asked for and kept: four, though the page was refreshed.
    assert_eq!(run.pictures_asked(), 4);
}
