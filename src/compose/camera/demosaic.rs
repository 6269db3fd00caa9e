//! Interpolates the two missing colours of each photosite.
//!
//! Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of Bayer-patterned color images", ICASSP 2004.

use glasshouse_line::Mosaic;
use render::trace::Isa;

/// Photosites beyond each border, mirrored at its last photosite, so that their colours continue the pattern.
const BORDER: usize = 2;

/// Returns the three planes of a mosaic. The known colour of each photosite keeps its value.
pub(super) fn demosaic(
    raw: &[f32],
    [width, height]: [usize; 2],
    mosaic: Mosaic,
    isa: Isa,
) -> Vec<f32> {
    let padded = padded(raw, [width, height]);
    let stride = width + 2 * BORDER;
    let mut planes = vec![0.0; 3 * width * height];
    let (red, rest) = planes.split_at_mut(width * height);
    let (green, blue) = rest.split_at_mut(width * height);
    let rows = red.chunks_exact_mut(width).zip(green.chunks_exact_mut(width));
    for (y, ((red, green), blue)) in rows.zip(blue.chunks_exact_mut(width)).enumerate() {
        let row = |k: usize| &padded[(y + k) * stride..][..stride];
        // Each row has green and one of the others: the near one. The far one is in the rows above and below.
        let is_green = [0, 1].map(|x| mosaic.channel(y, x) == 1);
        let has_red = (0..2).any(|x| mosaic.channel(y, x) == 0);
        let (near, far) = if has_red { (red, blue) } else { (blue, red) };
        interpolate_with(isa, [0, 1, 2, 3, 4].map(row), is_green, [near, green, far]);
    }
    planes
}

/// Calls [`interpolate`], compiled for an instruction set. All instruction sets yield the same bits.
fn interpolate_with(isa: Isa, rows: [&[f32]; 5], is_green: [bool; 2], out: [&mut [f32]; 3]) {
    match isa {
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code, reason = "calls code of an instruction set that was detected")]
        Isa::Avx2 | Isa::Avx512 if Isa::Avx2.is_available() => {
            // SAFETY: this machine has AVX2.
            unsafe { interpolate_avx2(rows, is_green, out) }
        }
        _ => interpolate(rows, is_green, out),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn interpolate_avx2(rows: [&[f32]; 5], is_green: [bool; 2], out: [&mut [f32]; 3]) {
    interpolate(rows, is_green, out);
}

/// Interpolates a row. `rows` are the row itself, in the middle, and two rows to each side, with their borders.
#[inline(always)]
fn interpolate(rows: [&[f32]; 5], is_green: [bool; 2], out: [&mut [f32]; 3]) {
    let masks = is_green.map(|green| if green { u32::MAX } else { 0 });
    let [near, green, far] = out;
    let width = near.len();
    let (green, far) = (&mut green[..width], &mut far[..width]);
    // Slices of equal lengths, so that the loop has no checks: by row, then by column.
    let at = |row: usize, column: usize| &rows[row][column..column + width];
    let (above_2, below_2) = (at(0, 2), at(4, 2));
    let [above_left, above, above_right] = [1, 2, 3].map(|column| at(1, column));
    let [below_left, below, below_right] = [1, 2, 3].map(|column| at(3, column));
    let [left_2, left, centre, right, right_2] = [0, 1, 2, 3, 4].map(|column| at(2, column));
    for x in 0..width {
        let value = centre[x];
        let (beside, beside_2) = (left[x] + right[x], left_2[x] + right_2[x]);
        let (upright, upright_2) = (above[x] + below[x], above_2[x] + below_2[x]);
        let diagonal = (above_left[x] + above_right[x]) + (below_left[x] + below_right[x]);
        let mask = masks[x % 2];
        let select = |at_green: f32, at_other: f32| {
            f32::from_bits((at_green.to_bits() & mask) | (at_other.to_bits() & !mask))
        };
        let green_there = (4.0 * value + 2.0 * (beside + upright) - (beside_2 + upright_2)) * 0.125;
        let far_there = (6.0 * value + 2.0 * diagonal - 1.5 * (beside_2 + upright_2)) * 0.125;
        let near_here =
            (5.0 * value + 4.0 * beside - beside_2 + 0.5 * upright_2 - diagonal) * 0.125;
        let far_here =
            (5.0 * value + 4.0 * upright - upright_2 + 0.5 * beside_2 - diagonal) * 0.125;
        near[x] = select(near_here, value);
        green[x] = select(value, green_there);
        far[x] = select(far_here, far_there);
    }
}

/// Returns the mosaic with [`BORDER`] more photosites at each side.
fn padded(raw: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
    // The place that `-k` and `count - 1 + k` mirror; a side of one photosite repeats it.
    let mirrored = |place: usize, count: usize| {
        let place = place.abs_diff(BORDER);
        let last = count - 1;
        if place <= last { place } else { (2 * last).saturating_sub(place) }.min(last)
    };
    let mut padded = Vec::with_capacity((width + 2 * BORDER) * (height + 2 * BORDER));
    for y in 0..height + 2 * BORDER {
        let row = &raw[mirrored(y, height) * width..][..width];
        padded.extend([0, 1].map(|x| row[mirrored(x, width)]));
        padded.extend_from_slice(row);
        padded.extend([2, 3].map(|x| row[mirrored(width + x, width)]));
    }
    padded
}

#[cfg(test)]
mod tests {
    use super::*;
    use safetensors::SafeTensors;

    const ALL: [Mosaic; 4] = [Mosaic::Rggb, Mosaic::Bggr, Mosaic::Grbg, Mosaic::Gbrg];

    fn sampled(colour: impl Fn(usize, usize) -> [f32; 3], size: [usize; 2], m: Mosaic) -> Vec<f32> {
        let [width, height] = size;
        let place = |k: usize| (k / width, k % width);
        (0..width * height)
            .map(|k| colour(place(k).0, place(k).1)[m.channel(place(k).0, place(k).1)])
            .collect()
    }

    #[test]
    fn constants_and_known_colours_stay() {
        for mosaic in ALL {
            for size in [[9, 6], [8, 7], [2, 2], [1, 5], [3, 1]] {
                let raw = sampled(|_, _| [0.5; 3], size, mosaic);
                assert!(
                    demosaic(&raw, size, mosaic, Isa::detect())
                        .iter()
                        .all(|v| (v - 0.5).abs() < 1e-6)
                );
            }
            let size = [12, 10];
            let colour = |y: usize, x: usize| [0, 1, 2].map(|c| ((y * 7 + x * 3 + c) % 11) as f32);
            let raw = sampled(colour, size, mosaic);
            let planes = demosaic(&raw, size, mosaic, Isa::detect());
            for (k, value) in raw.iter().enumerate() {
                let channel = mosaic.channel(k / 12, k % 12);
                assert_eq!(planes[channel * 120 + k], *value);
            }
        }
    }

    /// The filters are exact for colours that differ by constants and vary linearly.
    #[test]
    fn ramps_are_exact_inside() {
        let size = [16, 14];
        let colour = |y: usize, x: usize| {
            let v = 0.02 * y as f32 + 0.03 * x as f32;
            [v + 0.1, v, v + 0.25]
        };
        for mosaic in ALL {
            let planes = demosaic(&sampled(colour, size, mosaic), size, mosaic, Isa::detect());
            for y in 2..12 {
                for x in 2..14 {
                    for (c, expected) in colour(y, x).into_iter().enumerate() {
                        let found = planes[c * 224 + y * 16 + x];
                        // A constant offset of a channel is not seen by its neighbours' Laplacians.
                        assert!((found - expected).abs() < 1e-5, "{mosaic:?} {y} {x} {c}");
                    }
                }
            }
        }
    }
    /// Largest difference from colour-demosaicing inside its border, which continues pictures otherwise.
    fn worst_difference(tensors: &SafeTensors, name: &str, mosaic: Mosaic, raw: &[f32]) -> f32 {
        let expected = tensors.tensor(&format!("{name}.planes")).unwrap();
        let [height, width] = [1, 2].map(|axis| expected.shape()[axis]);
        let planes = demosaic(raw, [width, height], mosaic, Isa::detect());
        let (expected, mut worst) = (floats(expected.data()), 0.0f32);
        for (k, value) in planes.iter().enumerate() {
            let (y, x) = (k % (width * height) / width, k % width);
            if (4..height - 4).contains(&y) && (4..width - 4).contains(&x) {
                worst = worst.max((value - expected[k]).abs());
            }
        }
        worst
    }

    fn floats(bytes: &[u8]) -> Vec<f32> {
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }

    /// `tests/camera/malvar.py` makes the expected numbers with colour-demosaicing, and draws the same charts.
    #[test]
    fn colours_are_those_of_colour_demosaicing() {
        let file = include_bytes!("../../../tests/camera/malvar.safetensors");
        let tensors = SafeTensors::deserialize(file).unwrap();
        let zone_plate = |y: usize, x: usize| {
            let (y, x) = (y as f64, x as f64);
            let phase = std::f64::consts::PI * (x * x + y * y) / 176.0;
            [0, 1, 2].map(|c| (0.5 + 0.4 * libm::cos(phase + 0.5 * f64::from(c))) as f32)
        };
        let slanted_edge = |y: usize, x: usize| {
            let beyond = (x as f64 - 20.0 - 0.0875 * y as f64 + 2.0).clamp(0.0, 1.0);
            [(0.8, 0.1), (0.7, 0.2), (0.2, 0.9)].map(|(a, b)| (a + (b - a) * beyond) as f32)
        };
        let stored = |name: &str| floats(tensors.tensor(&format!("{name}.raw")).unwrap().data());
        for (name, mosaic, drawn) in [
            ("zone_plate", Mosaic::Rggb, sampled(zone_plate, [48, 40], Mosaic::Rggb)),
            ("slanted_edge", Mosaic::Gbrg, sampled(slanted_edge, [40, 48], Mosaic::Gbrg)),
            ("photograph", Mosaic::Grbg, stored("photograph")),
            ("photograph_bggr", Mosaic::Bggr, stored("photograph_bggr")),
        ] {
            for (drawn, stored) in drawn.iter().zip(stored(name)) {
                assert!((drawn - stored).abs() < 1e-6, "{name} is drawn like the script's");
            }
            let worst = worst_difference(&tensors, name, mosaic, &drawn);
            assert!(worst < 1e-6, "{name}: {worst}");
        }
    }

    /// All instruction sets yield the same bits.
    #[test]
    fn instruction_sets_agree() {
        let raw: Vec<f32> = (0..37).map(|k| libm::sinf(k as f32 * 1.7)).collect();
        let rows = [&raw[..33], &raw[1..34], &raw[2..35], &raw[3..36], &raw[4..]];
        let made = [Isa::Baseline, Isa::detect()].map(|isa| {
            let [mut a, mut b, mut c] = [(); 3].map(|()| vec![0.0; 29]);
            interpolate_with(isa, rows, [true, false], [&mut a, &mut b, &mut c]);
            [a, b, c].map(|row| row.iter().map(|v| v.to_bits()).collect::<Vec<u32>>())
        });
        assert_eq!(made[0], made[1]);
    }
}
