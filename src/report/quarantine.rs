//! Lists of scenes in quarantine and of damaged tuples, with their reasons.

use super::text::table;
use crate::run::Quarantined;
use crate::text::cut;
use glasshouse_line::ids::SceneId;
use maud::{Markup, html};

/// Maximum number of scenes in each list on the page.
const SHOWN: usize = 200;
/// Maximum length of a reason on the page, in characters.
const REASON_SHOWN: usize = 2000;

pub(super) fn quarantine(scenes: &[Quarantined]) -> Markup {
    if scenes.is_empty() {
        return html! { p.dim { "No scene is in quarantine." } };
    }
    let all = scenes.iter().map(|s| (s.scene.as_str(), s.reason.as_str()));
    html! {
        p {
            "Workers could not make these scenes, and the run continued without them. After you repair their files, "
            code { "glasshouse retry RUN --all" } " makes workers try again."
        }
        (reasons("Scenes in quarantine", all, "RUN/quarantine/"))
    }
}

/// Lists the tuples that cannot be used.
pub(super) fn damaged(scenes: &[(SceneId, String)]) -> Markup {
    if scenes.is_empty() {
        return html! {};
    }
    let all = scenes.iter().map(|(s, r)| (s.as_str(), r.as_str()));
    html! {
        div.alert #damaged {
            h3 { "Damaged tuples" }
            p {
                "The tuples of these scenes cannot be used and are not shown. To make them again, run "
                code { "glasshouse retry RUN SCENE --anew" } ", then " code { "glasshouse work RUN" } "."
            }
            (reasons("Damaged tuples", all, "RUN/tuples/"))
        }
    }
}

fn reasons<'a>(
    label: &str,
    all: impl ExactSizeIterator<Item = (&'a str, &'a str)>,
    folder: &str,
) -> Markup {
    let rest = all.len().saturating_sub(SHOWN);
    let rows = html! {
        @for (scene, reason) in all.take(SHOWN) {
            tr { td.mono { (scene) } td { (cut(reason, REASON_SHOWN)) } }
        }
    };
    html! {
        (table(label, &["scene", "reason"], &rows))
        @if rest > 0 { p.dim { "and " (rest) " more, see " code { (folder) } } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_cut_and_reasons_are_escaped() {
        let scene = |k: usize| Quarantined {
            scene: format!("s{k}"),
            reason: format!("<script>{}", "x".repeat(9000)),
        };
        let html = quarantine(&(0..SHOWN + 7).map(scene).collect::<Vec<_>>()).into_string();
        assert!(!html.contains("<script") && html.contains("&lt;script&gt;x"));
        assert!(html.contains("and 7 more") && html.len() < 2300 * SHOWN);
        assert!(quarantine(&[]).into_string().contains("No scene"));
        assert!(damaged(&[]).into_string().is_empty());
    }
}
