//! `[glass]` of a recipe: the words that stand for several keys of the pane, and draws in which a feature is off.

use super::draw::{Draw, Drawing};
use glasshouse_line::keys::{At, Drawn};
use glasshouse_line::param::OneOf;
use glasshouse_line::{Glass, GlassLayer, GlassRecipe, Smudges};

/// Thickness, m, and index of refraction of a pane for which a recipe gives neither: the paper's.
pub(super) const PAPER: (f64, f64) = (0.010, 1.6);

/// Draws the pane of a line.
pub(super) fn draw_glass(recipe: &GlassRecipe, draw: Draw<'_>) -> Glass {
    let at = At::section("glass");
    let mut glass = Glass::draw(recipe, &at, &draw);
    let given = glass.roughness.take();
    if let Some(OneOf(names)) = &recipe.glazing {
        let glazing = draw.pick("glass.glazing", names).glazing();
        glass.set_stack(&glazing.layers);
        glass.coatings.clone_from(&glazing.coatings);
        glass.roughness.clone_from(&glazing.roughness);
    } else {
        glass.thickness_m.get_or_insert(PAPER.0);
        glass.ior.get_or_insert(PAPER.1);
        glass.absorption_per_m.get_or_insert([0.0; 3]);
    }
    if let Some(wedge_deg) = Drawn::draw(&recipe.wedge_deg, &At::section("glass.wedge_deg"), &draw)
    {
        set_wedge(&mut glass, wedge_deg);
    }
    // A distribution that reaches 0 turns a feature off in some scenes.
    if given.is_some() {
        glass.roughness = given.filter(|roughness| roughness.largest() > 0.0);
    }
    glass.wave = glass.wave.filter(|wave| wave.amplitude_m > 0.0);
    glass.smudges = glass.smudges.filter(|smudges| smudges.coverage > Some(0.0)).map(|smudges| {
        // 32 bits stay exact in readers that hold numbers as f64.
        let seed = (draw.unit("glass.smudges.seed") * f64::from(u32::MAX)) as u64;
        Smudges { seed: Some(seed), ..smudges }
    });
    glass
}

/// Turns the faces behind the first gap of a pane, or behind its glass.
fn set_wedge(glass: &mut Glass, wedge_deg: [f64; 2]) {
    let mut layers = glass.stack();
    let gap = layers.iter().position(|layer| matches!(layer, GlassLayer::Gap { .. }));
    let last = layers.len() - 1;
    layers[gap.unwrap_or(last)].set_wedge_deg(wedge_deg);
    glass.set_stack(&layers);
}
