//! Symbols and colours of layers, and a number format.

use glasshouse_line::layer::PerLayer;

/// Symbols of the layers in the paper; R~ has a combining tilde.
pub(crate) const PAPER_SYMBOLS: PerLayer<&str> = PerLayer(["I", "T", "R\u{303}", "R"]);

/// Colours of the layers, from Okabe and Ito's palette for colour-blind readers.
pub(crate) const LAYER_COLOURS: PerLayer<&str> =
    PerLayer(["#0072B2", "#D55E00", "#009E73", "#CC79A7"]);

/// Formats a number as an integer or with up to 3 significant digits. Sizes outside 1e-4..1e7 (not 0) get an exponent.
pub(crate) fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-4..1e7).contains(&size) {
        return format!("{value:.2e}");
    }
    let digits = if value == 0.0 { 0 } else { (2 - libm::log10(size).floor() as i32).clamp(0, 6) };
    let text = format!("{value:.*}", digits as usize);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.3, "0.3"),
            (1234.5, "1234"),
            (0.00893, "0.00893"),
            (-1.25, "-1.25"),
            (0.0, "0"),
            (0.000012345, "1.23e-5"),
            (2e9, "2.00e9"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
