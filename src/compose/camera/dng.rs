//! `raw.dng`: the numbers of a sensor as a file that raw converters open (Adobe DNG 1.4).

use super::matrix::{Matrix, inverse, product, scaled};
use glasshouse_line::Sensor;
use std::io::Cursor;
use tiff::TiffResult;
use tiff::encoder::{DirectoryEncoder, Rational, SRational, TiffEncoder, TiffKindStandard};
use tiff::tags::Tag;

/// From CIE XYZ to linear sRGB (IEC 61966-2-1).
const XYZ_TO_SRGB: Matrix = [
    [3.240_625_5, -1.537_208, -0.498_628_6],
    [-0.968_930_7, 1.875_756_1, 0.041_517_5],
    [0.055_710_1, -0.204_021_1, 1.056_995_9],
];

/// D65, as EXIF numbers light sources.
const D65: u16 = 21;
/// Photometric interpretation: a colour filter array.
const COLOUR_FILTER_ARRAY: u16 = 32_803;
/// Denominator of the rational numbers.
const PARTS: i32 = 10_000;

type Directory<'a, 'b> = DirectoryEncoder<'a, &'b mut Cursor<Vec<u8>>, TiffKindStandard>;

/// Encodes the numbers of a sensor, row by row, with what a converter needs: levels, mosaic, colours and white balance.
pub fn encode_dng(
    numbers: &[u16],
    [width, height]: [usize; 2],
    sensor: &Sensor,
) -> TiffResult<Vec<u8>> {
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file)?;
    let mut tags = encoder.image_directory()?;
    tags.write_tag(Tag::NewSubfileType, 0u32)?;
    tags.write_tag(Tag::ImageWidth, width as u32)?;
    tags.write_tag(Tag::ImageLength, height as u32)?;
    tags.write_tag(Tag::BitsPerSample, 16u16)?;
    tags.write_tag(Tag::Compression, 1u16)?;
    tags.write_tag(Tag::PhotometricInterpretation, COLOUR_FILTER_ARRAY)?;
    tags.write_tag(Tag::Make, "Glasshouse")?;
    let model = sensor.name.as_deref().unwrap_or("sensor");
    tags.write_tag(Tag::Model, model)?;
    tags.write_tag(Tag::Orientation, 1u16)?;
    tags.write_tag(Tag::SamplesPerPixel, 1u16)?;
    tags.write_tag(Tag::RowsPerStrip, height as u32)?;
    tags.write_tag(Tag::PlanarConfiguration, 1u16)?;
    write_camera(&mut tags, sensor)?;
    let offset = tags.write_data(numbers)?;
    tags.write_tag(Tag::StripOffsets, u32::try_from(offset)?)?;
    tags.write_tag(Tag::StripByteCounts, (2 * numbers.len()) as u32)?;
    tags.finish()?;
    Ok(file.into_inner())
}

/// Writes the tags of the colour filter array and those of DNG.
fn write_camera(tags: &mut Directory<'_, '_>, sensor: &Sensor) -> TiffResult<()> {
    let own = Tag::Unknown;
    let places = [(0, 0), (0, 1), (1, 0), (1, 1)];
    let pattern = places.map(|(y, x)| sensor.mosaic.channel(y, x) as u8);
    tags.write_tag(own(33_421), &[2u16, 2][..])?; // CFARepeatPatternDim
    tags.write_tag(own(33_422), &pattern[..])?; // CFAPattern
    tags.write_tag(own(50_706), &[1u8, 4, 0, 0][..])?; // DNGVersion
    tags.write_tag(own(50_707), &[1u8, 1, 0, 0][..])?; // DNGBackwardVersion
    let name = format!("Glasshouse {}", sensor.name.as_deref().unwrap_or("sensor"));
    tags.write_tag(own(50_708), name.as_str())?; // UniqueCameraModel
    tags.write_tag(own(50_710), &[0u8, 1, 2][..])?; // CFAPlaneColor
    tags.write_tag(own(50_711), 1u16)?; // CFALayout: rectangular
    tags.write_tag(own(50_714), sensor.black_level_dn)?; // BlackLevel
    let white = f64::from(sensor.black_level_dn) + sensor.gain_dn_per_e * sensor.white_e();
    tags.write_tag(own(50_717), white.round() as u32)?; // WhiteLevel
    // From XYZ to the camera's raw values, and the raw values of neutral light.
    let balanced = product(&inverse(&sensor.colour_matrix), &XYZ_TO_SRGB);
    let neutral = sensor.white_balance.map(|gain| 1.0 / gain);
    let rational = |value: f32| SRational { n: (value * PARTS as f32).round() as i32, d: PARTS };
    let matrix: Vec<SRational> =
        scaled(&balanced, neutral).as_flattened().iter().map(|v| rational(*v)).collect();
    tags.write_tag(own(50_721), &matrix[..])?; // ColorMatrix1
    tags.write_tag(own(50_778), D65)?; // CalibrationIlluminant1
    let neutral = neutral.map(|v| Rational { n: (v * 1e6).round() as u32, d: 1_000_000 });
    tags.write_tag(own(50_728), &neutral[..])?; // AsShotNeutral
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::{Mosaic, SensorExposure};

    #[test]
    fn files_have_the_numbers_and_the_tags() {
        let line = r#"{"name":"a7","exposure":{"factor":1},"gain_dn_per_e":0.5,"bits":14,"black_level_dn":512,"mosaic":"gbrg","white_balance":[2.0,1.0,1.6],"jpeg_quality":90}"#;
        let sensor: Sensor = serde_json::from_str(line).unwrap();
        assert_eq!(sensor.mosaic, Mosaic::Gbrg);
        assert_eq!(sensor.exposure, SensorExposure::Factor { factor: 1.0 });
        let numbers: Vec<u16> = (0..35).map(|k| 512 + 400 * k).collect();
        let file = encode_dng(&numbers, [7, 5], &sensor).unwrap();
        // An independent reader: entries of 12 bytes behind the offset at byte 4 (TIFF 6.0, little endian).
        let u16_at = |at: usize| u16::from_le_bytes([file[at], file[at + 1]]);
        let u32_at = |at: usize| u32::from(u16_at(at)) + (u32::from(u16_at(at + 2)) << 16);
        assert_eq!(&file[..4], b"II*\0");
        let first = u32_at(4) as usize;
        let entries: Vec<usize> =
            (0..usize::from(u16_at(first))).map(|k| first + 2 + 12 * k).collect();
        let tags: Vec<u16> = entries.iter().map(|at| u16_at(*at)).collect();
        assert!(tags.is_sorted(), "{tags:?}");
        let entry = |tag: u16| entries[tags.iter().position(|t| *t == tag).unwrap()];
        let value = |tag: u16| u32_at(entry(tag) + 8);
        assert_eq!((value(256), value(257)), (7, 5));
        let offset = value(273) as usize;
        let stored: Vec<u16> = (0..35).map(|k| u16_at(offset + 2 * k)).collect();
        assert_eq!(stored, numbers);
        assert_eq!(value(33_422).to_le_bytes(), [1, 2, 0, 1]);
        assert_eq!(value(50_706).to_le_bytes(), [1, 4, 0, 0]);
        assert_eq!((value(50_714), value(50_717)), (512, 16_383));
        let neutral = value(50_728) as usize;
        let parts: Vec<u32> = (0..6).map(|k| u32_at(neutral + 4 * k)).collect();
        assert_eq!(parts, [500_000, 1_000_000, 1_000_000, 1_000_000, 625_000, 1_000_000]);
    }
}
