//! Computes exposures and white balance from a preview and writes them into the scene line.

use super::images::Preview;
use super::rules::{Violation, first_violation};
use crate::draw::nine_digits;
use crate::light::{
    LightRecipe, LuminanceScale, RejectRecipe, WhiteBalance, gains_against, luminance,
};
use glasshouse_line::SceneLine;
use render::scene::{AssembleError, Decoded, LoadError, SceneFiles, decode};
use render::trace::{Isa, Texture};

/// Geometric mean luminance of a metered photograph: middle grey.
const MIDDLE_GREY: f64 = 0.18;

/// Lower bound of a pixel's luminance, because black has no logarithm: a quarter of the first 8-bit sRGB step.
const FLOOR: f64 = 7.6e-5;

/// Error of a scene that cannot be previewed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ExposureError {
    #[error(transparent)]
    Load(#[from] LoadError),
    /// The drawn parameters do not fit the photographs.
    #[error(transparent)]
    Refused(#[from] AssembleError),
    #[error("I is too dark: the exposure's percentile or the mean of a colour channel is 0")]
    Black,
}

/// Result of a preview.
#[derive(Clone, Debug)]
pub(crate) struct Exposed {
    /// Scene line with exposures and white balance.
    pub line: SceneLine,
    /// First `[reject]` bound that the scene violates, if any.
    pub rejected: Option<Violation>,
}

/// Sets exposures and white balance of a drawn line, which already has the recipe's exposures and illuminants.
pub(crate) fn auto_expose(
    line: &SceneLine,
    files: &SceneFiles,
    light: &LightRecipe,
    rules: &RejectRecipe,
    isa: Isa,
) -> Result<Exposed, ExposureError> {
    let mut line = line.clone();
    // Light is linear, so exposures and illuminants are factors of the decoded values.
    let mut plain = line.clone();
    for side in [&mut plain.front, &mut plain.back] {
        let (exposure, illuminant) = side.light_mut();
        (*exposure, *illuminant) = (1.0, [1.0; 3]);
    }
    plain.camera.exposure = 1.0;
    plain.camera.white_balance = [1.0; 3];
    let mut scene = decode(&plain, files)?;
    let sides =
        [(&mut line.front, &mut scene.front.surface), (&mut line.back, &mut scene.back.surface)];
    for (side, decoded) in sides {
        let (exposure, illuminant) = side.light_mut();
        if light.scale == LuminanceScale::Metered {
            *exposure = nine_digits(*exposure * MIDDLE_GREY / mean_luminance(decoded));
        }
        scale(decoded, illuminant.map(|c| c * *exposure));
    }
    let preview = Preview::new(&plain_camera(&line), &scene, isa)?;
    let balance = match light.white_balance {
        WhiteBalance::GreyWorld => {
            let color = preview.mean_color();
            if color.iter().any(|c| *c <= 0.0) {
                return Err(ExposureError::Black);
            }
            gains_against(color)
        }
        // `draw_line` has set this balance.
        WhiteBalance::None | WhiteBalance::Front | WhiteBalance::Back => line.camera.white_balance,
    };
    line.camera.white_balance = balance;
    let preview = preview.times(balance);
    let mut gain = 1.0;
    if let Some(auto) = light.auto_exposure {
        let value = preview.percentile(auto.percentile);
        if value <= 0.0 {
            return Err(ExposureError::Black);
        }
        gain = nine_digits(auto.level / value);
        line.camera.exposure = gain;
    }
    let rejected = first_violation(&preview.times([gain; 3]), rules);
    Ok(Exposed { line, rejected })
}

/// Returns the line with a camera exposure and a white balance of 1.
fn plain_camera(line: &SceneLine) -> SceneLine {
    let mut line = line.clone();
    line.camera.exposure = 1.0;
    line.camera.white_balance = [1.0; 3];
    line
}

/// Computes the geometric mean luminance of one side's pixels (for a mesh: its vertices).
fn mean_luminance(side: &Decoded) -> f64 {
    let log = |&[r, g, b, _]: &[f32; 4]| libm::log2(luminance([r, g, b].map(f64::from)).max(FLOOR));
    let (sum, count): (f64, usize) = match side {
        Decoded::Sheet(sheet) => {
            let texture = &sheet.texture;
            (sheet.radiance().map(log).sum(), texture.width() * texture.height())
        }
        Decoded::Mesh(mesh) => (mesh.radiance.iter().map(log).sum(), mesh.radiance.len()),
    };
    libm::exp2(sum / count.max(1) as f64)
}

fn scale(side: &mut Decoded, factors: [f64; 3]) {
    let scaled = |pixel: &[f32; 4]| {
        let [red, green, blue] = [0, 1, 2].map(|c| (f64::from(pixel[c]) * factors[c]) as f32);
        [red, green, blue, pixel[3]]
    };
    match side {
        Decoded::Sheet(sheet) => {
            let texels = sheet.radiance().map(scaled).collect();
            let (width, height) = (sheet.texture.width(), sheet.texture.height());
            sheet.texture = Texture::from_vec(width, height, texels).into();
        }
        Decoded::Mesh(mesh) => {
            mesh.radiance.iter_mut().for_each(|vertex| *vertex = scaled(vertex));
            mesh.max_radiance = mesh.radiance.iter().flatten().copied().fold(0.0, f32::max);
        }
    }
}
