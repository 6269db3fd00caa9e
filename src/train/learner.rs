//! The networks of a stage and one step of their training.

use super::adam::{Adam, AdamOptions};
use super::batch::Batch;
use super::discriminator::Discriminator;
use super::generator::{Generator, GeneratorOptions, SLOPE};
use super::inference::Networks;
use super::loss::{adversarial_loss, discriminator_loss, feature_difference, l1};
use super::vgg::Vgg;
#[cfg(test)]
use candle_core::backprop::GradStore;
use candle_core::{Device, Result, Tensor, Var};
use plan::{Stage, TrainSettings};
use std::collections::{BTreeMap, HashMap};

/// The networks of a stage and their optimisers.
pub struct Learner {
    pub stage: Stage,
    /// SP-net; `None` in the backtrack stage.
    pub separation: Option<Generator>,
    pub backtrack: Generator,
    /// Discriminator of R and R*, given R~, or of T and T*, given I; `None` if the adversarial weight is 0.
    pub discriminator: Option<Discriminator>,
    pub generator_adam: Adam,
    pub discriminator_adam: Option<Adam>,
    settings: TrainSettings,
    vgg: Option<Vgg>,
    device: Device,
}

/// One weighted term of a step's loss.
pub struct Term {
    /// Name in logs, such as `transmission_l1`.
    pub name: &'static str,
    pub value: f32,
}

pub struct StepLosses {
    pub total: f32,
    pub terms: Vec<Term>,
    /// The discriminator's loss; `None` in steps that do not train it.
    pub discriminator: Option<f32>,
}

/// Callback that receives the name of each finished part of a step.
pub type Lap<'a> = &'a mut dyn FnMut(&'static str);

/// Weighted terms of a loss.
#[derive(Default)]
struct Sum {
    terms: Vec<(&'static str, Tensor)>,
}

impl Sum {
    fn add(&mut self, name: &'static str, weight: f64, value: &Tensor) -> Result<()> {
        self.terms.push((name, (value * weight)?));
        Ok(())
    }

    fn total(&self) -> Result<Tensor> {
        let mut terms = self.terms.iter();
        let Some((_, first)) = terms.next() else {
            candle_core::bail!("the loss has no terms: nothing can be learned");
        };
        terms.try_fold(first.clone(), |sum, (_, term)| sum + term)
    }

    fn numbers(&self) -> Result<Vec<Term>> {
        let terms = self.terms.iter();
        terms.map(|(name, value)| Ok(Term { name, value: value.to_scalar()? })).collect()
    }
}

impl Learner {
    /// Creates the networks of a stage. `vgg` is `None` if the settings use no features.
    pub fn new(
        stage: Stage,
        settings: &TrainSettings,
        vgg: Option<Vgg>,
        device: &Device,
    ) -> Result<Self> {
        Self::with_slope(stage, settings, vgg, device, SLOPE)
    }

    /// Creates the networks with the given slope of all leaky ReLUs.
    pub(super) fn with_slope(
        stage: Stage,
        settings: &TrainSettings,
        vgg: Option<Vgg>,
        device: &Device,
        slope: f32,
    ) -> Result<Self> {
        let options = |outputs| GeneratorOptions {
            width: settings.width,
            outputs,
            features: vgg.as_ref().map(Vgg::widths).unwrap_or_default(),
            start: settings.start,
            slope,
        };
        let seed = settings.seed;
        let backtrack = Generator::new(&options(3), seed, "backtrack", device)?;
        let separation = match stage {
            Stage::Backtrack => None,
            Stage::Separation => Some(Generator::new(&options(6), seed, "separation", device)?),
        };
        let discriminator = (settings.adversarial_weight > 0.0)
            .then(|| -> Result<Discriminator> {
                let name = format!("{} discriminator", stage.name());
                let width = settings.discriminator_width;
                Ok(Discriminator::new(width, seed, &name, device)?.with_slope(slope))
            })
            .transpose()?;
        let mut learned = Vec::new();
        if let Some(separation) = &separation {
            learned.extend(prefixed("separation", separation.variables()));
        }
        learned.extend(prefixed("backtrack", backtrack.variables()));
        let discriminator_adam = discriminator
            .as_ref()
            .map(|d| Adam::new(prefixed("discriminator", d.variables()), adam_options(settings)))
            .transpose()?;
        Ok(Self {
            stage,
            generator_adam: Adam::new(learned, adam_options(settings))?,
            discriminator_adam,
            separation,
            backtrack,
            discriminator,
            settings: settings.clone(),
            vgg,
            device: device.clone(),
        })
    }

    /// Returns all trainable variables by name, in a fixed order.
    pub fn variables(&self) -> Vec<(String, Var)> {
        let adams = std::iter::once(&self.generator_adam).chain(&self.discriminator_adam);
        adams
            .flat_map(|adam| &adam.moments)
            .map(|moments| (moments.name.clone(), moments.variable.clone()))
            .collect()
    }

    /// Returns the number of trainable weights.
    pub fn parameters(&self) -> usize {
        let variables = self.variables();
        variables.iter().map(|(_, v)| v.elem_count()).sum()
    }

    /// Returns all trainable weights by name.
    pub fn model(&self) -> BTreeMap<String, Tensor> {
        let variables = self.variables().into_iter();
        variables.map(|(name, variable)| (name, variable.as_detached_tensor())).collect()
    }

    /// Returns the moments of the optimisers: `mean.NAME` and `square.NAME`.
    pub fn moments(&self) -> BTreeMap<String, Tensor> {
        let adams = std::iter::once(&self.generator_adam).chain(&self.discriminator_adam);
        adams
            .flat_map(|adam| &adam.moments)
            .flat_map(|m| {
                [
                    (format!("mean.{}", m.name), m.mean.clone()),
                    (format!("square.{}", m.name), m.square.clone()),
                ]
            })
            .collect()
    }

    /// Copies every weight from `model` if its name starts with `prefix`.
    ///
    /// # Errors
    ///
    /// Fails if a weight is missing or has another shape.
    pub fn set_model(&mut self, model: &HashMap<String, Tensor>, prefix: &str) -> Result<()> {
        for (name, variable) in self.variables() {
            if name.starts_with(prefix) {
                variable.set(of_shape(model, &name, variable.dims())?)?;
            }
        }
        Ok(())
    }

    /// Restores the optimisers' moments and step counts; fails like [`Self::set_model`].
    pub fn set_moments(
        &mut self,
        moments: &HashMap<String, Tensor>,
        generator_steps: u64,
        discriminator_steps: u64,
    ) -> Result<()> {
        self.generator_adam.steps = generator_steps;
        if let Some(adam) = &mut self.discriminator_adam {
            adam.steps = discriminator_steps;
        }
        let adams = std::iter::once(&mut self.generator_adam).chain(&mut self.discriminator_adam);
        for m in adams.flat_map(|adam| &mut adam.moments) {
            let dims = m.variable.dims();
            m.mean = of_shape(moments, &format!("mean.{}", m.name), dims)?.clone();
            m.square = of_shape(moments, &format!("square.{}", m.name), dims)?.clone();
        }
        Ok(())
    }

    /// Trains one step (counted from 0): the discriminator if it is due, then the generators.
    ///
    /// # Errors
    ///
    /// Fails if candle fails, if the batch lacks layers that the stage needs, or if the loss has no terms.
    pub fn step(&mut self, step: u64, batch: &Batch, lap: Lap) -> Result<StepLosses> {
        let (given, made, truth, mut sum) = match self.stage {
            Stage::Backtrack => self.backtrack_losses(batch, lap)?,
            Stage::Separation => self.separation_losses(batch, lap)?,
        };
        let mut of_discriminator = None;
        if let (Some(discriminator), Some(adam)) =
            (&self.discriminator, &mut self.discriminator_adam)
        {
            if step.is_multiple_of(self.settings.discriminator_every) {
                let real = discriminator.forward(&given, &truth)?;
                let fake = discriminator.forward(&given, &made.detach())?;
                let loss = discriminator_loss(&real, &fake)?;
                adam.step(&loss.backward()?)?;
                of_discriminator = Some(loss.to_scalar()?);
                lap("discriminator step");
            }
            let verdicts = discriminator.forward_frozen(&given, &made)?;
            let weight = self.settings.adversarial_weight;
            sum.add("adversarial", weight, &adversarial_loss(&verdicts)?)?;
            lap("losses");
        }
        let total = sum.total()?;
        let gradients = total.backward()?;
        lap("backward");
        self.generator_adam.step(&gradients)?;
        lap("Adam");
        Ok(StepLosses {
            total: total.to_scalar()?,
            terms: sum.numbers()?,
            discriminator: of_discriminator,
        })
    }

    /// Computes the separation stage's loss and its gradients, without a step of Adam.
    #[cfg(test)]
    pub(super) fn gradients(&self, batch: &Batch) -> Result<(Tensor, GradStore)> {
        let (given, made, _, mut sum) = self.separation_losses(batch, &mut |_| {})?;
        if let Some(discriminator) = &self.discriminator {
            let verdicts = discriminator.forward_frozen(&given, &made)?;
            let weight = self.settings.adversarial_weight;
            sum.add("adversarial", weight, &adversarial_loss(&verdicts)?)?;
        }
        let total = sum.total()?;
        let gradients = total.backward()?;
        Ok((total, gradients))
    }

    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Returns the networks for inference.
    pub fn networks(&self) -> Networks<'_> {
        Networks {
            vgg: self.vgg.as_ref(),
            separation: self.separation.as_ref(),
            backtrack: &self.backtrack,
        }
    }

    fn features(&self, image: &Tensor) -> Result<Vec<Tensor>> {
        match &self.vgg {
            Some(vgg) => vgg.features(image),
            None => Ok(Vec::new()),
        }
    }

    /// Adds the terms that compare an output with its ground truth. `features` belong to the output.
    fn compare(
        &self,
        sum: &mut Sum,
        names: [&'static str; 2],
        made: &Tensor,
        features: &[Tensor],
        truth: &Tensor,
    ) -> Result<()> {
        if self.settings.pixel_weight > 0.0 {
            sum.add(names[0], self.settings.pixel_weight, &l1(made, truth)?)?;
        }
        if self.settings.feature_weight > 0.0 && !features.is_empty() {
            let difference = feature_difference(features, &self.features(&truth.detach())?)?;
            sum.add(names[1], self.settings.feature_weight, &difference)?;
        }
        Ok(())
    }

    /// Compares BT(R~) with R. Returns the discriminator's images (input, output, ground truth) and the terms.
    fn backtrack_losses(&self, batch: &Batch, lap: Lap) -> Result<(Tensor, Tensor, Tensor, Sum)> {
        let (Some(given), Some(truth)) = (&batch.glass_reflection, &batch.clean_reflection) else {
            candle_core::bail!(
                "BT-net learns from glass_reflection and clean_reflection, which these examples lack: render these layers, or use the examples only in the separation stage"
            );
        };
        let made = self.backtrack.forward(given, &self.features(given)?)?;
        lap("forward");
        let mut sum = Sum::default();
        let features = self.loss_features(&made)?;
        let names = ["clean_reflection_l1", "clean_reflection_feature"];
        self.compare(&mut sum, names, &made, &features, truth)?;
        lap("losses");
        Ok((given.clone(), made, truth.clone(), sum))
    }

    /// Returns the features of an output, or none if the loss does not use them.
    fn loss_features(&self, image: &Tensor) -> Result<Vec<Tensor>> {
        if self.settings.feature_weight > 0.0 { self.features(image) } else { Ok(Vec::new()) }
    }

    /// Computes L_pst + L_pr of Kim et al.: compares SP(I) with T and R~, and BT(R~*) with R.
    fn separation_losses(&self, batch: &Batch, lap: Lap) -> Result<(Tensor, Tensor, Tensor, Sum)> {
        let Some(separation) = &self.separation else {
            candle_core::bail!("the backtrack stage has no SP-net");
        };
        let input = &batch.input;
        let made = separation.forward(input, &self.features(input)?)?;
        let (t, r) = (made.narrow(1, 0, 3)?, made.narrow(1, 3, 3)?);
        let (t, r) = (t.contiguous()?, r.contiguous()?);
        lap("forward");
        let mut sum = Sum::default();
        let features = self.loss_features(&t)?;
        let names = ["transmission_l1", "transmission_feature"];
        self.compare(&mut sum, names, &t, &features, &batch.transmission)?;
        // Tuples and real pairs may lack R~ and R.
        let priori = batch.clean_reflection.as_ref().filter(|_| self.settings.a_priori);
        if batch.glass_reflection.is_some() || priori.is_some() {
            // BT-net and the comparison of R~* share these features.
            let features = self.features(&r)?;
            if let Some(truth) = &batch.glass_reflection {
                let names = ["glass_reflection_l1", "glass_reflection_feature"];
                self.compare(&mut sum, names, &r, &features, truth)?;
            }
            if let Some(truth) = priori {
                let tracked = self.backtrack.forward(&r, &features)?;
                let features = self.loss_features(&tracked)?;
                let names = ["clean_reflection_l1", "clean_reflection_feature"];
                self.compare(&mut sum, names, &tracked, &features, truth)?;
            }
        }
        lap("losses");
        Ok((input.clone(), t, batch.transmission.clone(), sum))
    }
}

fn adam_options(settings: &TrainSettings) -> AdamOptions {
    AdamOptions { learning_rate: settings.learning_rate, ..AdamOptions::default() }
}

fn of_shape<'a>(
    tensors: &'a HashMap<String, Tensor>,
    name: &str,
    dims: &[usize],
) -> Result<&'a Tensor> {
    match tensors.get(name) {
        Some(tensor) if tensor.dims() == dims => Ok(tensor),
        Some(tensor) => candle_core::bail!("{name} is {:?}, not {dims:?}", tensor.dims()),
        None => candle_core::bail!("{name} is missing"),
    }
}

fn prefixed(prefix: &str, variables: Vec<(String, Var)>) -> Vec<(String, Var)> {
    let named = variables.into_iter();
    named.map(|(name, variable)| (format!("{prefix}.{name}"), variable)).collect()
}
