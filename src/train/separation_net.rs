//! The network that separates an image: the paper's SP-net, or a U-Net for T* alone. Its output may be bounded.

use super::generator::{self, Generator, GeneratorOptions, Norms};
use super::ops::{bounded, brightened};
use super::tiles::Tiling;
use super::unet::{self, Unet};
use candle_core::{Result, Tensor, Var};
use plan::{NetworkKind, TrainSettings};

pub struct SeparationNet {
    net: Net,
    /// Largest light of T* as a multiple of the light of I; 0 for no bound.
    bound: f64,
}

enum Net {
    Generator(Generator),
    Unet(Unet),
}

/// Outputs of a network, each (batch, 3, rows, columns).
pub struct Separated {
    /// T*.
    pub transmission: Tensor,
    /// R~*; `None` from a network with T* alone.
    pub glass_reflection: Option<Tensor>,
}

impl SeparationNet {
    /// Creates the network of the settings. `generator` has the options of SP-net.
    pub(super) fn new(settings: &TrainSettings, generator: &GeneratorOptions) -> Result<Self> {
        const NAME: &str = "separation";
        let net = match settings.network {
            NetworkKind::Generator => {
                Net::Generator(Generator::new(generator, settings.seed, NAME)?)
            }
            NetworkKind::Unet => Net::Unet(Unet::new(settings.width, settings.seed, NAME)?),
        };
        Ok(Self { net, bound: settings.bound })
    }

    /// Wraps an SP-net without a bound.
    pub fn of_generator(generator: Generator) -> Self {
        Self { net: Net::Generator(generator), bound: 0.0 }
    }

    /// True if the network has T* alone.
    pub fn has_transmission_alone(&self) -> bool {
        matches!(self.net, Net::Unet(_))
    }

    /// Returns tiles for the network.
    pub(super) fn tiling(&self, tile_px: usize) -> Tiling {
        match self.net {
            Net::Generator(_) => Tiling { tile_px, reach_px: generator::REACH_PX, period_px: 1 },
            Net::Unet(_) => Tiling { tile_px, reach_px: unet::REACH_PX, period_px: unet::MULTIPLE },
        }
    }

    /// True if the network normalises by statistics of the image.
    pub(super) fn has_norms(&self) -> bool {
        matches!(self.net, Net::Generator(_))
    }

    /// Returns all trainable variables by name, in a fixed order.
    pub fn variables(&self) -> Vec<(String, Var)> {
        match &self.net {
            Net::Generator(generator) => generator.variables(),
            Net::Unet(unet) => unet.variables(),
        }
    }

    /// True if the features of images are inputs of the network.
    pub(super) fn needs_features(&self) -> bool {
        matches!(self.net, Net::Generator(_))
    }

    /// Computes the outputs, not clamped, from sRGB-coded images and their features, finest first; a
    /// U-Net needs none.
    pub fn forward(&self, images: &Tensor, features: &[Tensor]) -> Result<Separated> {
        self.split(
            images,
            &match &self.net {
                Net::Generator(generator) => generator.forward(images, features)?,
                Net::Unet(unet) => unet.forward(images)?,
            },
        )
    }

    /// Computes the outputs with detached weights, which receive no gradients.
    pub fn forward_frozen(
        &self,
        images: &Tensor,
        features: &[Tensor],
        norms: &mut Norms,
    ) -> Result<Separated> {
        self.split(
            images,
            &match &self.net {
                Net::Generator(generator) => generator.forward_frozen(images, features, norms)?,
                Net::Unet(unet) => unet.forward_frozen(images)?,
            },
        )
    }

    fn split(&self, images: &Tensor, made: &Tensor) -> Result<Separated> {
        let mut transmission = made.narrow(1, 0, 3)?.contiguous()?;
        if self.bound > 0.0 {
            transmission = bounded(&transmission, &brightened(images, self.bound)?)?;
        }
        let glass_reflection = match self.net {
            Net::Generator(_) => Some(made.narrow(1, 3, 3)?.contiguous()?),
            Net::Unet(_) => None,
        };
        Ok(Separated { transmission, glass_reflection })
    }
}
