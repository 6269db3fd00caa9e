//! ZIP compression of OpenEXR's blocks of scan lines, with zlib-rs in place of the exr crate's miniz_oxide, which takes
//! longer and makes 1 % more bytes of a tuple's half floats.

use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::enumerate_ordered_header_block_indices;
use exr::block::writer::ChunksWriter;
use exr::error::Error;
use exr::image::Image;
use exr::image::write::layers::{LayersWriter, WritableLayers};
use flate2::{Compress, Compression, FlushCompress, Status};
use std::io::Cursor;

/// Level of deflate: levels 1 and 2 are faster, but make more bytes than the exr crate.
const LEVEL: u32 = 3;

// The exr crate delivers samples in the machine's byte order, and a file has the little one.
const _: () = assert!(cfg!(target_endian = "little"));

/// Encodes an image whose layers all have scan lines and [`exr::prelude::Compression::ZIP16`].
pub(super) fn write_zip16<'image, Layers: WritableLayers<'image>>(
    image: &'image Image<Layers>,
) -> Result<Vec<u8>, Error> {
    let headers = image.layer_data.infer_headers(&image.attributes);
    let layers = image.layer_data.create_writer(&headers);
    let mut deflate = Compress::new(Compression::new(LEVEL), true);
    let mut bytes = Cursor::new(Vec::new());
    exr::block::write(&mut bytes, headers, true, |meta, chunks| {
        let headers = &meta.headers;
        for (number, block) in enumerate_ordered_header_block_indices(headers) {
            let samples = layers.extract_uncompressed_block(headers, block);
            let top = headers[block.layer].own_attributes.layer_position.y();
            let y = i32::try_from(block.pixel_position.y())?;
            let block_of_lines = CompressedScanLineBlock {
                y_coordinate: top + y,
                compressed_pixels_le: zip(&mut deflate, samples)?,
            };
            let compressed_block = CompressedBlock::ScanLine(block_of_lines);
            chunks.write_chunk(number, Chunk { layer_index: block.layer, compressed_block })?;
        }
        Ok(())
    })?;
    Ok(bytes.into_inner())
}

/// Compresses the bytes of a block. Returns them unchanged if they would not become fewer, as the format requires.
fn zip(deflate: &mut Compress, samples: Vec<u8>) -> Result<Vec<u8>, Error> {
    let differences = differences(&samples);
    let mut zipped = vec![0; samples.len()];
    deflate.reset();
    let status = deflate
        .compress(&differences, &mut zipped, FlushCompress::Finish)
        .map_err(|e| Error::Io(std::io::Error::other(e)))?;
    if status != Status::StreamEnd || deflate.total_out() >= samples.len() as u64 {
        return Ok(samples);
    }
    zipped.truncate(deflate.total_out() as usize);
    Ok(zipped)
}

/// Returns the bytes with even index, then those with odd index, each as its difference to the byte before, plus 128:
/// `ImfZip.cpp` of OpenEXR.
fn differences(samples: &[u8]) -> Vec<u8> {
    let mut separated = Vec::with_capacity(samples.len());
    separated.extend(samples.iter().step_by(2));
    separated.extend(samples.iter().skip(1).step_by(2));
    let difference = |pair: &[u8]| pair[1].wrapping_sub(pair[0]).wrapping_add(128);
    let mut all = Vec::with_capacity(samples.len());
    all.extend(separated.first());
    all.extend(separated.windows(2).map(difference));
    all
}

#[cfg(test)]
mod tests {
    use super::super::exr_read::first_layer;
    use super::super::exr_write::{channel, encode_exr};
    use super::*;
    use exr::prelude::FlatSamples;
    use glasshouse_line::ExrPrecision;

    /// Values of a film of 37 x 35 px: rows end in the middle of a word, and the last block has three of sixteen lines.
    fn values(noise: bool) -> Vec<f32> {
        let value = |i: u32| {
            let n = if noise { i.wrapping_mul(2_654_435_761) >> 8 } else { 7 };
            (i % 37) as f32 * 0.01 + n as f32 * 1e-7
        };
        (0..37 * 35).map(value).collect()
    }

    #[test]
    fn other_readers_find_the_same_samples() {
        for precision in [ExrPrecision::Half, ExrPrecision::Float] {
            for noise in [true, false] {
                let channels =
                    ["a.R", "b.G"].map(|name| channel(name, values(noise).into_iter(), precision));
                let bytes = encode_exr(channels.to_vec(), 37, 35).unwrap();
                let layer = first_layer(&bytes).unwrap();
                for read in &layer.channel_data.list {
                    let back: Vec<f32> = match &read.sample_data {
                        FlatSamples::F16(samples) => samples.iter().map(|v| v.to_f32()).collect(),
                        FlatSamples::F32(samples) => samples.clone(),
                        FlatSamples::U32(_) => unreachable!("no integers were written"),
                    };
                    let same = channel("", values(noise).into_iter(), precision).sample_data;
                    let same: Vec<f32> = same.values_as_f32().collect();
                    assert_eq!(back, same);
                }
            }
        }
    }

    #[test]
    fn a_block_that_cannot_shrink_is_stored() {
        let mut deflate = Compress::new(Compression::new(LEVEL), true);
        let hash = |i: u32| blake3::hash(&i.to_le_bytes()).as_bytes().to_vec();
        let random: Vec<u8> = (0..99).flat_map(hash).collect();
        assert_eq!(zip(&mut deflate, random.clone()).unwrap(), random);
        let constant = vec![5; 999];
        assert!(zip(&mut deflate, constant).unwrap().len() < 50);
        // The stream before leaves nothing behind.
        assert_eq!(zip(&mut deflate, random.clone()).unwrap(), random);
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_instruction_set() {
        // Computed on an EPYC with AVX2: zlib-rs chooses its loops by the machine.
        let channels = [channel("R", values(true).into_iter(), ExrPrecision::Half)];
        let bytes = encode_exr(channels.to_vec(), 37, 35).unwrap();
        assert_eq!(blake3::hash(&bytes).to_hex()[..16], *"12dcbc205edbc6c3");
    }
}
