//! Parses pages strictly: errors that browsers tolerate make a test fail.

use scraper::{ElementRef, Html, Selector};
use std::collections::BTreeSet;

/// Parses a page; panics at errors, external resources, equal ids, dead links, and a missing language, title or label.
#[track_caller]
pub(crate) fn strictly(page: &str) -> Html {
    let html = Html::parse_document(page);
    assert!(html.errors.is_empty(), "{:?}", html.errors);
    assert_eq!(one(&html, "html").attr("lang"), Some("en"));
    assert!(!one(&html, "head > title").inner_html().trim().is_empty());
    for elsewhere in ["http://", "https://", "src=\"//", "href=\"//", "@import"] {
        assert!(!page.contains(elsewhere), "{elsewhere}");
    }
    let mut ids = BTreeSet::new();
    for element in all(&html, "[id]") {
        let id = element.attr("id").unwrap();
        assert!(ids.insert(id), "two elements have the id {id}");
    }
    for image in all(&html, "img") {
        let alt = image.attr("alt").unwrap_or_default();
        assert!(!alt.is_empty(), "{}", image.html());
    }
    for plot in all(&html, "svg") {
        let label = plot.attr("aria-label").unwrap_or_default();
        assert!(!label.is_empty(), "{}", plot.html());
    }
    for link in all(&html, "a[href^='#']") {
        let id = link.attr("href").unwrap().trim_start_matches('#');
        assert!(ids.contains(id), "no element has the id {id}");
    }
    html
}

/// Returns all elements that match a selector.
pub(crate) fn all<'a>(html: &'a Html, selector: &str) -> Vec<ElementRef<'a>> {
    html.select(&Selector::parse(selector).unwrap()).collect()
}

/// Returns the only element that matches a selector.
#[track_caller]
pub(crate) fn one<'a>(html: &'a Html, selector: &str) -> ElementRef<'a> {
    let found = all(html, selector);
    assert_eq!(found.len(), 1, "{selector}");
    found[0]
}

/// Returns an element's text.
pub(crate) fn words(element: ElementRef) -> String {
    element.text().collect()
}

/// Returns the exact numbers in the `data` elements inside an element.
pub(crate) fn values(element: ElementRef) -> Vec<f64> {
    let data = Selector::parse("data").unwrap();
    let values = element.select(&data);
    values.map(|data| data.attr("value").unwrap().parse().unwrap()).collect()
}
