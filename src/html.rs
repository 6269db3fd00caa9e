//! Text that was written by others, inside HTML and SVG; the layers' symbols in HTML.

use render::layer::Layer;
use std::fmt;

/// Text between tags or in a quoted attribute.
pub(crate) struct Html<'a>(pub(crate) &'a str);

impl fmt::Display for Html<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for c in self.0.chars() {
            match c {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                // Colours of a log, and what could hide other text.
                c if c.is_control() && c != '\n' && c != '\t' => f.write_str("\u{fffd}")?,
                c => fmt::Write::write_char(f, c)?,
            }
        }
        Ok(())
    }
}

/// The paper's symbol of a layer.
pub(crate) fn symbol(layer: Layer) -> &'static str {
    match layer {
        Layer::GlassReflection => "R&#771;",
        other => other.symbol(),
    }
}

/// At most `limit` characters of a text.
pub(crate) fn cut(text: &str, limit: usize) -> String {
    let mut characters = text.chars();
    let mut first: String = characters.by_ref().take(limit).collect();
    if characters.next().is_some() {
        first.push('…');
    }
    first
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_text() {
        let hostile = "<b a='\"'>&\x1b[31m\n";
        let html = Html(hostile).to_string();
        assert_eq!(html, "&lt;b a=&#39;&quot;&#39;&gt;&amp;\u{fffd}[31m\n");
    }

    #[test]
    fn long_text_is_cut_between_characters() {
        assert_eq!(cut("R̃äx", 9), "R̃äx");
        assert_eq!(cut("äöü", 2), "äö…");
        assert_eq!(cut("äöü", 3), "äöü");
    }
}
