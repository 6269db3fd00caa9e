//! Mixtures of photographs as examples.

use super::example::{Example, Planes};
use super::random::Stream;
use crate::manifest::ExampleKind;

/// Mixes two images of one size, sRGB-coded; `None` if the recipe refuses such a pair.
pub(super) fn mix(
    _kind: ExampleKind,
    _size: [usize; 2],
    _front: &Planes,
    _back: &Planes,
    _stream: &mut Stream,
) -> Option<Example> {
    None
}
