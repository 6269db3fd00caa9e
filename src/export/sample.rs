//! Converts a tuple to the files of an export, names and bytes, or to tensors.

use super::error::ExportError;
use super::plan::ExportPlan;
use super::request::{ExportFormat, PixelEncoding};
use super::tensors::{Tensor, tensors};
use crate::made::{self, Digests, Files};
use crate::run::keys;
use crate::store::Store;
use bytes::Bytes;
use glasshouse_line::label::{Label, LabelImages, LabelSet};
use glasshouse_line::layer::{Layer, PerLayer};
use glasshouse_line::{ExrPrecision, SceneLine, Split};
use render::formats::{encode_npy, encode_parts_exr, label_precision};
use render::merge::{
    PHOTO, RAW, TupleRecord, check_png, decode_tuple_exr, decode_tuple_labels, encode_png16,
    encode_rgb8_png, is_readable_record_of, photographed_layer, tuple_files,
};
use std::collections::BTreeMap;
use std::path::Path;

pub(super) struct Sample {
    /// Files, sorted by name: paths in the exported folder, or members of a tar.
    pub(super) files: Vec<(String, Bytes)>,
    /// Tensors of [`ExportFormat::Safetensors`], which has no files for a tuple.
    pub(super) tensors: Vec<Tensor>,
    /// Content of `tuple.json`.
    pub(super) record: TupleRecord,
    /// BLAKE3 of the tuple's files that were read, by key in the store.
    pub(super) of: BTreeMap<String, String>,
}

/// Folder names of published sets of pairs, by layer.
const PAIR_FOLDERS: [&str; 4] =
    ["blended", "transmission_layer", "reflection_layer", "clean_reflection_layer"];

/// Returns the path (in a shard, the name) of a layer's file; in [`ExportFormat::Exr`], one file has all layers.
pub(super) fn layer_file(
    format: ExportFormat,
    encoding: PixelEncoding,
    line: &SceneLine,
    layer: usize,
) -> String {
    let ending = match encoding {
        PixelEncoding::Srgb8 | PixelEncoding::Srgb16 | PixelEncoding::Photograph => "png",
        PixelEncoding::Linear => "exr",
    };
    let (split, id, name) = (line.split, &line.id, Layer::NAMES[layer]);
    match format {
        ExportFormat::Webdataset => format!("{id}.{name}.{ending}"),
        ExportFormat::Imagefolder => format!("{split}/{name}/{id}.{ending}"),
        ExportFormat::Pairs => format!("{split}/{}/{id}.{ending}", PAIR_FOLDERS[layer]),
        ExportFormat::Exr => format!("{split}/{id}.{ending}"),
        ExportFormat::Safetensors => format!("{id}.{name}"),
    }
}

/// Returns the path (in a shard, the name) of a label's file; in [`ExportFormat::Exr`], the file of the layers has the labels, too.
pub(super) fn label_file(format: ExportFormat, line: &SceneLine, label: Label) -> String {
    let (split, id) = (line.split, &line.id);
    match format {
        ExportFormat::Webdataset => format!("{id}.{label}.npy"),
        ExportFormat::Imagefolder | ExportFormat::Pairs => format!("{split}/{label}/{id}.npy"),
        ExportFormat::Exr => layer_file(format, PixelEncoding::Linear, line, 0),
        ExportFormat::Safetensors => format!("{id}.{label}"),
    }
}

/// Lists the folders of a split, relative to the exported folder; none for shards.
pub(super) fn layer_folders(plan: &ExportPlan, split: Split) -> Vec<String> {
    let layers = plan.layers();
    let mut folders: Vec<String> = match plan.request.format {
        ExportFormat::Webdataset | ExportFormat::Safetensors => return Vec::new(),
        ExportFormat::Exr => return vec![split.to_string()],
        ExportFormat::Imagefolder => layers.map(|(_, name)| format!("{split}/{name}")).collect(),
        ExportFormat::Pairs => {
            layers.map(|(l, _)| format!("{split}/{}", PAIR_FOLDERS[l])).collect()
        }
    };
    folders.extend(plan.labels.iter().map(|label| format!("{split}/{label}")));
    folders
}

/// Reads a scene's tuple from the run's store, checks the tuple, and encodes its files for the export. Remembers the digests of the
/// tuple's files.
pub(super) fn sample(
    store: &Store,
    line: &SceneLine,
    (format, encoding): (ExportFormat, PixelEncoding),
    remember: Option<(&Digests, &Files)>,
) -> Result<Sample, ExportError> {
    let (mut tuple, of) = read(store, line, encoding, remember)?;
    let json = tuple.take(line, "tuple.json")?;
    if !is_readable_record_of(&json, line) {
        return Err(damaged(line, "tuple.json", &"it belongs to another plan or version"));
    }
    let record: TupleRecord =
        serde_json::from_slice(&json).map_err(|e| damaged(line, "tuple.json", &e))?;
    let (mut files, mut of_layers) = (Vec::new(), Vec::new());
    match encoding {
        PixelEncoding::Srgb8 => files.extend(copies(&mut tuple, &record, line, format)?),
        PixelEncoding::Photograph => {
            files.extend(photographs(&mut tuple, &record, line, format)?);
        }
        PixelEncoding::Srgb16 | PixelEncoding::Linear => {}
    }
    if needs_exr(line, encoding) {
        let exr = tuple.take(line, "tuple.exr")?;
        record.check_file("tuple.exr", &exr).map_err(|e| damaged(line, "tuple.exr", &e))?;
        let labels = decode_tuple_labels(&exr, &record);
        let labels = labels.map_err(|e| damaged(line, "tuple.exr", &e))?;
        if format == ExportFormat::Safetensors {
            let layers = decoded(&exr, &record, line)?;
            of_layers = tensors(line, &layers, &labels, precision(&record));
        } else if format != ExportFormat::Exr {
            files.extend(label_files(&labels, &record, line, format));
        }
        if encoding.is_of_exr() && format != ExportFormat::Safetensors {
            files.extend(encoded(&exr, &labels, &record, line, format, encoding)?);
        }
    }
    if format == ExportFormat::Webdataset {
        files.push((format!("{}.json", line.id), json));
    }
    files.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(Sample { files, tensors: of_layers, record, of })
}

/// True if the export needs `tuple.exr`: the PNGs lack labels, and pixels of other encodings.
fn needs_exr(line: &SceneLine, encoding: PixelEncoding) -> bool {
    encoding.is_of_exr() || line.film.layers.labels() != LabelSet::default()
}

/// Bytes of a tuple's files, by name; `None` if the file is missing or was taken.
struct TupleBytes(BTreeMap<String, Option<Bytes>>);

impl TupleBytes {
    fn take(&mut self, line: &SceneLine, name: &str) -> Result<Bytes, ExportError> {
        let bytes = self.0.get_mut(name).and_then(Option::take);
        bytes.ok_or_else(|| damaged(line, name, &"it is missing, although the scene was merged"))
    }
}

/// Reads the record and the files that the encoding needs. Returns their digests, too.
fn read(
    store: &Store,
    line: &SceneLine,
    encoding: PixelEncoding,
    remember: Option<(&Digests, &Files)>,
) -> Result<(TupleBytes, BTreeMap<String, String>), ExportError> {
    let mut names = tuple_files(line);
    names.retain(|name| match name.as_str() {
        "tuple.json" => true,
        "tuple.exr" => needs_exr(line, encoding),
        name => match encoding {
            PixelEncoding::Srgb8 => photographed_layer(name).is_none(),
            PixelEncoding::Photograph => photographed_layer(name).is_some() && name != RAW,
            PixelEncoding::Srgb16 | PixelEncoding::Linear => false,
        },
    });
    let keys: Vec<String> = names.iter().map(|n| keys::tuple(&line.id, n)).collect();
    let stamp = |key: &String| remember.map_or(Ok(None), |(_, files)| files.stamp(key));
    let stamps: Vec<_> = keys.iter().map(stamp).collect::<Result<_, _>>()?;
    let bytes = store.get_all(&keys)?;
    let mut of = BTreeMap::new();
    for ((key, stamp), bytes) in keys.into_iter().zip(stamps).zip(&bytes) {
        let (Some((digests, files)), Some(bytes)) = (remember, bytes) else { continue };
        let digest = made::digest(bytes);
        digests.remember(files, &key, stamp, &digest);
        of.insert(key, digest);
    }
    Ok((TupleBytes(names.into_iter().zip(bytes).collect()), of))
}

fn copies(
    tuple: &mut TupleBytes,
    record: &TupleRecord,
    line: &SceneLine,
    format: ExportFormat,
) -> Result<Vec<(String, Bytes)>, ExportError> {
    let mut files = Vec::new();
    for (layer, name) in made(line) {
        let file = format!("{name}.png");
        let bytes = tuple.take(line, &file)?;
        // A truncated or changed file must not be exported. Older records have no digest of it.
        check_png(&bytes, line.film.width, line.film.height)
            .and_then(|()| record.check_file(&file, &bytes))
            .map_err(|e| damaged(line, &file, &e))?;
        files.push((layer_file(format, PixelEncoding::Srgb8, line, layer), bytes));
    }
    Ok(files)
}

/// Copies the photographs of T and R~, and decodes that of I, which a pair's loader expects under the name of the others.
fn photographs(
    tuple: &mut TupleBytes,
    record: &TupleRecord,
    line: &SceneLine,
    format: ExportFormat,
) -> Result<Vec<(String, Bytes)>, ExportError> {
    let mut files = Vec::new();
    for name in render::merge::photographs(line) {
        let Some(layer) = photographed_layer(name).filter(|_| name != RAW) else { continue };
        let mut bytes = tuple.take(line, name)?;
        record.check_file(name, &bytes).map_err(|e| damaged(line, name, &e))?;
        if name == PHOTO {
            let photo = compose::decode_picture(Path::new(name), bytes.to_vec())
                .map_err(|e| damaged(line, name, &e))?;
            let png = encode_rgb8_png(photo.as_raw(), photo.dimensions().into());
            bytes = png.map_err(|e| damaged(line, name, &e))?.into();
        }
        files.push((layer_file(format, PixelEncoding::Photograph, line, layer as usize), bytes));
    }
    Ok(files)
}

/// Encodes labels as NumPy arrays of height, width and, for three channels, 3.
fn label_files(
    labels: &LabelImages,
    record: &TupleRecord,
    line: &SceneLine,
    format: ExportFormat,
) -> impl Iterator<Item = (String, Bytes)> {
    let size = [line.film.height, line.film.width].map(|side| side as usize);
    let precision = precision(record);
    labels.iter().map(move |(label, values)| {
        let channels = label.channels().len();
        let shape: Vec<usize> =
            size.into_iter().chain((channels > 1).then_some(channels)).collect();
        let bytes = encode_npy(&shape, values, label_precision(*label, precision));
        (label_file(format, line, *label), bytes.into())
    })
}

/// Returns the precision of the tuple's OpenEXR file.
fn precision(record: &TupleRecord) -> ExrPrecision {
    // Only layers with half floats have this digest.
    let is_half = record.layers.values().all(|l| l.exr_blake3.is_some());
    if is_half { ExrPrecision::Half } else { ExrPrecision::Float }
}

fn decoded(
    exr: &[u8],
    record: &TupleRecord,
    line: &SceneLine,
) -> Result<PerLayer<Vec<[f32; 3]>>, ExportError> {
    decode_tuple_exr(exr, record).map_err(|e| damaged(line, "tuple.exr", &e))
}

fn encoded(
    exr: &[u8],
    labels: &LabelImages,
    record: &TupleRecord,
    line: &SceneLine,
    format: ExportFormat,
    encoding: PixelEncoding,
) -> Result<Vec<(String, Bytes)>, ExportError> {
    let layers = decoded(exr, record, line)?;
    let (width, height) = (line.film.width, line.film.height);
    let precision = precision(record);
    let failed = |name: &str, reason: &dyn std::fmt::Display| ExportError::Encode {
        name: name.to_owned(),
        reason: reason.to_string(),
    };
    if format == ExportFormat::Exr {
        let name = layer_file(format, encoding, line, 0);
        let parts: Vec<(&str, &[[f32; 3]])> =
            made(line).map(|(layer, name)| (name, layers.0[layer].as_slice())).collect();
        let bytes = encode_parts_exr(&parts, labels, width, height, precision)
            .map_err(|e| failed(&name, &e))?;
        return Ok(vec![(name, bytes.into())]);
    }
    let mut files = Vec::new();
    for (layer, _) in made(line) {
        let name = layer_file(format, encoding, line, layer);
        let pixels = &layers.0[layer];
        let bytes = if encoding == PixelEncoding::Linear {
            encode_parts_exr(&[("", pixels)], &LabelImages::new(), width, height, precision)
                .map_err(|e| failed(&name, &e))?
        } else {
            encode_png16(pixels, width, height).map_err(|e| failed(&name, &e))?
        };
        files.push((name, bytes.into()));
    }
    Ok(files)
}

/// Returns the indices and names of a scene's layers.
pub(super) fn made(line: &SceneLine) -> impl Iterator<Item = (usize, &'static str)> {
    let asked = line.film.layers.asked().0;
    Layer::NAMES.into_iter().enumerate().filter(move |(layer, _)| asked[*layer])
}

fn damaged(line: &SceneLine, name: &str, reason: &dyn std::fmt::Display) -> ExportError {
    ExportError::Damaged { file: keys::tuple(&line.id, name), reason: reason.to_string() }
}
