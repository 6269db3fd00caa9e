//! The four images of a scene, and arrays with a value for each image.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::{Index, IndexMut};

/// One of the four images of a scene. Arrays in code and JSON have the order of the variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Layer {
    /// I: the front scene through the pane, with the reflection.
    Input,
    /// T: the front scene through the pane, refracted but not attenuated.
    Transmission,
    /// R~: the reflection in the glass, with its ghosts.
    GlassReflection,
    /// R: the mirrored back scene, without glass and lens.
    CleanReflection,
}

impl Layer {
    /// All layers, in order.
    pub const ALL: [Self; 4] =
        [Self::Input, Self::Transmission, Self::GlassReflection, Self::CleanReflection];

    /// Names of all layers, in order.
    pub const NAMES: [&'static str; 4] = [
        Self::Input.name(),
        Self::Transmission.name(),
        Self::GlassReflection.name(),
        Self::CleanReflection.name(),
    ];

    /// Returns the name in files, keys and flags.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Transmission => "transmission",
            Self::GlassReflection => "glass_reflection",
            Self::CleanReflection => "clean_reflection",
        }
    }

    /// Returns the paper's symbol, in ASCII.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Input => "I",
            Self::Transmission => "T",
            Self::GlassReflection => "R~",
            Self::CleanReflection => "R",
        }
    }

    /// Returns the layer with that name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }
}

impl fmt::Display for Layer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// A value for each layer; in files, an array of four.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct PerLayer<T>(pub [T; 4]);

impl<T> PerLayer<T> {
    /// Makes a value for each layer by a call of `f`, in order.
    pub fn of(f: impl FnMut(Layer) -> T) -> Self {
        Self(Layer::ALL.map(f))
    }

    /// Iterates over the layers and their values, in order.
    pub fn iter(&self) -> impl Iterator<Item = (Layer, &T)> {
        Layer::ALL.into_iter().zip(&self.0)
    }
}

impl<T> Index<Layer> for PerLayer<T> {
    type Output = T;

    #[inline(always)]
    fn index(&self, layer: Layer) -> &T {
        &self.0[layer as usize]
    }
}

impl<T> IndexMut<Layer> for PerLayer<T> {
    #[inline(always)]
    fn index_mut(&mut self, layer: Layer) -> &mut T {
        &mut self.0[layer as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_and_their_names_round_trip() {
        for (place, layer) in Layer::ALL.into_iter().enumerate() {
            assert_eq!(layer as usize, place);
            assert_eq!(Layer::from_name(layer.name()), Some(layer));
            assert_eq!(Layer::NAMES[place], layer.to_string());
        }
        assert_eq!(Layer::from_name("I"), None);
    }

    #[test]
    fn values_are_an_array_in_json() {
        let symbols = PerLayer::of(Layer::symbol);
        let json = serde_json::to_string(&symbols).unwrap();
        assert_eq!(json, r#"["I","T","R~","R"]"#);
    }
}
