//! The depth image of a photograph without depth: a plane, or a ground before a wall.

use super::color;
use crate::formats::encode_npy;
use crate::formats::error::SceneError;
use crate::formats::files::NamedBytes;
use glasshouse_line::{ExrPrecision, Photograph, Sketch};

/// Longest side of a sketched depth image, px. Inverse depth is linear on a plane, so only the foot of the wall needs pixels.
const LONGEST_PX: usize = 512;

/// Makes the depth image of a photograph's sketch, as a file of z in metres with the aspect of the colour image.
pub(super) fn depth_file(
    photograph: &Photograph,
    sketch: &Sketch,
    color: &NamedBytes,
) -> Result<NamedBytes, SceneError> {
    let size = color::size(color, color.bytes.len() as u64)?.used_px(photograph.orientation);
    let longest = size[0].max(size[1]).max(1);
    let [width, height] = size.map(|side| {
        let reduced = (side * LONGEST_PX.min(longest)).div_ceil(longest);
        reduced.max(1)
    });
    let camera = &photograph.intrinsics;
    let of_height = camera.size.map_or(size[1] as f64, |[_, height]| f64::from(height));
    // The focal length in heights of the picture.
    let focal = camera.fy / of_height;
    let depth_of_row = |row: usize| {
        let z = match *sketch {
            Sketch::Plane { plane_m } => plane_m,
            Sketch::Ground { wall_m, camera_height_m, horizon } => {
                let below = (row as f64 + 0.5) / height as f64 - horizon;
                // The ground's inverse depth; the wall is where the ground is farther.
                let inverse = (below / (focal * camera_height_m)).max(1.0 / wall_m);
                1.0 / inverse
            }
        };
        z as f32
    };
    let values: Vec<f32> =
        (0..height).flat_map(|row| std::iter::repeat_n(depth_of_row(row), width)).collect();
    let bytes = encode_npy(&[height, width], &values, ExrPrecision::Float);
    Ok(NamedBytes { path: color.path.with_extension("sketch"), bytes })
}

#[cfg(test)]
mod tests {
    use super::super::decode_photograph;
    use super::*;
    use crate::formats::PhotographFiles;

    /// A PNG of a size.
    fn png(width: u32, height: u32) -> NamedBytes {
        let picture =
            image::RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 90]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        NamedBytes { path: "a.png".into(), bytes: bytes.into_inner() }
    }

    fn sheet(sketch: &str, size: [u32; 2]) -> crate::scene::Sheet {
        let line: Photograph = serde_json::from_str(&format!(
            r#"{{"color":"a.png","sketch":{sketch},
                "intrinsics":{{"fx":80,"fy":80,"cx":50,"cy":30,"size":[100,60]}}}}"#
        ))
        .unwrap();
        let color = png(size[0], size[1]);
        let depth = depth_file(&line, line.sketch.as_ref().unwrap(), &color).unwrap();
        decode_photograph(&line, &PhotographFiles { color, depth, mask: None }).unwrap()
    }

    #[test]
    fn a_plane_has_one_depth() {
        let sheet = sheet(r#"{"plane_m":5}"#, [100, 60]);
        assert_eq!((sheet.width, sheet.height, sheet.filled_share), (100, 60, 0.0));
        assert!(sheet.inverse_depths_per_m().all(|inverse| inverse == 0.2));
        assert_eq!(sheet.front_center_z_m, 5.0);
    }

    /// A ray through row y meets the ground at z = f h / (y - horizon), and the wall where that is farther.
    #[test]
    fn ground_and_wall_are_where_rays_meet_them() {
        for size in [[100, 60], [1000, 600], [2000, 1200]] {
            let sheet = sheet(r#"{"wall_m":8,"camera_height_m":1.2,"horizon":0.4}"#, size);
            assert!(
                sheet.width <= LONGEST_PX && sheet.width * 60 == sheet.height * 100
                    || size[0] > 512
            );
            let inverse: Vec<f32> = sheet.inverse_depths_per_m().collect();
            for row in 0..sheet.height {
                let y = (row as f64 + 0.5) * 60.0 / sheet.height as f64;
                let ground = if y > 24.0 { 80.0 * 1.2 / (y - 24.0) } else { f64::INFINITY };
                let expected = 1.0 / ground.min(8.0);
                let found = f64::from(inverse[row * sheet.width]);
                assert!((found / expected - 1.0).abs() < 1e-6, "{size:?} row {row}: {found}");
            }
        }
    }
}
