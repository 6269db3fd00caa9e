//! Formats that the program recognises but does not read, each with a command that converts it.

/// A format: how its files begin, what it is, and how to convert one.
struct OtherFormat {
    is_start: fn(&[u8]) -> bool,
    name: &'static str,
    conversion: &'static str,
}

/// Brands of ISO base media files, in the order of their ftyp boxes.
fn has_brand(start: &[u8], brands: &[&[u8; 4]]) -> bool {
    let Some(&[size @ .., b'f', b't', b'y', b'p']) = start.first_chunk::<8>() else {
        return false;
    };
    let size = u32::from_be_bytes(size) as usize;
    let all = start.get(8..size.min(start.len())).unwrap_or_default();
    // Bytes 12 to 15 are a version.
    let of_file = all.as_chunks::<4>().0.iter().enumerate().filter(|(k, _)| *k != 1);
    of_file.into_iter().any(|(_, brand)| brands.contains(&brand))
}

/// True for COLMAP's `width&height&channels&` before floats.
fn is_colmap(start: &[u8]) -> bool {
    let mut parts = start.split(|byte| *byte == b'&');
    let is_number = |part: Option<&[u8]>| {
        part.is_some_and(|p| (1..=6).contains(&p.len()) && p.iter().all(u8::is_ascii_digit))
    };
    (0..3).all(|_| is_number(parts.next())) && parts.next().is_some()
}

const FORMATS: [OtherFormat; 14] = [
    OtherFormat {
        is_start: |b| has_brand(b, &[b"avif", b"avis"]),
        name: "AVIF",
        conversion: "`avifdec IN.avif OUT.png`",
    },
    OtherFormat {
        is_start: |b| {
            has_brand(b, &[b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"])
        },
        name: "HEIC",
        conversion: "`heif-convert IN.heic OUT.png`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"RIFF") && b.get(8..12) == Some(b"WEBP"),
        name: "WebP",
        conversion: "`dwebp IN.webp -o OUT.png`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"\xff\x0a") || b.starts_with(b"\0\0\0\x0cJXL \r\n\x87\n"),
        name: "JPEG XL",
        conversion: "`djxl IN.jxl OUT.png`",
    },
    OtherFormat {
        is_start: |b| {
            b.starts_with(b"\0\0\0\x0cjP  \r\n\x87\n") || b.starts_with(b"\xff\x4f\xff\x51")
        },
        name: "JPEG 2000",
        conversion: "`opj_decompress -i IN.jp2 -o OUT.png`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"GIF8"),
        name: "GIF",
        conversion: "`magick IN.gif[0] OUT.png`",
    },
    OtherFormat {
        // The reserved bytes are 0.
        is_start: |b| b.starts_with(b"BM") && b.get(6..10) == Some(&[0; 4]),
        name: "BMP",
        conversion: "`magick IN.bmp OUT.png`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"8BPS"),
        name: "Photoshop",
        conversion: "`magick IN.psd[0] OUT.png`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"\x89HDF\r\n\x1a\n"),
        name: "HDF5",
        conversion: "in Python: `numpy.save(\"OUT.npy\", h5py.File(\"IN.h5\")[\"NAME\"][()])`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"MATLAB 7.3 MAT-file"),
        name: "MAT of version 7.3",
        conversion: "in Python: `numpy.save(\"OUT.npy\", h5py.File(\"IN.mat\")[\"NAME\"][()].T)`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"MATLAB 5.0 MAT-file"),
        name: "MAT",
        conversion: "in Python: `numpy.save(\"OUT.npy\", scipy.io.loadmat(\"IN.mat\")[\"NAME\"])`",
    },
    OtherFormat {
        is_start: is_colmap,
        name: "an array of COLMAP",
        conversion: "in Python, with COLMAP's read_write_dense.py: `numpy.save(\"OUT.npy\", read_array(\"IN.bin\"))`",
    },
    OtherFormat {
        is_start: |b| b.starts_with(b"\x1f\x8b"),
        name: "gzip",
        conversion: "`gunzip IN.gz`",
    },
    OtherFormat {
        is_start: |b| {
            let text = b.trim_ascii_start();
            let is = |start: &[u8]| {
                text.get(..start.len()).is_some_and(|t| t.eq_ignore_ascii_case(start))
            };
            is(b"<!doctype html") || is(b"<html")
        },
        name: "a web page",
        conversion: "a download that failed: fetch it again",
    },
];

/// Names the format of a file by its first bytes, and says how to convert it; `None` if it is unknown.
pub(super) fn name_with_conversion(start: &[u8]) -> Option<String> {
    let found = FORMATS.iter().find(|format| (format.is_start)(start))?;
    Some(format!("{}, which is not read ({})", found.name, found.conversion))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_bytes_name_the_format() {
        let ftyp = |brand: &[u8; 4], others: &[u8]| {
            let size = 16 + others.len() as u32;
            [&size.to_be_bytes()[..], b"ftyp", brand, &[0; 4], others, b"rest"].concat()
        };
        let bmp = [&b"BM\x36\x10\0\0"[..], &[0; 4], b"\x36\0\0\0"].concat();
        for (start, words) in [
            (ftyp(b"heic", b"mif1heic"), "HEIC, which is not read (`heif-convert"),
            (ftyp(b"mif1", b"mif1heic"), "HEIC"),
            (ftyp(b"mif1", b"avifmif1"), "AVIF, which is not read (`avifdec"),
            (ftyp(b"avif", b""), "AVIF"),
            (b"RIFF\x10\0\0\0WEBPVP8 ".to_vec(), "WebP"),
            (b"\0\0\0\x0cjP  \r\n\x87\n\0".to_vec(), "JPEG 2000"),
            (b"\0\0\0\x0cJXL \r\n\x87\n\0".to_vec(), "JPEG XL"),
            (b"GIF89a".to_vec(), "GIF"),
            (bmp, "BMP"),
            (b"\x89HDF\r\n\x1a\n\0".to_vec(), "h5py"),
            (b"MATLAB 5.0 MAT-file, Platform".to_vec(), "scipy.io.loadmat"),
            (b"MATLAB 7.3 MAT-file, Platform".to_vec(), "h5py"),
            (b"640&480&1&\0\0\x80\x3f".to_vec(), "COLMAP"),
            (b"\x1f\x8b\x08\0".to_vec(), "gunzip"),
            (b"\n<!DOCTYPE HTML><html>".to_vec(), "a web page"),
        ] {
            let found = name_with_conversion(&start).unwrap_or_default();
            assert!(found.contains(words), "{words}: {found}");
        }
        let movie = ftyp(b"isom", b"mp42");
        for start in [&b"640&480"[..], b"&&&&", b"BM", b"plain text", b"", &movie] {
            assert_eq!(name_with_conversion(start), None);
        }
    }
}
