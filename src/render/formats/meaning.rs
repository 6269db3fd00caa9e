//! The meaning of the codes of a PNG or JPEG file: what its chunks and its ICC profile say.

use super::color_space::{ColorSpace, Curve, REC709};
use super::icc::{self, ColorError};
use super::png_chunks::PngChunks;

/// Chromaticities of white, red, green and blue of ITU-R BT.2020 and of Display P3.
const BT2020: [[f64; 2]; 4] = [[0.3127, 0.3290], [0.708, 0.292], [0.170, 0.797], [0.131, 0.046]];
const DISPLAY_P3: [[f64; 2]; 4] =
    [[0.3127, 0.3290], [0.680, 0.320], [0.265, 0.690], [0.150, 0.060]];
/// Chromaticities of ITU-R BT.601 with 625 and with 525 lines.
const BT601_625: [[f64; 2]; 4] = [[0.3127, 0.3290], [0.64, 0.33], [0.29, 0.60], [0.15, 0.06]];
const BT601_525: [[f64; 2]; 4] = [[0.3127, 0.3290], [0.630, 0.340], [0.310, 0.595], [0.155, 0.070]];

/// The curve of ITU-R BT.709, BT.601 and BT.2020: H.273, table 3, inverted.
const BT709: Curve = Curve::Parametric {
    g: 1.0 / 0.45,
    a: 1.0 / 1.099,
    b: 0.099 / 1.099,
    c: 1.0 / 4.5,
    d: 0.081,
    e: 0.0,
    f: 0.0,
};

/// Code point of H.273 for "unspecified", in each of its tables.
const UNSPECIFIED: u8 = 2;

/// Returns the colour space of a PNG with `channels` channels; none, if it is sRGB or not stated. As in the PNG
/// standard, cICP comes before iCCP, iCCP before sRGB, and sRGB before gAMA and cHRM. `icc` is the contents of iCCP.
pub(super) fn of_png(
    chunks: &PngChunks<'_>,
    icc: Option<&[u8]>,
    channels: usize,
) -> Result<Option<ColorSpace>, ColorError> {
    if let Some(points) = chunks.cicp
        && !is_unspecified(points)
    {
        return of_cicp(points);
    }
    if chunks.has_icc {
        return icc::read(icc.ok_or(ColorError::Damaged)?, channels);
    }
    if chunks.is_srgb || (chunks.gamma.is_none() && chunks.chromaticities.is_none()) {
        return Ok(None);
    }
    let curve = match chunks.gamma {
        // The value that the standard prescribes beside sRGB, with rounding.
        None | Some(45_454..=45_456) => Curve::Srgb,
        Some(0) => return Err(ColorError::Chunk("gAMA", "is 0".to_owned())),
        Some(gamma) => Curve::Power(100_000.0 / f64::from(gamma)),
    };
    let chromaticities = match chunks.chromaticities {
        None => REC709,
        Some(all) => {
            let all = all.map(|v| f64::from(v) / 100_000.0);
            let points = [0, 2, 4, 6].map(|k| [all[k], all[k + 1]]);
            if !is_triangle(points) {
                let text = "states primaries that no display has".to_owned();
                return Err(ColorError::Chunk("cHRM", text));
            }
            points
        }
    };
    Ok(ColorSpace::of_primaries(curve, chromaticities))
}

/// True if the white lies inside of the triangle of the primaries, and no y is 0.
fn is_triangle([white, red, green, blue]: [[f64; 2]; 4]) -> bool {
    let side = |a: [f64; 2], b: [f64; 2]| {
        (b[0] - a[0]) * (white[1] - a[1]) - (b[1] - a[1]) * (white[0] - a[0])
    };
    let sides = [side(red, green), side(green, blue), side(blue, red)];
    let inside = sides.iter().all(|s| *s > 1e-4) || sides.iter().all(|s| *s < -1e-4);
    inside && [white, red, green, blue].iter().all(|point| point[1] > 0.0)
}

/// True if code points state nothing about the colours, as programs write them that do not know.
fn is_unspecified([primaries, transfer, matrix, full_range]: [u8; 4]) -> bool {
    let is_rgb = matches!((matrix, full_range), (0 | UNSPECIFIED, 1));
    primaries == UNSPECIFIED && transfer == UNSPECIFIED && is_rgb
}

/// Reads code points of ITU-T H.273: primaries, transfer, matrix, full range.
fn of_cicp(points: [u8; 4]) -> Result<Option<ColorSpace>, ColorError> {
    let [primaries, transfer, matrix, full_range] = points;
    let unknown = |what: &str, code: u8, names: &str| {
        Err(ColorError::Chunk("cICP", format!("states the {what} {code}{names}")))
    };
    let chromaticities = match primaries {
        1 | UNSPECIFIED => REC709,
        5 => BT601_625,
        // 7, SMPTE ST 240, has the primaries of 6.
        6 | 7 => BT601_525,
        9 => BT2020,
        12 => DISPLAY_P3,
        code => return unknown("primaries", code, ""),
    };
    let curve = match transfer {
        1 | 6 | 14 | 15 => BT709,
        4 => Curve::Power(2.2),
        5 => Curve::Power(2.8),
        8 => Curve::Power(1.0),
        13 | UNSPECIFIED => Curve::Srgb,
        16 => return unknown("transfer", 16, " (PQ), whose values are absolute"),
        18 => return unknown("transfer", 18, " (HLG), whose values depend on the display"),
        code => return unknown("transfer", code, ""),
    };
    match (matrix, full_range) {
        (0 | UNSPECIFIED, 1) => Ok(ColorSpace::of_primaries(curve, chromaticities)),
        (0 | UNSPECIFIED, _) => unknown("range", full_range, " (codes of video)"),
        _ => unknown("matrix", matrix, ", but codes of a PNG are RGB"),
    }
}

/// Returns the colour space of a JPEG with `components` components; none, if it is sRGB or not stated. `claims_icc`:
/// the file has segments of a profile.
pub(super) fn of_jpeg(
    icc: Option<&[u8]>,
    claims_icc: bool,
    components: usize,
) -> Result<Option<ColorSpace>, ColorError> {
    match icc {
        None if claims_icc => Err(ColorError::Damaged),
        None => Ok(None),
        Some(_) if components == 4 => Err(ColorError::Cmyk),
        Some(icc) => icc::read(icc, components),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_count_in_the_order_of_the_standard() {
        let read = |chunks: &PngChunks<'_>| of_png(chunks, None, 3);
        let p3 = read(&PngChunks { cicp: Some([12, 13, 0, 1]), ..PngChunks::default() });
        assert_eq!(p3, Ok(ColorSpace::of_primaries(Curve::Srgb, DISPLAY_P3)));
        assert!(p3.unwrap().is_some());
        let both = PngChunks { cicp: Some([1, 13, 0, 1]), has_icc: true, ..PngChunks::default() };
        assert_eq!(read(&both), Ok(None));
        let srgb = PngChunks { is_srgb: true, gamma: Some(100_000), ..PngChunks::default() };
        assert_eq!(read(&srgb), Ok(None));
        let damaged = PngChunks { has_icc: true, is_srgb: true, ..PngChunks::default() };
        assert_eq!(read(&damaged), Err(ColorError::Damaged));
    }

    /// Frames of video have the curve of BT.709; 2 states nothing, and the next chunk counts.
    #[test]
    fn code_points_of_video_are_those_of_h273() {
        let curve =
            |v: f64| if v < 0.081 { v / 4.5 } else { ((v + 0.099) / 1.099).powf(1.0 / 0.45) };
        for transfer in [1, 6, 14, 15] {
            let space = of_cicp([1, transfer, 0, 1]).unwrap().unwrap();
            let [red, ..] = space.tables(255);
            for (code, value) in red.iter().enumerate() {
                assert!((value - curve(code as f64 / 255.0)).abs() < 1e-12, "{code}");
            }
        }
        // White stays white, and the primaries differ from those of sRGB.
        for primaries in [5, 6, 7] {
            let space = of_cicp([primaries, 13, 0, 1]).unwrap().unwrap();
            let white = space.rec709([1.0; 3]);
            assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-9), "{white:?}");
        }
        assert_eq!(of_cicp([6, 1, 0, 1]), of_cicp([7, 6, 0, 1]));
        assert_ne!(of_cicp([5, 1, 0, 1]), of_cicp([6, 1, 0, 1]));
        let read = |cicp, gamma| {
            of_png(&PngChunks { cicp: Some(cicp), gamma, ..PngChunks::default() }, None, 3).unwrap()
        };
        let linear = ColorSpace::of_grey(Curve::Power(1.0));
        for nothing in [[2, 2, 0, 1], [2, 2, 2, 1]] {
            assert_eq!(read(nothing, Some(100_000)), linear);
            assert_eq!(read(nothing, None), None);
        }
        // What is stated counts beside what is not.
        assert_eq!(read([2, 8, 0, 1], None), linear);
        assert_eq!(read([9, 2, 0, 1], None), of_cicp([9, 13, 0, 1]).unwrap());
    }

    #[test]
    fn gamma_and_primaries_are_converted() {
        let read = |gamma, chromaticities| {
            of_png(&PngChunks { gamma, chromaticities, ..PngChunks::default() }, None, 3)
        };
        let rec709 = [31_270, 32_900, 64_000, 33_000, 30_000, 60_000, 15_000, 6_000];
        assert_eq!(read(Some(45_455), Some(rec709)), Ok(None));
        assert_eq!(read(None, Some(rec709)), Ok(None));
        let linear = read(Some(100_000), None).unwrap();
        assert_eq!(linear, ColorSpace::of_grey(Curve::Power(1.0)));
        let wide = [31_270, 32_900, 68_000, 32_000, 26_500, 69_000, 15_000, 6_000];
        let p3 = read(None, Some(wide)).unwrap();
        assert_eq!(p3, ColorSpace::of_primaries(Curve::Srgb, DISPLAY_P3));
        assert!(read(Some(0), None).is_err());
        for broken in [[0; 8], [31_270, 32_900, 64_000, 33_000, 64_000, 33_000, 15_000, 6_000]] {
            assert!(read(None, Some(broken)).is_err());
        }
    }

    #[test]
    fn unknown_code_points_are_refused_by_name() {
        for (points, words) in [
            ([9, 16, 0, 1], "the transfer 16 (PQ)"),
            ([9, 18, 0, 1], "the transfer 18 (HLG)"),
            ([1, 7, 0, 1], "the transfer 7"),
            ([10, 13, 0, 1], "the primaries 10"),
            ([2, 2, 0, 0], "the range 0"),
            ([1, 13, 1, 1], "the matrix 1"),
            ([1, 13, 0, 0], "the range 0"),
        ] {
            let error = of_cicp(points).unwrap_err().to_string();
            assert!(
                error.contains(words) && error.ends_with("convert the picture to sRGB"),
                "{error}"
            );
        }
    }
}
