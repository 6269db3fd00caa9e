//! The allowed values of a key, in the notation of intervals: `(0, 1e15] m`, `[1, 16384] px whole`, `(-inf, inf)`.

use proc_macro2::TokenStream;
use quote::quote;

/// Reads `text`, and returns an expression of the type `Limit`.
pub(crate) fn limit(text: &str) -> Result<TokenStream, String> {
    let wrong = || {
        format!(
            "{text:?} is not an interval such as \"(0, 1] m\", \"[1, 9] px whole\" or \"[1, 64] power of two\""
        )
    };
    let close = text.find([']', ')']).ok_or_else(wrong)?;
    let (interval, words) = text.split_at(close + 1);
    let inner = interval.get(1..close).ok_or_else(wrong)?;
    let (least, most) = inner.split_once(',').ok_or_else(wrong)?;
    let end = |end: &str| end.trim().parse::<f64>().map_err(|_| wrong());
    let (least, most) = (end(least)?, end(most)?);
    let is_open = |bracket: &str| interval.contains(bracket);
    let (opens, closes) = (is_open("("), is_open(")"));
    let words = words.trim();
    let (unit, grid) = if words == "power of two" {
        ("", quote!(PowersOfTwo))
    } else if let Some(unit) = words.strip_suffix("whole") {
        (unit.trim(), quote!(Whole))
    } else {
        (words, quote!(All))
    };
    let bound = |value: f64, is_open: bool| {
        if value.is_infinite() {
            quote!(::std::ops::Bound::Unbounded)
        } else if is_open {
            quote!(::std::ops::Bound::Excluded(#value))
        } else {
            quote!(::std::ops::Bound::Included(#value))
        }
    };
    let allowed = in_words([least, most], [opens, closes], unit, words == "power of two");
    let (from, to) = (bound(least, opens), bound(most, closes));
    Ok(quote! {
        crate::limits::Limit::new((#from, #to), crate::limits::Grid::#grid, #unit, #allowed)
    })
}

/// Returns the interval as the end of a sentence such as "ior must be 1 to 10".
fn in_words(ends: [f64; 2], [opens, closes]: [bool; 2], unit: &str, is_power: bool) -> String {
    let [least, most] = ends.map(number);
    let words = match (ends.map(f64::is_finite), opens, closes) {
        ([false, false], ..) => "finite".to_owned(),
        ([true, false], true, _) => format!("finite and above {least}"),
        ([true, false], false, _) => format!("finite and at least {least}"),
        ([false, true], _, true) => format!("finite and below {most}"),
        ([false, true], _, false) => format!("finite and at most {most}"),
        ([true, true], false, false) => format!("{least} to {most}"),
        ([true, true], true, false) => format!("above {least} and at most {most}"),
        ([true, true], false, true) => format!("{least} or more and below {most}"),
        ([true, true], true, true) => format!("above {least} and below {most}"),
    };
    let words = if is_power { format!("a power of two from {words}") } else { words };
    // "finite and above 0" needs no unit; a range of metres does.
    let has_unit = ends.iter().all(|end| end.is_finite()) && !unit.is_empty();
    if has_unit { format!("{words} {unit}") } else { words }
}

/// Writes numbers of many digits with an exponent.
fn number(value: f64) -> String {
    let magnitude = value.abs();
    if magnitude != 0.0 && !(1e-4..1e6).contains(&magnitude) {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_become_words() {
        for (text, words) in [
            ("(0, 1e15] m", "above 0 and at most 1e15 m"),
            ("[0.001, 1000] m", "0.001 to 1000 m"),
            ("(-90, 90) degrees", "above -90 and below 90 degrees"),
            ("[0, 1)", "0 or more and below 1"),
            ("[1, 65536] power of two", "a power of two from 1 to 65536"),
            ("[1, 16384] px whole", "1 to 16384 px"),
            ("(0, inf) m", "finite and above 0"),
            ("[0, inf)", "finite and at least 0"),
            ("(-inf, inf) m", "finite"),
            ("[1e-5, 1e6] m", "1e-5 to 1e6 m"),
        ] {
            let tokens = limit(text).unwrap().to_string();
            assert!(tokens.contains(&format!("{words:?}")), "{text}: {tokens}");
        }
        for wrong in ["", "0, 1", "[0 1]", "[a, 1]", "[0, 1"] {
            assert!(limit(wrong).unwrap_err().contains("is not an interval"), "{wrong}");
        }
    }
}
