//! The networks of a stage and one step of their training.

use super::adam::{Adam, AdamOptions, Averages};
use super::batch::Batch;
use super::discriminator::Discriminator;
use super::generator::{Generator, GeneratorOptions, SLOPE};
use super::inference::Networks;
use super::loss::{adversarial_loss, discriminator_loss};
use super::ops::Sampling;
use super::separation_net::SeparationNet;
use super::vgg::Vgg;
#[cfg(test)]
use candle_core::backprop::GradStore;
use candle_core::{Result, Tensor, Var};
use plan::{NetworkKind, OptimizerKind, Stage, TrainSettings};
use std::collections::{BTreeMap, HashMap};

/// The networks of a stage and their optimisers.
pub struct Learner {
    pub stage: Stage,
    /// SP-net or the U-Net; `None` in the backtrack stage.
    pub separation: Option<SeparationNet>,
    /// BT-net; `None` beside a U-Net.
    pub backtrack: Option<Generator>,
    /// Discriminator of R and R*, given R~, or of T and T*, given I; `None` if the adversarial weight is 0.
    pub discriminator: Option<Discriminator>,
    pub generator_adam: Adam,
    pub discriminator_adam: Option<Adam>,
    /// Running means of the generators' weights, which are the weights of the model; `None` if the settings use none.
    averages: Option<Averages>,
    pub(super) settings: TrainSettings,
    pub(super) vgg: Option<Vgg>,
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

impl Learner {
    /// Creates the networks of a stage. `vgg` is `None` if the settings use no features.
    pub fn new(stage: Stage, settings: &TrainSettings, vgg: Option<Vgg>) -> Result<Self> {
        Self::with_slope(stage, settings, vgg, SLOPE)
    }

    /// Creates the networks with the given slope of all leaky ReLUs.
    pub(super) fn with_slope(
        stage: Stage,
        settings: &TrainSettings,
        vgg: Option<Vgg>,
        slope: f32,
    ) -> Result<Self> {
        let vgg = vgg.map(|vgg| vgg.with_style(settings.feature_style));
        let options = |outputs| GeneratorOptions {
            width: settings.width,
            outputs,
            features: vgg.as_ref().map(Vgg::widths).unwrap_or_default(),
            sampling: vgg.as_ref().map_or(Sampling::Centres, Vgg::sampling),
            start: settings.start,
            slope,
        };
        let seed = settings.seed;
        let backtrack = match (settings.network, stage) {
            (NetworkKind::Generator, _) => Some(Generator::new(&options(3), seed, "backtrack")?),
            (NetworkKind::Unet, Stage::Separation) => None,
            (NetworkKind::Unet, Stage::Backtrack) => {
                candle_core::bail!("a U-Net has no BT-net, so it has no backtrack stage")
            }
        };
        let separation = match stage {
            Stage::Backtrack => None,
            Stage::Separation => Some(SeparationNet::new(settings, &options(6))?),
        };
        let discriminator = (settings.adversarial_weight > 0.0)
            .then(|| -> Result<Discriminator> {
                let name = format!("{} discriminator", stage.name());
                let width = settings.discriminator_width;
                Ok(Discriminator::new(width, seed, &name)?.with_slope(slope))
            })
            .transpose()?;
        let mut learned = Vec::new();
        if let Some(separation) = &separation {
            learned.extend(prefixed("separation", separation.variables()));
        }
        if let Some(backtrack) = &backtrack {
            learned.extend(prefixed("backtrack", backtrack.variables()));
        }
        let options = adam_options(settings);
        let discriminator_adam = discriminator
            .as_ref()
            .map(|d| {
                let options = AdamOptions { weight_decay: 0.0, ..options };
                Adam::new(prefixed("discriminator", d.variables()), options)
            })
            .transpose()?;
        let generator_adam = Adam::new(learned, options)?;
        let averages = (settings.ema > 0.0)
            .then(|| Averages::new(&generator_adam.moments, settings.ema))
            .transpose()?;
        Ok(Self {
            stage,
            generator_adam,
            averages,
            discriminator_adam,
            separation,
            backtrack,
            discriminator,
            settings: settings.clone(),
            vgg,
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

    /// Returns the weights for work by name: running means if the settings use them, and trained weights.
    pub fn model(&self) -> BTreeMap<String, Tensor> {
        let variables = self.variables().into_iter();
        let mut model: BTreeMap<String, Tensor> =
            variables.map(|(name, variable)| (name, variable.as_detached_tensor())).collect();
        for (name, mean) in self.means() {
            model.insert(name.to_owned(), mean.clone());
        }
        model
    }

    /// Returns the running means by name; none if the settings use none.
    fn means(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        let names = self.generator_adam.moments.iter().map(|m| m.name.as_str());
        names.zip(self.averages.iter().flat_map(Averages::means))
    }

    /// Returns the state of the optimisers: `mean.NAME` and `square.NAME`, and with running means the trained weights,
    /// `weight.NAME`.
    pub fn moments(&self) -> BTreeMap<String, Tensor> {
        let adams = std::iter::once(&self.generator_adam).chain(&self.discriminator_adam);
        let moments = adams.flat_map(|adam| &adam.moments).flat_map(|m| {
            [
                (format!("mean.{}", m.name), m.mean.clone()),
                (format!("square.{}", m.name), m.square.clone()),
            ]
        });
        let trained = self.averages.iter().flat_map(|_| &self.generator_adam.moments);
        let trained =
            trained.map(|m| (format!("weight.{}", m.name), m.variable.as_detached_tensor()));
        moments.chain(trained).collect()
    }

    /// Copies every weight from `model` if its name starts with `prefix`, to the running mean, too.
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
        if let Some(averages) = &mut self.averages {
            *averages = Averages::new(&self.generator_adam.moments, self.settings.ema)?;
        }
        Ok(())
    }

    /// Restores the optimisers' moments and step counts, and with running means the trained weights, after
    /// [`Self::set_model`]; fails like it.
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
        if self.averages.is_some() {
            for m in &self.generator_adam.moments {
                let name = format!("weight.{}", m.name);
                m.variable.set(of_shape(moments, &name, m.variable.dims())?)?;
            }
        }
        let adams = std::iter::once(&mut self.generator_adam).chain(&mut self.discriminator_adam);
        for m in adams.flat_map(|adam| &mut adam.moments) {
            let dims = m.variable.dims();
            m.mean = of_shape(moments, &format!("mean.{}", m.name), dims)?.clone();
            m.square = of_shape(moments, &format!("square.{}", m.name), dims)?.clone();
        }
        Ok(())
    }

    /// Calls `with` with the networks at work, which have the weights of [`Self::model`].
    pub fn at_work<T, E: From<candle_core::Error>>(
        &self,
        with: impl FnOnce(Networks) -> std::result::Result<T, E>,
    ) -> std::result::Result<T, E> {
        let Some(averages) = &self.averages else {
            return with(self.networks());
        };
        let moments = &self.generator_adam.moments;
        let trained = moments.iter().map(|m| m.variable.as_tensor().copy());
        let trained: Vec<Tensor> = trained.collect::<Result<_>>()?;
        let set = |weights: &[Tensor]| -> Result<()> {
            moments.iter().zip(weights).try_for_each(|(m, weight)| m.variable.set(weight))
        };
        set(averages.means())?;
        let result = with(self.networks());
        set(&trained)?;
        result
    }

    /// Trains one step (counted from 0): the discriminator if it is due, then the generators.
    ///
    /// # Errors
    ///
    /// Fails if candle fails, if the batch lacks layers that the stage needs, or if the loss has no terms.
    pub fn step(&mut self, step: u64, batch: &Batch, lap: Lap) -> Result<StepLosses> {
        self.generator_adam.options.learning_rate = self.settings.rate(step + 1);
        if let Some(adam) = &mut self.discriminator_adam {
            adam.options.learning_rate = self.settings.discriminator_rate(step + 1);
        }
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
        if let Some(averages) = &mut self.averages {
            averages.step(&self.generator_adam.moments, self.generator_adam.steps)?;
        }
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

    /// Returns the networks with the trained weights; see [`Self::at_work`].
    pub fn networks(&self) -> Networks<'_> {
        Networks {
            vgg: self.vgg.as_ref(),
            separation: self.separation.as_ref(),
            backtrack: self.backtrack.as_ref(),
        }
    }
}

fn adam_options(settings: &TrainSettings) -> AdamOptions {
    let [beta1, beta2] = settings.betas;
    AdamOptions {
        learning_rate: settings.learning_rate,
        beta1,
        beta2,
        weight_decay: match settings.optimizer {
            OptimizerKind::Adam => 0.0,
            OptimizerKind::Adamw => settings.weight_decay,
        },
        clip_norm: settings.clip_norm,
        ..AdamOptions::default()
    }
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
