//! The report page.

use super::facts::{Inspection, Problem, many};
use super::kind::Kind;
use super::look::Input;

/// What to do: the page is made from the run alone.
const WRITE: &str = "`glasshouse report RUN` writes it again";

pub(super) fn read(input: &Input) -> Inspection {
    let mut found = Inspection::new(Kind::Report);
    let Some(text) = input.text(&mut found) else {
        return found;
    };
    let title = text
        .split_once("<title>")
        .and_then(|(_, rest)| rest.split_once("</title>"));
    if let Some((title, _)) = title {
        found.facts.fact("title", title, title);
    }
    let count = |what: &str| text.matches(what).count() as u64;
    let pictures = count("src=\"data:image/");
    found.facts.fact(
        "pictures",
        format!("{} inside the page", many(pictures, "picture")),
        pictures,
    );
    let outside = count("src=\"http") + count("href=\"http");
    found.facts.fact("outside", many(outside, "link"), outside);
    if text.trim_end().ends_with("</html>") {
        found.may_be_whole("it ends as a page does; pages have no digest");
    } else {
        found.wrong(Problem::new(
            "it is cut: it does not end with </html>",
            WRITE,
        ));
    }
    found
}
