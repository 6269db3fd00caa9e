//! Inspects a file by its path.

use super::archive;
use super::bytes::{HEAD_BYTES, inspect_bytes};
use super::facts::{Inspection, Problem};
use super::input::Input;
use super::kind::{Kind, kind_of};
use render::input_file::InputFile;
use std::io::{self, Read, Seek};
use std::path::Path;

/// Maximum length of a file that is read as a whole, bytes. Archives are read as streams.
const MAX_WHOLE_BYTES: u64 = 1 << 32;

/// Inspects a file. Every error, even of a missing file, becomes a problem of the inspection.
pub(super) fn inspect_file(path: &Path) -> Inspection {
    read(path).unwrap_or_else(|error| {
        let mut found = Inspection::new(Kind::Unknown);
        let to_do = match error.kind() {
            io::ErrorKind::NotFound => "check the path: it is relative to the current folder",
            io::ErrorKind::InvalidInput => "give a file or a folder",
            io::ErrorKind::PermissionDenied => "check its permissions",
            _ => "check the disk",
        };
        found.wrong(Problem::new(format!("it cannot be read: {error}"), to_do));
        found
    })
}

fn read(path: &Path) -> io::Result<Inspection> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut file = InputFile::open(path)?;
    let length = file.len();
    let mut bytes = Vec::new();
    (&mut file).take(HEAD_BYTES as u64).read_to_end(&mut bytes)?;
    let beside = |name: &str| file_beside(path, name);
    if kind_of(&name, &bytes) == Some(Kind::Archive) {
        file.rewind()?;
        let stream = io::BufReader::with_capacity(1 << 20, file);
        return Ok(archive::read(stream, length));
    }
    if length > MAX_WHOLE_BYTES {
        let mut found = Inspection::new(kind_of(&name, &bytes).unwrap_or(Kind::Unknown));
        found.bytes = Some(length);
        let what = format!("it has {length} bytes, more than the limit of {MAX_WHOLE_BYTES} bytes");
        found.wrong(Problem::new(what, "give another file; only archives may be longer"));
        return Ok(found);
    }
    file.take(MAX_WHOLE_BYTES).read_to_end(&mut bytes)?;
    Ok(inspect_bytes(&Input { name: &name, bytes: &bytes, beside: &beside }))
}

/// Reads a file in or below the folder of `path`. Returns `None` if it cannot be read, is too long, or lies elsewhere.
fn file_beside(path: &Path, name: &str) -> Option<Vec<u8>> {
    let is_plain = |part: std::path::Component| matches!(part, std::path::Component::Normal(_));
    if !Path::new(name).components().all(is_plain) {
        return None;
    }
    let path = path.parent()?.join(name);
    let is_readable = |data: &std::fs::Metadata| data.is_file() && data.len() <= MAX_WHOLE_BYTES;
    std::fs::metadata(&path).ok().filter(is_readable)?;
    render::input_file::read(&path).ok()
}
