//! The files of a tuple: those of its layers, and the photographs that its sensor takes of them.

use crate::camera::{Shot, encode_dng};
use crate::jpeg::{encode_jpeg, to_rgb8};
use glasshouse_line::Sensor;
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::layer::Layer;
use render::atomic_file;
use render::merge::{
    PHOTO, RAW, Tuple, TupleWriteError, encode_layer_image, encode_rgb8_png, encode_tuple_record,
    photographed_layer, tuple_images,
};
use std::path::Path;

/// Writes the tuple's files into `folder`, durably. The last one is `tuple.json`, so that its presence implies the others.
pub fn write_tuple(tuple: &Tuple, folder: &Path) -> Result<(), TupleWriteError> {
    let files = encode_tuple(tuple, &SrgbEncoder::new())?;
    atomic_file::create_dir(folder)?;
    for (name, bytes) in files {
        atomic_file::write(&folder.join(name), &bytes)?;
    }
    Ok(())
}

/// Encodes a tuple's files. Returns names and bytes in the order of writing.
pub fn encode_tuple(
    tuple: &Tuple,
    encoder: &SrgbEncoder,
) -> Result<Vec<(String, Vec<u8>)>, TupleWriteError> {
    let mut files = Vec::new();
    for name in tuple_images(&tuple.record.scene) {
        let bytes = encode_tuple_image(tuple, encoder, &name)?;
        files.push((name, bytes));
    }
    files.push(encode_tuple_record(&tuple.record, &files)?);
    Ok(files)
}

/// Encodes one of a tuple's [`tuple_images`].
pub fn encode_tuple_image(
    tuple: &Tuple,
    encoder: &SrgbEncoder,
    name: &str,
) -> Result<Vec<u8>, TupleWriteError> {
    let Some(layer) = photographed_layer(name) else {
        return encode_layer_image(tuple, encoder, name);
    };
    let (scene, size) = (&tuple.record.scene, [tuple.width, tuple.height]);
    let (Some(sensor), Some(record)) = (&scene.sensor, &tuple.record.photographs) else {
        return Err(TupleWriteError::encode(name, &"the scene has no sensor"));
    };
    let pixels = tuple.stored(layer);
    encode_photograph(name, &pixels, size, sensor, record.exposure_factor, scene.seed)
}

/// Takes and encodes a photograph.
///
/// `pixels` are the linear values of the [`photographed_layer`] of `name`, row by row, as `tuple.exr` stores them. The factor is that
/// of [`render::merge::PhotographRecord`], and `seed` determines the noise.
pub fn encode_photograph(
    name: &str,
    pixels: &[[f32; 3]],
    size: [u32; 2],
    sensor: &Sensor,
    exposure_factor: f64,
    seed: u64,
) -> Result<Vec<u8>, TupleWriteError> {
    let size_px = size.map(|side| side as usize);
    let shot = Shot::with_factor(sensor, size_px, exposure_factor);
    let channel = |c: usize| pixels.iter().map(move |pixel| pixel[c]);
    let planes: Vec<f32> = (0..3).flat_map(channel).collect();
    encode_shot(name, &shot, &planes, seed)
}

/// Takes and encodes a photograph of planes. See [`encode_photograph`].
pub(crate) fn encode_shot(
    name: &str,
    shot: &Shot,
    planes: &[f32],
    seed: u64,
) -> Result<Vec<u8>, TupleWriteError> {
    let (sensor, size) = (shot.sensor(), shot.photograph_px());
    let error = |reason: &dyn std::fmt::Display| TupleWriteError::encode(name, reason);
    if photographed_layer(name) != Some(Layer::Input) {
        let rgb = to_rgb8(&shot.noiseless(planes));
        return encode_rgb8_png(&rgb, size.map(|side| side as u32)).map_err(|e| error(&e));
    }
    let numbers = shot.expose(planes, seed);
    match name {
        RAW => encode_dng(&numbers, shot.film_px(), sensor).map_err(|e| error(&e)),
        PHOTO => {
            let rgb = to_rgb8(&shot.develop(&numbers));
            let (quality, subsampling) = (sensor.jpeg_quality, sensor.jpeg_subsampling);
            encode_jpeg(&rgb, size, quality, subsampling).map_err(|e| error(&e))
        }
        _ => Err(error(&"there is no such photograph")),
    }
}
