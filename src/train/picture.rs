//! Pictures of a training for a person to look at.

use super::code::bytes_of_planes;
use super::inference::Picture;
use crate::merge::SrgbEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageEncoder, RgbImage, imageops};

/// Pixels between pictures.
const GAP: u32 = 4;

/// Widest picture of a grid, px.
const WIDEST: u32 = 256;

impl Picture {
    /// As 8-bit RGB.
    pub fn to_rgb(&self) -> RgbImage {
        let (width, height) = (self.columns as u32, self.rows as u32);
        let mut picture = RgbImage::new(width, height);
        picture.copy_from_slice(&bytes_of_planes(&self.planes));
        picture
    }

    /// Of 8-bit RGB.
    pub fn from_rgb(picture: &RgbImage) -> Self {
        Self {
            rows: picture.height() as usize,
            columns: picture.width() as usize,
            planes: super::code::planes_of_bytes(picture.as_raw()),
        }
    }
}

/// PSNR of two pictures of one size, as 8-bit RGB, dB; 100 where they are equal, so that means stay numbers.
pub(super) fn psnr_db(a: &Picture, b: &Picture) -> f64 {
    let (a, b) = (a.to_rgb(), b.to_rgb());
    let pairs = a.as_raw().iter().zip(b.as_raw());
    let sum: u64 = pairs.map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum();
    if sum == 0 {
        return 100.0;
    }
    let mean = sum as f64 / a.as_raw().len() as f64;
    10.0 * libm::log10(255.0 * 255.0 / mean)
}

/// A PNG.
pub(super) struct Grid {
    pub(super) png: Vec<u8>,
    /// Width and height, px.
    pub(super) size: [u32; 2],
}

/// Rows of pictures in one.
pub(super) fn picture_grid(rows: &[Vec<Picture>]) -> Result<Grid, image::ImageError> {
    let shrunk = |picture: &Picture| {
        let picture = picture.to_rgb();
        if picture.width() <= WIDEST {
            return picture;
        }
        let height = (picture.height() * WIDEST / picture.width()).max(1);
        imageops::thumbnail(&picture, WIDEST, height)
    };
    let rows: Vec<Vec<RgbImage>> = rows
        .iter()
        .map(|row| row.iter().map(shrunk).collect())
        .collect();
    let width_of = |row: &Vec<RgbImage>| row.iter().map(|p| p.width() + GAP).sum::<u32>();
    let height_of = |row: &Vec<RgbImage>| row.iter().map(RgbImage::height).max().unwrap_or(0);
    let width = rows.iter().map(width_of).max().unwrap_or(1).max(1);
    let height = rows
        .iter()
        .map(|row| height_of(row) + GAP)
        .sum::<u32>()
        .max(1);
    let grey = image::Rgb([SrgbEncoder::new().encode(0.2); 3]);
    let mut grid = RgbImage::from_pixel(width, height, grey);
    let mut y = 0;
    for row in &rows {
        let mut x = 0;
        for picture in row {
            imageops::replace(&mut grid, picture, x.into(), y.into());
            x += picture.width() + GAP;
        }
        y += height_of(row) + GAP;
    }
    let mut png = Vec::new();
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive)
        .write_image(grid.as_raw(), width, height, image::ExtendedColorType::Rgb8)?;
    Ok(Grid {
        png,
        size: [width, height],
    })
}
