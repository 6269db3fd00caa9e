//! How near synthesised pictures come to a camera's picture: a rendered input, and image-space mixtures of the same scene.
//!
//! The parameters of a mixture are unknown for a photograph, so the best of many draws stands for each method, as in the
//! comparison of Kim, Huo and Yoon (CVPR 2020, "Data analysis"). The camera's picture chooses the draw: the scores of
//! mixtures are upper bounds.

use super::{Picture, Stream};
use compose::{EvaluateError, Factor, Scores, own_best_factor, psnr_colour_db, score};
use examples::mixture::{Mixture, MixtureError, MixtureRecipe};
use image::RgbImage;
use rayon::prelude::*;

#[derive(Debug, thiserror::Error)]
pub enum SimilarityError {
    #[error(transparent)]
    Mixture(#[from] MixtureError),
    #[error(transparent)]
    Score(#[from] EvaluateError),
}

/// The similarity of a method's picture to the camera's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Scores of the 8-bit picture.
    pub raw: Scores,
    /// Index of the draw with the best `raw` PSNR; `None` for a picture without random parameters.
    pub draw: Option<u32>,
    /// The factor of linear light, 0.30 to 2.00 in steps of 0.01, that gives the best PSNR.
    pub factor: Factor,
    /// Scores after this factor.
    pub after_factor: Scores,
    /// Index of the draw with the best PSNR after its own factor.
    pub draw_after_factor: Option<u32>,
}

/// The best of many mixtures of one recipe.
#[derive(Clone, Debug, PartialEq)]
pub struct BestMixture {
    /// `None` if the recipe rejects all draws.
    pub best: Option<Similarity>,
    /// Number of draws that the recipe rejects: Zhang's training uses no pairs with a dark back picture.
    pub rejected: u32,
}

/// Scores a picture without random parameters.
pub fn similarity(picture: &RgbImage, captured: &RgbImage) -> Result<Similarity, SimilarityError> {
    let (factor, _) = own_best_factor(picture, captured)?;
    Ok(Similarity {
        raw: score(picture, captured)?,
        draw: None,
        factor,
        after_factor: score(&factor.apply(picture), captured)?,
        draw_after_factor: None,
    })
}

/// Mixes `front` and `back` with `draws` parameter sets and scores the best mixtures. The parameters depend only on the
/// recipe, the seed, the index of the draw and, for Zhang's vignette, the size. Of equal scores, the first draw wins.
pub fn best_mixture(
    recipe: MixtureRecipe,
    [front, back]: [&Picture; 2],
    captured: &RgbImage,
    draws: u32,
    seed: u64,
) -> Result<BestMixture, SimilarityError> {
    let mix = |draw: u32| -> Result<Option<RgbImage>, SimilarityError> {
        let mut stream = Stream::new(seed, &format!("similarity {recipe:?} {draw}"));
        let mixture = recipe.mix(front, back, &mut stream)?;
        Ok(mixture.map(|Mixture { input, .. }| input.to_rgb()))
    };
    let scores: Vec<Option<[f64; 2]>> = (0..draws)
        .into_par_iter()
        .map(|draw| {
            let of = |picture: RgbImage| -> Result<[f64; 2], SimilarityError> {
                let after_factor = own_best_factor(&picture, captured)?.1;
                Ok([psnr_colour_db(&picture, captured)?, after_factor])
            };
            mix(draw)?.map(of).transpose()
        })
        .collect::<Result<_, SimilarityError>>()?;
    let rejected = scores.iter().filter(|of_draw| of_draw.is_none()).count() as u32;
    let best = |kind: usize| best_draw(scores.iter().map(|s| s.map(|of_draw| of_draw[kind])));
    let (Some(draw), Some(draw_after_factor)) = (best(0), best(1)) else {
        return Ok(BestMixture { best: None, rejected });
    };
    let again = |draw: u32| mix(draw).map(|made| made.expect("the same draw gives the same"));
    let raw = score(&again(draw)?, captured)?;
    let Similarity { factor, after_factor, .. } = similarity(&again(draw_after_factor)?, captured)?;
    let best = Similarity {
        raw,
        draw: Some(draw),
        factor,
        after_factor,
        draw_after_factor: Some(draw_after_factor),
    };
    Ok(BestMixture { best: Some(best), rejected })
}

/// Returns the index of the largest score, or of the first of equal ones.
fn best_draw(scores: impl Iterator<Item = Option<f64>>) -> Option<u32> {
    let mut best: Option<(u32, f64)> = None;
    for (draw, score) in (0..).zip(scores) {
        if let Some(score) = score
            && best.is_none_or(|(_, largest)| score > largest)
        {
            best = Some((draw, score));
        }
    }
    best.map(|(draw, _)| draw)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(salt: u32) -> RgbImage {
        RgbImage::from_fn(48, 40, |x, y| {
            image::Rgb([0, 1, 2].map(|c| ((x * (3 + salt) + y * y * (c + 1) + 31 * c) % 160) as u8))
        })
    }

    #[test]
    fn the_draw_that_made_the_picture_is_found() {
        let [front, back] = [1, 2].map(|salt| Picture::from_rgb(&picture(salt)));
        for recipe in [MixtureRecipe::Zhang, MixtureRecipe::Ceilnet] {
            let mut stream = Stream::new(3, &format!("similarity {recipe:?} 11"));
            let made = recipe.mix(&front, &back, &mut stream).unwrap().unwrap().input.to_rgb();
            let of = |draws| best_mixture(recipe, [&front, &back], &made, draws, 3).unwrap();
            let best = of(16).best.unwrap();
            assert_eq!((best.draw, best.draw_after_factor), (Some(11), Some(11)));
            assert_eq!((best.raw.psnr_colour_db, best.factor), (f64::INFINITY, Factor(1.0)));
            // Without this draw, the best is another one.
            let best = of(11).best.unwrap();
            assert!(best.raw.psnr_colour_db.is_finite() && best.draw < Some(11));
        }
    }

    #[test]
    fn a_factor_is_free_after_the_score() {
        let captured = picture(1);
        let found = similarity(&Factor(0.5).apply(&captured), &captured).unwrap();
        // The codes of the darker picture are rounded, so the best factor may be a step away.
        assert!((found.factor.0 - 2.0).abs() < 0.015, "{found:?}");
        assert!(found.after_factor.psnr_colour_db > found.raw.psnr_colour_db + 20.0, "{found:?}");
        assert_eq!(found.after_factor.psnr_colour_db, found.raw.psnr_own_factor_db);
        assert!(similarity(&RgbImage::new(48, 39), &captured).is_err());
    }

    #[test]
    fn rejected_draws_are_counted() {
        let front = Picture::from_rgb(&picture(1));
        let black = Picture::from_rgb(&RgbImage::new(48, 40));
        let of = |recipe| best_mixture(recipe, [&front, &black], &picture(1), 5, 1).unwrap();
        assert_eq!(of(MixtureRecipe::Zhang), BestMixture { best: None, rejected: 5 });
        assert_eq!(of(MixtureRecipe::Ceilnet).rejected, 0);
    }
}
