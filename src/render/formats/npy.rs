//! Reads images from `.npy` files, and from `.npz` files with one array, in C or Fortran order, with elements of any [`Element`] type, row by row.

use super::error::SceneError;
use super::files::{FileFormat, NamedBytes};
use super::limits::check_size;
use super::npy_header::{Element, NpyError, NpyHeader};
use super::npz;
use ::exr::prelude::f16;
use std::borrow::Cow;

/// Meaning of an array's axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axes {
    /// A depth image or mask: (H,W), (H,W,1) or (1,H,W). (1,N,1) is one row of N pixels.
    Single,
    /// A colour image: (H,W), (H,W,1), (H,W,3) or (H,W,4).
    Color,
}

/// An image inside the bytes of a `.npy` file, without a copy.
pub(crate) struct NpyImage<'a> {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1 (grey), 3 (RGB) or 4 (RGB and alpha).
    pub(crate) channels: usize,
    pub(crate) element: Element,
    big_endian: bool,
    /// Distances, in elements, to the pixel below, to the next pixel of the row, and to the next channel.
    strides: [usize; 3],
    data: Cow<'a, [u8]>,
}

/// Size and type of an image, from its header.
pub(crate) struct NpyHead {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// 1 (grey), 3 (RGB) or 4 (RGB and alpha).
    pub(crate) channels: usize,
    header: NpyHeader,
}

impl NpyHead {
    /// Returns the type of the elements.
    pub(crate) fn element(&self) -> Element {
        self.header.element
    }

    /// Parses the header and checks the shape, the size and the file's `length`; `file` may hold only the beginning.
    pub(crate) fn parse(
        file: &NamedBytes,
        length: u64,
        axes: Axes,
        expected: &'static str,
    ) -> Result<Self, SceneError> {
        let array = npz::array(file)?;
        let length = if npz::is_archive(file) { array.len() as u64 } else { length };
        Self::of_array(file, &array, length, axes, expected)
    }

    /// Parses the header of an array of `length` bytes and checks the shape and the size.
    fn of_array(
        file: &NamedBytes,
        array: &[u8],
        length: u64,
        axes: Axes,
        expected: &'static str,
    ) -> Result<Self, SceneError> {
        let unreadable = |error: NpyError| file.unreadable(FileFormat::Npy, error);
        let header = NpyHeader::parse(array).map_err(unreadable)?;
        let (height_axis, channels) = match (axes, header.shape.as_slice()) {
            (_, [_, _] | [_, _, 1]) => (0, 1),
            (Axes::Single, [1, _, _]) => (1, 1),
            (Axes::Color, [_, _, 3]) => (0, 3),
            (Axes::Color, [_, _, 4]) => (0, 4),
            (_, shape) => {
                return Err(file.wrong_layout(format!("an array of shape {shape:?}"), expected));
            }
        };
        let (height, width) = (header.shape[height_axis], header.shape[height_axis + 1]);
        check_size(&file.path, width as u64, height as u64)?;

        let needed = width * height * channels * header.element.size();
        let found = (length as usize).saturating_sub(header.data_offset);
        if needed != found {
            return Err(unreadable(NpyError::Length { needed, found }));
        }
        Ok(Self { width, height, channels, header })
    }
}

impl<'a> NpyImage<'a> {
    /// Parses the header and checks the shape, the size and the file's length.
    pub(crate) fn parse(
        file: &'a NamedBytes,
        axes: Axes,
        expected: &'static str,
    ) -> Result<Self, SceneError> {
        let array = npz::array(file)?;
        let NpyHead { width, height, channels, header } =
            NpyHead::of_array(file, &array, array.len() as u64, axes, expected)?;
        let data = match array {
            Cow::Borrowed(array) => Cow::Borrowed(&array[header.data_offset..]),
            Cow::Owned(mut array) => {
                array.drain(..header.data_offset);
                Cow::Owned(array)
            }
        };
        // Without a channel axis, the channel stride is not used.
        let strides = if header.fortran_order {
            [1, height, width * height]
        } else {
            [width * channels, channels, 1]
        };
        Ok(Self {
            width,
            height,
            channels,
            element: header.element,
            big_endian: header.big_endian,
            strides,
            data,
        })
    }

    /// Converts all values, row by row, with interleaved channels. 64-bit integers beyond 2^53 are rounded.
    pub(crate) fn values<T>(&self, convert: impl Fn(f64) -> T) -> Vec<T> {
        match self.element {
            Element::Bool | Element::U8 => self.decode(|[byte]| convert(byte as f64)),
            Element::U16 => self.decode(|bytes| convert(u16::from_le_bytes(bytes) as f64)),
            Element::U32 => self.decode(|bytes| convert(u32::from_le_bytes(bytes) as f64)),
            Element::U64 => self.decode(|bytes| convert(u64::from_le_bytes(bytes) as f64)),
            Element::I8 => self.decode(|bytes| convert(i8::from_le_bytes(bytes) as f64)),
            Element::I16 => self.decode(|bytes| convert(i16::from_le_bytes(bytes) as f64)),
            Element::I32 => self.decode(|bytes| convert(i32::from_le_bytes(bytes) as f64)),
            Element::I64 => self.decode(|bytes| convert(i64::from_le_bytes(bytes) as f64)),
            Element::F16 => self.decode(|bytes| convert(f16::from_le_bytes(bytes).to_f64())),
            Element::F32 => self.decode(|bytes| convert(f32::from_le_bytes(bytes) as f64)),
            Element::F64 => self.decode(|bytes| convert(f64::from_le_bytes(bytes))),
        }
    }

    /// Returns, for each value, true if it is neither 0 nor NaN.
    pub(crate) fn nonzero(&self) -> Vec<bool> {
        self.values(|value| value != 0.0 && !value.is_nan())
    }

    /// Returns the values of 8-bit elements unchanged.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.decode(|[byte]| byte)
    }

    /// Returns the values of 16-bit unsigned elements unchanged.
    pub(crate) fn words(&self) -> Vec<u16> {
        self.decode(u16::from_le_bytes)
    }

    /// Converts all elements of N bytes, row by row; `convert` receives their bytes in little-endian order.
    fn decode<const N: usize, T>(&self, convert: impl Fn([u8; N]) -> T) -> Vec<T> {
        let (elements, _) = self.data.as_chunks::<N>();
        let little = |mut element: [u8; N]| {
            if self.big_endian {
                element.reverse();
            }
            element
        };
        let [down, right, deeper] = self.strides;
        if down == self.width * self.channels && right == self.channels && deeper == 1 {
            return elements.iter().map(|element| convert(little(*element))).collect();
        }
        let mut values = Vec::with_capacity(elements.len());
        for y in 0..self.height {
            for x in 0..self.width {
                for c in 0..self.channels {
                    values.push(convert(little(elements[y * down + x * right + c * deeper])));
                }
            }
        }
        values
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use npyz::WriterBuilder;
    use std::path::PathBuf;

    /// Returns a file of format version 1.0 with the given type, order, shape and data.
    pub(crate) fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> NamedBytes {
        let fortran = if fortran { "True" } else { "False" };
        let text =
            format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        NamedBytes { path: PathBuf::from("a.npy"), bytes }
    }

    /// Writes a file with `npyz`, an independent implementation. With the calls for all types inlined into one test, this
    /// crate's tests take twice as long to compile.
    #[inline(never)]
    fn written<T: npyz::AutoSerialize + Copy>(
        values: &[T],
        shape: &[u64],
        order: npyz::Order,
    ) -> NamedBytes {
        let mut bytes = Vec::new();
        let mut writer = npyz::WriteOptions::new()
            .default_dtype()
            .shape(shape)
            .order(order)
            .writer(&mut bytes)
            .begin_nd()
            .unwrap();
        writer.extend(values.iter().copied()).unwrap();
        writer.finish().unwrap();
        NamedBytes { path: PathBuf::from("a.npy"), bytes }
    }

    fn single(file: &NamedBytes) -> Result<NpyImage<'_>, SceneError> {
        NpyImage::parse(file, Axes::Single, "x")
    }

    #[test]
    fn arrays_written_by_npyz_are_read() {
        let check = |c: &NamedBytes, fortran: &NamedBytes| {
            let image = single(c).unwrap();
            assert_eq!((image.width, image.height, image.channels), (3, 2, 1));
            assert_eq!(image.values(|v| v), [0.0, 1.0, 2.0, 3.0, 4.0, 100.0]);
            assert_eq!(image.nonzero(), [false, true, true, true, true, true]);
            let values = single(fortran).unwrap().values(|v| v);
            assert_eq!(values, [0.0, 2.0, 4.0, 1.0, 3.0, 100.0]);
        };
        macro_rules! check_types {
            ($($kind:ty),*) => {$(
                let values = [0, 1, 2, 3, 4, 100].map(|value| value as $kind);
                check(
                    &written(&values, &[2, 3], npyz::Order::C),
                    &written(&values, &[2, 3, 1], npyz::Order::Fortran),
                );
            )*};
        }
        check_types!(u8, u16, u32, u64, i8, i16, i32, i64, f32, f64);
        let file = written(&[true, false], &[1, 2], npyz::Order::C);
        assert_eq!(single(&file).unwrap().nonzero(), [true, false]);
    }

    #[test]
    fn npyz_reads_the_files_of_these_tests() {
        let file = npy(">f4", false, "(1, 2)", &[0x3f, 0x80, 0, 0, 0x40, 0, 0, 0]);
        let theirs: Vec<f32> = npyz::NpyFile::new(&file.bytes[..]).unwrap().into_vec().unwrap();
        assert_eq!(theirs, [1.0, 2.0]);
        assert_eq!(single(&file).unwrap().values(|v| v as f32), theirs);
    }

    #[test]
    fn big_endian_halves_and_fortran_order_are_read() {
        let file = npy(">f2", false, "(1, 1, 2)", &[0x3c, 0, 0xc0, 0]);
        assert_eq!(single(&file).unwrap().values(|v| v), [1.0, -2.0]);
        let file = npy("<f2", false, "(2, 2)", &[0, 0x80, 0, 0x7e, 1, 0, 0, 0]);
        assert_eq!(single(&file).unwrap().nonzero(), [false, false, true, false]);
        // Fortran order, (2 rows, 2 columns, 3 channels): the element at row y, column x, channel c is the byte
        // y + 2 x + 4 c.
        let file = npy("|u1", true, "(2, 2, 3)", &std::array::from_fn::<u8, 12, _>(|i| i as u8));
        let image = NpyImage::parse(&file, Axes::Color, "x").unwrap();
        assert_eq!(image.bytes(), [0, 4, 8, 2, 6, 10, 1, 5, 9, 3, 7, 11]);
        // (1,H,W) in Fortran order.
        let file = npy("|u1", true, "(1, 2, 3)", &[0, 1, 2, 3, 4, 5]);
        assert_eq!(single(&file).unwrap().bytes(), [0, 2, 4, 1, 3, 5]);
    }

    #[test]
    fn only_shapes_of_images_are_accepted() {
        let size = |shape: &str, axes| {
            NpyImage::parse(&npy("|u1", false, shape, &[0; 12]), axes, "x")
                .map(|image| (image.width, image.height, image.channels))
        };
        assert_eq!(size("(1, 12, 1)", Axes::Single).unwrap(), (12, 1, 1));
        assert_eq!(size("(1, 3, 4)", Axes::Single).unwrap(), (4, 3, 1));
        assert_eq!(size("(12, 1, 1)", Axes::Single).unwrap(), (1, 12, 1));
        assert_eq!(size("(2, 2, 3)", Axes::Color).unwrap(), (2, 2, 3));
        assert_eq!(size("(3, 1, 4)", Axes::Color).unwrap(), (1, 3, 4));
        for (shape, axes) in [
            ("(12,)", Axes::Single),
            ("()", Axes::Single),
            ("(2, 2, 3)", Axes::Single),
            ("(2, 3, 2)", Axes::Color),
            ("(1, 2, 2, 3)", Axes::Color),
        ] {
            assert!(matches!(size(shape, axes), Err(SceneError::Layout { .. })), "{shape}");
        }
        for shape in ["(0, 12)", "(12, 0)", "(99999, 1)", "(18446744073709551615, 2)"] {
            assert!(matches!(size(shape, Axes::Single), Err(SceneError::Size { .. })), "{shape}");
        }
        for shape in ["(2, 5)", "(2, 7)", "(8192, 8192)"] {
            let error = size(shape, Axes::Single).unwrap_err();
            assert!(matches!(error, SceneError::Unreadable { .. }), "{shape}");
        }
    }
}
