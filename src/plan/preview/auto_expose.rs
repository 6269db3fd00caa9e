//! Exposures and white balance become numbers of the scene line: what is farmed depends on the line alone.

use super::rules::{Bound, reject};
use super::images::Look;
use super::meter::mean_luminance;
use crate::{LightRecipe, LuminanceScale, RejectRecipe, WhiteBalance, gains_against, nine_digits};
use render::line::SceneLine;
use render::scene::{AssembleError, Decoded, LoadError, SceneFiles, decode};
use render::trace::Isa;

/// Geometric mean luminance of a metered photograph: middle grey.
const MIDDLE_GREY: f64 = 0.18;

/// A scene that cannot be looked at.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SettleError {
    /// Its files cannot be used.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The scene refuses what was drawn for it.
    #[error(transparent)]
    Refused(#[from] AssembleError),
    /// Nothing to expose for.
    #[error("I is black: there is nothing to expose or balance for")]
    Black,
}

/// A scene whose light is settled.
#[derive(Clone, Debug)]
pub(crate) struct Settled {
    /// The line with its exposures and white balance.
    pub line: SceneLine,
    /// Why the scene is not wanted, if it is not.
    pub rejected: Option<Bound>,
}

/// Settles the light of a drawn line, whose sides' exposures and illuminants are the recipe's.
pub(crate) fn settle(
    line: &SceneLine,
    files: &SceneFiles,
    light: &LightRecipe,
    rules: &RejectRecipe,
    isa: Isa,
) -> Result<Settled, SettleError> {
    let mut line = line.clone();
    // Decoded as they are stored; light is linear, so the rest are factors.
    let mut plain = line.clone();
    for side in [&mut plain.front, &mut plain.back] {
        let (exposure, illuminant) = side.light_mut();
        (*exposure, *illuminant) = (1.0, [1.0; 3]);
    }
    plain.camera.exposure = 1.0;
    plain.camera.white_balance = [1.0; 3];
    let mut scene = decode(&plain, files)?;
    let sides = [
        (&mut line.front, &mut scene.front),
        (&mut line.back, &mut scene.back),
    ];
    for (side, decoded) in sides {
        let (exposure, illuminant) = side.light_mut();
        if light.scale == LuminanceScale::Metered {
            *exposure = nine_digits(*exposure * MIDDLE_GREY / mean_luminance(decoded));
        }
        scale(decoded, illuminant.map(|c| c * *exposure));
    }
    let look = Look::new(&plain_camera(&line), &scene, isa)?;
    let balance = match light.white_balance {
        WhiteBalance::GreyWorld => {
            let color = look.mean_color();
            if color.iter().any(|c| *c <= 0.0) {
                return Err(SettleError::Black);
            }
            gains_against(color)
        }
        // Known when it was drawn.
        WhiteBalance::None | WhiteBalance::Front | WhiteBalance::Back => line.camera.white_balance,
    };
    line.camera.white_balance = balance;
    let look = look.times(balance);
    let mut gain = 1.0;
    if let Some(auto) = light.auto_exposure {
        let value = look.percentile(auto.percentile);
        if value <= 0.0 {
            return Err(SettleError::Black);
        }
        gain = nine_digits(auto.level / value);
        line.camera.exposure = gain;
    }
    let rejected = reject(&look.times([gain; 3]), rules);
    Ok(Settled { line, rejected })
}

/// The line with a camera that leaves light as it is.
fn plain_camera(line: &SceneLine) -> SceneLine {
    let mut line = line.clone();
    line.camera.exposure = 1.0;
    line.camera.white_balance = [1.0; 3];
    line
}

fn scale(side: &mut Decoded, factors: [f64; 3]) {
    let (radiance, max) = match side {
        Decoded::Sheet(sheet) => (&mut sheet.radiance, &mut sheet.max_radiance),
        Decoded::Mesh(mesh) => (&mut mesh.radiance, &mut mesh.max_radiance),
    };
    *max = 0.0;
    for pixel in radiance {
        for c in 0..3 {
            pixel[c] = (f64::from(pixel[c]) * factors[c]) as f32;
            *max = max.max(pixel[c]);
        }
    }
}
