//! Checks `[glass]` of a recipe: keys that exclude each other, and ranges beyond those of single numbers.

use super::cover_check::check_edges;
use super::recipe_check::bad;
use super::recipe_error::RecipeError;
use glasshouse_line::param::{OneOf, Param};
use glasshouse_line::{GlassRecipe, KnownGlazing, MAX_WAVE_SLOPE, Wave};

/// Checks what the declarations of the keys do not know.
pub(super) fn check_glass(glass: &GlassRecipe) -> Result<(), RecipeError> {
    check_glazing(glass)?;
    check_bow(glass)?;
    check_wave(glass)?;
    if glass.wedge_deg.is_some() && glass.bow_radius_m.is_some() {
        return bad("glass.wedge_deg", "and glass.bow_radius_m are both given: remove one");
    }
    if glass.smudges.as_ref().is_some_and(|smudges| smudges.coverage.is_none()) {
        return bad(
            "glass.smudges",
            "missing field `coverage`: give the share of the pane with marks",
        );
    }
    let Some(outline) = &glass.outline else {
        return Ok(());
    };
    for (key, [low, high]) in [("x_m", &outline.x_m), ("y_m", &outline.y_m)] {
        check_edges(&format!("glass.outline.{key}"), low, high)?;
    }
    Ok(())
}

/// Refuses a glazing together with a key that it replaces.
fn check_glazing(glass: &GlassRecipe) -> Result<(), RecipeError> {
    let replaced = [
        ("thickness_m", glass.thickness_m.is_some()),
        ("ior", glass.ior.is_some()),
        ("absorption_per_m", glass.absorption_per_m.is_some()),
    ];
    match replaced.into_iter().find(|(_, is_given)| *is_given) {
        Some((key, _)) if glass.glazing.is_some() => bad(
            "glass.glazing",
            format!(
                "names the layers of the pane, and glass.{key} is given, too: remove one of them"
            ),
        ),
        _ => Ok(()),
    }
}

fn check_wave(glass: &GlassRecipe) -> Result<(), RecipeError> {
    const KEY: &str = "glass.wave";
    let Some(wave) = &glass.wave else {
        return Ok(());
    };
    if glass.bow_radius_m.is_some() {
        return bad(KEY, "and glass.bow_radius_m are both given: remove one");
    }
    if [&wave.amplitude_m, &wave.length_m].contains(&&Param::FromSource) {
        // The waves of each photograph are checked with its scene line.
        return Ok(());
    }
    let (amplitude_m, length_m) = (wave.amplitude_m.bounds().1, wave.length_m.bounds().0);
    let slope = Wave { amplitude_m, length_m, direction_deg: 0.0 }.largest_slope();
    if slope <= MAX_WAVE_SLOPE {
        return Ok(());
    }
    bad(
        KEY,
        format!(
            "can have slopes of {slope:.3}, with an amplitude of {amplitude_m} m and a length of {length_m} m, but at \
             most {MAX_WAVE_SLOPE} are allowed: reduce amplitude_m, or increase length_m"
        ),
    )
}

fn check_bow(glass: &GlassRecipe) -> Result<(), RecipeError> {
    const KEY: &str = "glass.bow_radius_m";
    let Some(radius) = &glass.bow_radius_m else {
        return Ok(());
    };
    let names = glass.glazing.as_ref().map_or(&[][..], |OneOf(names)| &names.values);
    let is_stack = |name: &&KnownGlazing| !name.glazing().is_plain();
    if let Some(name) = names.iter().find(is_stack) {
        return bad(
            KEY,
            format!(
                "bends single uncoated panes only, but glass.glazing can be {name:?}: remove {KEY}, or take this \
                 name out of glass.glazing"
            ),
        );
    }
    let (least, most) = radius.bounds();
    let can_be_0 = match radius {
        Param::Choice(choice) => choice.values.contains(&0.0),
        Param::FromSource => false,
        _ => (least..=most).contains(&0.0),
    };
    if can_be_0 {
        return bad(
            KEY,
            format!(
                "({radius}) can be 0, but must stay above or below 0: leave it out for flat panes, and list radii of \
                 both signs in a choice"
            ),
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::recipe::Recipe;
    use super::super::recipe::tests::PAPER;

    /// Parses the paper's recipe with other keys of the pane's make.
    fn error(keys: &str) -> String {
        let text = PAPER.replacen("thickness_m = 0.010\nior = 1.6", keys, 1);
        assert_ne!(text, PAPER);
        Recipe::parse(&text).expect_err(keys).to_string()
    }

    #[test]
    fn errors_say_what_to_change() {
        for (keys, message) in [
            ("glazing = \"single-5\"", "unknown glazing \"single-5\", expected one of "),
            ("glazing = \"single-5\"", "line 15"),
            ("glazing = 4", "expected a name, or { choice = [names]"),
            ("glazing = {}", "expected a name, or {"),
            ("glazing = { choise = [\"single-4\"] }", "unknown field `choise`, expected `choice`"),
            ("glazing = { choice = [] }", "choice must list one or more names"),
            (
                "glazing = { choice = [\"single-4\", \"window\"] }",
                "unknown glazing \"window\", expected one of ",
            ),
            (
                "glazing = { choice = [\"single-4\", \"single-6\"], weights = [1] }",
                "choice and weights have 2 and 1 entries",
            ),
            (
                "glazing = \"single-4\"\nthickness_m = 0.010",
                "key glass.glazing names the layers of the pane, and glass.thickness_m is given, too: remove one",
            ),
            ("glazing = \"single-4\"\nior = 1.6", "and glass.ior is given, too"),
            (
                "glazing = \"single-4\"\nabsorption_per_m = [0, 0, 0]",
                "and glass.absorption_per_m is given, too",
            ),
            ("roughness = 0.2", "key glass.roughness is 0.2, but must be 0 to 0.1"),
            ("roughness = { uniform = [0, 1] }", "(uniform 0 to 1) can be 1, but must be 0 to 0.1"),
            (
                "wave = { amplitude_m = 0.001, length_m = { uniform = [0.1, 0.4] } }",
                "key glass.wave can have slopes of 0.063, with an amplitude of 0.001 m and a length of 0.1 m",
            ),
            (
                "bow_radius_m = 8\nwave = { amplitude_m = 0.0001, length_m = 0.3 }",
                "key glass.wave and glass.bow_radius_m are both given: remove one",
            ),
            (
                "bow_radius_m = 8\nwedge_deg = [0, 0.1]",
                "key glass.wedge_deg and glass.bow_radius_m are both given: remove one",
            ),
            ("wedge_deg = [0, 6]", "glass.wedge_deg[1] is 6, but must be -5 to 5 degrees"),
            ("wave = { amplitude_m = 0.0001 }", "missing field `length_m`"),
            ("bow_radius_m = 0", "glass.bow_radius_m (0) can be 0, but must stay above or below 0"),
            ("bow_radius_m = { uniform = [-8, 8] }", "(uniform -8 to 8) can be 0, but must stay"),
            ("bow_radius_m = { choice = [-8, 0] }", "can be 0, but must stay above or below 0"),
            (
                "bow_radius_m = 8\nglazing = { choice = [\"single-4\", \"double-4-16-4\"] }",
                "key glass.bow_radius_m bends single uncoated panes only, but glass.glazing can be \"double-4-16-4\"",
            ),
            ("bow_radius_m = 8\nglazing = \"museum-ar\"", "glass.glazing can be \"museum-ar\""),
            ("smudges = { mark_m = 0.1 }", "missing field `coverage`"),
            ("smudges = { coverage = 0.1, seed = 4 }", "unknown field `seed`"),
            (
                "smudges = { coverage = { uniform = [0, 2] } }",
                "glass.smudges.coverage (uniform 0 to 2) can be 2, but must be 0 to 1",
            ),
            ("smudges = { coverage = 0.1, mark_m = 0 }", "key glass.smudges.mark_m is 0, but must"),
            ("outline = { x_m = [0, 1] }", "missing field `y_m`"),
            ("outline = { x_m = [0, 1], y_m = [0, 1], frame = 1 }", "unknown field `frame`"),
            (
                "outline = { x_m = [0.1, 0.1], y_m = [0, 1] }",
                "key glass.outline.x_m can begin at 0.1 and end at 0.1, but must begin before it ends",
            ),
            (
                "outline = { x_m = [0, 1], y_m = [{ uniform = [-1, 0.3] }, { uniform = [0.2, 1] }] }",
                "key glass.outline.y_m can begin at 0.3 and end at 0.2",
            ),
            (
                "outline = { x_m = [0, 1], y_m = [0, 1], frame_m = -1 }",
                "glass.outline.frame_m is -1, but must be finite and at least 0",
            ),
            (
                "outline = { x_m = [0, 1], y_m = [0, 1], frame_radiance = [0, -1, 0] }",
                "glass.outline.frame_radiance[1] is -1",
            ),
        ] {
            let error = error(keys);
            assert!(error.contains(message), "{keys}: {error}");
        }
    }

    #[test]
    fn panes_that_can_be_bent_are_accepted() {
        for keys in [
            "bow_radius_m = { choice = [-8, 8] }\nglazing = { choice = [\"single-4\", \"single-6\"] }",
            "bow_radius_m = { uniform = [-9, -3] }",
            "bow_radius_m = \"from_source\"",
        ] {
            Recipe::parse(&PAPER.replacen("thickness_m = 0.010\nior = 1.6", keys, 1)).unwrap();
        }
    }
}
