//! Scores as a Markdown table of means and as a CSV file of all pictures.

use super::align::MAX_ALIGNED_SHIFT_PX;
use super::score::Scores;
use std::fmt::Write;

/// One picture's scores by one method.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name of the method; `input` for the unprocessed picture.
    pub method: String,
    pub image: String,
    pub width: u32,
    pub height: u32,
    /// Length of the shift between picture and truth, px; `None` for rendered pairs, which are aligned by construction.
    pub shift_px: Option<f64>,
    pub scores: Scores,
}

impl Row {
    /// True if the shift is at most [`MAX_ALIGNED_SHIFT_PX`], or if no shift was measured.
    pub fn is_aligned(&self) -> bool {
        self.shift_px.is_none_or(|shift| shift <= MAX_ALIGNED_SHIFT_PX)
    }
}

/// The protocols of the scores in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// Kim et al.: PSNR of all channels together, SSIM of grey.
    Paper,
    /// ERRNet: means over the channels.
    Errnet,
    Both,
}

/// Tabulates means by method, in the order of the methods' first rows. If some pairs are not aligned, appends a line
/// with their names and a second table without them.
pub fn means_table(rows: &[Row], protocol: Protocol) -> String {
    let all: Vec<&Row> = rows.iter().collect();
    let aligned: Vec<&Row> = rows.iter().filter(|row| row.is_aligned()).collect();
    let mut text = table(&all, protocol);
    if aligned.len() == all.len() {
        return text;
    }
    let mut shifted: Vec<&str> = Vec::new();
    for row in rows.iter().filter(|row| !row.is_aligned()) {
        if !shifted.contains(&row.image.as_str()) {
            shifted.push(&row.image);
        }
    }
    let _ = write!(
        text,
        "\nThese pairs have a shift of more than {MAX_ALIGNED_SHIFT_PX} px between picture and truth: {}. Means without them:\n\n{}",
        shifted.iter().map(|name| escaped(name)).collect::<Vec<_>>().join(", "),
        table(&aligned, protocol)
    );
    text
}

/// Largest width of a column; longer cells have no padding. Widths above 65,535 panic in `format!`.
const WIDEST: usize = 200;

/// Formats a Markdown table with padded cells. The first row is the head; the first `left` columns are left-aligned.
pub fn markdown_table(rows: &[Vec<String>], left: usize) -> String {
    let columns = rows.first().map_or(0, Vec::len);
    let cell = |row: &Vec<String>, k: usize| row.get(k).cloned().unwrap_or_default();
    let width = |k: usize| rows.iter().map(|row| cell(row, k).chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|k| width(k).unwrap_or(0).clamp(3, WIDEST)).collect();
    let mut text = String::new();
    for (n, row) in rows.iter().enumerate() {
        for (k, &width) in widths.iter().enumerate() {
            let cell = cell(row, k);
            let _ = if k < left {
                write!(text, "| {cell:width$} ")
            } else {
                write!(text, "| {cell:>width$} ")
            };
        }
        text += "|\n";
        if n == 0 {
            for (k, width) in widths.iter().enumerate() {
                let end = if k < left { '-' } else { ':' };
                let _ = write!(text, "|{}{end}", "-".repeat(width + 1));
            }
            text += "|\n";
        }
    }
    text
}

fn table(rows: &[&Row], protocol: Protocol) -> String {
    let scores_of = |[psnr, ssim, psnr_channels, ssim_channels]: [String; 4]| match protocol {
        Protocol::Paper => vec![psnr, ssim],
        Protocol::Errnet => vec![psnr_channels, ssim_channels],
        Protocol::Both => vec![psnr, ssim, psnr_channels, ssim_channels],
    };
    let line = |method: &str, images: String, scores: [String; 4]| {
        let mut cells = vec![escaped(method), images];
        cells.extend(scores_of(scores));
        cells
    };
    let head =
        ["PSNR (dB, colour)", "SSIM (grey)", "PSNR (dB, channel mean)", "SSIM (channel mean)"];
    let mut lines = vec![line("Method", "Images".to_owned(), head.map(str::to_owned))];
    let mut methods: Vec<&str> = Vec::new();
    for row in rows {
        if !methods.contains(&row.method.as_str()) {
            methods.push(&row.method);
        }
    }
    for method in methods {
        let of_method = rows.iter().filter(|row| row.method == method);
        let scores: Vec<Scores> = of_method.map(|row| row.scores).collect();
        let mean = Scores::mean(&scores);
        let cells = [
            format!("{:.2}", mean.psnr_colour_db),
            format!("{:.4}", mean.ssim_grey),
            format!("{:.2}", mean.psnr_channels_db),
            format!("{:.4}", mean.ssim_channels),
        ];
        lines.push(line(method, scores.len().to_string(), cells));
    }
    markdown_table(&lines, 1)
}

/// Formats all rows as CSV. The PSNR of equal pictures is `inf`; cells of unmeasured shifts are empty.
pub fn per_image_csv(rows: &[Row]) -> String {
    let mut text = "method,image,width,height,aligned,shift_px,psnr_colour_db,ssim_grey,psnr_channels_db,ssim_channels\n".to_owned();
    for row in rows {
        let (aligned, shift_px) = match row.shift_px {
            Some(shift) if row.is_aligned() => ("yes", format!("{shift:.2}")),
            Some(shift) => ("no", format!("{shift:.2}")),
            None => ("", String::new()),
        };
        let _ = writeln!(
            text,
            "{},{},{},{},{aligned},{shift_px},{:.4},{:.6},{:.4},{:.6}",
            quoted(&row.method),
            quoted(&row.image),
            row.width,
            row.height,
            row.scores.psnr_colour_db,
            row.scores.ssim_grey,
            row.scores.psnr_channels_db,
            row.scores.ssim_channels
        );
    }
    text
}

/// Quotes a CSV cell if necessary (RFC 4180).
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

/// Escapes a cell of a Markdown table.
fn escaped(cell: &str) -> String {
    cell.replace('|', "\\|").replace(['\n', '\r'], " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(method: &str, image: &str, shift_px: Option<f64>, psnr_db: f64) -> Row {
        Row {
            method: method.to_owned(),
            image: image.to_owned(),
            width: 4,
            height: 3,
            shift_px,
            scores: Scores {
                psnr_colour_db: psnr_db,
                ssim_grey: psnr_db / 40.0,
                psnr_channels_db: psnr_db + 1.0,
                ssim_channels: 0.5,
            },
        }
    }

    fn packed(table: &str) -> String {
        let mut text = table.to_owned();
        while text.contains("  ") || text.contains("--") {
            text = text.replace("  ", " ").replace("--", "-");
        }
        text.replace(" |", "|").replace("| ", "|")
    }

    const HEAD: &str = "|Method|Images|PSNR (dB, colour)|SSIM (grey)|PSNR (dB, channel mean)|SSIM (channel mean)|\n|-|-:|-:|-:|-:|-:|\n";

    #[test]
    fn columns_are_aligned() {
        let rows = [["a", "R~"], ["long", "10.5"]].map(|row| row.map(str::to_owned).to_vec());
        let text = "| a    |   R~ |\n|------|-----:|\n| long | 10.5 |\n";
        assert_eq!(markdown_table(&rows, 1), text);
    }

    #[test]
    fn means_are_by_method() {
        let rows = [
            row("ours", "b", Some(0.5), 20.0),
            row("in|put", "a", None, 10.0),
            row("ours", "a", Some(1.5), 30.0),
        ];
        let table = means_table(&rows, Protocol::Both);
        let expected = format!(
            "{HEAD}|ours|2|25.00|0.6250|26.00|0.5000|\n|in\\|put|1|10.00|0.2500|11.00|0.5000|\n"
        );
        assert_eq!(packed(&table), expected);
        let mut lengths: Vec<usize> = table.lines().map(str::len).collect();
        lengths.dedup();
        assert_eq!(lengths.len(), 1, "{table}");
        assert!(
            packed(&means_table(&rows, Protocol::Errnet)).ends_with("|in\\|put|1|11.00|0.5000|\n")
        );
        assert!(
            packed(&means_table(&rows, Protocol::Paper)).ends_with("|in\\|put|1|10.00|0.2500|\n")
        );
    }

    #[test]
    fn a_second_table_leaves_shifted_pairs_out() {
        let rows = [row("ours", "b", Some(0.5), f64::INFINITY), row("ours", "a", Some(9.0), 30.0)];
        let text = packed(&means_table(&rows, Protocol::Both));
        assert_eq!(text.matches(HEAD).count(), 2);
        assert!(text.contains("|ours|2|inf|"), "{text}");
        assert!(text.contains("|ours|1|inf|"), "{text}");
        assert!(text.contains("more than 1.5 px between picture and truth: a. Means"));
        assert_eq!(packed(&means_table(&[], Protocol::Both)), HEAD);
        // If all pairs are shifted, the second table has only a head.
        assert!(packed(&means_table(&rows[1..], Protocol::Both)).ends_with(HEAD));
    }

    #[test]
    fn csv_has_every_picture() {
        let rows = [
            row("a \"b\", c", "x", Some(2.0), f64::INFINITY),
            row("d", "y", None, 20.0),
            row("d", "z", Some(0.123), 20.0),
        ];
        assert_eq!(
            per_image_csv(&rows),
            "method,image,width,height,aligned,shift_px,psnr_colour_db,ssim_grey,psnr_channels_db,ssim_channels\n\
             \"a \"\"b\"\", c\",x,4,3,no,2.00,inf,inf,inf,0.500000\n\
             d,y,4,3,,,20.0000,0.500000,21.0000,0.500000\n\
             d,z,4,3,yes,0.12,20.0000,0.500000,21.0000,0.500000\n"
        );
    }
}
