//! The bytes of a scene's files and their formats.

use super::error::SceneError;
use super::other_formats::name_with_conversion;
use std::path::PathBuf;

/// The contents of a file, and its path for error texts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedBytes {
    pub path: PathBuf,
    pub bytes: Vec<u8>,
}

/// The files of one photograph.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PhotographFiles {
    /// PNG, JPEG, PNM, EXR, Radiance HDR, PFM, `.npy` or `.npz`.
    pub color: NamedBytes,
    /// PNG, PNM, EXR, PFM, TIFF, `.npy` or `.npz`.
    pub depth: NamedBytes,
    /// PNG, PNM, `.npy` or `.npz`. Without a mask, every finite depth above 0 is valid.
    pub mask: Option<NamedBytes>,
}

/// The files of one panorama.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PanoramaFiles {
    /// Equirectangular image, in any format of a colour image.
    pub panorama: NamedBytes,
    /// Equirectangular distances, in any format of a depth image. Without them, all directions have the same distance.
    pub depth: Option<NamedBytes>,
}

/// A file format, recognised by its magic bytes because extensions are unreliable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FileFormat {
    Png,
    Jpeg,
    Pnm,
    Exr,
    Npy,
    Ply,
    Pfm,
    Hdr,
    Tiff,
}

impl FileFormat {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Pnm => "PNM",
            Self::Exr => "EXR",
            Self::Npy => ".npy",
            Self::Ply => "PLY",
            Self::Pfm => "PFM",
            Self::Hdr => "Radiance HDR",
            Self::Tiff => "TIFF",
        }
    }
}

impl NamedBytes {
    /// Recognises the format by the magic bytes. The error of an unknown format lists the `expected` formats.
    pub(crate) fn format(&self, expected: &'static str) -> Result<FileFormat, SceneError> {
        match self.bytes.as_slice() {
            [] => Err(SceneError::Empty { path: self.path.clone() }),
            [0x89, b'P', b'N', b'G', ..] => Ok(FileFormat::Png),
            [0xff, 0xd8, 0xff, ..] => Ok(FileFormat::Jpeg),
            [b'P', b'1'..=b'7', b' ' | b'\t' | b'\r' | b'\n' | b'#', ..] => Ok(FileFormat::Pnm),
            [b'P', b'f' | b'F', b' ' | b'\t' | b'\r' | b'\n', ..] => Ok(FileFormat::Pfm),
            [b'#', b'?', ..] => Ok(FileFormat::Hdr),
            [0x76, 0x2f, 0x31, 0x01, ..] => Ok(FileFormat::Exr),
            // A .npz file is a ZIP archive of .npy files.
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] | [b'P', b'K', 3, 4, ..] => {
                Ok(FileFormat::Npy)
            }
            [b'p', b'l', b'y', b'\r' | b'\n', ..] => Ok(FileFormat::Ply),
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Ok(FileFormat::Tiff),
            other => {
                let found = name_with_conversion(other).unwrap_or_else(|| {
                    let start: Vec<String> =
                        other.iter().take(8).map(|byte| format!("{byte:02x}")).collect();
                    format!("of no known format (it starts with {})", start.join(" "))
                });
                Err(self.wrong_format(found, expected))
            }
        }
    }

    /// Returns the error of a file in the wrong format.
    pub(crate) fn wrong_format(&self, found: String, expected: &'static str) -> SceneError {
        SceneError::Format { path: self.path.clone(), found, expected }
    }

    /// Returns the error of a file with the wrong channels, element type or shape.
    pub(crate) fn wrong_layout(&self, found: String, expected: &'static str) -> SceneError {
        SceneError::Layout { path: self.path.clone(), found, expected }
    }

    /// Returns the error of a mesh with the invalid vertex, triangle, face or element `what`.
    pub(crate) fn bad_element(
        &self,
        what: String,
        problem: String,
        remedy: &'static str,
    ) -> SceneError {
        SceneError::Element { path: self.path.clone(), what, problem, remedy }
    }

    /// Returns the error of a file that cannot be decoded.
    pub(crate) fn unreadable(
        &self,
        format: FileFormat,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> SceneError {
        SceneError::Unreadable {
            path: self.path.clone(),
            format: format.name(),
            source: source.into(),
        }
    }

    /// Runs a third-party decoder and turns a panic into an error.
    pub(crate) fn contain<T>(
        &self,
        format: FileFormat,
        decode: impl FnOnce() -> Result<T, SceneError>,
    ) -> Result<T, SceneError> {
        // Unwind safe: a panic drops everything that the closure owns.
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(decode))
            .unwrap_or_else(|_| Err(self.unreadable(format, "the decoder failed on its contents")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(bytes: &[u8]) -> NamedBytes {
        NamedBytes { path: PathBuf::from("dir/a.png"), bytes: bytes.to_vec() }
    }

    #[test]
    fn magic_bytes_determine_the_format() {
        assert_eq!(named(b"\xff\xd8\xff\xe0").format("x").unwrap(), FileFormat::Jpeg);
        assert_eq!(named(b"P5 1 1 255 a").format("x").unwrap(), FileFormat::Pnm);
        let error = named(b"ABC89a").format("PNG or EXR").unwrap_err().to_string();
        assert_eq!(
            error,
            "dir/a.png is of no known format (it starts with 41 42 43 38 39 61); give PNG or EXR"
        );
        let error = named(b"GIF89a").format("PNG or EXR").unwrap_err().to_string();
        assert_eq!(
            error,
            "dir/a.png is GIF, which is not read (`magick IN.gif[0] OUT.png`); give PNG or EXR"
        );
        assert_eq!(named(b"PK\x03\x04").format("x").unwrap(), FileFormat::Npy);
        assert_eq!(named(b"II*\0").format("x").unwrap(), FileFormat::Tiff);
        assert!(matches!(named(b"").format("x"), Err(SceneError::Empty { .. })));
    }

    #[test]
    fn a_panic_of_a_decoder_becomes_an_error() {
        let error = named(b"x").contain::<()>(FileFormat::Exr, || panic!("on purpose"));
        assert!(matches!(error, Err(SceneError::Unreadable { format: "EXR", .. })));
    }
}
