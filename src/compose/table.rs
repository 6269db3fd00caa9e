//! Tables of mean scores.

use super::align::MAX_ALIGNED_SHIFT_PX;
use super::bootstrap::Interval;
use super::markdown::{escaped, markdown_table};
use super::per_image::Row;
use super::seeds::Spread;
use super::summary::{ALL, INPUT, MethodSummary, Summary};
use std::fmt::Write;

/// The protocols of the scores in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// Kim et al.: PSNR of all channels together, SSIM of grey.
    Paper,
    /// ERRNet: means over the channels.
    Errnet,
    Both,
}

/// Tabulates means by group and method, and the differences to the veil rule. If some pairs are not aligned, appends a
/// line with their names and the tables without them.
pub fn means_tables(
    summaries: &[MethodSummary],
    rows: &[Row],
    veil: Option<&str>,
    protocol: Protocol,
) -> String {
    // The means over seeds stand for the seeds.
    let shown: Vec<&MethodSummary> = summaries.iter().filter(|of| of.seed_of.is_none()).collect();
    let all: Vec<Line> = shown.iter().map(|of| (*of, &of.all)).collect();
    let mut text = tables(&all, veil, protocol);
    let mut shifted: Vec<&str> = Vec::new();
    for row in rows.iter().filter(|row| !row.is_aligned()) {
        if !shifted.contains(&row.image.as_str()) {
            shifted.push(&row.image);
        }
    }
    if shifted.is_empty() {
        return text;
    }
    let aligned: Vec<Line> =
        shown.iter().filter_map(|of| Some((*of, of.aligned.as_ref()?))).collect();
    let _ = write!(
        text,
        "\nThese pairs have a shift of more than {MAX_ALIGNED_SHIFT_PX} px between picture and truth: {}. ",
        shifted.into_iter().map(escaped).collect::<Vec<_>>().join(", ")
    );
    if aligned.iter().all(|(_, summary)| summary.count == 0) {
        text += "No pair is left without them.\n";
    } else {
        let _ = write!(text, "Means without them:\n\n{}", tables(&aligned, veil, protocol));
    }
    text
}

/// A method in a group, and the scores that a table shows.
type Line<'a> = (&'a MethodSummary, &'a Summary);

fn tables(lines: &[Line], veil: Option<&str>, protocol: Protocol) -> String {
    let mut blocks: Vec<&[Line]> = lines.chunk_by(|(a, _), (b, _)| a.group == b.group).collect();
    let counts = |block: &[Line]| block.first().map_or(0, |(_, summary)| summary.count);
    // A group without pictures has no means, and the only group has those of all pictures.
    blocks.retain(|block| block[0].0.group == ALL || counts(block) > 0);
    if let [all, only] = blocks[..]
        && counts(all) == counts(only)
    {
        blocks.truncate(1);
    }
    let mut text = String::new();
    for (place, block) in blocks.iter().enumerate() {
        if blocks.len() > 1 {
            let (gap, count) = (if place > 0 { "\n" } else { "" }, counts(block));
            let plural = if count == 1 { "" } else { "s" };
            let _ =
                write!(text, "{gap}{}: {count} picture{plural}\n\n", escaped(&block[0].0.group));
        }
        text += &scores_table(block, veil, protocol);
    }
    let over_veil = veil.map(|veil| over_veil_table(&blocks, veil)).unwrap_or_default();
    if !over_veil.is_empty() {
        let _ = write!(
            text,
            "\nPSNR minus that of the veil rule, dB: mean and 95 % interval\n\n{over_veil}"
        );
    }
    text
}

/// Tabulates the scores of one group.
fn scores_table(block: &[Line], veil: Option<&str>, protocol: Protocol) -> String {
    let columns_of = |cells: [String; 5]| {
        let [psnr, own, ssim, psnr_channels, ssim_channels] = cells;
        match protocol {
            Protocol::Paper => vec![psnr, own, ssim],
            Protocol::Errnet => vec![psnr_channels, ssim_channels, own],
            Protocol::Both => vec![psnr, own, ssim, psnr_channels, ssim_channels],
        }
    };
    let line = |method: &str, count: String, scores: [String; 5], wins: [String; 2]| {
        let mut cells = vec![escaped(method), count];
        cells.extend(columns_of(scores));
        cells.extend(wins);
        cells
    };
    let head = ["PSNR, dB", "Own factor", "SSIM", "PSNR, channels", "SSIM, channels"];
    let wins = ["Wins", "Over veil"].map(str::to_owned);
    let mut lines = vec![line("Method", "Images".to_owned(), head.map(str::to_owned), wins)];
    for (of, summary) in block {
        let scores = &summary.scores;
        let spread = |value: fn(&Spread) -> f64, digits| {
            let spread = of.spread.as_ref().map(value);
            spread.map(|spread| format!(" ±{spread:.digits$}")).unwrap_or_default()
        };
        let cells = [
            format!("{:.2}{}", scores.psnr_colour_db, spread(|s| s.psnr_colour_db, 2)),
            format!("{:.2}{}", scores.psnr_own_factor_db, spread(|s| s.psnr_own_factor_db, 2)),
            format!("{:.4}{}", scores.ssim_grey, spread(|s| s.ssim_grey, 4)),
            format!("{:.2}", scores.psnr_channels_db),
            format!("{:.4}", scores.ssim_channels),
        ];
        let over_input =
            (of.method != INPUT).then(|| format!("{} / {}", summary.wins, summary.wins_own_factor));
        let over_veil = summary.wins_veil.zip(summary.wins_veil_own_factor);
        let over_veil = over_veil.filter(|_| veil != Some(of.method.as_str()));
        let over_veil = over_veil.map(|(raw, own)| format!("{raw} / {own}"));
        let wins = [over_input, over_veil].map(|wins| wins.unwrap_or_else(|| "-".to_owned()));
        lines.push(line(&of.method, summary.count.to_string(), cells, wins));
    }
    markdown_table(&lines, 1)
}

/// Tabulates the differences to the veil rule of the methods that are neither the rule nor oracles; empty without any.
fn over_veil_table(blocks: &[&[Line]], veil: &str) -> String {
    let head = ["Method", "Group", "PSNR", "After own factor"].map(str::to_owned).to_vec();
    let mut lines = vec![head];
    for (of, summary) in blocks.iter().copied().flatten() {
        if of.method == veil || of.oracle {
            continue;
        }
        if let (Some(raw), Some(own)) = (summary.over_veil_db, summary.over_veil_own_factor_db) {
            lines.push(vec![escaped(&of.method), escaped(&of.group), interval(raw), interval(own)]);
        }
    }
    if lines.len() == 1 { String::new() } else { markdown_table(&lines, 2) }
}

fn interval(Interval { mean, low, high }: Interval) -> String {
    format!("{mean:+.2} [{low:+.2}, {high:+.2}]")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scores, summaries};

    fn row(method: &str, image: &str, shift_px: Option<f64>, psnr_db: f64) -> Row {
        Row {
            method: method.to_owned(),
            oracle: false,
            image: image.to_owned(),
            group: None,
            only_for: None,
            width: 4,
            height: 3,
            shift_px,
            scores: Scores {
                psnr_colour_db: psnr_db,
                psnr_own_factor_db: psnr_db + 0.5,
                ssim_grey: psnr_db / 40.0,
                psnr_channels_db: psnr_db + 1.0,
                ssim_channels: 0.5,
            },
        }
    }

    fn tabulated(rows: &[Row], veil: Option<&str>, protocol: Protocol) -> String {
        let mut text = means_tables(&summaries(rows, veil, &[]), rows, veil, protocol);
        while text.contains("  ") || text.contains("--") {
            text = text.replace("  ", " ").replace("--", "-");
        }
        text.replace(" |", "|").replace("| ", "|")
    }

    const HEAD: &str =
        "|Method|Images|PSNR, dB|Own factor|SSIM|Wins|Over veil|\n|-|-:|-:|-:|-:|-:|-:|\n";

    #[test]
    fn means_are_by_method() {
        let rows = [
            row("input", "b", None, 10.0),
            row("input", "a", None, 10.0),
            row("ou|rs", "b", Some(0.5), 20.0),
            row("ou|rs", "a", Some(1.5), 30.0),
        ];
        let paper = tabulated(&rows, None, Protocol::Paper);
        let expected = "|input|2|10.00|10.50|0.2500|-|-|\n|ou\\|rs|2|25.00|25.50|0.6250|2 / 2|-|\n";
        assert_eq!(paper, format!("{HEAD}{expected}"));
        let both = tabulated(&rows, None, Protocol::Both);
        assert!(both.ends_with("|ou\\|rs|2|25.00|25.50|0.6250|26.00|0.5000|2 / 2|-|\n"), "{both}");
        let errnet = tabulated(&rows, None, Protocol::Errnet);
        assert!(errnet.ends_with("|ou\\|rs|2|26.00|0.5000|25.50|2 / 2|-|\n"), "{errnet}");
    }

    #[test]
    fn groups_have_blocks_and_differences_to_the_veil_rule() {
        let mut rows = Vec::new();
        for (method, psnr_db) in [("input", 10.0), ("veil", 11.0), ("net", 12.0), ("best", 13.0)] {
            for (image, group) in [("1", "a"), ("2", "a"), ("3", "b")] {
                let (group, oracle) = (Some(group.to_owned()), method == "best");
                rows.push(Row { oracle, group, ..row(method, image, None, psnr_db) });
            }
        }
        let text = tabulated(&rows, Some("veil"), Protocol::Paper);
        let blocks: Vec<&str> = text.split(HEAD).collect();
        assert_eq!(blocks.len(), 4, "{text}");
        assert_eq!(blocks[0], "all: 3 pictures\n\n");
        assert!(
            blocks[1].ends_with("|best|3|13.00|13.50|0.3250|3 / 3|3 / 3|\n\na: 2 pictures\n\n"),
            "{text}"
        );
        assert!(blocks[2].ends_with("\n\nb: 1 picture\n\n"), "{text}");
        let over = blocks[3].split("95 % interval\n\n").nth(1).unwrap();
        assert_eq!(over.lines().count(), 2 + 2 * 3, "{over}");
        assert!(over.contains("|net|b|+1.00 [+1.00, +1.00]|+1.00 [+1.00, +1.00]|\n"), "{over}");
        // One group of all pictures needs no block of its own.
        rows.retain(|row| row.group.as_deref() == Some("a"));
        assert_eq!(tabulated(&rows, None, Protocol::Paper).matches(HEAD).count(), 1);
    }

    #[test]
    fn a_second_table_leaves_shifted_pairs_out() {
        let rows = [row("ours", "b", Some(0.5), f64::INFINITY), row("ours", "a", Some(9.0), 30.0)];
        let text = tabulated(&rows, None, Protocol::Paper);
        assert_eq!(text.matches(HEAD).count(), 2);
        assert!(text.contains("|ours|2|inf|"), "{text}");
        assert!(text.contains("|ours|1|inf|"), "{text}");
        assert!(text.contains("more than 1.5 px between picture and truth: a. Means"));
        assert_eq!(tabulated(&[], None, Protocol::Paper), "");
        let text = tabulated(&rows[1..], None, Protocol::Paper);
        assert!(text.ends_with(": a. No pair is left without them.\n"), "{text}");
    }
}
