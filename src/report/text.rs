//! Formats numbers and tables as HTML; computes evenly spaced indices and quantiles.

use maud::{Markup, html};

/// Formats a number as text, with its exact value for programs that read the page.
pub(super) fn exact(value: f64, text: &str) -> Markup {
    html! { data value=(value) { (text) } }
}

/// Formats an error of linear radiance.
pub(super) fn error(value: f64) -> Markup {
    let text = if value == 0.0 { "0".to_owned() } else { format!("{value:.2e}") };
    exact(value, &text)
}

/// Formats seconds with three decimals below 1, two below 100, and none from 100.
pub(super) fn seconds(value: f64) -> Markup {
    let digits = match value {
        v if v < 1.0 => 3,
        v if v < 100.0 => 2,
        _ => 0,
    };
    exact(value, &format!("{value:.digits$}"))
}

/// Draws a table in a scrollable region. A head that starts with `#` marks a column of numbers.
pub(super) fn table<H: AsRef<str>>(label: &str, heads: &[H], rows: &Markup) -> Markup {
    html! {
        div.box role="region" aria-label=(label) tabindex="0" {
            table {
                thead { tr {
                    @for head in heads {
                        @match head.as_ref().strip_prefix('#') {
                            Some(head) => { th.n scope="col" { (head) } }
                            None => { th scope="col" { (head.as_ref()) } }
                        }
                    }
                } }
                tbody { (rows) }
            }
        }
    }
}

/// Returns at most `count` evenly spaced indices below `all`.
pub(super) fn evenly(all: usize, count: usize) -> Vec<usize> {
    let taken = all.min(count);
    (0..taken).map(|k| k * all / taken).collect()
}

/// Returns the quantile at `share`, 0 to 1, of sorted values; NaN without values.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    let place = (share * last as f64).round() as usize;
    sorted.get(place.min(last)).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_are_evenly_spaced() {
        assert_eq!(evenly(3, 8), [0, 1, 2]);
        assert_eq!(evenly(10, 4), [0, 2, 5, 7]);
        assert!(evenly(0, 4).is_empty());
        let many = evenly(5200, 48);
        assert_eq!((many.len(), many[0], many[47]), (48, 0, 5091));
    }

    #[test]
    fn a_quantile_is_one_of_the_values() {
        let values = [1.0, 2.0, 3.0, 4.0, 50.0];
        assert_eq!(quantile(&values, 0.5), 3.0);
        assert_eq!(quantile(&values, 0.95), 50.0);
        assert_eq!(quantile(&values[..1], 0.95), 1.0);
        assert!(quantile(&[], 0.5).is_nan());
    }
}
