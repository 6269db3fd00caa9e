//! Compares pairs, scores and shifts of published pictures with measurements by other programs (`index.csv`).

#![allow(clippy::print_stdout, reason = "prints measurements and skipped tests")]

use super::{find_pairs, read_picture, score, shift_px};
use image::ImageFormat;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Returns the folder, and the index rows with a ground truth as maps from column to value; `None` without an index.
fn published() -> Option<(PathBuf, Vec<HashMap<String, String>>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/reflection");
    let Ok(index) = std::fs::read_to_string(root.join("index.csv")) else {
        println!("skipped: no {}", root.display());
        return None;
    };
    let mut lines = index.lines().map(|line| line.split(',').map(str::to_owned));
    let names: Vec<String> = lines.next().unwrap().collect();
    let rows: Vec<HashMap<String, String>> = lines
        .map(|cells| names.iter().cloned().zip(cells).collect())
        .filter(|row: &HashMap<_, _>| !row["transmission"].is_empty())
        .collect();
    assert!(!rows.is_empty());
    Some((root, rows))
}

#[test]
fn published_pairs_are_found() {
    let Some((root, rows)) = published() else {
        return;
    };
    let found = find_pairs(&root).unwrap();
    assert_eq!(found.pairs.len(), rows.len());
    for row in rows {
        let blended = root.join(&row["blended"]);
        let pair = found.pairs.iter().find(|pair| pair.blended == blended);
        let pair = pair.unwrap();
        assert_eq!(pair.transmission, root.join(&row["transmission"]));
        assert_eq!(pair.reflection.is_some(), !row["reflection"].is_empty());
        assert!(pair.name.starts_with(&row["group"]), "{}", pair.name);
    }
    for (path, reason) in &found.left_out {
        assert!(
            path.starts_with(root.join("ceilnet_real_inputs_only"))
                && reason.contains("no transmission"),
            "{} {reason}",
            path.display()
        );
    }
}

#[test]
fn scores_and_shifts_of_published_pairs_match_the_index() {
    let Some((root, rows)) = published() else {
        return;
    };
    for row in rows {
        let number = |name: &str| row[name].parse::<f64>().unwrap();
        let blended = read_picture(&root.join(&row["blended"])).unwrap();
        let transmission = read_picture(&root.join(&row["transmission"])).unwrap();
        let found = score(&blended, &transmission).unwrap();
        let shift = shift_px(&blended, &transmission).unwrap();
        println!(
            "{} {:.5} dB {:.6}, {:.2} {:.2} px, peak {:.2}",
            row["id"], found.psnr_colour_db, found.ssim_grey, shift.across, shift.down, shift.peak
        );
        // PNG files agree to the printed digits. JPEG decoders differ in rounding and chroma upsampling, so pixels at
        // coloured edges differ by some levels.
        let format = ImageFormat::from_path(&row["blended"]).unwrap();
        let (psnr_near_db, ssim_near) =
            if format == ImageFormat::Png { (0.00501, 0.0000501) } else { (0.012, 0.00012) };
        let psnr_off = (found.psnr_colour_db - number("input_psnr_rgb")).abs();
        let ssim_off = (found.ssim_grey - number("input_ssim_gray")).abs();
        assert!(psnr_off <= psnr_near_db && ssim_off <= ssim_near, "{}", row["id"]);
        assert_eq!(shift.is_aligned(), row["aligned"] == "yes", "{}", row["id"]);
        // The other program interpolates shifts differently and prints one decimal.
        let off = [shift.across - number("shift_x"), shift.down - number("shift_y")];
        assert!(off.iter().all(|d| d.abs() < 0.25), "{}", row["id"]);
    }
}
