//! Bounds the memory and the nesting of a `.pth` file before candle reads it.
//!
//! candle copies objects of a pickle and drops nested ones recursively. A file of a few bytes could therefore overflow the
//! stack or exhaust the memory. [`scan`] follows the opcodes with depths and sizes only, and keeps no object.

use std::collections::HashMap;
use std::io::{self, BufRead, Cursor, Read};
use std::path::Path;

/// Largest depth of nested objects. A list of weights has about 6.
const MAX_DEPTH: u32 = 64;
/// Largest number of objects that candle may create, copies included. torchvision's VGG-19 has about 3,000.
const MAX_OBJECTS: u64 = 1_000_000;
/// Largest size of the pickle in a file, bytes.
const MAX_PICKLE_BYTES: u64 = 1 << 24;
/// Number of bytes of a text that count as one object.
const TEXT_BYTES: u64 = 64;

/// Checks all pickles of a `.pth` file. An error is a text for the user.
pub(super) fn scan(path: &Path) -> Result<(), String> {
    let file = std::fs::File::open(path).map_err(|e| e.to_string())?;
    let mut archive = zip::ZipArchive::new(io::BufReader::new(file)).map_err(|e| e.to_string())?;
    for index in 0..archive.len() {
        let member = archive.by_index(index).map_err(|e| e.to_string())?;
        let is_pickle = member.name().is_ok_and(|name| name.ends_with("data.pkl"));
        if !is_pickle {
            continue;
        }
        let mut bytes = Vec::new();
        member.take(MAX_PICKLE_BYTES + 1).read_to_end(&mut bytes).map_err(|e| e.to_string())?;
        if bytes.len() as u64 > MAX_PICKLE_BYTES {
            return Err(format!("its list of tensors has more than {MAX_PICKLE_BYTES} bytes"));
        }
        scan_pickle(&bytes)?;
    }
    Ok(())
}

/// Depth and number of objects of an object on the stack.
#[derive(Clone, Copy)]
struct Size {
    depth: u32,
    objects: u64,
    is_mark: bool,
}

const LEAF: Size = Size { depth: 1, objects: 1, is_mark: false };

impl Size {
    /// Returns the size of an object that contains `parts`.
    fn around(parts: &[Self]) -> Self {
        parts.iter().fold(LEAF, |whole, part| whole.with(*part))
    }

    fn with(self, part: Self) -> Self {
        Self {
            depth: self.depth.max(part.depth.saturating_add(1)),
            objects: self.objects.saturating_add(part.objects),
            is_mark: false,
        }
    }
}

/// The stack and the memo of a pickle machine, with sizes in place of objects.
#[derive(Default)]
struct Machine {
    stack: Vec<Size>,
    memo: HashMap<u32, Size>,
    /// Number of objects so far, copies included.
    objects: u64,
}

fn scan_pickle(bytes: &[u8]) -> Result<(), String> {
    let mut reader = Cursor::new(bytes);
    let mut machine = Machine::default();
    while machine.step(&mut reader)? {}
    Ok(())
}

impl Machine {
    fn push(&mut self, size: Size, created: u64) -> Result<(), String> {
        self.objects = self.objects.saturating_add(created);
        if size.depth > MAX_DEPTH {
            return Err(format!("its pickle nests objects more than {MAX_DEPTH} deep"));
        }
        if self.objects > MAX_OBJECTS {
            return Err(format!("its pickle has more than {MAX_OBJECTS} objects"));
        }
        self.stack.push(size);
        Ok(())
    }

    fn pop(&mut self) -> Result<Size, String> {
        self.stack.pop().ok_or_else(|| "its pickle is damaged: the stack is empty".to_owned())
    }

    /// Replaces the last `count` objects by one that contains them.
    fn wrap(&mut self, count: usize) -> Result<(), String> {
        let mut whole = LEAF;
        for _ in 0..count {
            whole = whole.with(self.pop()?);
        }
        self.push(whole, 1)
    }

    fn pop_to_mark(&mut self) -> Result<Vec<Size>, String> {
        let mark = self.stack.iter().rposition(|size| size.is_mark);
        let mark = mark.ok_or("its pickle is damaged: a mark is missing")?;
        let parts = self.stack.split_off(mark + 1);
        self.stack.pop();
        Ok(parts)
    }

    /// Adds objects to the container on top of the stack.
    fn add(&mut self, parts: &[Size]) -> Result<(), String> {
        let container = self.pop()?;
        let whole = parts.iter().fold(container, |whole, part| whole.with(*part));
        self.push(whole, 0)
    }

    fn get(&mut self, id: u32) -> Result<(), String> {
        let size = self.memo.get(&id).copied();
        let size = size.ok_or("its pickle is damaged: an object is missing in its memo")?;
        self.push(size, size.objects)
    }

    fn put(&mut self, id: u32) -> Result<(), String> {
        let size = self.pop()?;
        self.memo.insert(id, size);
        self.push(size, size.objects)
    }

    /// Follows one opcode. Returns false at the end, and before an opcode that candle refuses.
    fn step(&mut self, reader: &mut Cursor<&[u8]>) -> Result<bool, String> {
        let Ok([code]) = bytes(reader) else {
            return Ok(false);
        };
        match code {
            0x80 => drop(bytes::<1>(reader)?),
            b'c' => {
                let length = line(reader)? + line(reader)?;
                self.push(LEAF, 1 + length / TEXT_BYTES)?;
            }
            b'K' => self.leaf::<1>(reader)?,
            b'M' => self.leaf::<2>(reader)?,
            b'J' => self.leaf::<4>(reader)?,
            b'G' => self.leaf::<8>(reader)?,
            b'N' | 0x88 | 0x89 | b')' | b']' | b'}' => self.leaf::<0>(reader)?,
            0x8a => {
                let [count] = bytes(reader)?;
                skip(reader, count.into())?;
                self.push(LEAF, 1)?;
            }
            b'X' => {
                let length = u32::from_le_bytes(bytes(reader)?).into();
                skip(reader, length)?;
                let objects = 1 + length / TEXT_BYTES;
                self.push(Size { objects, ..LEAF }, objects)?;
            }
            b'(' => self.push(Size { is_mark: true, ..LEAF }, 1)?,
            b'Q' | 0x85 => self.wrap(1)?,
            0x86 | b'R' | 0x81 | b'b' => self.wrap(2)?,
            0x87 => self.wrap(3)?,
            b't' | b'd' => {
                let parts = self.pop_to_mark()?;
                self.push(Size::around(&parts), 1)?;
            }
            b'a' => {
                let part = self.pop()?;
                self.add(&[part])?;
            }
            b's' => {
                let parts = [self.pop()?, self.pop()?];
                self.add(&parts)?;
            }
            b'e' | b'u' => {
                let parts = self.pop_to_mark()?;
                self.add(&parts)?;
            }
            b'h' => {
                let [id] = bytes(reader)?;
                self.get(id.into())?;
            }
            b'j' => self.get(u32::from_le_bytes(bytes(reader)?))?,
            b'q' => {
                let [id] = bytes(reader)?;
                self.put(id.into())?;
            }
            b'r' => self.put(u32::from_le_bytes(bytes(reader)?))?,
            // The end. candle refuses all other opcodes before it executes them.
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Pushes an object without parts, after `N` bytes of arguments.
    fn leaf<const N: usize>(&mut self, reader: &mut Cursor<&[u8]>) -> Result<(), String> {
        bytes::<N>(reader)?;
        self.push(LEAF, 1)
    }
}

fn bytes<const N: usize>(reader: &mut Cursor<&[u8]>) -> Result<[u8; N], String> {
    let mut bytes = [0; N];
    reader.read_exact(&mut bytes).map_err(|_| "its pickle is truncated".to_owned())?;
    Ok(bytes)
}

fn skip(reader: &mut Cursor<&[u8]>, count: u64) -> Result<(), String> {
    let left = reader.get_ref().len() as u64 - reader.position();
    if count > left {
        return Err("its pickle is truncated".to_owned());
    }
    reader.set_position(reader.position() + count);
    Ok(())
}

/// Skips a line; returns its length, bytes.
fn line(reader: &mut Cursor<&[u8]>) -> Result<u64, String> {
    reader.skip_until(b'\n').map(|length| length as u64).map_err(|e| e.to_string())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::io::Write;

    /// Writes a `.pth` file with the given pickle.
    pub(in super::super) fn write_pth(path: &Path, pickle: &[u8]) {
        let mut archive = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
        let options = zip::write::SimpleFileOptions::default();
        archive.start_file("archive/data.pkl", options).unwrap();
        archive.write_all(pickle).unwrap();
        archive.finish().unwrap();
    }

    /// A pickle of `depth` nested tuples.
    pub(in super::super) fn nested(depth: usize) -> Vec<u8> {
        let mut pickle = vec![0x80, 2, b')'];
        pickle.resize(3 + depth, 0x85);
        pickle.push(b'.');
        pickle
    }

    #[test]
    fn nested_and_copied_objects_are_refused() {
        scan_pickle(&nested(60)).unwrap();
        let error = scan_pickle(&nested(1_000_000)).unwrap_err();
        assert_eq!(error, "its pickle nests objects more than 64 deep");
        // Each round makes a tuple of two copies of the previous one.
        let mut doubled = vec![0x80, 2, b')'];
        for _ in 0..40 {
            doubled.extend([b'q', 0, b'h', 0, 0x86]);
        }
        doubled.push(b'.');
        let error = scan_pickle(&doubled).unwrap_err();
        assert_eq!(error, "its pickle has more than 1000000 objects");
        // A text of 4 GB that is not there.
        let error = scan_pickle(&[0x80, 2, b'X', 255, 255, 255, 255]).unwrap_err();
        assert_eq!(error, "its pickle is truncated");
    }

    #[test]
    fn lists_and_dictionaries_count() {
        let mut lists = vec![0x80, 2, b']'];
        lists.extend([b']'; 100]);
        lists.extend([b'a'; 100]);
        lists.push(b'.');
        assert!(scan_pickle(&lists).unwrap_err().contains("nests objects"));
        let dictionary = b"\x80\x02}q\x00(X\x01\x00\x00\x00aK\x01X\x01\x00\x00\x00bK\x02u.";
        scan_pickle(dictionary).unwrap();
    }
}
