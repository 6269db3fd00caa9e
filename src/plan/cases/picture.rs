//! A photograph in words, and the bytes of its files.

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde::Deserialize;
use std::io::Cursor;

/// A described RGBD photograph: what it shows (one of the first five), and its depths.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Picture {
    /// One colour, linear radiance.
    pub radiance: Option<[f32; 3]>,
    /// White and black texels by turns, the first white.
    #[serde(default)]
    pub checker: bool,
    /// A linear ramp over the plane at `depth_m`.
    pub ramp: Option<Ramp>,
    /// Radiance of the middle texel; the others are black.
    pub spot: Option<f32>,
    /// Uniform random texels of this seed.
    pub noise: Option<u32>,
    /// Size of the colour image.
    #[serde(default = "one_texel")]
    pub texels: [usize; 2],
    /// Depth of all pixels.
    pub depth_m: f32,
    /// `[column, row, depth_m]` of pixels with another one; NaN, infinity, 0 and negative ones too.
    #[serde(default)]
    pub depth_points: Vec<(usize, usize, f32)>,
    /// Size of the depth image.
    #[serde(default = "four_by_four")]
    pub depth_px: [usize; 2],
    /// Tangents of the capture camera's half fields of view; the film's if missing.
    pub half_fov_tan: Option<[f64; 2]>,
    /// Form of the colour image's file.
    #[serde(default)]
    pub color_file: FileKind,
    /// Form of the depth image's file.
    #[serde(default)]
    pub depth_file: FileKind,
}

/// `middle + across_per_m X + down_per_m Y` at the plane's point (X, Y), metres; linear radiance.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ramp {
    /// On the optical axis.
    pub middle: f64,
    /// Change for a metre to the right.
    pub across_per_m: f64,
    /// Change for a metre down.
    pub down_per_m: f64,
}

/// A file's form. Values keep their bits but in PNG: 8-bit codes of 0 to 1, depths in 16-bit millimetres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FileKind {
    /// float32.
    #[default]
    Npy,
    /// float32.
    Exr,
    /// Whole numbers.
    Png,
}

impl FileKind {
    pub(crate) fn ending(self) -> &'static str {
        match self {
            Self::Npy => "npy",
            Self::Exr => "exr",
            Self::Png => "png",
        }
    }
}

fn one_texel() -> [usize; 2] {
    [1, 1]
}

fn four_by_four() -> [usize; 2] {
    [4, 4]
}

/// Larger pictures belong into files.
const MAX_SIDE: usize = 256;

impl Picture {
    pub(crate) fn validate(&self) -> Result<(), String> {
        let shown = [
            self.radiance.is_some(),
            self.checker,
            self.ramp.is_some(),
            self.spot.is_some(),
            self.noise.is_some(),
        ];
        if shown.iter().filter(|is| **is).count() != 1 {
            return Err("a picture is one of radiance, checker, ramp, spot, noise".to_owned());
        }
        let sides = self.texels.iter().chain(&self.depth_px);
        if !sides.into_iter().all(|n| (1..=MAX_SIDE).contains(n)) {
            return Err(format!("sides of texels and depth_px are 1 to {MAX_SIDE}"));
        }
        let [nx, ny] = self.depth_px;
        if self.depth_points.iter().any(|p| p.0 >= nx || p.1 >= ny) {
            return Err(format!(
                "a depth point lies outside the {nx} x {ny} depth pixels"
            ));
        }
        let tan = self.half_fov_tan.unwrap_or([1.0; 2]);
        if !tan.iter().all(|t| *t > 0.0 && *t < f64::INFINITY) {
            return Err("half_fov_tan is finite and above 0".to_owned());
        }
        Ok(())
    }

    pub(crate) fn depth_unit_m(&self) -> f64 {
        match self.depth_file {
            FileKind::Png => 1e-3,
            _ => 1.0,
        }
    }

    /// Red, green, blue of all texels, row by row.
    fn values(&self) -> Vec<f32> {
        let [nx, ny] = self.texels;
        let tan = self.half_fov_tan.unwrap_or([1.0; 2]);
        let texel = |q: usize| -> [f32; 3] {
            let (i, j) = (q % nx, q / nx);
            if let Some(radiance) = self.radiance {
                radiance
            } else if let Some(ramp) = self.ramp {
                let at = |k: usize, n: usize, tan: f64| {
                    ((k as f64 + 0.5) / n as f64 * 2.0 - 1.0) * tan * f64::from(self.depth_m)
                };
                let (x, y) = (at(i, nx, tan[0]), at(j, ny, tan[1]));
                [(ramp.middle + ramp.across_per_m * x + ramp.down_per_m * y) as f32; 3]
            } else if let Some(spot) = self.spot {
                [if (i, j) == (nx / 2, ny / 2) {
                    spot
                } else {
                    0.0
                }; 3]
            } else if let Some(seed) = self.noise {
                [0, 1, 2].map(|c| noise(q as u32 * 3 + c, seed))
            } else {
                [if (i + j) % 2 == 0 { 1.0 } else { 0.0 }; 3]
            }
        };
        (0..nx * ny).flat_map(texel).collect()
    }

    /// The colour image's file.
    pub fn color_bytes(&self) -> Vec<u8> {
        let values = self.values();
        let [nx, ny] = self.texels;
        match self.color_file {
            FileKind::Npy => npy(&format!("({ny}, {nx}, 3)"), &values),
            FileKind::Exr => {
                let channel = |c: usize| values.iter().skip(c).step_by(3).copied().collect();
                exr(
                    [nx, ny],
                    ["R", "G", "B"].into_iter().zip([0, 1, 2].map(channel)),
                )
            }
            FileKind::Png => {
                let codes: Vec<u8> = values.iter().map(|v| (v * 255.0 + 0.5) as u8).collect();
                png(&codes, [nx, ny], ExtendedColorType::Rgb8)
            }
        }
    }

    /// The depth image's file.
    pub fn depth_bytes(&self) -> Vec<u8> {
        let [nx, ny] = self.depth_px;
        let mut depths = vec![self.depth_m; nx * ny];
        for &(i, j, depth_m) in &self.depth_points {
            depths[j * nx + i] = depth_m;
        }
        match self.depth_file {
            FileKind::Npy => npy(&format!("({ny}, {nx})"), &depths),
            FileKind::Exr => exr([nx, ny], std::iter::once(("Z", depths))),
            FileKind::Png => {
                // Big endian in the file, native for the encoder.
                let codes = depths.iter().map(|z| (z * 1000.0 + 0.5) as u16);
                let bytes: Vec<u8> = codes.flat_map(u16::to_ne_bytes).collect();
                png(&bytes, [nx, ny], ExtendedColorType::L16)
            }
        }
    }
}

/// A number in [0, 1).
fn noise(q: u32, seed: u32) -> f32 {
    let mut x = q.wrapping_mul(0x9e37_79b9) ^ seed.wrapping_mul(0x85eb_ca6b);
    for _ in 0..2 {
        x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    }
    (x >> 8) as f32 / 16_777_216.0
}

fn npy(shape: &str, values: &[f32]) -> Vec<u8> {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(format!("{header:117}\n").bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

fn png(codes: &[u8], [nx, ny]: [usize; 2], kind: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(codes, nx as u32, ny as u32, kind)
        .expect("sides of 1 to 256, in memory");
    bytes
}

fn exr<'a>([nx, ny]: [usize; 2], channels: impl Iterator<Item = (&'a str, Vec<f32>)>) -> Vec<u8> {
    let list = channels.map(|(name, values)| AnyChannel::new(name, FlatSamples::F32(values)));
    let layer = Layer::new(
        (nx, ny),
        LayerAttributes::default(),
        Encoding::UNCOMPRESSED,
        AnyChannels::sort(list.collect()),
    );
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .expect("sides of 1 to 256, in memory");
    bytes.into_inner()
}
