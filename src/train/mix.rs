//! Mixtures of photographs as examples.

use super::example::{Example, Planes};
use super::inference::Picture;
use super::mixture::{MixtureError, MixtureRecipe};
use super::random::Stream;
use crate::manifest::ExampleKind;

/// Mixes two images of `[rows, columns]`, sRGB-coded; `None` if the recipe refuses such a pair.
pub(super) fn mix(
    kind: ExampleKind,
    [rows, columns]: [usize; 2],
    front: &Planes,
    back: &Planes,
    stream: &mut Stream,
) -> Result<Option<Example>, MixtureError> {
    let recipe = match kind {
        ExampleKind::Ceilnet => MixtureRecipe::Ceilnet,
        _ => MixtureRecipe::Zhang,
    };
    let picture = |planes: &Planes| Picture {
        rows,
        columns,
        planes: planes.clone(),
    };
    let mixture = recipe.mix(&picture(front), &picture(back), stream)?;
    Ok(mixture.map(|mixture| Example {
        rows,
        columns,
        input: mixture.input.planes,
        transmission: mixture.transmission.planes,
        glass_reflection: Some(mixture.reflection.planes),
        clean_reflection: Some(mixture.clean_reflection.planes),
    }))
}
