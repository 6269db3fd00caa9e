//! Adam (Kingma and Ba, ICLR 2015). Its moments can be saved in checkpoints; those of candle's AdamW are private.

use candle_core::backprop::GradStore;
use candle_core::{Result, Tensor, Var};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamOptions {
    pub learning_rate: f64,
    /// Decay rate of the running mean of gradients.
    pub beta1: f64,
    /// Decay rate of the running mean of squared gradients.
    pub beta2: f64,
    /// Constant added to the root of the mean square.
    pub epsilon: f64,
}

impl Default for AdamOptions {
    fn default() -> Self {
        Self { learning_rate: 1e-4, beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
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
        self.steps += 1;
        let AdamOptions { learning_rate, beta1, beta2, epsilon } = self.options;
        let steps = self.steps as f64;
        let (of_mean, of_square) = (1.0 - libm::pow(beta1, steps), 1.0 - libm::pow(beta2, steps));
        for moments in &mut self.moments {
            let Some(gradient) = gradients.get(&moments.variable) else {
                continue;
            };
            // Without detaching, the graph of all steps would stay in memory.
            moments.mean = ((&moments.mean * beta1)? + (gradient * (1.0 - beta1))?)?.detach();
            moments.square =
                ((&moments.square * beta2)? + (gradient.sqr()? * (1.0 - beta2))?)?.detach();
            let deviation = ((&moments.square / of_square)?.sqrt()? + epsilon)?;
            let change = ((&moments.mean * (learning_rate / of_mean))? / deviation)?;
            moments.variable.set(&(moments.variable.as_tensor() - change)?)?;
        }
        Ok(())
    }
}
