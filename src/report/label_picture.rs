//! Pictures of labels for the contact sheet.

use super::picture::{img, shrunk};
use super::sheet::{GAIN, THUMBNAIL_PX, figure};
use crate::plot::number;
use glasshouse_line::SceneLine;
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::label::{Label, LabelImages};
use image::RgbImage;
use maud::{Markup, html};

/// Draws the labels of a tuple.
pub(super) fn figures(
    labels: &LabelImages,
    line: &SceneLine,
    encoder: &SrgbEncoder,
) -> Result<Vec<Markup>, String> {
    let size = [line.film.width, line.film.height];
    let draw = |(label, values): (&Label, &Vec<f32>)| {
        let picture = shrunk(picture(*label, values, size, encoder), THUMBNAIL_PX);
        let tag = img(&picture, &format!("{label} of {}", line.id))?;
        let symbol = if *label == Label::Ghosts { format!("\u{d7} {GAIN}") } else { String::new() };
        Ok(figure(&tag, &symbol, label.name(), Some(&summary(*label, values))))
    };
    labels.iter().map(draw).collect()
}

/// Draws a label: shares from black to white, depths from far (black) to near (white), radiance as the layers.
fn picture(
    label: Label,
    values: &[f32],
    [width, height]: [u32; 2],
    encoder: &SrgbEncoder,
) -> RgbImage {
    let code = |share: f32| (share.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let nearest = values.iter().copied().filter(|z| *z > 0.0).fold(f32::INFINITY, f32::min);
    RgbImage::from_fn(width, height, |x, y| {
        let pixel = (y * width + x) as usize;
        image::Rgb(match label {
            Label::Coverage | Label::ReflectedShare => [code(values[pixel]); 3],
            Label::FrontDepth => [code(nearest / values[pixel]); 3],
            Label::Ghosts => [0, 1, 2].map(|c| encoder.encode(values[3 * pixel + c] * GAIN)),
        })
    })
}

/// Formats the mean of a share or of radiance, or the range of depths.
fn summary(label: Label, values: &[f32]) -> Markup {
    if label == Label::FrontDepth {
        let finite = || values.iter().copied().filter(|z| z.is_finite());
        let least = finite().fold(f32::INFINITY, f32::min);
        let most = finite().fold(0.0, f32::max);
        let metres = |z: f32| number((f64::from(z) * 100.0).round() / 100.0);
        return html! { (metres(least)) " to " (metres(most)) " m" };
    }
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len().max(1) as f64;
    html! { "mean " (format_args!("{mean:.3}")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_grey_and_near_surfaces_are_bright() {
        let encoder = SrgbEncoder::new();
        let of = |label, values: &[f32]| picture(label, values, [2, 1], &encoder).into_raw();
        assert_eq!(of(Label::Coverage, &[0.0, 1.0]), [0, 0, 0, 255, 255, 255]);
        assert_eq!(of(Label::FrontDepth, &[2.0, 4.0]), [255, 255, 255, 128, 128, 128]);
        assert_eq!(of(Label::FrontDepth, &[f32::INFINITY, 4.0])[..3], [0; 3]);
        let ghosts = of(Label::Ghosts, &[1.0 / GAIN, 0.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(ghosts, [255, 0, 0, 0, 0, 255]);
        assert_eq!(summary(Label::FrontDepth, &[0.5, 12.0]).into_string(), "0.5 to 12 m");
        assert_eq!(summary(Label::Coverage, &[0.5, 1.0]).into_string(), "mean 0.750");
    }
}
