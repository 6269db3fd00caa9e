//! Opens the report in a browser, if one is installed: the page fits a phone, and both colour schemes are readable.

use crate::support::browser::browse;
use crate::support::program::{run, text};
use crate::support::scenes::place;
use serde_json::Value;

/// A page that measures the report in frames of two widths and writes the results into an element.
const MEASURE: &str = r#"<!doctype html><html lang="en"><head><meta charset="utf-8">
<meta name="color-scheme" content="light dark"><title>measure</title></head><body>
<iframe src="index.html" width="420" height="900"></iframe>
<iframe src="index.html" width="1280" height="900"></iframe>
<pre id="found"></pre>
<script>
addEventListener("load", () => {
  const found = [...document.querySelectorAll("iframe")].map(frame => {
    const inside = frame.contentDocument, page = inside.documentElement;
    const style = frame.contentWindow.getComputedStyle(inside.body);
    // The content of a scrolling element may be wider than the page.
    const wide = [...inside.body.querySelectorAll("*")].filter(e =>
      e.getBoundingClientRect().right > page.clientWidth + 1 && !e.closest(".box, pre"));
    return { scroll: page.scrollWidth, client: page.clientWidth, wide: wide.map(e => e.outerHTML.slice(0, 200)),
      images: inside.images.length, broken: [...inside.images].filter(i => i.naturalWidth === 0).length,
      plots: [...inside.querySelectorAll("svg")].filter(s => s.getBoundingClientRect().height > 10).length,
      text: style.color, page: style.backgroundColor };
  });
  document.getElementById("found").textContent = JSON.stringify(found);
});
</script></body></html>"#;

/// Returns the relative luminance of `rgb(r, g, b)` (WCAG 2).
fn luminance(colour: &str) -> f64 {
    let numbers = colour.trim_start_matches("rgb(").trim_end_matches(')');
    let linear: Vec<f64> = numbers
        .split(", ")
        .map(|n| f64::from(glasshouse_line::color::srgb_to_linear(n.parse().unwrap())))
        .collect();
    0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
}

#[test]
fn the_report_fits_phones_and_is_readable_in_both_colour_schemes() {
    let place = place();
    run(&place.arguments("run", &[])).expect(0);
    let folder = place.run.join("report");
    std::fs::write(folder.join("measure.html"), MEASURE).unwrap();
    let mut pages = Vec::new();
    // Scheme 0 is dark, and scheme 1 is light.
    for scheme in ["0", "1"] {
        let url = format!("file://{}", text(&folder.join("measure.html")));
        let scheme = format!("--blink-settings=preferredColorScheme={scheme}");
        let more = [scheme.as_str(), "--allow-file-access-from-files"];
        let Some(browsed) = browse(&url, 20_000, &more) else {
            return;
        };
        assert!(browsed.console.is_empty(), "{:?}", browsed.console);
        let (_, found) = browsed.dom.split_once("<pre id=\"found\">").unwrap();
        let found = found.split_once("</pre>").unwrap().0;
        let found = found.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        let found: Vec<Value> = serde_json::from_str(&found).unwrap();
        assert_eq!(found.len(), 2);
        for frame in &found {
            assert_eq!(frame["wide"], serde_json::json!([]));
            assert!(frame["scroll"].as_u64() <= frame["client"].as_u64(), "{frame}");
            assert_eq!(frame["broken"], 0);
            assert!(frame["images"].as_u64() >= Some(20), "{frame}");
            assert!(frame["plots"].as_u64() >= Some(3), "{frame}");
            let [on, text] = ["page", "text"].map(|key| luminance(frame[key].as_str().unwrap()));
            let contrast = (on.max(text) + 0.05) / (on.min(text) + 0.05);
            assert!(contrast > 7.0, "{frame}");
        }
        pages.push(luminance(found[0]["page"].as_str().unwrap()));
    }
    assert!(pages[0] < 0.05 && pages[1] > 0.7, "{pages:?}");
}
