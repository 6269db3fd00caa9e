//! The header of a PLY file: its elements and their properties.
//!
//! Greg Turk, "The PLY Polygon File Format", 1994: lines of ASCII from `ply` to `end_header`.

/// Largest length of a header, bytes. Real headers have hundreds of bytes, including comments.
const MAX_HEADER: usize = 1 << 16;
/// Largest number of elements, and of properties of an element.
const MAX_PARTS: usize = 256;

/// Coding of the numbers in the body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Coding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Result<Self, String> {
        Ok(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return Err(format!("the header names an unknown type {name:?}")),
        })
    }

    /// Returns the size of a number in a binary file, bytes.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(crate) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }
}

/// Type of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Scalar(Scalar),
    /// A count, followed by that number of items.
    List {
        count: Scalar,
        item: Scalar,
    },
}

#[derive(Debug)]
pub(crate) struct Property {
    pub(crate) name: String,
    pub(crate) kind: Kind,
}

/// A table of the file, such as its vertices or faces.
#[derive(Debug)]
pub(crate) struct Element {
    pub(crate) name: String,
    pub(crate) count: u64,
    pub(crate) properties: Vec<Property>,
}

impl Element {
    /// Returns the index of the property `name`, if the element has one.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }

    /// Returns the least size of an item in the body, bytes: a list may have only its count, and an ASCII number
    /// needs a digit and a space.
    pub(crate) fn least_bytes(&self, coding: Coding) -> u64 {
        let of = |property: &Property| match (coding, property.kind) {
            (Coding::Ascii, _) => 2,
            (_, Kind::Scalar(scalar) | Kind::List { count: scalar, .. }) => scalar.size() as u64,
        };
        self.properties.iter().map(of).sum()
    }
}

#[derive(Debug)]
pub(crate) struct Header {
    pub(crate) coding: Coding,
    pub(crate) elements: Vec<Element>,
    /// Offset of the body, bytes.
    pub(crate) body: usize,
}

impl Header {
    /// Reads the header. An error is a text for the user.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let mut coding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut at = 0;
        loop {
            let rest = &bytes[at..bytes.len().min(MAX_HEADER)];
            let length = rest
                .iter()
                .position(|&byte| byte == b'\n')
                .ok_or("the header has no end_header")?;
            let is_first = at == 0;
            at += length + 1;
            let line = std::str::from_utf8(&rest[..length])
                .map_err(|_| "the header is not text".to_owned())?;
            let mut words = line.split_ascii_whitespace();
            let mut word = || words.next().unwrap_or_default();
            match word() {
                "ply" if is_first => {}
                "comment" | "obj_info" | "" if !is_first => {}
                "format" if coding.is_none() => {
                    coding = Some(match (word(), word()) {
                        ("ascii", "1.0") => Coding::Ascii,
                        ("binary_little_endian", "1.0") => Coding::LittleEndian,
                        ("binary_big_endian", "1.0") => Coding::BigEndian,
                        (coding, version) => {
                            return Err(format!("its format {coding} {version} is unknown"));
                        }
                    });
                }
                "element" if coding.is_some() && elements.len() < MAX_PARTS => {
                    let (name, count) = (word().to_owned(), word());
                    let count = count
                        .parse()
                        .map_err(|_| format!("element {name} has the count {count:?}"))?;
                    if elements.iter().any(|e| e.name == name) {
                        return Err(format!("the header has element {name} twice"));
                    }
                    elements.push(Element { name, count, properties: Vec::new() });
                }
                "property" => {
                    let element = elements.last_mut().ok_or("a property precedes all elements")?;
                    let kind = match word() {
                        "list" => Kind::List {
                            count: Scalar::parse(word())?,
                            item: Scalar::parse(word())?,
                        },
                        scalar => Kind::Scalar(Scalar::parse(scalar)?),
                    };
                    if matches!(kind, Kind::List { count, .. } if !count.is_integer()) {
                        return Err("a list has a count of floating-point type".to_owned());
                    }
                    let name = word().to_owned();
                    if element.find(&name).is_some() {
                        return Err(format!("element {} has {name} twice", element.name));
                    }
                    if element.properties.len() == MAX_PARTS {
                        return Err(format!("element {} has too many properties", element.name));
                    }
                    element.properties.push(Property { name, kind });
                }
                "end_header" => break,
                _ => return Err(format!("the header line {:?} is invalid", short(line))),
            }
        }
        Ok(Self { coding: coding.ok_or("the header has no format")?, elements, body: at })
    }
}

/// Returns the start of a line, for an error.
fn short(line: &str) -> String {
    line.trim_end().chars().take(60).collect()
}
