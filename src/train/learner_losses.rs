//! Losses of a learner's networks for a batch.

use super::batch::Batch;
use super::generator::Generator;
use super::learner::{Lap, Learner, Term};
use super::loss::{feature_difference, l1};
use super::ops::mean_slope_difference;
use super::separation_net::Separated;
use super::vgg::Vgg;
use candle_core::{Result, Tensor};

/// Names of the terms of T*, R~* and R*: pixels, differences of neighbouring pixels, features.
const TRANSMISSION: [&str; 3] =
    ["transmission_l1", "transmission_gradient", "transmission_feature"];
const GLASS: [&str; 3] =
    ["glass_reflection_l1", "glass_reflection_gradient", "glass_reflection_feature"];
const CLEAN: [&str; 3] =
    ["clean_reflection_l1", "clean_reflection_gradient", "clean_reflection_feature"];

/// The discriminator's images (input, output, ground truth), and the terms of the loss without the adversarial term.
pub(super) type Compared = (Tensor, Tensor, Tensor, Sum);

/// Weighted terms of a loss.
#[derive(Default)]
pub(super) struct Sum {
    terms: Vec<(&'static str, Tensor)>,
}

impl Sum {
    pub(super) fn add(&mut self, name: &'static str, weight: f64, value: &Tensor) -> Result<()> {
        self.terms.push((name, (value * weight)?));
        Ok(())
    }

    pub(super) fn total(&self) -> Result<Tensor> {
        let mut terms = self.terms.iter();
        let Some((_, first)) = terms.next() else {
            candle_core::bail!("the loss has no terms: nothing can be learned");
        };
        terms.try_fold(first.clone(), |sum, (_, term)| sum + term)
    }

    pub(super) fn numbers(&self) -> Result<Vec<Term>> {
        let terms = self.terms.iter();
        terms.map(|(name, value)| Ok(Term { name, value: value.to_scalar()? })).collect()
    }
}

impl Learner {
    fn features(&self, image: &Tensor) -> Result<Vec<Tensor>> {
        match &self.vgg {
            Some(vgg) => vgg.features(image),
            None => Ok(Vec::new()),
        }
    }

    fn bt_net(&self) -> Result<&Generator> {
        let missing = || candle_core::Error::Msg("a U-Net has no BT-net".to_owned());
        self.backtrack.as_ref().ok_or_else(missing)
    }

    /// Adds the terms that compare an output with its ground truth. `features` belong to the output.
    fn compare(
        &self,
        sum: &mut Sum,
        names: [&'static str; 3],
        made: &Tensor,
        features: &[Tensor],
        truth: &Tensor,
    ) -> Result<()> {
        if self.settings.pixel_weight > 0.0 {
            sum.add(names[0], self.settings.pixel_weight, &l1(made, truth)?)?;
        }
        if self.settings.gradient_weight > 0.0 {
            let difference = mean_slope_difference(made, truth)?;
            sum.add(names[1], self.settings.gradient_weight, &difference)?;
        }
        if self.settings.feature_weight > 0.0 && !features.is_empty() {
            let difference = feature_difference(features, &self.features(&truth.detach())?)?;
            let factor = self.vgg.as_ref().map_or(1.0, Vgg::loss_factor);
            sum.add(names[2], self.settings.feature_weight * factor, &difference)?;
        }
        Ok(())
    }

    /// Compares BT(R~) with R. Returns the discriminator's images (input, output, ground truth) and the terms.
    pub(super) fn backtrack_losses(&self, batch: &Batch, lap: Lap) -> Result<Compared> {
        let (Some(given), Some(truth)) = (&batch.glass_reflection, &batch.clean_reflection) else {
            candle_core::bail!(
                "BT-net learns from glass_reflection and clean_reflection, which these examples lack: render these layers, or use the examples only in the separation stage"
            );
        };
        let made = self.bt_net()?.forward(given, &self.features(given)?)?;
        lap("forward");
        let mut sum = Sum::default();
        let features = self.loss_features(&made)?;
        self.compare(&mut sum, CLEAN, &made, &features, truth)?;
        lap("losses");
        Ok((given.clone(), made, truth.clone(), sum))
    }

    /// Returns the features of an output, or none if the loss does not use them.
    fn loss_features(&self, image: &Tensor) -> Result<Vec<Tensor>> {
        if self.settings.feature_weight > 0.0 { self.features(image) } else { Ok(Vec::new()) }
    }

    /// Computes L_pst + L_pr of Kim et al.: compares SP(I) with T and R~, and BT(R~*) with R.
    pub(super) fn separation_losses(&self, batch: &Batch, lap: Lap) -> Result<Compared> {
        let Some(separation) = &self.separation else {
            candle_core::bail!("the backtrack stage has no SP-net");
        };
        let input = &batch.input;
        let features = if separation.needs_features() { self.features(input)? } else { Vec::new() };
        let Separated { transmission: t, glass_reflection: r } =
            separation.forward(input, &features)?;
        lap("forward");
        let mut sum = Sum::default();
        let features = self.loss_features(&t)?;
        self.compare(&mut sum, TRANSMISSION, &t, &features, &batch.transmission)?;
        // Tuples and real pairs may lack R~ and R, and a U-Net has no R~*.
        let priori = batch.clean_reflection.as_ref().filter(|_| self.settings.a_priori);
        if let Some(r) = r.filter(|_| batch.glass_reflection.is_some() || priori.is_some()) {
            // BT-net and the comparison of R~* share these features.
            let features = self.features(&r)?;
            if let Some(truth) = &batch.glass_reflection {
                self.compare(&mut sum, GLASS, &r, &features, truth)?;
            }
            if let Some(truth) = priori {
                let tracked = self.bt_net()?.forward(&r, &features)?;
                let features = self.loss_features(&tracked)?;
                self.compare(&mut sum, CLEAN, &tracked, &features, truth)?;
            }
        }
        lap("losses");
        Ok((input.clone(), t, batch.transmission.clone(), sum))
    }
}
