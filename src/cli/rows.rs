//! Formats labels and texts in two columns, for a terminal 80 characters wide.

/// Width of a line, in characters.
pub(super) const WIDTH: usize = 80;
/// Least width of the label column, in characters.
const LEAST_LABEL: usize = 10;

/// Formats rows of a label and a text. Long texts wrap between words and stay in their column; a long word (a path, a
/// digest) is not split.
pub(super) fn rows<'a>(rows: impl IntoIterator<Item = (&'a str, &'a str)>) -> String {
    let rows: Vec<(&str, &str)> = rows.into_iter().collect();
    let labels = rows.iter().map(|(label, _)| label.chars().count());
    let width = labels.max().unwrap_or(0).max(LEAST_LABEL);
    let mut text = String::new();
    for (label, value) in rows {
        for (index, line) in wrapped(value, WIDTH - width.min(WIDTH / 2) - 4).iter().enumerate() {
            let label = if index == 0 { label } else { "" };
            text += format!("\n  {label:<width$}  {line}").trim_end();
        }
    }
    text
}

/// Wraps a text to lines of at most `width` characters; a longer word gets its own line. Keeps runs of spaces, because
/// they align columns.
pub(super) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = Vec::new();
    for line in text.lines() {
        let line = line.replace(|c: char| c.is_control(), " ");
        let mut current = String::new();
        for word in line.split(' ') {
            let length = current.chars().count();
            if length > 0 && length + 1 + word.chars().count() > width {
                lines.push(current.trim_end().to_owned());
                current = String::new();
            } else if length > 0 || word.is_empty() {
                current.push(' ');
            }
            current += word;
        }
        lines.push(current.trim_end().to_owned());
    }
    if lines.is_empty() {
        lines.push(String::new());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_wrap_in_their_column() {
        let long = "word ".repeat(30);
        let text = rows([("a", "b"), ("label", long.trim())]);
        assert!(text.starts_with("\n  a           b\n  label       word word"), "{text}");
        assert!(text.lines().all(|line| line.len() <= WIDTH), "{text}");
        assert!(text.lines().skip(3).all(|line| line.starts_with("              word")), "{text}");
        assert_eq!(wrapped("min 0  max 1", 40), ["min 0  max 1"]);
        let digest = "f".repeat(100);
        assert_eq!(wrapped(&digest, 40), [digest]);
        assert_eq!(wrapped("a\tb\nc", 40), ["a b", "c"]);
    }
}
