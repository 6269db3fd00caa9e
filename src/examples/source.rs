//! Sources of examples: the run's tuples, its photographs, and pairs of real photographs.

use super::example::{Example, Planes};
use super::picture::Picture;
use super::srgb_planes::{planes_of_bytes, planes_of_linear};
use compose::{Layer as LinearLayer, LinearTuple, Pair, TupleLayers, read_picture};
use glasshouse_line::ids::SceneId;
use glasshouse_line::label::Label;
use glasshouse_line::layer::Layer;
use glasshouse_line::{Roots, SceneLine};
use image::{Rgb32FImage, imageops};
use plan::{InputFiles, PixelSource};
use render::merge::{
    PHOTO, RAW, TupleRecord, decode_tuple_exr, decode_tuple_labels, is_readable_record_of,
    photographed_layer, photographs,
};
use render::scene::{Decoded, decode, read_files_by};
use render::trace::Texture;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, thiserror::Error)]
pub enum ExampleError {
    #[error(
        "{file}: {reason}; `glasshouse audit` finds other damage; `glasshouse retry --anew` resets the scene"
    )]
    Damaged {
        /// Key in the store.
        file: String,
        reason: String,
    },
    #[error("{}: {reason}; export the run again with `glasshouse export RUN --format safetensors`", path.display())]
    Export { path: PathBuf, reason: String },
    #[error("example {name}: {reason}")]
    Unusable { name: String, reason: String },
    #[error(transparent)]
    Store(#[from] TupleFilesError),
    #[error("{0}")]
    None(String),
    #[error("stopped")]
    Stopped,
}

#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct TupleFilesError(pub Box<dyn std::error::Error + Send + Sync>);

/// Access to the tuples of a run in any store.
pub trait TupleFiles: Send + Sync {
    /// Returns one file of a scene's tuple, or `None` if the file does not exist.
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Vec<u8>>, TupleFilesError>;

    /// True if the scene is in quarantine, so that it gets no tuple unless it is retried.
    fn is_quarantined(&self, scene: &SceneId) -> Result<bool, TupleFilesError>;

    /// Returns the number of these scenes that have a tuple.
    fn count(&self, scenes: &[SceneId]) -> Result<usize, TupleFilesError>;
}

/// An example before random augmentation.
pub enum Base {
    Example(Example),
    /// Linear layers, for composing.
    Linear(LinearTuple),
    /// Two photographs of one size, sRGB-coded, for mixing.
    Photographs {
        front: Picture,
        back: Picture,
    },
}

impl Base {
    pub(crate) fn bytes(&self) -> usize {
        match self {
            Self::Example(example) => example.bytes(),
            Self::Linear(tuple) => tuple.bytes(),
            Self::Photographs { front, back } => {
                (front.planes.len() + back.planes.len()) * size_of::<f32>()
            }
        }
    }
}

/// The tuples of scene lines.
pub struct TupleSource {
    pub files: Arc<dyn TupleFiles>,
    pub lines: Vec<SceneLine>,
    pub pixels: PixelSource,
}

impl TupleSource {
    /// Reads a scene's tuple; returns `None` if no tuple of this scene line and version exists.
    pub fn read(&self, index: usize) -> Result<Option<Base>, ExampleError> {
        let line = &self.lines[index];
        let Some(record) = self.record(line)? else {
            return Ok(None);
        };
        let film = [line.film.width, line.film.height];
        let (layers, [width, height]) = match self.pixels {
            PixelSource::Exr => (self.read_exr(line, &record)?, film),
            PixelSource::Png => (self.read_pngs(line, &record)?, film),
            PixelSource::Photograph => self.read_photographs(line, &record)?,
        };
        let [input, transmission, glass_reflection, clean_reflection] = layers;
        let (Some(input), Some(transmission)) = (input, transmission) else {
            return Err(ExampleError::Unusable {
                name: line.id.to_string(),
                reason: "its tuple has no input or no transmission: plan the run with these layers"
                    .to_owned(),
            });
        };
        Ok(Some(Base::Example(Example {
            rows: height as usize,
            columns: width as usize,
            input,
            transmission,
            glass_reflection,
            clean_reflection,
        })))
    }

    /// Reads the linear layers of a scene's tuple as `tuple.exr` stores them; returns `None` like [`Self::read`].
    pub fn read_linear(&self, index: usize) -> Result<Option<Base>, ExampleError> {
        let line = &self.lines[index];
        let Some(record) = self.record(line)? else {
            return Ok(None);
        };
        let (key, bytes) = self.file(line, &record, "tuple.exr")?;
        let layers = decode_tuple_exr(&bytes, &record).map_err(|e| damaged(&key, &e))?;
        let layers =
            layers.0.map(|pixels| (!pixels.is_empty()).then(|| LinearLayer::of_pixels(&pixels)));
        let [Some(input), Some(transmission), Some(glass_reflection), clean_reflection] = layers
        else {
            return Err(ExampleError::Unusable {
                name: line.id.to_string(),
                reason: "its tuple has no input, transmission or glass_reflection, which composed examples need: plan \
                         the run with these layers"
                    .to_owned(),
            });
        };
        let labels = decode_tuple_labels(&bytes, &record).map_err(|e| damaged(&key, &e))?;
        let coverage = labels.get(&Label::Coverage).map(|values| LinearLayer::of_values(values));
        let layers =
            TupleLayers { input, transmission, glass_reflection, clean_reflection, coverage };
        let tuple = LinearTuple::new(line.film.height as usize, line.film.width as usize, layers);
        let tuple = tuple.ok_or_else(|| damaged(&key, &"its size differs from the film's"))?;
        Ok(Some(Base::Linear(tuple)))
    }

    /// Reads `tuple.json`; returns `None` if no tuple of this scene line and version exists.
    fn record(&self, line: &SceneLine) -> Result<Option<TupleRecord>, ExampleError> {
        let Some(json) = self.files.get(&line.id, "tuple.json")? else {
            return Ok(None);
        };
        if !is_readable_record_of(&json, line) {
            // The record is damaged or belongs to another plan or version; the farm replaces the tuple.
            return Ok(None);
        }
        let file = tuple_key(&line.id, "tuple.json");
        TupleRecord::parse(&json).map(Some).map_err(|e| damaged(&file, &e))
    }

    pub fn is_in_quarantine(&self, index: usize) -> Result<bool, ExampleError> {
        Ok(self.files.is_quarantined(&self.lines[index].id)?)
    }

    /// Reads a file of a tuple and compares it with its digest, if the record has one.
    fn file(
        &self,
        line: &SceneLine,
        record: &TupleRecord,
        name: &str,
    ) -> Result<(String, Vec<u8>), ExampleError> {
        let key = tuple_key(&line.id, name);
        let Some(bytes) = self.files.get(&line.id, name)? else {
            return Err(damaged(&key, &"it is missing, although tuple.json exists"));
        };
        match record.check_file(name, &bytes) {
            Ok(()) => Ok((key, bytes)),
            Err(reason) => Err(damaged(&key, &reason)),
        }
    }

    fn read_exr(
        &self,
        line: &SceneLine,
        record: &TupleRecord,
    ) -> Result<[Option<Planes>; 4], ExampleError> {
        let (key, bytes) = self.file(line, record, "tuple.exr")?;
        let layers = decode_tuple_exr(&bytes, record).map_err(|e| damaged(&key, &e))?;
        Ok(layers.0.map(|pixels| (!pixels.is_empty()).then(|| planes_of_linear(&pixels))))
    }

    fn read_pngs(
        &self,
        line: &SceneLine,
        record: &TupleRecord,
    ) -> Result<[Option<Planes>; 4], ExampleError> {
        let mut layers = [const { None }; 4];
        for (layer, name) in layers.iter_mut().zip(glasshouse_line::layer::Layer::NAMES) {
            if record.layers.contains_key(name) {
                let size = [line.film.width, line.film.height];
                let name = format!("{name}.png");
                *layer = Some(self.read_picture(line, record, &name, Some(size))?.0);
            }
        }
        Ok(layers)
    }

    /// Reads a scene's photographs. Returns them with their size, px.
    fn read_photographs(
        &self,
        line: &SceneLine,
        record: &TupleRecord,
    ) -> Result<([Option<Planes>; 4], [u32; 2]), ExampleError> {
        if record.photographs.is_none() {
            return Err(ExampleError::Unusable {
                name: line.id.to_string(),
                reason: "its tuple has no photographs: render a recipe with [sensor]".to_owned(),
            });
        }
        let (input, size) = self.read_picture(line, record, PHOTO, None)?;
        let mut layers = [Some(input), None, None, None];
        for name in photographs(line).into_iter().filter(|name| ![PHOTO, RAW].contains(name)) {
            if let Some(layer) = photographed_layer(name) {
                layers[layer as usize] = Some(self.read_picture(line, record, name, Some(size))?.0);
            }
        }
        let clean = Layer::CleanReflection;
        let film = [line.film.width, line.film.height];
        if size == film && record.layers.contains_key(clean.name()) {
            let name = format!("{clean}.png");
            layers[clean as usize] = Some(self.read_picture(line, record, &name, Some(film))?.0);
        }
        Ok((layers, size))
    }

    /// Reads a picture of a tuple, which must have the size `expected` if that is given.
    fn read_picture(
        &self,
        line: &SceneLine,
        record: &TupleRecord,
        name: &str,
        expected: Option<[u32; 2]>,
    ) -> Result<(Planes, [u32; 2]), ExampleError> {
        let (key, bytes) = self.file(line, record, name)?;
        let picture = image::load_from_memory(&bytes).map_err(|e| damaged(&key, &e))?.into_rgb8();
        let size = [picture.width(), picture.height()];
        if expected.is_some_and(|expected| expected != size) {
            return Err(damaged(&key, &"its size differs from that of the others"));
        }
        Ok((planes_of_bytes(picture.as_raw()), size))
    }
}

/// Returns the key of a tuple's file in a run, for messages.
fn tuple_key(scene: &SceneId, file: &str) -> String {
    format!("tuples/{scene}/{file}")
}

fn damaged(file: &str, reason: &dyn std::fmt::Display) -> ExampleError {
    ExampleError::Damaged { file: file.to_owned(), reason: reason.to_string() }
}

/// The photographs of scene lines, without depth.
pub struct PhotographSource {
    pub lines: Vec<SceneLine>,
    pub roots: Roots,
    /// Folder that relative paths start from.
    pub base: PathBuf,
    pub inputs: Box<dyn InputFiles + Send + Sync>,
}

impl PhotographSource {
    /// Reads a scene's two photographs: the largest central crops with the film's aspect ratio, at the film's size.
    pub fn read(&self, index: usize) -> Result<Base, ExampleError> {
        let line = &self.lines[index];
        let unusable =
            |reason: String| ExampleError::Unusable { name: line.id.to_string(), reason };
        let read = |path: &std::path::Path| self.inputs.read(path);
        let files = read_files_by(line, &self.roots, &self.base, &read)
            .map_err(|e| unusable(e.to_string()))?;
        let decoded = decode(line, &files).map_err(|e| unusable(e.to_string()))?;
        let size = [line.film.width, line.film.height];
        let part = |side: &Decoded| match side {
            Decoded::Sheet(sheet) => Ok(fitted(&sheet.texture, size)),
            Decoded::Mesh(_) => {
                Err(unusable("one side is a mesh: mixtures need two photographs".to_owned()))
            }
        };
        Ok(Base::Photographs {
            front: part(&decoded.front.surface)?,
            back: part(&decoded.back.surface)?,
        })
    }
}

/// Crops a picture centrally, scales it to another size and encodes it in sRGB.
fn fitted(texture: &Texture, [to_width, to_height]: [u32; 2]) -> Picture {
    let (width, height) = (texture.width() as u32, texture.height() as u32);
    let values = texture.rows().flatten().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    let picture = Rgb32FImage::from_raw(width, height, values).expect("three values a texel");
    let scale =
        (f64::from(width) / f64::from(to_width)).min(f64::from(height) / f64::from(to_height));
    let cut = [to_width, to_height].map(|side| (f64::from(side) * scale).round().max(1.0) as u32);
    let (cut_width, cut_height) = (cut[0].min(width), cut[1].min(height));
    let (x, y) = ((width - cut_width) / 2, (height - cut_height) / 2);
    let middle = imageops::crop_imm(&picture, x, y, cut_width, cut_height).to_image();
    let resized = imageops::resize(&middle, to_width, to_height, imageops::FilterType::Triangle);
    let pixels: Vec<[f32; 3]> = resized.pixels().map(|p| p.0).collect();
    Picture {
        rows: to_height as usize,
        columns: to_width as usize,
        planes: planes_of_linear(&pixels),
    }
}

/// Real photographs with ground truth.
pub struct PairSource {
    pub pairs: Vec<Pair>,
}

impl PairSource {
    pub fn read(&self, index: usize) -> Result<Example, ExampleError> {
        let pair = &self.pairs[index];
        let unusable = |reason: String| ExampleError::Unusable { name: pair.name.clone(), reason };
        let input = read_picture(&pair.blended).map_err(|e| unusable(e.to_string()))?;
        let layer = |path: &PathBuf| -> Result<Planes, ExampleError> {
            let picture = read_picture(path).map_err(|e| unusable(e.to_string()))?;
            if picture.dimensions() != input.dimensions() {
                return Err(unusable(format!(
                    "{} has {:?} px, but its photograph has {:?} px",
                    path.display(),
                    picture.dimensions(),
                    input.dimensions()
                )));
            }
            Ok(planes_of_bytes(picture.as_raw()))
        };
        Ok(Example {
            rows: input.height() as usize,
            columns: input.width() as usize,
            transmission: layer(&pair.transmission)?,
            glass_reflection: pair.reflection.as_ref().map(layer).transpose()?,
            clean_reflection: pair.clean_reflection.as_ref().map(layer).transpose()?,
            input: planes_of_bytes(input.as_raw()),
        })
    }
}
