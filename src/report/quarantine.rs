//! Scenes that were set aside, with their reasons.

use super::text::table;
use crate::html::{Html, cut};
use crate::run::Quarantined;
use render::ids::SceneId;
use std::fmt::Write;

/// Scenes on the page.
const SHOWN: usize = 200;
/// Characters of a reason on the page.
const REASON_SHOWN: usize = 2000;

/// All that are in quarantine.
pub(super) fn quarantine(scenes: &[Quarantined]) -> String {
    if scenes.is_empty() {
        return "<p class=\"dim\">No scene is in quarantine.</p>\n".to_owned();
    }
    let all = scenes.iter().map(|s| (s.scene.as_str(), s.reason.as_str()));
    format!(
        "<p>These scenes could not be made; the run went on without them. After repairing their files, \
         <code>glasshouse retry RUN --all</code> has them tried again.</p>\n{}",
        reasons("Scenes in quarantine", all, "RUN/quarantine/")
    )
}

/// Tuples that are of no use.
pub(super) fn damaged(scenes: &[(SceneId, String)]) -> String {
    if scenes.is_empty() {
        return String::new();
    }
    let all = scenes.iter().map(|(s, r)| (s.as_str(), r.as_str()));
    format!(
        "<div class=\"alert\" id=\"damaged\"><h3>Damaged tuples</h3><p>What is there of these scenes is of no use, and is not \
         shown: <code>glasshouse retry RUN SCENE --anew</code>, then <code>glasshouse work RUN</code> make them \
         again.</p>\n{}</div>\n",
        reasons("Damaged tuples", all, "RUN/tuples/")
    )
}

fn reasons<'a>(
    label: &str,
    all: impl ExactSizeIterator<Item = (&'a str, &'a str)>,
    folder: &str,
) -> String {
    let rest = all.len().saturating_sub(SHOWN);
    let mut rows = String::new();
    for (scene, reason) in all.take(SHOWN) {
        let _ = writeln!(
            rows,
            "<tr><td class=\"mono\">{}</td><td>{}</td></tr>",
            Html(scene),
            Html(&cut(reason, REASON_SHOWN))
        );
    }
    let mut html = table(label, &["scene", "reason"], &rows);
    if rest > 0 {
        let _ = writeln!(
            html,
            "<p class=\"dim\">and {rest} more, see <code>{folder}</code></p>"
        );
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_end_and_reasons_stay_text() {
        let scene = |k: usize| Quarantined {
            scene: format!("s{k}"),
            reason: format!("<script>{}", "x".repeat(9000)),
        };
        let html = quarantine(&(0..SHOWN + 7).map(scene).collect::<Vec<_>>());
        assert!(!html.contains("<script") && html.contains("&lt;script&gt;x"));
        assert!(html.contains("and 7 more") && html.len() < 2300 * SHOWN);
        assert!(quarantine(&[]).contains("No scene"));
        assert!(damaged(&[]).is_empty());
    }
}
