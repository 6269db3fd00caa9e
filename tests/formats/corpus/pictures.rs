//! Small valid pictures in every format that a photograph may have.

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer,
    LayerAttributes, LineOrder, Vec2, WritableImage, f16,
};
use image::ExtendedColorType as Png;
use image::ImageEncoder;
use std::io::Cursor;

pub(crate) fn png(pixels: &[u8], width: u32, height: u32, kind: Png) -> Vec<u8> {
    let mut bytes = vec![];
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(pixels, width, height, kind)
        .unwrap();
    bytes
}

fn jpeg(pixels: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = vec![];
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 80)
        .write_image(pixels, width, height, Png::Rgb8)
        .unwrap();
    bytes
}

fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}");
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{header:117}\n").bytes());
    bytes.extend(data);
    bytes
}

fn exr(names: &[&str], compression: Compression, blocks: Blocks) -> Vec<u8> {
    let samples = |k: usize| match k % 3 {
        0 => FlatSamples::F16(vec![f16::from_f32(0.5); 6]),
        1 => FlatSamples::F32(vec![1.5, 0.1, 0.2, 0.3, 2.0, 1e-3]),
        _ => FlatSamples::U32(vec![1, 2, 3, 4, 5, 6]),
    };
    let channels = names.iter().enumerate().map(|(k, name)| AnyChannel::new(*name, samples(k)));
    let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
    let layer = Layer::new(
        (3, 2),
        LayerAttributes::named("main"),
        encoding,
        AnyChannels::sort(channels.collect()),
    );
    let mut bytes = Cursor::new(vec![]);
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

pub(crate) fn images() -> Vec<(String, Vec<u8>)> {
    let ramp: Vec<u8> = (1..=48).collect();
    let mut files = vec![
        ("grey8.png", png(&ramp[..6], 3, 2, Png::L8)),
        ("grey16.png", png(&ramp[..12], 3, 2, Png::L16)),
        ("rgb8.png", png(&ramp[..18], 3, 2, Png::Rgb8)),
        ("rgba16.png", png(&ramp, 3, 2, Png::Rgba16)),
        ("rgb.jpg", jpeg(&ramp[..18], 3, 2)),
        ("progressive.jpg", include_bytes!("../jpeg/progressive.jpg").to_vec()),
        ("restarts.jpg", include_bytes!("../jpeg/restarts.jpg").to_vec()),
        ("cmyk.jpg", include_bytes!("../jpeg/cmyk.jpg").to_vec()),
        (
            "turned.jpg",
            include_bytes!("../../../src/render/shard/golden_pictures/turned.jpg").to_vec(),
        ),
        ("p3.jpg", include_bytes!("../icc/p3-jpeg.jpg").to_vec()),
        ("p3.png", include_bytes!("../icc/p3.png").to_vec()),
        ("table.png", include_bytes!("../icc/refused-table.png").to_vec()),
        ("cicp.png", include_bytes!("../icc/chunk-cicp.png").to_vec()),
        ("primaries.png", include_bytes!("../icc/chunk-p3.png").to_vec()),
        ("f4.npy", npy("<f4", false, "(2, 3)", &0.5f32.to_le_bytes().repeat(6))),
        ("f8.npy", npy(">f8", true, "(2, 3, 1)", &2.5f64.to_be_bytes().repeat(6))),
        ("u1.npy", npy("|u1", false, "(2, 3, 3)", &ramp[..18])),
        ("u2.npy", npy("<u2", false, "(1, 2, 3)", &ramp[..12])),
        ("b1.npy", npy("|b1", false, "(2, 3)", &[1, 0, 1, 1, 0, 1])),
        ("bits.pbm", b"P1\n3 2\n1 0 1 0 1 0\n".to_vec()),
        ("text.pgm", b"P2 3 2 255 1 2 3 4 5 6".to_vec()),
        ("bits4.pbm", b"P4 3 2 \xa0\x40".to_vec()),
        ("grey16.pgm", b"P5 3 2 65535 abcdefghijkl".to_vec()),
        ("rgb.ppm", b"P6 3 2 255 abcdefghijklmnopqr".to_vec()),
        ("grey.pfm", [&b"Pf\n3 2\n-1.0\n"[..], &0.5f32.to_le_bytes().repeat(6)].concat()),
        ("rgb.pfm", [&b"PF\n1 2\n1\n"[..], &0.5f32.to_be_bytes().repeat(6)].concat()),
        (
            "rgbe.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 1\n\x80\x40\x20\x81\x10\x20\x30\x80"
                .to_vec(),
        ),
        (
            "any.pam",
            b"P7\nWIDTH 3\nHEIGHT 2\nDEPTH 1\nMAXVAL 255\nTUPLTYPE GRAYSCALE\nENDHDR\nabcdef"
                .to_vec(),
        ),
    ];
    for (name, names, compression, blocks) in [
        ("rgb.exr", &["R", "G", "B"][..], Compression::ZIP16, Blocks::ScanLines),
        ("y.exr", &["Y", "A"], Compression::Uncompressed, Blocks::ScanLines),
        ("z.exr", &["Z"], Compression::ZIP1, Blocks::Tiles(Vec2(2, 2))),
        ("rle.exr", &["Y"], Compression::RLE, Blocks::Tiles(Vec2(2, 2))),
        ("piz.exr", &["Y"], Compression::PIZ, Blocks::ScanLines),
        ("pxr24.exr", &["Y"], Compression::PXR24, Blocks::Tiles(Vec2(64, 64))),
        ("b44.exr", &["Y"], Compression::B44, Blocks::ScanLines),
    ] {
        files.push((name, exr(names, compression, blocks)));
    }
    files.into_iter().map(|(n, b)| (n.to_owned(), b)).collect()
}
