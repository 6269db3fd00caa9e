//! A scene with a camera's picture of it.

use crate::cli::store_env;
use compose::read_picture;
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::{LayerSet, Roots, SceneLine, parse_scene};
use image::RgbImage;
use render::Loaded;
use render::formats::{NamedBytes, decode_linear_exr};
use render::scene::read_files_by;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use train::Stream;
use train::mixture::ZhangDraw;

/// Reason why a scene has no scores.
pub(super) enum Unusable {
    /// A signal stopped the rendering.
    Stopped,
    /// Text for the user, with the file.
    Scene(String),
}

pub(super) struct Capture {
    folder: PathBuf,
    /// Name of the camera's file.
    pub(super) file: &'static str,
    pub(super) line: SceneLine,
    roots: Roots,
    /// The camera's picture in 8-bit sRGB codes.
    pub(super) captured: RgbImage,
}

impl Capture {
    /// Reads scene.json and the camera's picture of a folder. The line gets all layers and, if given, `spp`.
    pub(super) fn read(folder: &Path, spp: Option<u32>, roots: &Roots) -> Result<Self, Unusable> {
        let path = folder.join("scene.json");
        let reason = |e: &dyn Display| {
            Unusable::Scene(format!("cannot use {}: {e}; check the file", path.display()))
        };
        let text = render::input_file::read_to_string(&path).map_err(|e| reason(&e))?;
        let mut line = parse_scene(&text).map_err(|e| reason(&e))?;
        line.film.layers = LayerSet::default();
        line.film.spp = spp.unwrap_or(line.film.spp);
        let (file, captured) = captured(folder)?;
        let (rows, columns) = (line.film.height, line.film.width);
        if captured.dimensions() != (columns, rows) {
            return Err(Unusable::Scene(format!(
                "{} has {} x {} px, but the film of scene.json has {columns} x {rows} px: crop or scale the picture, or change the film",
                folder.join(file).display(),
                captured.width(),
                captured.height(),
            )));
        }
        // Zhang's vignette limits the size; better refused before the rendering.
        let draw =
            ZhangDraw::draw(rows as usize, columns as usize, &mut Stream::new(0, "size alone"));
        draw.map_err(|e| Unusable::Scene(format!("{}: {e}", folder.join(file).display())))?;
        Ok(Self { folder: folder.to_owned(), file, line, roots: roots.clone(), captured })
    }

    /// Reads and decodes the photographs of the scene.
    pub(super) fn load(&self) -> Result<Loaded, Unusable> {
        let inputs = store_env::inputs();
        let files = read_files_by(&self.line, &self.roots, &self.folder, &|path| inputs.read(path))
            .map_err(|e| self.unusable(&e))?;
        Loaded::new(self.line.clone(), &files).map_err(|e| self.unusable(&e))
    }

    pub(super) fn unusable(&self, error: &dyn Display) -> Unusable {
        let path = self.folder.join("scene.json");
        Unusable::Scene(format!("cannot compare {}: {error}", path.display()))
    }

    /// Returns the name of the folder.
    pub(super) fn name(&self) -> String {
        self.folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }
}

/// Reads captured.png as 8-bit sRGB, or captured.exr as linear light, which is coded like a rendering.
fn captured(folder: &Path) -> Result<(&'static str, RgbImage), Unusable> {
    let named = |name: &'static str| Some(name).filter(|name| folder.join(name).exists());
    let file = match (named("captured.png"), named("captured.exr")) {
        (Some(_), Some(_)) => {
            let folder = folder.display();
            return Err(Unusable::Scene(format!(
                "{folder} has captured.png and captured.exr: remove one of them"
            )));
        }
        (None, None) => {
            let folder = folder.display();
            return Err(Unusable::Scene(format!(
                "{folder} has neither captured.png nor captured.exr: add the camera's picture"
            )));
        }
        (png, exr) => png.or(exr).expect("one of them is there"),
    };
    let path = folder.join(file);
    let unusable = |e: &dyn Display| Unusable::Scene(e.to_string());
    if file == "captured.png" {
        return Ok((file, read_picture(&path).map_err(|e| unusable(&e))?));
    }
    let bytes = render::input_file::read(&path).map_err(|e| {
        Unusable::Scene(format!("cannot read {}: {e}; check the file", path.display()))
    })?;
    let picture =
        decode_linear_exr(&NamedBytes { path: path.clone(), bytes }).map_err(|e| unusable(&e))?;
    if !picture.pixels.iter().flatten().all(|value| value.is_finite()) {
        let path = path.display();
        return Err(Unusable::Scene(format!(
            "{path} has pixels that are NaN or infinite: repair them"
        )));
    }
    let encoder = SrgbEncoder::new();
    let codes = picture.pixels.iter().flat_map(|pixel| pixel.map(|value| encoder.encode(value)));
    let (width, height) = (picture.width as u32, picture.height as u32);
    let image = RgbImage::from_raw(width, height, codes.collect());
    Ok((file, image.expect("the reader returns all pixels")))
}
