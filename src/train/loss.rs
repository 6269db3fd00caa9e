//! Losses of Kim et al., section 4, in part from Zhang et al.

use super::ops::{absolute, mean_absolute_difference};
use candle_core::{Result, Tensor};

/// Divisors of the differences of conv1_2 to conv5_2 (Zhang et al.). The last is 1.5 divided by a weight of 10.
pub const FEATURE_DIVISORS: [f64; 5] = [2.6, 4.8, 3.7, 5.6, 0.15];

/// Computes the mean absolute difference.
pub fn l1(a: &Tensor, b: &Tensor) -> Result<Tensor> {
    mean_absolute_difference(a, b)
}

/// Sums the mean absolute differences of features (see [`super::Vgg::features`]), each divided by its divisor.
pub fn feature_difference(features: &[Tensor], targets: &[Tensor]) -> Result<Tensor> {
    let mut sum: Option<Tensor> = None;
    for ((feature, target), divisor) in features.iter().zip(targets).zip(FEATURE_DIVISORS) {
        let part = (l1(feature, target)? / divisor)?;
        sum = Some(match sum {
            None => part,
            Some(sum) => (sum + part)?,
        });
    }
    sum.ok_or_else(|| candle_core::Error::Msg("the feature network has no features".to_owned()))
}

/// Computes the mean of ln(1 + e^x) without overflow: max(x, 0) + ln(1 + e^-|x|).
fn softplus(x: &Tensor) -> Result<Tensor> {
    // x / 2 + |x| / 2 is max(x, 0) with softplus's gradient 1/2 at 0.
    let size = absolute(x)?;
    let positive = ((x + &size)? * 0.5)?;
    let rest = (size.neg()?.exp()? + 1.0)?.log()?;
    (positive + rest)?.mean_all()
}

/// Computes the generator's loss from the logits of its output: -ln D.
pub fn adversarial_loss(verdicts: &Tensor) -> Result<Tensor> {
    softplus(&verdicts.neg()?)
}

/// Computes the discriminator's loss: half of -ln D(real) - ln(1 - D(made)).
pub fn discriminator_loss(real: &Tensor, made: &Tensor) -> Result<Tensor> {
    (softplus(&real.neg()?)? + softplus(made)?)? * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::{Device, Var};

    #[test]
    fn softplus_and_its_gradient_do_not_overflow() {
        for x in [-200.0f32, -3.0, -1e-3, 0.0, 0.5, 4.0, 90.0] {
            let variable = Var::new(&[x], &Device::Cpu).unwrap();
            let y = softplus(&variable).unwrap();
            let exact = if x > 30.0 { f64::from(x) } else { f64::from(x).exp().ln_1p() };
            assert!(
                (f64::from(y.to_scalar::<f32>().unwrap()) - exact).abs() < 1e-6 * (1.0 + exact)
            );
            let gradient =
                y.backward().unwrap().get(&variable).unwrap().to_vec1::<f32>().unwrap()[0];
            let exact = 1.0 / (1.0 + (-f64::from(x)).exp());
            assert!((f64::from(gradient) - exact).abs() < 1e-6, "{x}: {gradient} {exact}");
        }
    }
}
