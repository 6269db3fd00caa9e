//! Scores of single pictures as rows, and as a CSV file.

use super::align::MAX_ALIGNED_SHIFT_PX;
use super::score::Scores;
use super::summary::ALL;
use std::fmt::Write;

/// One picture's scores by one method.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name of the method; `input` for the unprocessed picture.
    pub method: String,
    /// True if the method knows the truth.
    pub oracle: bool,
    pub image: String,
    /// Group of the picture, if it has one.
    pub group: Option<String>,
    /// The only group whose means contain this row; `None` for the group of all pictures and the picture's own.
    pub only_for: Option<String>,
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

    /// True if the means of the group contain this row.
    pub(super) fn counts_for(&self, group: &str) -> bool {
        match &self.only_for {
            Some(only_for) => only_for == group,
            None => group == ALL || self.group.as_deref() == Some(group),
        }
    }
}

/// Formats all rows as CSV. The PSNR of equal pictures is `inf`; cells of unmeasured shifts are empty. The cell of the
/// group is that of the picture, or the only group for which the row counts.
pub fn per_image_csv(rows: &[Row]) -> String {
    let mut text = "method,group,image,width,height,aligned,shift_px,psnr_colour_db,psnr_own_factor_db,ssim_grey,psnr_channels_db,ssim_channels\n".to_owned();
    for row in rows {
        let (aligned, shift_px) = match row.shift_px {
            Some(shift) if row.is_aligned() => ("yes", format!("{shift:.2}")),
            Some(shift) => ("no", format!("{shift:.2}")),
            None => ("", String::new()),
        };
        let group = row.only_for.as_ref().or(row.group.as_ref());
        let _ = writeln!(
            text,
            "{},{},{},{},{},{aligned},{shift_px},{:.4},{:.4},{:.6},{:.4},{:.6}",
            quoted(&row.method),
            quoted(group.map_or("", String::as_str)),
            quoted(&row.image),
            row.width,
            row.height,
            row.scores.psnr_colour_db,
            row.scores.psnr_own_factor_db,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_has_every_picture() {
        let row = |method: &str, image: &str, shift_px, psnr_db| Row {
            method: method.to_owned(),
            oracle: false,
            image: image.to_owned(),
            group: (image == "z").then(|| "last, not least".to_owned()),
            only_for: (method == "e").then(|| ALL.to_owned()),
            width: 4,
            height: 3,
            shift_px,
            scores: Scores {
                psnr_colour_db: psnr_db,
                psnr_own_factor_db: psnr_db + 0.5,
                ssim_grey: 0.25,
                psnr_channels_db: psnr_db + 1.0,
                ssim_channels: 0.5,
            },
        };
        let rows = [
            row("a \"b\", c", "x", Some(2.0), f64::INFINITY),
            row("d", "y", None, 20.0),
            row("d", "z", Some(0.123), 20.0),
            row("e", "z", None, 20.0),
        ];
        assert_eq!(
            per_image_csv(&rows),
            "method,group,image,width,height,aligned,shift_px,psnr_colour_db,psnr_own_factor_db,ssim_grey,psnr_channels_db,ssim_channels\n\
             \"a \"\"b\"\", c\",,x,4,3,no,2.00,inf,inf,0.250000,inf,0.500000\n\
             d,,y,4,3,,,20.0000,20.5000,0.250000,21.0000,0.500000\n\
             d,\"last, not least\",z,4,3,yes,0.12,20.0000,20.5000,0.250000,21.0000,0.500000\n\
             e,all,z,4,3,,,20.0000,20.5000,0.250000,21.0000,0.500000\n"
        );
        assert!(rows[2].counts_for("all") && rows[2].counts_for("last, not least"));
        assert!(!rows[1].counts_for("last, not least"));
        assert!(rows[3].counts_for("all") && !rows[3].counts_for("last, not least"));
    }
}
