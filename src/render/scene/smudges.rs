//! Patterns of smudges on a pane: decodes maps, and makes marks from a seed.

use super::color;
use super::geometry::pane_axes;
use crate::formats::error::SceneError;
use crate::formats::files::NamedBytes;
use crate::trace::{Smear, Smudges};
use glasshouse_line::hash::{GOLDEN_GAMMA, mix64};
use glasshouse_line::{Orientation, SceneLine, SmudgePattern, Transfer};
use std::sync::Arc;

/// Covered shares, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct SmudgeMap {
    /// Number of texels across.
    pub(super) columns: usize,
    /// Shares from 0 to 1, row by row.
    pub(super) shares: Vec<f32>,
}

/// Decodes a map: the mean of the three channels of a picture with linear codes.
pub(super) fn decode_map(file: &NamedBytes) -> Result<Arc<SmudgeMap>, SceneError> {
    let picture = color::decode(file, Orientation::Upright, Transfer::Linear, [1.0; 3])?;
    let share = |&[r, g, b, _]: &[f32; 4]| (r + g + b) / 3.0;
    let shares: Vec<f32> = picture.radiance.iter().map(share).collect();
    // Three channels of 1 have a mean of 1.
    match shares.iter().position(|share| *share > 1.0) {
        None => Ok(Arc::new(SmudgeMap { columns: picture.width, shares })),
        Some(at) => {
            let (x, y) = (at % picture.width, at / picture.width);
            let found = format!("a share of {} at ({x} px, {y} px)", shares[at]);
            Err(file.wrong_layout(found, "a map of shares from 0 to 1"))
        }
    }
}

/// Places the smudges of a line on its pane; `None` if no light meets them.
///
/// # Panics
///
/// If the line has a map, and `map` is `None`.
pub(super) fn smudges(line: &SceneLine, map: Option<&SmudgeMap>) -> Option<Smudges> {
    let smudges = line.glass.smudges.as_ref()?;
    let smear = Smear {
        roughness: smudges.roughness,
        share: smudges.haze,
        transmittance: smudges.transmittance,
    };
    let (map, texel_m, pivot, repeats) = match smudges.pattern()? {
        SmudgePattern::Marks { seed, coverage, mark_m } => {
            let side_m = mark_m * f64::from(MARKS);
            (&marks(seed, coverage), side_m / f64::from(TEXELS), [0.0; 2], true)
        }
        SmudgePattern::Map { center_m, width_m, .. } => {
            let map = map.expect("the map was decoded with the files of the line");
            let texel_m = width_m / map.columns as f64;
            let rows = map.shares.len() / map.columns;
            let middle = [map.columns, rows].map(|texels| 0.5 * texels as f64 - 0.5);
            let pivot = [0, 1].map(|k| middle[k] - center_m[k] / texel_m);
            (map, texel_m, pivot, false)
        }
    };
    let is_visible = smear.share > 0.0 && map.shares.iter().any(|share| *share > 0.0);
    let axes = pane_axes(line);
    is_visible
        .then(|| Smudges::new(smear, (map.columns, &map.shares), (axes, texel_m, pivot), repeats))
}

/// Number of texels along each side of the pattern of marks, which repeats.
const TEXELS: u32 = 512;
/// Number of the largest marks along a side.
const MARKS: u32 = 8;
/// Number of octaves of noise: the finest has marks of eight texels.
const OCTAVES: u32 = 4;

/// Makes the pattern of marks from value noise: marks are the texels with the largest values, a share `coverage` of all. Over
/// the outer half of this area, the pattern rises from 0 to 1.
fn marks(seed: u64, coverage: f64) -> SmudgeMap {
    let mut heights = vec![0.0f32; (TEXELS * TEXELS) as usize];
    for octave in 0..OCTAVES {
        let step = u64::from(octave).wrapping_mul(GOLDEN_GAMMA);
        add_noise(&mut heights, mix64(seed.wrapping_add(step)), octave);
    }
    let mut ascending: Vec<u32> = (0..TEXELS * TEXELS).collect();
    // The order of equal heights is that of the texels, so that it is the same on every machine.
    ascending.sort_by(|a, b| heights[*a as usize].total_cmp(&heights[*b as usize]));
    let mut shares = vec![0.0; heights.len()];
    let covered = (coverage * heights.len() as f64).round() as usize;
    for (rank, texel) in ascending.into_iter().rev().take(covered).enumerate() {
        let from_edge = (covered - rank) as f64 / covered as f64;
        shares[texel as usize] = (2.0 * from_edge).min(1.0) as f32;
    }
    SmudgeMap { columns: TEXELS as usize, shares }
}

/// Adds an octave of value noise, whose lattice repeats with the pattern.
fn add_noise(heights: &mut [f32], seed: u64, octave: u32) {
    let cells = MARKS << octave;
    let spacing = TEXELS / cells;
    let amplitude = 1.0 / (1 << octave) as f32;
    let at = |i: u32, j: u32| {
        let cell = u64::from(i % cells) | u64::from(j % cells) << 32;
        (mix64(seed ^ mix64(cell.wrapping_add(GOLDEN_GAMMA))) >> 40) as f32 / (1 << 24) as f32
    };
    let smooth = |texel: u32| {
        let t = (texel % spacing) as f32 / spacing as f32;
        t * t * (3.0 - 2.0 * t)
    };
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    for y in 0..TEXELS {
        for x in 0..TEXELS {
            let (i, j, u, v) = (x / spacing, y / spacing, smooth(x), smooth(y));
            let upper = mix(at(i, j), at(i + 1, j), u);
            let lower = mix(at(i, j + 1), at(i + 1, j + 1), u);
            heights[(y * TEXELS + x) as usize] += amplitude * mix(upper, lower, v);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_cover_their_share_and_repeat_without_a_seam() {
        for coverage in [0.0, 0.001, 0.3, 1.0] {
            let map = marks(5, coverage);
            let share = |least: f32| {
                let count = map.shares.iter().filter(|share| **share >= least).count();
                count as f64 / map.shares.len() as f64
            };
            assert!((share(f32::MIN_POSITIVE) - coverage).abs() < 1e-5, "{coverage}");
            assert!((share(1.0) - 0.5 * coverage).abs() < 1e-5, "{coverage}");
        }
        let map = marks(5, 0.5);
        let at = |x: usize, y: usize| map.shares[y % 512 * 512 + x % 512];
        // The steps across the seam are like those inside.
        let most = |x: usize| {
            (0..512)
                .map(move |y| (at(x + 1, y) - at(x, y)).abs().max((at(y, x + 1) - at(y, x)).abs()))
        };
        let inside = (0..511).flat_map(most).fold(0.0, f32::max);
        assert!(most(511).fold(0.0, f32::max) <= inside);
        assert_ne!(map, marks(6, 0.5));
    }

    /// The digest is that of this program: every machine must make the same pattern.
    #[test]
    fn the_pattern_is_pinned() {
        let bytes: Vec<u8> =
            marks(2020, 0.25).shares.iter().flat_map(|share| share.to_le_bytes()).collect();
        assert_eq!(&blake3::hash(&bytes).to_hex()[..16], "a9ddba9c4f457c36");
    }

    #[test]
    fn maps_are_grey_pictures_of_shares() {
        let png = |code: [u8; 3]| {
            let mut bytes = std::io::Cursor::new(vec![]);
            let image = image::RgbImage::from_pixel(3, 2, image::Rgb(code));
            image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
            NamedBytes { path: "map.png".into(), bytes: bytes.into_inner() }
        };
        let map = decode_map(&png([255, 255, 255])).unwrap();
        assert_eq!((map.columns, map.shares.as_slice()), (3, [1.0; 6].as_slice()));
        let map = decode_map(&png([51, 51, 51])).unwrap();
        assert!((map.shares[0] - 0.2).abs() < 1e-6);
        let pfm = b"Pf\n1 1\n-1.0\n\x00\x00\xc0\x3f".to_vec();
        let error = decode_map(&NamedBytes { path: "map.pfm".into(), bytes: pfm }).unwrap_err();
        assert!(
            error.to_string().contains("map.pfm holds a share of 1.5 at (0 px, 0 px)"),
            "{error}"
        );
    }
}
