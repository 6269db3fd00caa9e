//! Event files for TensorBoard: TFRecords of `Event` messages (tensorflow/core/util/event.proto) of scalars and PNGs.

use render::atomic_file::{self, WriteError};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

pub(super) struct EventFile {
    file: File,
    pub(super) path: PathBuf,
}

/// Appends a number as a varint of protocol buffers.
fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn field_varint(out: &mut Vec<u8>, field: u64, value: u64) {
    varint(out, field << 3);
    varint(out, value);
}

fn field_bytes(out: &mut Vec<u8>, field: u64, bytes: &[u8]) {
    varint(out, field << 3 | 2);
    varint(out, bytes.len() as u64);
    out.extend_from_slice(bytes);
}

/// Computes the checksum of TFRecords: CRC-32C, rotated and offset so that data may contain checksums.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

fn record(event: &[u8]) -> Vec<u8> {
    let length = (event.len() as u64).to_le_bytes();
    let mut out = length.to_vec();
    out.extend(masked_crc(&length).to_le_bytes());
    out.extend_from_slice(event);
    out.extend(masked_crc(event).to_le_bytes());
    out
}

fn event(seconds: f64, step: u64, field: u64, payload: &[u8]) -> Vec<u8> {
    let mut out = vec![1 << 3 | 1];
    out.extend(seconds.to_le_bytes());
    field_varint(&mut out, 2, step);
    field_bytes(&mut out, field, payload);
    out
}

/// Encodes a number as `Summary.Value`.
fn scalar(tag: &str, value: f32) -> Vec<u8> {
    let mut out = Vec::new();
    field_bytes(&mut out, 1, tag.as_bytes());
    out.push(2 << 3 | 5);
    out.extend(value.to_le_bytes());
    out
}

/// Encodes a PNG as `Summary.Value`.
fn picture(tag: &str, [width, height]: [u32; 2], png: &[u8]) -> Vec<u8> {
    let mut image = Vec::new();
    field_varint(&mut image, 1, height.into());
    field_varint(&mut image, 2, width.into());
    field_varint(&mut image, 3, 3);
    field_bytes(&mut image, 4, png);
    let mut out = Vec::new();
    field_bytes(&mut out, 1, tag.as_bytes());
    field_bytes(&mut out, 4, &image);
    out
}

impl EventFile {
    /// Creates the file for training that starts or resumes at `step`; replaces an older file for that step.
    pub(super) fn create(folder: &Path, step: u64) -> Result<Self, WriteError> {
        let path = folder.join(format!("events.out.tfevents.{step:010}"));
        atomic_file::write(&path, &record(&event(now(), 0, 3, b"brain.Event:2")))?;
        let file = File::options().append(true).open(&path);
        let file = file.map_err(|source| WriteError { path: path.clone(), source })?;
        Ok(Self { file, path })
    }

    /// Makes all events durable.
    pub(super) fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }

    /// Adds scalars of a step.
    pub(super) fn scalars(&mut self, step: u64, values: &[(&str, f32)]) -> io::Result<()> {
        let mut summary = Vec::new();
        for (tag, value) in values {
            field_bytes(&mut summary, 1, &scalar(tag, *value));
        }
        self.file.write_all(&record(&event(now(), step, 5, &summary)))
    }

    /// Adds a PNG of a step.
    pub(super) fn picture(
        &mut self,
        step: u64,
        tag: &str,
        size: [u32; 2],
        png: &[u8],
    ) -> io::Result<()> {
        let mut summary = Vec::new();
        field_bytes(&mut summary, 1, &picture(tag, size, png));
        self.file.write_all(&record(&event(now(), step, 5, &summary)))
    }
}

/// Returns the seconds since 1970, which TensorBoard shows.
fn now() -> f64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0.0, |duration| duration.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_equal_those_of_tensorboard() {
        // The first record of an event file, written by tensorboard 2.21's RecordWriter at wall time 1.5.
        let bytes = record(&event_of_version(1.5));
        let expected = [
            0x18, 0, 0, 0, 0, 0, 0, 0, 0xa3, 0x7f, 0x4b, 0x22, 0x09, 0, 0, 0, 0, 0, 0, 0xf8, 0x3f,
            0x1a, 0x0d, b'b', b'r', b'a', b'i', b'n', b'.', b'E', b'v', b'e', b'n', b't', b':',
            b'2', 0x2a, 0x28, 0x64, 0x6c,
        ];
        assert_eq!(bytes, expected);
    }

    /// Returns an event without a step, as TensorFlow writes it.
    fn event_of_version(seconds: f64) -> Vec<u8> {
        let mut out = vec![1 << 3 | 1];
        out.extend(seconds.to_le_bytes());
        field_bytes(&mut out, 3, b"brain.Event:2");
        out
    }
}
