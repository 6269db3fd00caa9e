//! The depth of a side's centre, for the focus `front_center` or `back_center`.

/// Returns the mean z of the four centre pixels, m.
///
/// Their columns are `width/2 - 1` and `width/2`, in integer division, and likewise the rows; a single column or row
/// counts twice. The nearest valid pixel, never a filled pixel, replaces a hole. `None` if no pixel is valid.
pub(super) fn front_center_z_m(
    z_m: &[f64],
    valid: &[bool],
    width: usize,
    height: usize,
) -> Option<f64> {
    let mut sum = 0.0;
    for y in [(height / 2).saturating_sub(1), height / 2] {
        for x in [(width / 2).saturating_sub(1), width / 2] {
            sum += z_m[nearest_valid(valid, width, height, x, y)?];
        }
    }
    Some(sum / 4.0)
}

/// Returns the index of the valid pixel nearest to (x0, y0): smallest squared pixel distance, then row, then column.
///
/// Searches square rings of growing radius; no pixel of ring r is nearer than r.
fn nearest_valid(
    valid: &[bool],
    width: usize,
    height: usize,
    x0: usize,
    y0: usize,
) -> Option<usize> {
    let mut best: Option<(usize, usize, usize)> = None;
    for radius in 0..width.max(height) {
        if best.is_some_and(|(squared_px, ..)| squared_px < radius * radius) {
            break;
        }
        let columns = x0.saturating_sub(radius)..=(x0 + radius).min(width - 1);
        let rows = y0.saturating_sub(radius)..=(y0 + radius).min(height - 1);
        let mut look = |x: usize, y: usize| {
            if valid[y * width + x] {
                let key = (x.abs_diff(x0).pow(2) + y.abs_diff(y0).pow(2), y, x);
                best = Some(best.map_or(key, |best| best.min(key)));
            }
        };
        for y in [y0.checked_sub(radius), Some(y0 + radius)].into_iter().flatten() {
            if y < height {
                columns.clone().for_each(|x| look(x, y));
            }
        }
        for x in [x0.checked_sub(radius), Some(x0 + radius)].into_iter().flatten() {
            if x < width {
                rows.clone().for_each(|y| look(x, y));
            }
        }
    }
    best.map(|(_, y, x)| y * width + x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_mean_is_of_the_four_centre_pixels() {
        let z: Vec<f64> = (0..20).map(f64::from).collect();
        // 5x4: columns 1 and 2, rows 1 and 2.
        assert_eq!(front_center_z_m(&z, &[true; 20], 5, 4), Some((6 + 7 + 11 + 12) as f64 / 4.0));
        assert_eq!(front_center_z_m(&[3.5], &[true], 1, 1), Some(3.5));
        assert_eq!(front_center_z_m(&[1.0, 2.0], &[true; 2], 2, 1), Some(1.5));
        assert_eq!(front_center_z_m(&[1.0, 2.0, 4.0], &[true; 3], 1, 3), Some(1.5));
        assert_eq!(front_center_z_m(&z, &[false; 20], 5, 4), None);
    }

    #[test]
    fn ties_go_to_the_upper_row_then_the_left_column() {
        let mut valid = [false; 9];
        for at in [1, 3, 5, 7] {
            valid[at] = true;
        }
        assert_eq!(nearest_valid(&valid, 3, 3, 1, 1), Some(1));
        valid[1] = false;
        assert_eq!(nearest_valid(&valid, 3, 3, 1, 1), Some(3));
        // Both valid pixels are direct neighbours of (1, 0); the upper row wins.
        assert_eq!(nearest_valid(&[true, false, false, true], 2, 2, 1, 0), Some(0));
    }

    proptest! {
        #[test]
        fn agrees_with_brute_force(
            width in 1usize..24, height in 1usize..24, x in 0usize..24, y in 0usize..24,
            seeds in proptest::collection::vec(0usize..576, 0..6),
        ) {
            let (x, y) = (x % width, y % height);
            let mut valid = vec![false; width * height];
            for seed in seeds {
                valid[seed % (width * height)] = true;
            }
            let brute = (0..width * height)
                .filter(|&at| valid[at])
                .min_by_key(|&at| ((at % width).abs_diff(x).pow(2) + (at / width).abs_diff(y).pow(2), at));
            prop_assert_eq!(nearest_valid(&valid, width, height, x, y), brute);
        }
    }
}
