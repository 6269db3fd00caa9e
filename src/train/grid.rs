//! Grids of pictures, for logs.

use examples::Picture;
use glasshouse_line::color::SrgbEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ImageEncoder, RgbImage, imageops};

const GAP: u32 = 4;

/// Largest width of a picture in a grid, px.
const WIDEST: u32 = 256;

pub struct Grid {
    pub png: Vec<u8>,
    pub size: [u32; 2],
}

pub(super) fn picture_grid(rows: &[Vec<Picture>]) -> Result<Grid, image::ImageError> {
    let rows: Vec<Vec<RgbImage>> = rows
        .iter()
        .map(|row| row.iter().map(|picture| shrunk(picture.to_rgb())).collect())
        .collect();
    rgb_grid(&rows)
}

/// Scales a picture down to the width limit of a grid.
pub fn shrunk(picture: RgbImage) -> RgbImage {
    if picture.width() <= WIDEST {
        return picture;
    }
    let height = (picture.height() * WIDEST / picture.width()).max(1);
    imageops::thumbnail(&picture, WIDEST, height)
}

/// Draws rows of pictures into one PNG.
pub fn rgb_grid(rows: &[Vec<RgbImage>]) -> Result<Grid, image::ImageError> {
    let width_of = |row: &Vec<RgbImage>| row.iter().map(|p| p.width() + GAP).sum::<u32>();
    let height_of = |row: &Vec<RgbImage>| row.iter().map(RgbImage::height).max().unwrap_or(0);
    let width = rows.iter().map(width_of).max().unwrap_or(1).max(1);
    let height = rows.iter().map(|row| height_of(row) + GAP).sum::<u32>().max(1);
    let grey = image::Rgb([SrgbEncoder::new().encode(0.2); 3]);
    let mut grid = RgbImage::from_pixel(width, height, grey);
    let mut y = 0;
    for row in rows {
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
    Ok(Grid { png, size: [width, height] })
}
