//! Compares two files of a tuple, or two partials: first their bytes, then their pixels or fields, so that the user can
//! judge the difference.

use render::formats::decode_exr_channels;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeSet;

/// Difference of two files with different bytes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct FileDifference {
    /// Key of the file in the store.
    pub(crate) file: String,
    /// Workers that made the file: the maker that a partial names, or those of the tuple's receipts. Empty if unknown.
    pub(crate) made_by: BTreeSet<String>,
    /// Number of differing pixels, for an image.
    pub(crate) pixels: Option<u64>,
    /// Number of all pixels, for an image.
    pub(crate) of_pixels: Option<u64>,
    /// Largest difference of a channel: linear radiance in an EXR, 8-bit steps in a PNG; `f64::MAX` if not finite.
    pub(crate) largest: Option<f64>,
    /// Position of the largest difference, `[x, y]`, px.
    pub(crate) at: Option<[u32; 2]>,
    /// Description of a difference without numbers.
    pub(crate) note: String,
}

/// A decoded image with interleaved channels.
struct Pixels {
    width: usize,
    height: usize,
    channels: usize,
    values: Vec<f32>,
}

/// Largest number of JSON fields to name.
const FIELDS_NAMED: usize = 8;

/// Compares the bytes `stored` under `file` with the bytes `made` now; returns `None` if they are equal. The caller fills
/// in `made_by`.
pub(crate) fn compare(file: &str, made: &[u8], stored: &[u8]) -> Option<FileDifference> {
    if made == stored {
        return None;
    }
    let mut difference = FileDifference {
        file: file.to_owned(),
        made_by: BTreeSet::new(),
        pixels: None,
        of_pixels: None,
        largest: None,
        at: None,
        note: String::new(),
    };
    let decode = match file.rsplit('.').next() {
        Some("exr") => decode_exr,
        Some("png") => decode_png,
        _ => {
            difference.note = fields(made, stored);
            return Some(difference);
        }
    };
    match (decode(made), decode(stored)) {
        (Ok(made), Ok(stored)) => images(&mut difference, &made, &stored),
        (_, Err(reason)) => difference.note = format!("it cannot be read: {reason}"),
        (Err(reason), _) => difference.note = format!("the new file cannot be read: {reason}"),
    }
    Some(difference)
}

fn images(difference: &mut FileDifference, made: &Pixels, stored: &Pixels) {
    let shape = |p: &Pixels| (p.width, p.height, p.channels);
    if shape(made) != shape(stored) {
        difference.note = format!(
            "it has {} x {} px and {} channels instead of {} x {} and {}",
            stored.width, stored.height, stored.channels, made.width, made.height, made.channels
        );
        return;
    }
    let (mut count, mut largest, mut at) = (0, 0.0, 0);
    let rows = made.values.chunks(made.channels.max(1));
    for (index, (a, b)) in rows.zip(stored.values.chunks(made.channels.max(1))).enumerate() {
        let pairs = || a.iter().zip(b).filter(|(a, b)| a.to_bits() != b.to_bits());
        if pairs().next().is_none() {
            continue;
        }
        count += 1;
        // NaN and infinities count as the largest possible difference.
        let off = pairs().map(|(a, b)| match f64::from(*a) - f64::from(*b) {
            off if off.is_finite() => off.abs(),
            _ => f64::MAX,
        });
        let off = off.fold(0.0, f64::max);
        if off > largest {
            (largest, at) = (off, index);
        }
    }
    difference.pixels = Some(count);
    difference.of_pixels = Some((made.width * made.height) as u64);
    if count == 0 {
        "no pixel differs: the compression or the header differs".clone_into(&mut difference.note);
        return;
    }
    difference.largest = Some(largest);
    difference.at = Some([(at % made.width) as u32, (at / made.width) as u32]);
}

fn decode_png(bytes: &[u8]) -> Result<Pixels, String> {
    let image = image::load_from_memory_with_format(bytes, image::ImageFormat::Png)
        .map_err(|e| e.to_string())?
        .into_rgb8();
    Ok(Pixels {
        width: image.width() as usize,
        height: image.height() as usize,
        channels: 3,
        values: image.into_raw().into_iter().map(f32::from).collect(),
    })
}

fn decode_exr(bytes: &[u8]) -> Result<Pixels, String> {
    let channels = decode_exr_channels(bytes)?;
    let count = channels.list.len();
    let mut values = vec![0.0; channels.width * channels.height * count];
    for (c, (_, channel)) in channels.list.iter().enumerate() {
        for (pixel, value) in values.chunks_exact_mut(count).zip(channel) {
            pixel[c] = *value;
        }
    }
    Ok(Pixels { width: channels.width, height: channels.height, channels: count, values })
}

/// Names the differing fields of two JSON texts.
fn fields(made: &[u8], stored: &[u8]) -> String {
    let (Ok(made), Ok(stored)) =
        (serde_json::from_slice::<Value>(made), serde_json::from_slice::<Value>(stored))
    else {
        return "it is not JSON".to_owned();
    };
    let mut found = Vec::new();
    walk("", &made, &stored, &mut found);
    let more = match found.len().saturating_sub(FIELDS_NAMED) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    found.truncate(FIELDS_NAMED);
    if found.is_empty() {
        "no field differs, only the formatting".to_owned()
    } else {
        format!("fields differ: {}{more}", found.join(", "))
    }
}

fn walk(path: &str, a: &Value, b: &Value, found: &mut Vec<String>) {
    match (a, b) {
        (Value::Object(x), Value::Object(y)) => {
            let keys: BTreeSet<&String> = x.keys().chain(y.keys()).collect();
            for key in keys {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                let none = &Value::Null;
                walk(&path, x.get(key).unwrap_or(none), y.get(key).unwrap_or(none), found);
            }
        }
        _ if a == b => {}
        _ => found.push(path.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::color::SrgbEncoder;
    use render::formats::encode_rgb_exr;
    use render::merge::encode_png;

    const PIXELS: [[f32; 3]; 6] = [[0.25, 0.5, 0.75]; 6];

    #[test]
    fn a_differing_pixel_is_found() {
        let mut other = PIXELS;
        other[4][1] += 0.125;
        let exr = |pixels: &[[f32; 3]]| encode_rgb_exr(pixels, 3, 2).unwrap();
        assert_eq!(compare("a.exr", &exr(&PIXELS), &exr(&PIXELS)), None);
        let found = compare("a.exr", &exr(&PIXELS), &exr(&other)).unwrap();
        assert_eq!((found.pixels, found.of_pixels), (Some(1), Some(6)));
        assert_eq!((found.largest, found.at), (Some(0.125), Some([1, 1])));

        let encoder = SrgbEncoder::new();
        let png = |pixels: &[[f32; 3]]| encode_png(&encoder, pixels, 3, 2).unwrap();
        let found = compare("a.png", &png(&PIXELS), &png(&other)).unwrap();
        assert_eq!(found.pixels, Some(1));
        let steps = f32::from(encoder.encode(0.625)) - f32::from(encoder.encode(0.5));
        assert_eq!(found.largest, Some(f64::from(steps)));
    }

    #[test]
    fn damaged_and_other_images_are_reported() {
        let exr = encode_rgb_exr(&PIXELS, 3, 2).unwrap();
        for damaged in [&b""[..], b"text", &exr[..exr.len() / 2]] {
            let found = compare("a.exr", &exr, damaged).unwrap();
            assert!(found.note.contains("cannot be read"), "{found:?}");
        }
        let wide = encode_rgb_exr(&PIXELS, 6, 1).unwrap();
        let found = compare("a.exr", &exr, &wide).unwrap();
        assert!(found.note.contains("6 x 1 px"), "{found:?}");
        let mut nan = PIXELS;
        nan[0][0] = f32::NAN;
        let found = compare("a.exr", &exr, &encode_rgb_exr(&nan, 3, 2).unwrap()).unwrap();
        assert_eq!(found.largest, Some(f64::MAX));
    }

    #[test]
    fn fields_are_named() {
        let a = br#"{"x":1,"layers":{"input":{"mean":1.0},"t":2},"only":3}"#;
        let b = br#"{"x":1,"layers":{"input":{"mean":1.5},"t":2}}"#;
        let found = compare("tuple.json", a, b).unwrap();
        assert_eq!(found.note, "fields differ: layers.input.mean, only");
        let found = compare("tuple.json", b"{}", b"{ }").unwrap();
        assert!(found.note.contains("no field differs"));
    }
}
