//! Scores and shifts of published pictures, against numbers that other programs measured (`index.csv` beside them).

use super::{read_picture, score, shift_px};
use std::path::Path;

#[test]
fn published_pairs_have_their_scores_and_shifts() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/reflection");
    let Ok(index) = std::fs::read_to_string(root.join("index.csv")) else {
        println!("skipped: no {}", root.display());
        return;
    };
    let mut lines = index.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut pair_count = 0;
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let cell = |name: &str| cells[names.iter().position(|n| *n == name).unwrap()];
        let number = |name: &str| cell(name).parse::<f64>().unwrap();
        if cell("transmission").is_empty() {
            continue;
        }
        let blended = read_picture(&root.join(cell("blended"))).unwrap();
        let transmission = read_picture(&root.join(cell("transmission"))).unwrap();
        let found = score(&blended, &transmission).unwrap();
        let shift = shift_px(&blended, &transmission).unwrap();
        println!(
            "{} {:.5} dB {:.6}, {:.2} {:.2} px, peak {:.2}",
            cell("id"),
            found.psnr_colour_db,
            found.ssim_grey,
            shift.across,
            shift.down,
            shift.peak
        );
        // PNG files to the digits that are printed. JPEG decoders round differently and scale colours up differently: pixels
        // of ours and of libjpeg differ by some codes at coloured edges.
        let is_png = cell("blended").ends_with(".png");
        let (psnr_near_db, ssim_near) = if is_png {
            (0.00501, 0.0000501)
        } else {
            (0.012, 0.00012)
        };
        let psnr_off = (found.psnr_colour_db - number("input_psnr_rgb")).abs();
        let ssim_off = (found.ssim_grey - number("input_ssim_gray")).abs();
        assert!(psnr_off <= psnr_near_db && ssim_off <= ssim_near, "{line}");
        assert_eq!(shift.is_aligned(), cell("aligned") == "yes", "{line}");
        // Their estimator finds fractions of a pixel in another way, and prints tenths.
        let off = [
            shift.across - number("shift_x"),
            shift.down - number("shift_y"),
        ];
        assert!(off.iter().all(|d| d.abs() < 0.25), "{line}");
        pair_count += 1;
    }
    assert!(pair_count > 0);
}
