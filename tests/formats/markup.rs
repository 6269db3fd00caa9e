//! The strict reader of pages (`support/markup.rs`) rejects errors that browsers tolerate.

use crate::support::markup::strictly;

#[test]
fn errors_that_browsers_tolerate_are_rejected() {
    let page = |body: &str| {
        format!(
            "<!doctype html><html lang=\"en\"><head><title>x</title></head><body>{body}</body></html>"
        )
    };
    strictly(&page("<p id=\"a\">fine <a href=\"#a\">too</a></p>"));
    for wrong in [
        "<p>a</div></p>",
        "<p><ul><li>a</li></ul></p>",
        "<table><p>a</p></table>",
        "<b><i>a</b></i>",
        "<div a=\"1\" a=\"2\"></div>",
        "<p id=\"a\">a</p><p id=\"a\">b</p>",
        "<img src=\"data:,\">",
        "<a href=\"#nowhere\">a</a>",
        "<a href=\"https://elsewhere\">a</a>",
    ] {
        let read = std::panic::catch_unwind(|| strictly(&page(wrong)));
        assert!(read.is_err(), "{wrong}");
    }
}
