//! Reads ICC profiles with `moxcms`, and takes their curves and primaries.
//!
//! Only the numbers of a profile are used, not the transforms of `moxcms`, which select instructions for the machine.

use super::color_space::{ColorSpace, Curve};
use moxcms::{ColorProfile, DataColorSpace, LutWarehouse, ProfileClass, ToneReprCurve};

/// Colours of a picture that cannot be converted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ColorError {
    #[error("its ICC profile is damaged; remove the profile, or embed it again")]
    Damaged,
    #[error("its ICC profile {0}; convert the picture to sRGB")]
    Unsupported(String),
    #[error("it is a CMYK picture with an ICC profile; convert it to sRGB")]
    Cmyk,
    #[error("its chunk {0} {1}; convert the picture to sRGB")]
    Chunk(&'static str, String),
    #[error(
        "its ICC profile is one of {profile} pictures, but the picture is {picture}; convert it to sRGB"
    )]
    OtherPicture { profile: &'static str, picture: &'static str },
}

/// Reads the profile of a picture with `channels` 1 or 2 (grey) or more (RGB). Returns `None` for sRGB.
pub(crate) fn read(icc: &[u8], channels: usize) -> Result<Option<ColorSpace>, ColorError> {
    let profile = ColorProfile::new_from_slice(icc).map_err(|_| ColorError::Damaged)?;
    let unsupported = |what: &str| Err(ColorError::Unsupported(what.to_owned()));
    if matches!(
        profile.profile_class,
        ProfileClass::DeviceLink | ProfileClass::Abstract | ProfileClass::Named
    ) {
        return unsupported("does not describe the colours of a device");
    }
    let is_grey = channels < 3;
    match profile.color_space {
        DataColorSpace::Rgb => {}
        DataColorSpace::Gray if is_grey => {}
        DataColorSpace::Gray => {
            return Err(ColorError::OtherPicture { profile: "grey", picture: "RGB" });
        }
        DataColorSpace::Cmyk => {
            let picture = if is_grey { "grey" } else { "RGB" };
            return Err(ColorError::OtherPicture { profile: "CMYK", picture });
        }
        _ => return unsupported("has codes that are neither RGB nor grey"),
    }
    let luts: [&Option<LutWarehouse>; 2] =
        [&profile.lut_a_to_b_perceptual, &profile.lut_a_to_b_colorimetric];
    if luts.into_iter().any(Option::is_some) {
        return unsupported("has a table of colours (A2B) in place of curves and primaries");
    }
    if profile.pcs != DataColorSpace::Xyz && profile.color_space == DataColorSpace::Rgb {
        return unsupported("has no curves and primaries");
    }
    if profile.color_space == DataColorSpace::Gray {
        let Some(grey) = &profile.gray_trc else {
            return unsupported("has no curve of grey");
        };
        let curve = curve(grey)?;
        // ICC.1:2022, 8.3.4: the curve gives the connection space's achromatic channel, here L*.
        return Ok(ColorSpace::of_grey(match profile.pcs {
            DataColorSpace::Lab => Curve::Lightness(Box::new(curve)),
            DataColorSpace::Xyz => curve,
            _ => return unsupported("has a connection space other than XYZ and Lab"),
        }));
    }
    let (Some(red), Some(green), Some(blue)) =
        (&profile.red_trc, &profile.green_trc, &profile.blue_trc)
    else {
        return unsupported("has no curves");
    };
    let columns = [profile.red_colorant, profile.green_colorant, profile.blue_colorant];
    let xyz = [columns.map(|c| c.x), columns.map(|c| c.y), columns.map(|c| c.z)];
    if !xyz.as_flattened().iter().all(|v| v.is_finite()) || columns.iter().all(|c| c.y == 0.0) {
        return unsupported("has no primaries");
    }
    Ok(ColorSpace::of_d50([curve(red)?, curve(green)?, curve(blue)?], xyz))
}

/// Converts a curve. Section 10 of ICC.1:2022 defines the parametric functions.
fn curve(read: &ToneReprCurve) -> Result<Curve, ColorError> {
    let curve = match read {
        ToneReprCurve::Lut(values) => match values.as_slice() {
            [] => Curve::Power(1.0),
            [gamma] => Curve::Power(f64::from(*gamma) / 256.0),
            values => Curve::Sampled(values.iter().map(|v| f64::from(*v) / 65535.0).collect()),
        },
        ToneReprCurve::Parametric(numbers) => {
            let numbers: Vec<f64> = numbers.iter().map(|v| f64::from(*v)).collect();
            if !numbers.iter().all(|v| v.is_finite()) {
                return Err(ColorError::Damaged);
            }
            let (zero, never) = (0.0, f64::NEG_INFINITY);
            match *numbers.as_slice() {
                [g] => {
                    Curve::Parametric { g, a: 1.0, b: zero, c: zero, d: never, e: zero, f: zero }
                }
                [g, a, b] => Curve::Parametric { g, a, b, c: zero, d: -b / a, e: zero, f: zero },
                [g, a, b, c] => Curve::Parametric { g, a, b, c: zero, d: -b / a, e: c, f: c },
                [g, a, b, c, d] => Curve::Parametric { g, a, b, c, d, e: zero, f: zero },
                [g, a, b, c, d, e, f] => Curve::Parametric { g, a, b, c, d, e, f },
                _ => return Err(ColorError::Damaged),
            }
        }
    };
    Ok(curve)
}
