//! Draws noise maps and their colour scale.

use crate::plot::{Axis, PAPER_SYMBOLS, plot};
use glasshouse_line::layer::Layer;
use image::{Rgb, RgbImage, imageops};
use maud::{Markup, html};
use render::merge::NoiseMap;

/// Errors at the ends of the colour scale, linear radiance. They are fixed, so that pages can be compared.
pub(super) const ENDS: [f64; 2] = [1e-5, 1e-1];
/// Number of colour steps. Pictures take fewer bytes than with a smooth scale and look the same.
const LEVELS: f64 = 48.0;
/// Maximum side of each map in a picture of several layers, px.
const PART_PX: u32 = 128;
/// Maximum side of a single map, px.
const ONLY_PX: u32 = 256;
const GAP: u32 = 2;

/// Viridis (Smith and van der Walt): perceptually uniform, readable with colour blindness.
const COLOURS: [[u8; 3]; 9] = [
    [0x44, 0x01, 0x54],
    [0x47, 0x2d, 0x7b],
    [0x3b, 0x52, 0x8b],
    [0x2c, 0x72, 0x8e],
    [0x21, 0x91, 0x8c],
    [0x28, 0xae, 0x80],
    [0x5e, 0xc9, 0x62],
    [0xad, 0xdc, 0x30],
    [0xfd, 0xe7, 0x25],
];

/// Draws one picture of all noise maps that are not empty, two per row. Also returns the symbols of their layers, in
/// order.
pub(super) fn noise_picture(map: &NoiseMap) -> (RgbImage, Vec<&'static str>) {
    let mut made = Layer::ALL.to_vec();
    made.retain(|&layer| !map.layers[layer].is_empty());
    let most = if made.len() > 1 { PART_PX } else { ONLY_PX };
    let parts: Vec<RgbImage> =
        made.iter().map(|&layer| part(&map.layers[layer], [map.width, map.height], most)).collect();
    let [width, height] = parts.first().map_or([1, 1], |p| [p.width(), p.height()]);
    let columns = parts.len().clamp(1, 2) as u32;
    let rows = (parts.len() as u32).div_ceil(columns).max(1);
    let side = |count: u32, size: u32| count * size + (count - 1) * GAP;
    let grey = Rgb([0x80; 3]);
    let mut picture = RgbImage::from_pixel(side(columns, width), side(rows, height), grey);
    for (k, part) in parts.iter().enumerate() {
        let (x, y) = (k as u32 % columns, k as u32 / columns);
        let (x, y) = (x * (width + GAP), y * (height + GAP));
        imageops::replace(&mut picture, part, x.into(), y.into());
    }
    let symbols = made.into_iter().map(|k| PAPER_SYMBOLS[k]);
    (picture, symbols.collect())
}

/// Draws the map of one layer. A pixel of a smaller picture is the RMS of the values that it covers.
fn part(values: &[f32], [width, height]: [u32; 2], most: u32) -> RgbImage {
    let longest = width.max(height).max(1);
    let side = |side: u32| {
        if longest <= most {
            side
        } else {
            (u64::from(side) * u64::from(most) / u64::from(longest)).max(1) as u32
        }
    };
    let (columns, rows) = (side(width), side(height));
    // The picture is never larger than the map, so every pixel covers at least one value.
    let cells = |cell: u32, cells: u32, size: u32| {
        let end = |cell: u32| (u64::from(cell) * u64::from(size) / u64::from(cells)) as usize;
        end(cell)..end(cell + 1)
    };
    RgbImage::from_fn(columns, rows, |x, y| {
        let (mut sum, mut count) = (0.0, 0.0);
        for row in cells(y, rows, height) {
            for column in cells(x, columns, width) {
                let value = f64::from(values[row * width as usize + column]);
                sum += value * value;
                count += 1.0;
            }
        }
        Rgb(colour(f64::max(sum / count, 0.0).sqrt()))
    })
}

/// Returns the colour of an error.
fn colour(error: f64) -> [u8; 3] {
    let place = libm::log10(error / ENDS[0]) / libm::log10(ENDS[1] / ENDS[0]);
    // The logarithm of 0 is minus infinity, not NaN, so an error of 0 takes the lower end.
    at((place.clamp(0.0, 1.0) * LEVELS).round() / LEVELS)
}

/// Returns the colour at a position between the ends, 0 to 1.
fn at(place: f64) -> [u8; 3] {
    let scaled = place * (COLOURS.len() - 1) as f64;
    let below = (scaled as usize).min(COLOURS.len() - 2);
    let share = scaled - below as f64;
    [0, 1, 2].map(|c| {
        let [a, b] = [COLOURS[below][c], COLOURS[below + 1][c]].map(f64::from);
        (a + (b - a) * share).round() as u8
    })
}

/// Draws the colour scale with its unit.
pub(super) fn scale() -> Markup {
    const SIZE: [f64; 2] = [460.0, 56.0];
    let label = format!(
        "Colours of the noise maps: from {:e} (dark violet) to {:e} (yellow), logarithmic",
        ENDS[0], ENDS[1]
    );
    let axis = Axis::log_between(ENDS, [18.0, SIZE[0] - 24.0]);
    let [left, right] = axis.ends;
    let content = html! {
        defs { linearGradient #viridis {
            @for (k, [r, g, b]) in COLOURS.iter().enumerate() {
                stop offset=(k as f64 / (COLOURS.len() - 1) as f64) stop-color=(format_args!("#{r:02x}{g:02x}{b:02x}")) {}
            }
        } }
        rect x=(left) y="2" width=(right - left) height="12" fill="url(#viridis)" {}
        @for tick in axis.ticks() {
            path d=(format_args!("M{:.1} 14v4", tick.at)) stroke="currentColor" {}
            text x=(format_args!("{:.1}", tick.at)) y="33" text-anchor="middle" { (tick.label) }
        }
        text x=(right) y="52" text-anchor="end" { "estimated RMS error of a pixel, linear radiance (white is 1)" }
    };
    plot(SIZE, &label, &content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::layer::PerLayer;

    #[test]
    fn colours_follow_the_error() {
        assert_eq!(colour(0.0), COLOURS[0]);
        assert_eq!(colour(1e-7), COLOURS[0]);
        assert_eq!(colour(1e-3), COLOURS[4]);
        assert_eq!(colour(0.1), COLOURS[8]);
        assert_eq!(colour(7.0), COLOURS[8]);
        let brightness = |e: f64| colour(e).map(u32::from).iter().sum::<u32>();
        assert!(brightness(1e-4) < brightness(1e-3) && brightness(1e-3) < brightness(1e-2));
        let scale = scale().into_string();
        assert!(scale.contains("linear radiance") && scale.matches("<text").count() == 6);
    }

    #[test]
    fn one_picture_has_the_maps_of_all_layers() {
        let layer = |value: f32| vec![value; 512 * 256];
        let mut map = NoiseMap {
            width: 512,
            height: 256,
            layers: PerLayer([layer(1e-3), layer(1e-4), layer(1e-2), layer(0.0)]),
        };
        let (picture, symbols) = noise_picture(&map);
        assert_eq!(picture.dimensions(), (258, 130));
        assert_eq!(symbols, ["I", "T", "R\u{303}", "R"]);
        assert_eq!(picture.get_pixel(5, 5).0, colour(1e-3));
        assert_eq!(picture.get_pixel(200, 5).0, colour(f64::from(1e-4f32)));
        assert_eq!(picture.get_pixel(200, 120).0, COLOURS[0]);
        map.layers[Layer::Input].clear();
        map.layers[Layer::CleanReflection].clear();
        let (picture, symbols) = noise_picture(&map);
        assert_eq!((picture.dimensions(), symbols), ((258, 64), vec!["T", "R\u{303}"]));
        map.layers[Layer::Transmission].clear();
        assert_eq!(noise_picture(&map).0.dimensions(), (256, 128));
        // The map is thin, and its width is no multiple of the picture's width.
        let odd = part(&vec![1e-3; 131 * 3], [131, 3], 128);
        assert_eq!(odd.dimensions(), (128, 2));
        assert!(odd.pixels().all(|p| p.0 == colour(f64::from(1e-3f32))));
    }
}
