//! Loads the status page in Debian's `chromium`, if it is installed.

use crate::serve_run::{HOSTILE, run, start};
use crate::support::browser::browse;
use std::sync::atomic::Ordering;

fn between<'a>(text: &'a str, before: &str, after: &str) -> &'a str {
    let (_, rest) = text.split_once(before).unwrap_or_else(|| panic!("no {before} in {text}"));
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
    // Each view of the run has one more finished scene than the last, and the first page shows 1,235.
    run.goes_on.store(true, Ordering::Relaxed);
    let server = start(&run, None);
    let url = format!("http://{}/", server.address());
    let Some(browsed) = browse(&url, 9000, &[]) else {
        return;
    };
    let dom = browsed.dom;
    let done: u64 = between(&dom, "<b id=\"done\">", "<").replace(',', "").parse().unwrap();
    assert!(done > 1235, "{done}: {dom}");
    assert!(dom.contains("of 5,000 scenes"));
    // The whole page is updated, and hostile text runs neither at the first load nor at an update.
    let title = between(&dom, "<title>", "<");
    assert!(title.contains("paper") && !title.contains("pwned"), "{title}");
    assert!(!dom.contains("<img src=\"x\""));
    assert!(between(&dom, "id=\"note\"", ">").contains("hidden"), "{dom}");
    assert_eq!(dom.matches("data-key=\"train-1\"").count(), 1);
    // The browser fetched each of the four pictures once, although it refreshed the page.
    assert_eq!(run.pictures_asked(), 4);
}
