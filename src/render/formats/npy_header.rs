//! The header of a `.npy` file: versions 1.0, 2.0 and 3.0 of NumPy's array format.
//!
//! <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>. The header is a Python dict literal with
//! exactly the keys `descr`, `fortran_order` and `shape`, here in any order and spacing.
//!
//! The parser of `npyz` is not used: it allocates the length that a header states, and its grammar backtracks, so that a
//! header of a hundred nested brackets takes minutes.

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};

/// Largest number of axes; the parser refuses more.
const MAX_AXES: usize = 8;

/// An array that cannot be read.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum NpyError {
    #[error("the file ends within the header")]
    ShortHeader,
    #[error("format version {0}.{1} is not known")]
    Version(u8, u8),
    #[error("the header is malformed at byte {0}")]
    Syntax(usize),
    #[error("the header needs the keys descr, fortran_order and shape, once each")]
    Keys,
    #[error("elements of type {0:?} are not numbers or booleans of up to 8 bytes")]
    Element(String),
    #[error("the shape needs {needed} bytes of data, but the file has {found}")]
    Length { needed: usize, found: usize },
}

/// The layout of an array's bytes.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct NpyHeader {
    pub(crate) element: Element,
    pub(crate) big_endian: bool,
    pub(crate) fortran_order: bool,
    pub(crate) shape: Vec<usize>,
    /// Offset of the first element from the start of the file, bytes.
    pub(crate) data_offset: usize,
}

/// Type of an array's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    Bool,
    U8,
    U16,
    U32,
    U64,
    I8,
    I16,
    I32,
    I64,
    F16,
    F32,
    F64,
}

impl Element {
    /// Returns the size of an element, bytes.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::Bool | Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// Returns NumPy's code without the byte order, such as `f4`.
    pub(crate) fn code(self) -> &'static str {
        match self {
            Self::Bool => "b1",
            Self::U8 => "u1",
            Self::U16 => "u2",
            Self::U32 => "u4",
            Self::U64 => "u8",
            Self::I8 => "i1",
            Self::I16 => "i2",
            Self::I32 => "i4",
            Self::I64 => "i8",
            Self::F16 => "f2",
            Self::F32 => "f4",
            Self::F64 => "f8",
        }
    }

    /// Parses NumPy's code, such as `<f4` or `|u1`, into the type and a flag that is true for big-endian.
    fn parse(descr: &str) -> Option<(Self, bool)> {
        use Element::{Bool, F16, F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
        let all = [Bool, U8, U16, U32, U64, I8, I16, I32, I64, F16, F32, F64];
        let (order, code) = descr.split_at_checked(1)?;
        let element = all.into_iter().find(|element| element.code() == code)?;
        match order {
            "<" => Some((element, false)),
            ">" => Some((element, true)),
            // "|" means no byte order, which suits only single bytes.
            "|" if element.size() == 1 => Some((element, false)),
            _ => None,
        }
    }
}

/// Reads the element type (such as `f4`) and the shape from the header, and checks that no element is missing.
pub fn npy_facts(file: &NamedBytes) -> Result<(&'static str, Vec<usize>), SceneError> {
    let failed = |error: NpyError| file.unreadable(FileFormat::Npy, error);
    let header = NpyHeader::parse(&file.bytes).map_err(failed)?;
    let product =
        header.shape.iter().try_fold(header.element.size(), |n, side| n.checked_mul(*side));
    let found = file.bytes.len() - header.data_offset;
    match product {
        Some(needed) if needed <= found => Ok((header.element.code(), header.shape)),
        needed => Err(failed(NpyError::Length { needed: needed.unwrap_or(usize::MAX), found })),
    }
}

impl NpyHeader {
    /// Reads the header at the start of a file.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, NpyError> {
        let (length, start) = match bytes {
            [0x93, b'N', b'U', b'M', b'P', b'Y', 1, 0, a, b, ..] => {
                (u16::from_le_bytes([*a, *b]) as usize, 10)
            }
            [0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, 0, a, b, c, d, ..] => {
                (u32::from_le_bytes([*a, *b, *c, *d]) as usize, 12)
            }
            [0x93, b'N', b'U', b'M', b'P', b'Y', 1..=3, 0, ..] => {
                return Err(NpyError::ShortHeader);
            }
            [_, _, _, _, _, _, major, minor, ..] => return Err(NpyError::Version(*major, *minor)),
            _ => return Err(NpyError::ShortHeader),
        };
        let text = bytes[start..].get(..length).ok_or(NpyError::ShortHeader)?;
        let mut literal = Literal { text, at: 0 };
        let (element, big_endian, fortran_order, shape) = literal.dict()?;
        Ok(Self { element, big_endian, fortran_order, shape, data_offset: start + length })
    }
}

/// A cursor over the Python literal.
struct Literal<'a> {
    text: &'a [u8],
    at: usize,
}

impl<'a> Literal<'a> {
    /// Reads `{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }` up to the end of the text.
    fn dict(&mut self) -> Result<(Element, bool, bool, Vec<usize>), NpyError> {
        let (mut descr, mut fortran_order, mut shape) = (None, None, None);
        self.expect(b'{')?;
        while !self.take(b'}') {
            let key = self.string()?;
            self.expect(b':')?;
            let repeated = match key {
                "descr" => descr.replace(self.string()?).is_some(),
                "fortran_order" => fortran_order.replace(self.boolean()?).is_some(),
                "shape" => shape.replace(self.tuple()?).is_some(),
                _ => true,
            };
            if repeated {
                return Err(NpyError::Keys);
            }
            if !self.take(b',') {
                self.expect(b'}')?;
                break;
            }
        }
        self.skip_space();
        if self.at != self.text.len() {
            return Err(self.error());
        }
        let (Some(descr), Some(fortran_order), Some(shape)) = (descr, fortran_order, shape) else {
            return Err(NpyError::Keys);
        };
        let (element, big_endian) =
            Element::parse(descr).ok_or_else(|| NpyError::Element(descr.to_owned()))?;
        Ok((element, big_endian, fortran_order, shape))
    }

    /// Reads `'text'` or `"text"`, without escapes. A structured type, `[('x', '<f4')]`, is an error.
    fn string(&mut self) -> Result<&'a str, NpyError> {
        self.skip_space();
        if self.text.get(self.at) == Some(&b'[') {
            return Err(NpyError::Element("structured".to_owned()));
        }
        let rest = &self.text[self.at..];
        let quote = *rest.first().ok_or_else(|| self.error())?;
        if quote != b'\'' && quote != b'"' {
            return Err(self.error());
        }
        let length =
            rest[1..].iter().position(|&byte| byte == quote).ok_or_else(|| self.error())?;
        let text = str::from_utf8(&rest[1..=length]).map_err(|_| self.error())?;
        self.at += length + 2;
        Ok(text)
    }

    fn boolean(&mut self) -> Result<bool, NpyError> {
        self.skip_space();
        for (word, value) in [("True", true), ("False", false)] {
            if self.text[self.at..].starts_with(word.as_bytes()) {
                self.at += word.len();
                return Ok(value);
            }
        }
        Err(self.error())
    }

    /// Reads `()`, `(3,)` or `(2, 3)`, also with integers of Python 2, such as `3L`.
    fn tuple(&mut self) -> Result<Vec<usize>, NpyError> {
        let mut shape = Vec::new();
        self.expect(b'(')?;
        while !self.take(b')') {
            if shape.len() == MAX_AXES {
                return Err(self.error());
            }
            shape.push(self.integer()?);
            if !self.take(b',') {
                self.expect(b')')?;
                break;
            }
        }
        Ok(shape)
    }

    fn integer(&mut self) -> Result<usize, NpyError> {
        self.skip_space();
        let digits = self.text[self.at..].iter().take_while(|byte| byte.is_ascii_digit()).count();
        let text = str::from_utf8(&self.text[self.at..self.at + digits]).unwrap_or("");
        let value = text.parse().map_err(|_| self.error())?;
        self.at += digits;
        if self.text.get(self.at) == Some(&b'L') {
            self.at += 1;
        }
        Ok(value)
    }

    fn expect(&mut self, byte: u8) -> Result<(), NpyError> {
        if self.take(byte) { Ok(()) } else { Err(self.error()) }
    }

    fn take(&mut self, byte: u8) -> bool {
        self.skip_space();
        let found = self.text.get(self.at) == Some(&byte);
        self.at += usize::from(found);
        found
    }

    fn skip_space(&mut self) {
        self.at += self.text[self.at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
    }

    fn error(&self) -> NpyError {
        NpyError::Syntax(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<NpyHeader, NpyError> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        NpyHeader::parse(&bytes)
    }

    #[test]
    fn spacing_order_and_quotes_may_vary() {
        for text in [
            "{'descr': '<f4', 'fortran_order': False, 'shape': (768, 1024, 1), }   \n",
            "{'shape':(768,1024,1),'fortran_order':False,'descr':'<f4'}",
            " {\n\"fortran_order\" : False ,\t'shape' : ( 768L , 1024L , 1L , ) , 'descr' : \"<f4\" } ",
        ] {
            let header = parse(text).unwrap();
            assert_eq!(header.shape, [768, 1024, 1]);
            assert_eq!(header.element, Element::F32);
            assert!(!header.big_endian && !header.fortran_order);
            assert_eq!(header.data_offset, 10 + text.len());
        }
        let header = parse("{'descr':'>i8','fortran_order':True,'shape':(5,)}").unwrap();
        assert_eq!((header.element, header.big_endian), (Element::I64, true));
        assert_eq!((header.fortran_order, header.shape), (true, vec![5]));
        let header = parse("{'descr':'|b1','fortran_order':True,'shape':()}").unwrap();
        assert!(header.shape.is_empty());
    }

    #[test]
    fn invalid_headers_are_refused() {
        let dict = |inside: &str| parse(&format!("{{{inside}}}")).unwrap_err();
        assert_eq!(dict(""), NpyError::Keys);
        assert_eq!(dict("'descr':'<f4','fortran_order':False"), NpyError::Keys);
        assert_eq!(dict("'descr':'<f4','descr':'<f4'"), NpyError::Keys);
        assert_eq!(dict("'other':1"), NpyError::Keys);
        let with =
            |descr: &str| dict(&format!("'fortran_order':False,'shape':(1,1),'descr':{descr}"));
        for descr in ["<c8", "|O", "<U3", "f4", "=f4", "|f4", "<f16", "", "é4"] {
            assert_eq!(with(&format!("'{descr}'")), NpyError::Element(descr.to_owned()));
        }
        assert_eq!(with("[('x','<f4')]"), NpyError::Element("structured".to_owned()));
        for text in [
            "",
            "{",
            "{'",
            "{'descr'",
            "{'descr':",
            "{'descr':'<f4'",
            "x",
            "{'shape':(1",
            "{'shape':(-1,)}",
            "{'shape':(99999999999999999999,)}",
            "{'shape':(1,1,1,1,1,1,1,1,1)}",
            "{'shape':(L,)}",
            "{'descr':'<f4','fortran_order':0,'shape':(1,1)}",
            "{'descr':'<f4','fortran_order':False,'shape':(1,1)} import os",
        ] {
            assert!(matches!(parse(text), Err(NpyError::Syntax(_))), "{text}");
        }
    }

    #[test]
    fn unknown_versions_and_wrong_lengths_are_refused() {
        assert_eq!(NpyHeader::parse(b"\x93NUMPY"), Err(NpyError::ShortHeader));
        assert_eq!(NpyHeader::parse(b"\x93NUMPY\x02\x00\xff"), Err(NpyError::ShortHeader));
        assert_eq!(NpyHeader::parse(b"\x93NUMPY\x04\x00    "), Err(NpyError::Version(4, 0)));
        assert_eq!(NpyHeader::parse(b"\x93NUMPY\x01\x00\xff\xff{"), Err(NpyError::ShortHeader));
        let giant = b"\x93NUMPY\x02\x00\xff\xff\xff\xff{'descr'";
        assert_eq!(NpyHeader::parse(giant), Err(NpyError::ShortHeader));
        let text = "{'descr':'<f8','fortran_order':False,'shape':(1,2)}";
        for version in [2, 3] {
            let mut bytes = vec![0x93, b'N', b'U', b'M', b'P', b'Y', version, 0];
            bytes.extend((text.len() as u32).to_le_bytes());
            bytes.extend(text.as_bytes());
            let header = NpyHeader::parse(&bytes).unwrap();
            assert_eq!((header.shape, header.data_offset), (vec![1, 2], bytes.len()));
        }
    }
}
