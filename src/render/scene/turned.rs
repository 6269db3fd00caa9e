//! Checks that depth, mask and intrinsics refer to the upright colour image, where its EXIF orientation matters.

use crate::formats::{PictureSize, SceneError};
use glasshouse_line::{Orientation, Photograph};
use std::path::Path;

/// Paths and sizes of a photograph's files.
pub struct PhotographSizes<'a> {
    /// Colour image.
    pub color: (&'a Path, PictureSize),
    /// Depth image.
    pub depth: (&'a Path, PictureSize),
    /// Mask, if there is one.
    pub mask: Option<(&'a Path, PictureSize)>,
}

/// Refuses a depth image, a mask or intrinsics that fit the stored rows of the colour image, but not the upright image.
/// Orientations that keep width and height (2, 3, 4), and square images, cannot be checked by sizes.
pub fn check_turned(line: &Photograph, sizes: &PhotographSizes<'_>) -> Result<(), SceneError> {
    let (color_path, color) = sizes.color;
    if line.orientation == Orientation::Stored {
        return Ok(());
    }
    let given = line.intrinsics.size.map(|size| size.map(|side| side as usize));
    let files = [("depth", Some(sizes.depth)), ("mask", sizes.mask)];
    let files = files.into_iter().filter_map(|(what, file)| {
        let (path, size) = file?;
        Some((format!("{what} {}", path.display()), size.upright_px()))
    });
    for (what, px) in files.chain(given.map(|px| ("intrinsics.size".to_owned(), px))) {
        if color.is_fit_only_by_stored(px) {
            return Err(SceneError::Turned {
                path: color_path.to_owned(),
                exif_orientation: color.exif_orientation,
                stored_px: color.stored_px,
                upright_px: color.upright_px(),
                what,
                px,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_fits_only_the_stored_rows_is_refused() {
        let line = |keys: &str| -> Photograph {
            let camera = r#""intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0"#;
            serde_json::from_str(&format!(r#"{{"color":"c","depth":"d",{camera}{keys}}}"#)).unwrap()
        };
        let path = |name: &'static str| Path::new(name);
        let turned = PictureSize { stored_px: [96, 128], exif_orientation: 6 };
        let check = |line: &Photograph, depth: [usize; 2], mask: [usize; 2]| {
            let sizes = PhotographSizes {
                color: (path("c.jpg"), turned),
                depth: (path("d.npy"), PictureSize::plain(depth)),
                mask: Some((path("m.png"), PictureSize::plain(mask))),
            };
            check_turned(line, &sizes).map_err(|error| error.to_string())
        };
        let plain = line("}");
        assert_eq!(check(&plain, [128, 96], [128, 96]), Ok(()));
        let error = check(&plain, [96, 128], [96, 128]).unwrap_err();
        assert_eq!(
            error,
            "c.jpg is stored with 96x128 pixels, and its EXIF orientation 6 turns it to 128x96; depth d.npy has 96x128, \
             which fits only the stored rows: turn it upright, or set \"orientation\": \"stored\" beside \"color\""
        );
        assert!(check(&plain, [128, 96], [96, 128]).unwrap_err().contains("mask m.png has 96x128"));
        let sized = line(r#","size":[192,256]}"#);
        let error = check(&sized, [128, 96], [128, 96]).unwrap_err();
        assert!(error.contains("intrinsics.size has 192x256"), "{error}");
        let stored = line(r#"},"orientation":"stored""#);
        assert_eq!(check(&stored, [96, 128], [96, 128]), Ok(()));
    }
}
