//! Reads PLY files with vertex colours, in ASCII or in binary of either byte order.
//!
//! This reader replaces a general PLY crate: a number costs a table lookup instead of a call by property name, counts
//! are checked against the file's length before any allocation, and errors name the element.

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::limits::{MAX_TRIANGLES, MAX_VERTICES};
use super::ply_header::{Coding, Element, Header, Kind, Scalar};
use glam::DVec3;

/// Description of a usable mesh, for error texts.
const USABLE: &str = "a PLY mesh with vertex x, y, z, red, green, blue and face vertex_indices";

/// A mesh with the values of its file.
#[derive(Debug)]
pub(crate) struct Ply {
    /// Coordinates in the file's units.
    pub(crate) vertices: Vec<DVec3>,
    /// Red, green and blue in the file's coding; integers are divided by the maximum of their type.
    pub(crate) colors: Vec<[f64; 3]>,
    /// Faces, with polygons divided into fans of triangles.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Number of faces with fewer than three corners.
    pub(crate) empty_faces: u64,
}

/// Reads the header and checks it against the file's `length`; `file` may hold only the beginning.
pub(crate) fn head(file: &NamedBytes, length: u64) -> Result<Header, SceneError> {
    match file.format(USABLE)? {
        FileFormat::Ply => {}
        other => {
            return Err(file.wrong_format(format!("a {} file", other.name()), USABLE));
        }
    }
    let torn = |reason: String| file.unreadable(FileFormat::Ply, reason);
    let header = Header::parse(&file.bytes).map_err(torn)?;
    check_counts(file, length, &header)?;
    Ok(header)
}

/// Reads the names and the counts of a PLY file's elements from its header.
pub fn ply_counts(file: &NamedBytes) -> Result<Vec<(String, u64)>, SceneError> {
    let header = head(file, file.bytes.len() as u64)?;
    Ok(header.elements.into_iter().map(|e| (e.name, e.count)).collect())
}

pub(crate) fn decode(file: &NamedBytes) -> Result<Ply, SceneError> {
    let torn = |reason: String| file.unreadable(FileFormat::Ply, reason);
    let header = head(file, file.bytes.len() as u64)?;
    let mut body = Body { coding: header.coding, bytes: &file.bytes, at: header.body };
    let mut ply =
        Ply { vertices: Vec::new(), colors: Vec::new(), triangles: Vec::new(), empty_faces: 0 };
    let mut faces = None;
    for element in &header.elements {
        let short = |index: u64| {
            let (name, count) = (&element.name, element.count);
            torn(format!("it ends or has an invalid number in {name} {index} of {count}"))
        };
        match element.name.as_str() {
            "vertex" => read_vertices(file, element, &mut body, &short, &mut ply)?,
            "face" => {
                faces = Some(element.count);
                read_faces(file, element, &mut body, &short, &mut ply)?;
            }
            _ => skip(element, &mut body).map_err(short)?,
        }
    }
    if !body.is_spent() {
        let rest = file.bytes.len() - body.at;
        return Err(torn(format!("{rest} bytes follow the last element")));
    }
    if ply.vertices.is_empty() || faces.is_none_or(|count| count == 0) {
        return Err(file.wrong_layout("no vertices or no faces".to_owned(), USABLE));
    }
    let vertices = ply.vertices.len() as u32;
    // Faces may precede the vertices to which they refer.
    if let Some((face, _)) =
        ply.triangles.iter().enumerate().find(|(_, corners)| corners.iter().any(|&i| i >= vertices))
    {
        let worst = ply.triangles[face].into_iter().max().unwrap_or_default();
        return Err(file.bad_element(
            format!("triangle {face} (counted after the division of polygons)"),
            format!("refers to vertex {worst}, but the file has {vertices} vertices"),
            "write or fetch the file again",
        ));
    }
    Ok(ply)
}

/// Checks the counts against the file's size and the limits, before any allocation.
fn check_counts(file: &NamedBytes, length: u64, header: &Header) -> Result<(), SceneError> {
    let mut least_bytes = 0u64;
    for element in &header.elements {
        let limit = match element.name.as_str() {
            "vertex" => MAX_VERTICES,
            "face" => MAX_TRIANGLES,
            _ => usize::MAX,
        };
        if element.count > limit as u64 {
            return Err(file.bad_element(
                format!("its element {}", element.name),
                format!("has {} items; at most {limit} are read", element.count),
                "simplify the mesh",
            ));
        }
        let bytes = element.count.checked_mul(element.least_bytes(header.coding));
        least_bytes = least_bytes.saturating_add(bytes.unwrap_or(u64::MAX));
    }
    // The last number of an ASCII file needs no space after it.
    let there = length.saturating_sub(header.body as u64) + 1;
    if least_bytes > there {
        let reason = format!(
            "its header announces at least {least_bytes} bytes of data, but the file has {}",
            there - 1
        );
        return Err(file.unreadable(FileFormat::Ply, reason));
    }
    Ok(())
}

/// A cursor over the numbers of the body.
struct Body<'a> {
    coding: Coding,
    bytes: &'a [u8],
    at: usize,
}

impl Body<'_> {
    /// Reads the next number; `None` at the end of the file, or if the number does not have the type.
    #[inline]
    fn number(&mut self, kind: Scalar) -> Option<f64> {
        if self.coding == Coding::Ascii {
            return self.word(kind);
        }
        let size = kind.size();
        let bytes = self.bytes.get(self.at..self.at + size)?;
        self.at += size;
        let mut little = [0u8; 8];
        little[..size].copy_from_slice(bytes);
        if self.coding == Coding::BigEndian {
            little[..size].reverse();
        }
        let [a, b, c, d, ..] = little;
        Some(match kind {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(little),
        })
    }

    /// Reads the next word of an ASCII file as a number.
    fn word(&mut self, kind: Scalar) -> Option<f64> {
        self.skip_space();
        let rest = &self.bytes[self.at..];
        let length = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        let word = std::str::from_utf8(&rest[..length]).ok()?;
        self.at += length;
        match kind {
            Scalar::I8 => word.parse::<i8>().ok().map(f64::from),
            Scalar::U8 => word.parse::<u8>().ok().map(f64::from),
            Scalar::I16 => word.parse::<i16>().ok().map(f64::from),
            Scalar::U16 => word.parse::<u16>().ok().map(f64::from),
            Scalar::I32 => word.parse::<i32>().ok().map(f64::from),
            Scalar::U32 => word.parse::<u32>().ok().map(f64::from),
            // The value is rounded to the type, as in a binary file.
            Scalar::F32 => word.parse::<f32>().ok().map(f64::from),
            Scalar::F64 => word.parse().ok(),
        }
    }

    fn skip_space(&mut self) {
        let rest = &self.bytes[self.at..];
        self.at += rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
    }

    /// True at the end of the body. Skips the white space at the end of an ASCII file.
    fn is_spent(&mut self) -> bool {
        if self.coding == Coding::Ascii {
            self.skip_space();
        }
        self.at == self.bytes.len()
    }

    /// Reads the next number as a count or an index; `None` also if it is out of range.
    fn whole(&mut self, kind: Scalar) -> Option<u32> {
        let value = self.number(kind)?;
        (0.0..=4_294_967_295.0).contains(&value).then_some(value as u32)
    }

    fn pass(&mut self, kind: Kind) -> Option<()> {
        match kind {
            Kind::Scalar(scalar) => {
                self.number(scalar)?;
            }
            Kind::List { count, item } => {
                for _ in 0..self.whole(count)? {
                    self.number(item)?;
                }
            }
        }
        Some(())
    }
}

/// Skips an element. An error is the index of the first incomplete or invalid item.
fn skip(element: &Element, body: &mut Body) -> Result<(), u64> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for index in 0..element.count {
        for property in &element.properties {
            body.pass(property.kind).ok_or(index)?;
        }
    }
    Ok(())
}

fn read_vertices(
    file: &NamedBytes,
    element: &Element,
    body: &mut Body,
    short: &dyn Fn(u64) -> SceneError,
    ply: &mut Ply,
) -> Result<(), SceneError> {
    let names = ["x", "y", "z", "red", "green", "blue"];
    // For each property: the index in `names` and the divisor of the values; `None` for a skipped property.
    let mut uses = vec![None; element.properties.len()];
    for (place, name) in names.into_iter().enumerate() {
        let missing = || file.wrong_layout(format!("vertices without {name}"), USABLE);
        let at = element.find(name).ok_or_else(missing)?;
        let divisor = match (element.properties[at].kind, place < 3) {
            (Kind::Scalar(Scalar::F32 | Scalar::F64), _) => 1.0,
            (Kind::Scalar(Scalar::U8), false) => 255.0,
            (Kind::Scalar(Scalar::U16), false) => 65_535.0,
            (_, true) => {
                return Err(file
                    .wrong_layout(format!("vertices with {name} not as float or double"), USABLE));
            }
            (_, false) => {
                return Err(file.wrong_layout(
                    format!("vertices with {name} not as uchar, ushort, float or double"),
                    USABLE,
                ));
            }
        };
        uses[at] = Some((place, divisor));
    }
    ply.vertices.reserve_exact(element.count as usize);
    ply.colors.reserve_exact(element.count as usize);
    for index in 0..element.count {
        let mut values = [0.0; 6];
        for (property, of) in element.properties.iter().zip(&uses) {
            match (property.kind, of) {
                (Kind::Scalar(scalar), Some((place, divisor))) => {
                    let value = body.number(scalar).ok_or_else(|| short(index))?;
                    values[*place] = value / divisor;
                }
                (kind, _) => body.pass(kind).ok_or_else(|| short(index))?,
            }
        }
        if let Some(place) = values.iter().position(|value| !value.is_finite()) {
            return Err(file.bad_element(
                format!("vertex {index}"),
                format!("has {} as {}", values[place], names[place]),
                "repair the file",
            ));
        }
        let [x, y, z, red, green, blue] = values;
        ply.vertices.push(DVec3::new(x, y, z));
        ply.colors.push([red, green, blue]);
    }
    Ok(())
}

fn read_faces(
    file: &NamedBytes,
    element: &Element,
    body: &mut Body,
    short: &dyn Fn(u64) -> SceneError,
    ply: &mut Ply,
) -> Result<(), SceneError> {
    let at = element.find("vertex_indices").or_else(|| element.find("vertex_index"));
    let found = at.map(|at| (at, element.properties[at].kind));
    let Some((at, Kind::List { count, item })) =
        found.filter(|(_, kind)| matches!(kind, Kind::List { item, .. } if item.is_integer()))
    else {
        return Err(file.wrong_layout("faces without a list vertex_indices".to_owned(), USABLE));
    };
    ply.triangles.reserve_exact(element.count as usize);
    for index in 0..element.count {
        for (place, property) in element.properties.iter().enumerate() {
            if place != at {
                body.pass(property.kind).ok_or_else(|| short(index))?;
                continue;
            }
            let corners = body.whole(count).ok_or_else(|| short(index))?;
            ply.empty_faces += u64::from(corners < 3);
            let (mut first, mut last) = (0, 0);
            for corner in 0..corners {
                let vertex = body.whole(item).ok_or_else(|| short(index))?;
                match corner {
                    0 => first = vertex,
                    1 => {}
                    _ => ply.triangles.push([first, last, vertex]),
                }
                last = vertex;
            }
            if ply.triangles.len() > MAX_TRIANGLES {
                return Err(file.bad_element(
                    format!("face {index}"),
                    format!("exceeds the limit of {MAX_TRIANGLES} triangles"),
                    "simplify the mesh",
                ));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests;
