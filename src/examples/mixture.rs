//! Pictures mixed in the image plane, as in the training data of earlier work, for comparison with rendered tuples.
//!
//! ```text
//! zhang.rs     Zhang, Ng and Chen, CVPR 2018: mixed in linear light, with a vignetted reflection
//! ceilnet.rs   Fan et al., ICCV 2017: mixed in sRGB codes
//! blur.rs      the Gaussian blur of both
//! ```
//!
//! Each recipe has a pure function of two pictures and random parameters, and a function that draws the parameters.

mod blur;
mod ceilnet;
mod zhang;

pub use ceilnet::{CeilnetDraw, ceilnet};
pub use zhang::{ZhangDraw, zhang};

use crate::picture::Picture;
use compose::Stream;

/// A mixed pair as sRGB codes from 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    pub input: Picture,
    /// The unchanged front picture, the target of both recipes.
    pub transmission: Picture,
    /// The back picture as the input contains it: blurred and darkened.
    pub reflection: Picture,
    /// The unchanged back picture.
    pub clean_reflection: Picture,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MixtureError {
    #[error(
        "front has {} x {} px and {} values, and back has {} x {} px and {} values; give two pictures of one size with three values per pixel",
        front[0], front[1], front[2], back[0], back[1], back[2]
    )]
    Sizes {
        /// Columns, rows and number of values.
        front: [usize; 3],
        /// Columns, rows and number of values.
        back: [usize; 3],
    },
    #[error(
        "{columns} x {rows} px are too many for Zhang's mixtures; crop to less than 550 px a side"
    )]
    TooLarge { columns: usize, rows: usize },
}

/// Published method of mixing two pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MixtureRecipe {
    /// The method of Zhang, Ng and Chen: [`zhang`].
    Zhang,
    /// The method of Fan et al.: [`ceilnet`].
    Ceilnet,
}

impl MixtureRecipe {
    /// Draws parameters and mixes two pictures; returns `None` if the recipe rejects the pair. The number of values
    /// taken from the stream does not depend on the pictures.
    pub fn mix(
        self,
        front: &Picture,
        back: &Picture,
        stream: &mut Stream,
    ) -> Result<Option<Mixture>, MixtureError> {
        check(front, back)?;
        match self {
            Self::Zhang => zhang(front, back, &ZhangDraw::draw(front.rows, front.columns, stream)?),
            Self::Ceilnet => ceilnet(front, back, &CeilnetDraw::draw(stream)).map(Some),
        }
    }
}

fn check(front: &Picture, back: &Picture) -> Result<(), MixtureError> {
    let size = |planes: &Picture| [planes.columns, planes.rows, planes.planes.len()];
    let [columns, rows, count] = size(front);
    if size(front) != size(back) || count != 3 * columns * rows || count == 0 {
        return Err(MixtureError::Sizes { front: size(front), back: size(back) });
    }
    Ok(())
}

/// Returns clamped values as a picture of the size of `like`.
fn planes(like: &Picture, values: impl IntoIterator<Item = f64>) -> Picture {
    Picture {
        rows: like.rows,
        columns: like.columns,
        planes: values.into_iter().map(|v| v.clamp(0.0, 1.0) as f32).collect(),
    }
}

fn doubles(planes: &Picture) -> impl Iterator<Item = f64> {
    planes.planes.iter().map(|v| f64::from(*v))
}

#[cfg(test)]
mod tests;
