//! Adam (Kingma and Ba, ICLR 2015) and AdamW, with clipping and a running mean of the weights. The moments can be saved in
//! checkpoints; those of candle's AdamW are private.

use candle_core::backprop::GradStore;
use candle_core::{Result, Tensor, Var};

/// Number of values that are summed at a time. It fixes the order of sums.
const AT_ONCE: usize = 1 << 12;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamOptions {
    pub learning_rate: f64,
    /// Decay rate of the running mean of gradients.
    pub beta1: f64,
    /// Decay rate of the running mean of squared gradients.
    pub beta2: f64,
    /// Constant added to the root of the mean square.
    pub epsilon: f64,
    /// Share of each weight, times the learning rate, that a step removes (Loshchilov and Hutter, ICLR 2019).
    pub weight_decay: f64,
    /// Largest norm of all gradients together; 0 for no limit.
    pub clip_norm: f64,
}

impl Default for AdamOptions {
    fn default() -> Self {
        Self {
            learning_rate: 1e-4,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            weight_decay: 0.0,
            clip_norm: 0.0,
        }
    }
}

/// A named variable with its moments.
pub struct Moments {
    /// Name, unique within the optimiser.
    pub name: String,
    pub variable: Var,
    /// Running mean of the gradients.
    pub mean: Tensor,
    /// Running mean of the squared gradients.
    pub square: Tensor,
}

pub struct Adam {
    pub options: AdamOptions,
    pub steps: u64,
    /// Variables in a fixed order.
    pub moments: Vec<Moments>,
}

/// Factors of one step, in the precision of the weights.
struct Factors {
    beta: [f32; 2],
    rest: [f32; 2],
    /// Inverse of the correction of the mean square.
    of_square: f32,
    epsilon: f32,
    rate: f32,
    kept: f32,
    clip: f32,
}

impl Adam {
    /// Creates an optimiser with moments of 0.
    pub fn new(variables: Vec<(String, Var)>, options: AdamOptions) -> Result<Self> {
        let moments = variables
            .into_iter()
            .map(|(name, variable)| {
                Ok(Moments {
                    mean: variable.zeros_like()?,
                    square: variable.zeros_like()?,
                    name,
                    variable,
                })
            })
            .collect::<Result<_>>()?;
        Ok(Self { options, steps: 0, moments })
    }

    /// Takes one step as in PyTorch. Variables without a gradient do not change.
    pub fn step(&mut self, gradients: &GradStore) -> Result<()> {
        let AdamOptions { learning_rate, beta1, beta2, epsilon, weight_decay, clip_norm } =
            self.options;
        let found: Vec<Option<Vec<f32>>> = self
            .moments
            .iter()
            .map(|moments| gradients.get(&moments.variable).map(numbers).transpose())
            .collect::<Result<_>>()?;
        let mut clip = 1.0;
        if clip_norm > 0.0 {
            // As in PyTorch: the small constant avoids a division by 0.
            clip = (clip_norm / (norm(found.iter().flatten()) + 1e-6)).min(1.0);
        }
        self.steps += 1;
        let steps = self.steps as f64;
        let (of_mean, of_square) = (1.0 - libm::pow(beta1, steps), 1.0 - libm::pow(beta2, steps));
        let factors = Factors {
            beta: [beta1, beta2].map(|beta| beta as f32),
            rest: [beta1, beta2].map(|beta| (1.0 - beta) as f32),
            of_square: (1.0 / of_square) as f32,
            epsilon: epsilon as f32,
            rate: (learning_rate / of_mean) as f32,
            kept: (1.0 - learning_rate * weight_decay) as f32,
            clip: clip as f32,
        };
        for (moments, gradient) in self.moments.iter_mut().zip(found) {
            if let Some(gradient) = gradient {
                moments.step(&gradient, &factors)?;
            }
        }
        Ok(())
    }
}

impl Moments {
    fn step(&mut self, gradient: &[f32], factors: &Factors) -> Result<()> {
        let mut weights = numbers(self.variable.as_tensor())?;
        let (mut mean, mut square) = (numbers(&self.mean)?, numbers(&self.square)?);
        let [beta1, beta2] = factors.beta;
        let [rest1, rest2] = factors.rest;
        let moments = mean.iter_mut().zip(&mut square);
        for ((weight, (mean, square)), gradient) in weights.iter_mut().zip(moments).zip(gradient) {
            let gradient = gradient * factors.clip;
            *mean = *mean * beta1 + gradient * rest1;
            *square = *square * beta2 + gradient * gradient * rest2;
            let deviation = (*square * factors.of_square).sqrt() + factors.epsilon;
            *weight = *weight * factors.kept - *mean * factors.rate / deviation;
        }
        let tensor = |values: Vec<f32>| {
            Tensor::from_vec(values, self.variable.shape(), self.variable.device())
        };
        self.variable.set(&tensor(weights)?)?;
        (self.mean, self.square) = (tensor(mean)?, tensor(square)?);
        Ok(())
    }
}

/// Returns all values of a tensor.
fn numbers(tensor: &Tensor) -> Result<Vec<f32>> {
    tensor.flatten_all()?.to_vec1()
}

/// Computes the Euclidean norm of all values together, in a fixed order.
fn norm<'a>(tensors: impl Iterator<Item = &'a Vec<f32>>) -> f64 {
    let squares =
        |values: &[f32]| values.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>();
    tensors.flat_map(|values| values.chunks(AT_ONCE)).map(squares).sum::<f64>().sqrt()
}

/// Running means of weights, which scatter less than the weights themselves.
pub struct Averages {
    /// Largest decay of a step.
    decay: f64,
    /// Means in the order of the optimiser's variables.
    means: Vec<Tensor>,
}

impl Averages {
    /// Begins with the current weights.
    pub fn new(moments: &[Moments], decay: f64) -> Result<Self> {
        let means = moments.iter().map(|m| m.variable.as_tensor().copy());
        Ok(Self { decay, means: means.collect::<Result<_>>()? })
    }

    /// Moves the means towards the weights after the optimiser's step `steps`, by 1 - min(decay, steps / (steps + 20)).
    /// The first means would otherwise keep the initial weights for too long.
    pub fn step(&mut self, moments: &[Moments], steps: u64) -> Result<()> {
        let steps = steps as f64;
        let share = (1.0 - self.decay.min(steps / (steps + 20.0))) as f32;
        for (mean, moments) in self.means.iter_mut().zip(moments) {
            let mut values = numbers(mean)?;
            for (mean, weight) in values.iter_mut().zip(numbers(moments.variable.as_tensor())?) {
                *mean += share * (weight - *mean);
            }
            *mean = Tensor::from_vec(values, mean.shape(), mean.device())?;
        }
        Ok(())
    }

    pub fn means(&self) -> &[Tensor] {
        &self.means
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

    const EXPECTED: [(usize, [f32; 6]); 3] = [
        (1, [0.88, -1.86, 0.59, 0.885714, -1.86667, 0.585714]),
        (2, [0.762439, -1.72272, 0.677911, 0.773646, -1.73581, 0.66953]),
        (30, [0.0653805, 0.312381, 2.65832, 0.0363829, 0.308909, 2.57507]),
    ];

    /// Takes steps on the loss sum(c w^2 / 2) and returns the weights and their means after each.
    fn steps(options: AdamOptions, decay: f64, count: u64) -> Vec<[Vec<f32>; 2]> {
        let scale = Tensor::new(&[3.0f32, 0.5, -1.0], &Device::Cpu).unwrap();
        let weight = Var::new(&[1.0f32, -2.0, 0.5], &Device::Cpu).unwrap();
        let mut adam = Adam::new(vec![("w".to_owned(), weight.clone())], options).unwrap();
        let mut averages = Averages::new(&adam.moments, decay).unwrap();
        let of = |tensor: &Tensor| tensor.to_vec1::<f32>().unwrap();
        (0..count)
            .map(|_| {
                let loss = (weight.sqr().unwrap() * &scale).unwrap().sum_all().unwrap();
                adam.step(&(loss * 0.5).unwrap().backward().unwrap()).unwrap();
                averages.step(&adam.moments, adam.steps).unwrap();
                [of(&weight), of(&averages.means()[0])]
            })
            .collect()
    }

    #[test]
    fn steps_equal_those_of_pytorch() {
        // Printed by tests/train/adamw.py: weights and means after steps 1, 2 and 30.
        let options = AdamOptions {
            learning_rate: 0.1,
            beta2: 0.99,
            weight_decay: 0.2,
            clip_norm: 1.0,
            ..AdamOptions::default()
        };
        let found = steps(options, 0.8, 30);
        for (step, expected) in EXPECTED {
            for (found, expected) in found[step - 1].iter().flatten().zip(expected) {
                assert!((found - expected).abs() < 1e-5, "step {step}: {found} {expected}");
            }
        }
    }

    #[test]
    fn adam_equals_the_same_candle_operations() {
        let found = steps(AdamOptions { learning_rate: 0.1, ..AdamOptions::default() }, 0.5, 5);
        let scale = Tensor::new(&[3.0f32, 0.5, -1.0], &Device::Cpu).unwrap();
        let mut weight = Tensor::new(&[1.0f32, -2.0, 0.5], &Device::Cpu).unwrap();
        let (mut mean, mut square) = (weight.zeros_like().unwrap(), weight.zeros_like().unwrap());
        for (step, [found, _]) in (1..).zip(found) {
            let gradient = (&weight * &scale).unwrap();
            let correction = |beta: f64| 1.0 - libm::pow(beta, f64::from(step));
            let add = |a: Tensor, b: Tensor| (a + b).unwrap();
            mean = add((&mean * 0.9).unwrap(), (&gradient * (1.0 - 0.9)).unwrap());
            let squared = gradient.sqr().unwrap();
            square = add((&square * 0.999).unwrap(), (squared * (1.0 - 0.999)).unwrap());
            let root = (&square / correction(0.999)).unwrap().sqrt().unwrap();
            let change =
                ((&mean * (0.1 / correction(0.9))).unwrap() / (root + 1e-8).unwrap()).unwrap();
            weight = (weight - change).unwrap();
            assert_eq!(weight.to_vec1::<f32>().unwrap(), found);
        }
    }
}
