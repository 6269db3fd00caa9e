//! Formats numbers and times for people; shortens, cleans and splits texts.

use std::borrow::Cow;

/// Formats a count as `1,234,567`.
pub(crate) fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (at, digit) in digits.char_indices() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Formats a count with a noun: `1 scene`, `2,000 scenes`.
pub(crate) fn many(count: u64, what: &str) -> String {
    let plural = if count == 1 { "" } else { "s" };
    format!("{} {what}{plural}", grouped(count))
}

/// Formats a duration, rounded down: `3 s`, `2 min 05 s`, `12 min`, `2 h 05 min`, `3 d 4 h`; `unknown` if not finite.
pub(crate) fn duration(seconds: f64) -> String {
    if !seconds.is_finite() {
        return "unknown".to_owned();
    }
    let s = seconds.max(0.0) as u64;
    match s {
        0..60 => format!("{s} s"),
        60..600 => format!("{} min {:02} s", s / 60, s % 60),
        600..3600 => format!("{} min", s / 60),
        3600..86400 => format!("{} h {:02} min", s / 3600, s % 3600 / 60),
        _ => format!("{} d {} h", s / 86400, s % 86400 / 3600),
    }
}

/// Formats a rate of scenes as a number and a unit: scenes a second, a minute or an hour.
pub(crate) fn rate(per_s: f64) -> (String, &'static str) {
    let (value, unit) = if per_s >= 1.0 {
        (per_s, "scenes a second")
    } else if per_s * 60.0 >= 1.0 {
        (per_s * 60.0, "scenes a minute")
    } else {
        (per_s * 3600.0, "scenes an hour")
    };
    let text = match value {
        v if !v.is_finite() => "unknown".to_owned(),
        v if v >= 100.0 => grouped(v as u64),
        v => format!("{v:.1}"),
    };
    (text, unit)
}

/// Returns a share in percent with one decimal, rounded down, so that 100 % means all. An empty total gives 100 %.
pub(crate) fn percent(done: u64, total: u64) -> f64 {
    if total == 0 {
        return 100.0;
    }
    let tenths = u128::from(done.min(total)) * 1000 / u128::from(total);
    tenths as f64 / 10.0
}

/// Returns the first `limit` characters of a text, with an ellipsis if the text is longer.
pub(crate) fn cut(text: &str, limit: usize) -> String {
    let mut characters = text.chars();
    let mut first: String = characters.by_ref().take(limit).collect();
    if characters.next().is_some() {
        first.push('…');
    }
    first
}

/// Replaces control characters except tabs and line feeds, because a log's escape codes could hide text, the characters that
/// reverse the direction of text, and [credentials](without_credentials).
pub(crate) fn printable<'a>(text: impl Into<Cow<'a, str>>) -> Cow<'a, str> {
    let is_hidden = |c: char| (c.is_control() || is_reversing(c)) && c != '\n' && c != '\t';
    let text = without_credentials(text.into());
    if text.contains(is_hidden) { text.replace(is_hidden, "\u{fffd}").into() } else { text }
}

/// True if a terminal or a browser shows the text after this character in another order.
fn is_reversing(c: char) -> bool {
    matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Escapes the characters that [`printable`] replaces and that JSON permits in its texts, because terminals obey them.
pub(crate) fn printable_json(json: String) -> String {
    let json = without_credentials(json.into()).into_owned();
    let is_hidden = |c: char| matches!(c, '\u{7f}'..='\u{9f}') || is_reversing(c);
    if !json.contains(is_hidden) {
        return json;
    }
    let escape = |c: char| {
        if is_hidden(c) { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() }
    };
    json.chars().map(escape).collect()
}

/// Names of parameters of an address whose values are secret, in lower case.
const SECRET_PARAMETERS: [&str; 7] =
    ["sig", "signature", "token", "password", "secret", "credential", "key"];

/// Hides what stands for a user in the addresses of a text, and secret parameters: `s3://KEY:SECRET@bucket` becomes `s3://…@bucket`.
pub(crate) fn without_credentials(text: Cow<'_, str>) -> Cow<'_, str> {
    if !text.contains("://") {
        return text;
    }
    let mut clean = String::with_capacity(text.len());
    let mut rest = &*text;
    while let Some(at) = rest.find("://") {
        let (before, address) = rest.split_at(at + 3);
        clean.push_str(before);
        let is_end = |c: char| c.is_whitespace() || matches!(c, '"' | '<' | '>' | '`' | '\\');
        let end = address.find(is_end).unwrap_or(address.len());
        // Several servers are separated by commas; each of the others has a scheme of its own.
        let end = address[..end]
            .find("://")
            .map_or(end, |next| address[..next].rfind(',').map_or(next, |comma| comma + 1));
        let (address, after) = address.split_at(end);
        clean.push_str(&hidden(address));
        rest = after;
    }
    clean.push_str(rest);
    clean.into()
}

/// Hides user and secret parameters of an address without its scheme.
fn hidden(address: &str) -> String {
    let host = address.find(['/', '?']).unwrap_or(address.len());
    let user = match address[..host].rfind('@') {
        Some(at) => Some(at),
        // A secret key may have a slash: then a colon precedes it that no port follows.
        None => address[..host]
            .split_once(':')
            .filter(|(_, port)| !port.chars().all(|c| c.is_ascii_digit()) || port.is_empty())
            .and_then(|_| address.rfind('@')),
    };
    let address = user.map_or_else(|| address.to_owned(), |at| format!("…{}", &address[at..]));
    let Some((path, parameters)) = address.split_once('?') else {
        return address;
    };
    let hide = |parameter: &str| match parameter.split_once('=') {
        Some((name, _)) if SECRET_PARAMETERS.iter().any(|s| name.to_lowercase().contains(s)) => {
            format!("{name}=…")
        }
        _ => parameter.to_owned(),
    };
    let parameters: Vec<String> = parameters.split('&').map(hide).collect();
    format!("{path}?{}", parameters.join("&"))
}

/// Splits a line of CSV (RFC 4180) into cells. Returns `None` if a quote is not closed.
pub(crate) fn csv_cells(line: &str) -> Option<Vec<String>> {
    let (mut cells, mut cell, mut is_quoted) = (Vec::new(), String::new(), false);
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if is_quoted && letters.peek() == Some(&'"') => {
                cell.push('"');
                letters.next();
            }
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => cells.push(std::mem::take(&mut cell)),
            letter => cell.push(letter),
        }
    }
    cells.push(cell);
    (!is_quoted).then_some(cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credentials_of_addresses_are_hidden() {
        for (text, clean) in [
            ("s3://AKIA:S3CRET@bucket/x is no store", "s3://…@bucket/x is no store"),
            ("\"s3://AKIA:S3/CR+ET@b/x.png\",", "\"s3://…@b/x.png\","),
            (
                "nats://S3CRET@one:4222,nats://a:S3C@RET@two:4222",
                "nats://…@one:4222,nats://…@two:4222",
            ),
            ("see https://b/x?sv=1&sig=S3CRET&a=1 and", "see https://b/x?sv=1&sig=…&a=1 and"),
            ("https://b/x?X-Amz-Security-Token=S3CRET", "https://b/x?X-Amz-Security-Token=…"),
            ("s3://AKIA:@bucket", "s3://…@bucket"),
        ] {
            assert_eq!(printable(text), clean);
            assert_eq!(printable_json(text.to_owned()), clean);
        }
        for text in
            ["s3://bucket/a@2x.png", "http://127.0.0.1:4222/a@b", "a@b.c", "://", "x://?a&b="]
        {
            assert_eq!(printable(text), text);
        }
    }

    #[test]
    fn numbers_are_readable() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1000), "1,000");
        assert_eq!(grouped(1234567), "1,234,567");
        let durations = [0.4, 59.9, 61.0, 3599.0, 7500.0, 100_000.0, -1.0].map(duration);
        let expected = ["0 s", "59 s", "1 min 01 s", "59 min", "2 h 05 min", "1 d 3 h", "0 s"];
        assert_eq!(durations, expected);
        assert_eq!(duration(f64::NAN), "unknown");
        assert_eq!(rate(12.34), ("12.3".to_owned(), "scenes a second"));
        assert_eq!(rate(0.05), ("3.0".to_owned(), "scenes a minute"));
        assert_eq!(rate(0.001), ("3.6".to_owned(), "scenes an hour"));
        assert_eq!(rate(4321.0).0, "4,321");
    }

    #[test]
    fn only_a_complete_count_is_a_hundred_percent() {
        assert_eq!(percent(4999, 5000), 99.9);
        assert_eq!(percent(5000, 5000), 100.0);
        assert_eq!(percent(0, 5000), 0.0);
        assert_eq!(percent(0, 0), 100.0);
        assert_eq!(percent(u64::MAX, u64::MAX), 100.0);
    }

    #[test]
    fn long_text_is_cut_between_characters() {
        assert_eq!(cut("R̃äx", 9), "R̃äx");
        assert_eq!(cut("äöü", 2), "äö…");
        assert_eq!(cut("äöü", 3), "äöü");
    }

    #[test]
    fn control_characters_become_visible() {
        assert_eq!(printable("a\x1b[31m\n\tb\0"), "a\u{fffd}[31m\n\tb\u{fffd}");
        assert_eq!(printable("a\u{9b}31m\u{202e}b"), "a\u{fffd}31m\u{fffd}b");
        let json = printable_json("{\"a\":\"\u{9b}1m\u{7f}ä\"}".to_owned());
        assert_eq!(json, "{\"a\":\"\\u009b1m\\u007fä\"}");
        let value: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(value["a"], "\u{9b}1m\u{7f}ä");
    }

    #[test]
    fn cells_may_contain_commas_and_quotes() {
        assert_eq!(csv_cells("a,\"b,\"\"c\"\"\",").unwrap(), ["a", "b,\"c\"", ""]);
        assert_eq!(csv_cells("a,\"b"), None);
    }
}
