//! Numbers and names as people and Prometheus read them.

use std::fmt;

/// The value of a label in Prometheus' text format, without its quotes.
pub(super) struct Label<'a>(pub(super) &'a str);

impl fmt::Display for Label<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for c in self.0.chars() {
            match c {
                '\\' => f.write_str("\\\\")?,
                '"' => f.write_str("\\\"")?,
                '\n' => f.write_str("\\n")?,
                c => fmt::Write::write_char(f, c)?,
            }
        }
        Ok(())
    }
}

/// `1,234,567`
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

/// `3 s`, `12 min`, `2 h 05 min`, `3 d 4 h`: what a glance needs, rounded down.
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

/// A rate as a number and the unit that makes it readable: per second, minute or hour.
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

/// A share in percent with one decimal, rounded down: 100 % means all.
pub(crate) fn percent(done: u64, total: u64) -> f64 {
    if total == 0 {
        return 100.0;
    }
    let tenths = u128::from(done.min(total)) * 1000 / u128::from(total);
    tenths as f64 / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_readable() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1000), "1,000");
        assert_eq!(grouped(1234567), "1,234,567");
        let durations = [0.4, 59.9, 61.0, 3599.0, 7500.0, 100_000.0, -1.0].map(duration);
        let expected = [
            "0 s",
            "59 s",
            "1 min 01 s",
            "59 min",
            "2 h 05 min",
            "1 d 3 h",
            "0 s",
        ];
        assert_eq!(durations, expected);
        assert_eq!(duration(f64::NAN), "unknown");
        assert_eq!(rate(12.34), ("12.3".to_owned(), "scenes a second"));
        assert_eq!(rate(0.05), ("3.0".to_owned(), "scenes a minute"));
        assert_eq!(rate(0.001), ("3.6".to_owned(), "scenes an hour"));
        assert_eq!(rate(4321.0).0, "4,321");
    }

    #[test]
    fn only_all_is_a_hundred_percent() {
        assert_eq!(percent(4999, 5000), 99.9);
        assert_eq!(percent(5000, 5000), 100.0);
        assert_eq!(percent(0, 5000), 0.0);
        assert_eq!(percent(0, 0), 100.0);
        assert_eq!(percent(u64::MAX, u64::MAX), 100.0);
    }

    #[test]
    fn text_stays_text() {
        assert_eq!(Label("a\\b\"c\nd").to_string(), "a\\\\b\\\"c\\nd");
    }
}
