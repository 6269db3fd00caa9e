//! Expands a recipe and its photographs into scene lines.

use super::assign::{AssignedScene, Assignment, Drawn, spread};
use super::cover_draw::SceneCover;
use super::diode::SourceImage;
use super::draw::{Draw, scene_seed};
use super::glass::draw_glass;
use super::light::{WhiteBalance, gains_against};
use super::pair::Pair;
use super::recipe::Recipe;
use super::recipe_error::{RecipeError, RefusedDraw};
use super::sections::{camera, film, illuminants_k, light, side};
use super::source::Layout;
use super::source_values::source_values;
use glasshouse_line::keys::Number;
use glasshouse_line::param::OneOf;
use glasshouse_line::{Apex, Focus, SCENE_SCHEMA, SceneLine, Side};
use render::scene::check_geometry;
use std::collections::{BTreeMap, BTreeSet};

/// Number of successive failed draws of a scene after which expansion fails; 1 if all geometry parameters are constant.
const MAX_ATTEMPTS: u32 = 100;

/// The scene lines of a recipe, with counts for notes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Expansion {
    /// Lines in the order of the recipe's splits, then of the keys of `pairs`.
    pub lines: Vec<SceneLine>,
    /// Number of scenes with two indoor or two outdoor photographs of one source, for lack of others.
    pub same_place: u32,
    /// Number of scenes with two photographs of one scan, for lack of others.
    pub same_scan: u32,
    /// Number of draws that failed the geometry check.
    pub redrawn: u32,
}

impl Expansion {
    pub(super) fn add(&mut self, drawn: Drawn, redrawn: u32) {
        self.same_place += u32::from(drawn.same_place);
        self.same_scan += u32::from(drawn.same_scan);
        self.redrawn += redrawn;
        self.lines.push(drawn.line);
    }
}

/// Calls [`expand_counted`] without exclusions and returns only the lines.
#[cfg(test)]
pub(crate) fn expand(
    recipe: &Recipe,
    sources: &BTreeMap<String, Vec<SourceImage>>,
) -> Result<Vec<SceneLine>, RecipeError> {
    expand_counted(recipe, sources, &BTreeSet::new(), None).map(|expansion| expansion.lines)
}

/// Draws all scenes of `recipe` from the photographs of its `sources`, without those named in `excluded`
/// (`SOURCE:PATH` of the colour image). Excluding a photograph changes only the scenes that use it. With `only`, draws so
/// many of them.
pub(crate) fn expand_counted(
    recipe: &Recipe,
    sources: &BTreeMap<String, Vec<SourceImage>>,
    excluded: &BTreeSet<String>,
    only: Option<usize>,
) -> Result<Expansion, RecipeError> {
    let assignment = Assignment::new(recipe, sources, excluded)?;
    let mut expansion = Expansion::default();
    for number in spread(assignment.len(), only) {
        let drawn = assignment.draw(number, 0, 0)?;
        let redrawn = drawn.attempt;
        expansion.add(drawn, redrawn);
    }
    Ok(expansion)
}

/// Draws a scene, starting with attempt `from`. Returns the line and the number of the first attempt that passes the
/// geometry check.
pub(super) fn draw_line(
    recipe: &Recipe,
    scene: &AssignedScene<'_>,
    pair: Pair<'_>,
    from: u32,
) -> Result<(SceneLine, u32), RecipeError> {
    let id = &scene.id;
    let [front_source, back_source] = scene.sources.map(|name| (name, &recipe.sources[name]));
    let dataset_seed = recipe.seed;
    let mut front = side(front_source, pair.front);
    let mut back = side(back_source, pair.back);
    let plain = Draw { dataset_seed, scene: id.as_str(), attempt: from, values: &BTreeMap::new() };
    let values = source_values(recipe, id, pair, &front, &film(recipe, plain))?;
    let draw_of = |attempt| Draw { attempt, values: &values, ..plain };
    let first = draw_of(from);
    let [front_k, back_k] = illuminants_k(recipe, first);
    let back_light = light("back", recipe.back.light(), back_k, first, &mut back);
    let front_light = light("front", recipe.front.light(), front_k, first, &mut front);
    if recipe.back.apex != Apex::default() {
        back.set_apex(recipe.back.apex);
    }
    for (name, source, side) in
        [("front", front_source.1, &mut front), ("back", back_source.1, &mut back)]
    {
        if let (Layout::Folder, Side::Photograph(photograph)) = (source.layout, side) {
            let shape = source.depth.clone().unwrap_or_default();
            photograph.sketch = Some(shape.draw(name, first));
        }
    }
    let mut line = SceneLine {
        schema: SCENE_SCHEMA.to_owned(),
        id: id.clone(),
        split: scene.split,
        seed: scene_seed(dataset_seed, id.as_str()),
        film: film(recipe, first),
        camera: camera(recipe, first),
        glass: draw_glass(&recipe.glass, first),
        front,
        back,
        sensor: recipe.sensor.as_ref().map(|sensor| sensor.draw(first)),
    };
    let cover = recipe.cover.as_ref().map(|recipe| SceneCover {
        recipe,
        first,
        light: [front_light, back_light],
        own_cards: [line.front.cards().len(), line.back.cards().len()],
    });
    let deciding = deciding_numbers(recipe);
    let names = recipe.glass.glazing.as_ref().map(|OneOf(names)| names);
    let is_constant = deciding.iter().all(|number| number.param.is_constant())
        && names.is_none_or(|names| names.values.len() == 1)
        && recipe.cover.is_none();
    let attempts = if is_constant { 1 } else { MAX_ATTEMPTS };
    let white_balance = match recipe.light.white_balance {
        WhiteBalance::Front => gains_against(line.front.illuminant()),
        WhiteBalance::Back => gains_against(line.back.illuminant()),
        // The mean colour is only known after a preview.
        WhiteBalance::None | WhiteBalance::GreyWorld => [1.0; 3],
    };
    let mut last_error = None;
    for attempt in from..from + attempts {
        line.camera = camera(recipe, draw_of(attempt));
        line.camera.white_balance = white_balance;
        line.glass = draw_glass(&recipe.glass, draw_of(attempt));
        if let Some(Err(misfit)) =
            cover.as_ref().map(|cover| cover.draw(draw_of(attempt), &mut line))
        {
            last_error = Some(RefusedDraw::from(misfit));
            continue;
        }
        line.validate().map_err(|source| RecipeError::Line { id: id.clone(), source })?;
        // The distance of a focus on a photograph is known only after loading, which checks the geometry again.
        let inverse_focus_distance_per_m = match line.camera.focus {
            Focus::Distance { distance_m } => 1.0 / distance_m,
            Focus::At { .. } => 0.0,
        };
        match check_geometry(&line, inverse_focus_distance_per_m) {
            Ok(()) => return Ok((line, attempt)),
            Err(reason) => last_error = Some(reason.into()),
        }
    }
    Err(RecipeError::Refused {
        id: id.clone(),
        attempts,
        ranges: deciding
            .iter()
            .map(|Number { path, param, .. }| format!("{path} ({param})"))
            .chain(names.map(|names| format!("glass.glazing ({names})")))
            .collect::<Vec<_>>()
            .join(", "),
        source: Box::new(last_error.expect("there was at least one attempt")),
    })
}

/// Returns the numbers that decide whether pane, lens and film fit together.
fn deciding_numbers(recipe: &Recipe) -> Vec<Number<'_>> {
    let has_f_number = recipe.camera.f_number.is_some();
    let decides = |number: &Number<'_>| {
        number.decides && !(has_f_number && number.path == "camera.aperture_radius_m")
    };
    recipe.numbers().into_iter().filter(decides).collect()
}

#[cfg(test)]
mod tests {
    use super::super::recipe::SplitRecipe;
    use super::super::recipe::tests::PAPER;
    use super::super::split::tests::set;
    use super::*;
    use glasshouse_line::{Side, Split, parse_jsonl, to_jsonl};
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn two_sources(indoors: usize, outdoor: usize) -> BTreeMap<String, Vec<SourceImage>> {
        ["diode", "places"].map(|name| (name.to_owned(), set(indoors, outdoor))).into()
    }

    fn recipe(glass: &str, train: u32, test: u32) -> Recipe {
        let text = PAPER
            .replace("ior = 1.6", glass)
            .replace("diode = 3000, places = 2000", &format!("diode = {train}"))
            .replace("diode = 120, places = 80", &format!("diode = {test}"));
        Recipe::parse(&text).unwrap()
    }

    fn colors(lines: &[SceneLine], split: Split) -> BTreeSet<&str> {
        lines
            .iter()
            .filter(|line| line.split == split)
            .flat_map(|line| [line.front.name(), line.back.name()])
            .collect()
    }

    #[test]
    fn a_share_of_the_backs_has_the_illuminant_of_the_front() {
        let range = "{ uniform = [2500, 9000] }";
        let text = |share: &str| {
            let light = format!(
                "[front]\nilluminant_k = {range}\n[back]\nilluminant_k = {range}\n{share}\n[sources.diode]"
            );
            PAPER
                .replace("diode = 3000, places = 2000", "diode = 400")
                .replace("diode = 120, places = 80", "diode = 40")
                .replacen("[sources.diode]", &light, 1)
        };
        let lines = |share| {
            let recipe = Recipe::parse(&text(share)).unwrap();
            expand(&recipe, &two_sources(90, 90)).unwrap()
        };
        let (apart, shared) = (lines(""), lines("front_illuminant_share = 0.25"));
        let mut count = 0;
        for (a, b) in apart.iter().zip(&shared) {
            assert_eq!(a.front, b.front);
            if b.back.illuminant() == b.front.illuminant() {
                count += 1;
            } else {
                assert_eq!(a.back, b.back);
            }
        }
        // Four standard deviations around 110.
        assert!((74..=146).contains(&count), "{count}");
        for (share, reason) in [
            ("front_illuminant_share = 0", "must be above 0"),
            ("front_illuminant_share = 1.5", "is 1.5"),
        ] {
            let error = Recipe::parse(&text(share)).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
        let bare = PAPER.replacen(
            "[sources.diode]",
            "[back]\nfront_illuminant_share = 0.5\n[sources.diode]",
            1,
        );
        let error = Recipe::parse(&bare).unwrap_err().to_string();
        assert!(error.contains("does nothing"), "{error}");
    }

    #[test]
    fn a_few_photographs_suffice_for_the_5200_scenes_of_the_paper() {
        let lines = expand(&Recipe::parse(PAPER).unwrap(), &two_sources(12, 12)).unwrap();
        assert_eq!(lines.len(), 5200);
        assert_eq!(lines[0].id.as_str(), "train-diode-000000");
        assert_eq!(lines[5199].id.as_str(), "test-places-000079");
        assert!(lines[0].front.name().starts_with("diode:"));
        assert!(lines[4999].front.name().starts_with("places:"));
        assert!(colors(&lines, Split::Train).is_disjoint(&colors(&lines, Split::Test)));
        let text = to_jsonl(&lines);
        assert_eq!(parse_jsonl(&text).unwrap(), lines);
    }

    #[test]
    fn lines_are_pinned() {
        let sources = two_sources(4, 4);
        let lines = expand(&recipe("ior = { uniform = [1.3, 1.7] }", 2, 2), &sources).unwrap();
        // New values here mean that every recipe yields another manifest.
        let digest = blake3::hash(to_jsonl(&lines).as_bytes()).to_hex();
        assert_eq!(
            (lines[0].seed, lines[0].glass.ior, &digest[..16]),
            (2_673_717_074_845_612, Some(1.60614171), "d05b8d469912d095")
        );
    }

    #[test]
    fn drawn_light_multiplies_the_light_of_a_list() {
        let listed = |n: usize| {
            let place = if n.is_multiple_of(2) { "indoors" } else { "outdoor" };
            format!(
                r#"{{"schema":"glasshouse.photograph/1","place":"{place}","panorama":"{n}.exr","exposure":3,
                "transfer":"linear","yaw_deg":{n}}}"#
            )
            .replace('\n', "")
        };
        let text: Vec<String> = (0..4).map(listed).collect();
        let images = super::super::list::parse_list(&text.join("\n")).unwrap();
        let sources = [("diode".to_owned(), images)].into();
        let head = PAPER.split("[sources.diode]").next().unwrap();
        let text = format!(
            "{head}[front]\nexposure = 0.5\n[back]\napex = \"camera\"\n[sources.diode]\nlayout = \"list\"\n\
             list = \"l\"\n[[split]]\nname = \"train\"\npairs = {{ diode = 6 }}\n"
        );
        let lines = expand(&Recipe::parse(&text).unwrap(), &sources).unwrap();
        for line in &lines {
            let (Side::Panorama(front), Side::Panorama(back)) = (&line.front, &line.back) else {
                panic!("{line:?}")
            };
            assert_eq!((front.exposure, back.exposure), (1.5, 3.0));
            assert_eq!((front.apex, back.apex), (None, Some(Apex::Camera)));
            assert_eq!(front.panorama, format!("diode:{}.exr", front.yaw_deg));
        }
    }

    #[test]
    fn a_new_distribution_changes_only_its_own_parameter() {
        let sources = two_sources(6, 6);
        let plain = expand(&recipe("ior = { uniform = [1.3, 1.7] }", 20, 4), &sources).unwrap();
        let mut more = expand(
            &recipe(
                "ior = { uniform = [1.3, 1.7] }\nabsorption_per_m = [{ uniform = [0, 9] }, 0, 0]",
                20,
                4,
            ),
            &sources,
        )
        .unwrap();
        assert_ne!(plain, more);
        for line in &mut more {
            line.glass.absorption_per_m = Some([0.0; 3]);
        }
        assert_eq!(plain, more);
    }

    #[test]
    fn draws_that_fail_the_geometry_check_are_repeated() {
        let sources = two_sources(6, 6);
        let steep = recipe("tilt_deg = [0, { uniform = [0, 89] }]", 60, 4);
        let expansion = expand_counted(&steep, &sources, &BTreeSet::new(), None).unwrap();
        assert!(expansion.redrawn > 0);
        for line in &expansion.lines {
            check_geometry(line, 0.0).unwrap();
        }

        let hopeless = recipe("tilt_deg = [0, { uniform = [85, 89] }]", 4, 4);
        let error = expand(&hopeless, &sources).unwrap_err().to_string();
        assert!(error.contains("all 100 draws of"), "{error}");
        assert!(error.contains("glass.tilt_deg[1] (uniform 85 to 89)"), "{error}");

        let named = "tilt_deg = [0, 86]\nroughness = { choice = [0, 0.1], weights = [1, 9] }";
        let error = expand(&recipe(named, 4, 4), &sources).unwrap_err().to_string();
        let range = "glass.roughness (choice of [0.0, 0.1] with weights [1.0, 9.0])";
        assert!(error.contains("all 100 draws of") && error.contains(range), "{error}");

        let constant = recipe("tilt_deg = [0, 88]", 4, 4);
        let error = expand(&constant, &sources).unwrap_err().to_string();
        assert!(error.contains("scene train-diode-000000: all 1 draws of"), "{error}");
    }

    #[test]
    fn errors_name_sources_without_enough_photographs() {
        let none = BTreeMap::new();
        let error = expand(&recipe("", 4, 4), &none).unwrap_err().to_string();
        assert!(error.starts_with("source diode has not been indexed"), "{error}");
        let error = expand(&recipe("", 4, 4), &two_sources(1, 2)).unwrap_err().to_string();
        assert!(error.contains("has 3 photographs"), "{error}");
    }

    #[test]
    fn parameters_can_come_from_the_photographs() {
        let recipe = recipe("ior = \"from_source\"", 12, 4);
        let mut sources = two_sources(6, 6);
        let error = expand(&recipe, &sources).unwrap_err().to_string();
        assert!(
            error.contains("glass.ior is from_source, but") && error.contains("has no value"),
            "{error}"
        );
        for (number, image) in sources.get_mut("diode").unwrap().iter_mut().enumerate() {
            let values = [("glass.ior", 1.3 + 0.01 * number as f64), ("back.exposure", 2.0)];
            image.values = values.map(|(name, value)| (name.to_owned(), value)).into();
        }
        let images = sources["diode"].clone();
        for line in expand(&recipe, &sources).unwrap() {
            let image = images.iter().find(|i| line.front.name().ends_with(&i.color));
            assert_eq!(line.glass.ior, Some(image.unwrap().values["glass.ior"]));
            assert_eq!(line.back.exposure(), 1.0);
        }

        // DIODE's camera has a field of view of 60 by 45 degrees. A square film has the smaller angle.
        let own = PAPER.replace("focal_length_mm = 55.0", "focal_length_mm = \"from_source\"");
        let line = &expand(&Recipe::parse(&own).unwrap(), &sources).unwrap()[0];
        let tan = 36f64.hypot(24.0) / 2.0 / line.camera.focal_length_mm / 2f64.sqrt();
        assert!((tan - 384.0 / 927.06).abs() < 1e-8, "{tan}");
        let wide =
            own.replace("width = 256", "width = 1024").replace("height = 256", "height = 384");
        let line = &expand(&Recipe::parse(&wide).unwrap(), &sources).unwrap()[0];
        let tan =
            36f64.hypot(24.0) / 2.0 / line.camera.focal_length_mm * 1024.0 / 1024f64.hypot(384.0);
        assert!((tan - 512.0 / 886.81).abs() < 1e-8, "{tan}");
    }

    #[test]
    fn front_and_back_can_come_from_two_sources() {
        let text = PAPER
            .replace("diode = 3000, places = 2000", "\"diode/places\" = 30, places = 5")
            .replace("diode = 120, places = 80", "\"places/diode\" = 6");
        let sources = two_sources(12, 9);
        let lines = expand(&Recipe::parse(&text).unwrap(), &sources).unwrap();
        assert_eq!(lines.len(), 41);
        assert_eq!(lines[0].id.as_str(), "train-diode-places-000000");
        let has = |name: &str, source: &str| name.starts_with(&format!("{source}:"));
        for line in &lines[..30] {
            assert!(has(line.front.name(), "diode") && has(line.back.name(), "places"));
        }
        assert!(has(lines[40].front.name(), "places") && has(lines[40].back.name(), "diode"));
        assert!(colors(&lines, Split::Train).is_disjoint(&colors(&lines, Split::Test)));

        let twice = text.replace("places = 5", "places = 5, \"diode-places\" = 2").replace(
            "[sources.places]",
            "[sources.diode-places]\nlayout = \"diode\"\n[sources.places]",
        );
        let error = Recipe::parse(&twice).unwrap_err().to_string();
        assert!(error.contains("would give its scenes the ids of"), "{error}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn adding_a_scene_does_not_change_others(
            indoors in 2usize..20, outdoor in 2usize..20, seed: u64,
            pairs in prop::array::uniform4(1u32..40), which in 0usize..4,
        ) {
            let with = |n: [u32; 4]| {
                let text = PAPER
                    .replace("seed = 2020", &format!("seed = {}", seed >> 12))
                    .replace("ior = 1.6", "ior = { uniform = [1.3, 1.7] }")
                    .replace("diode = 3000, places = 2000", &format!("diode = {}, places = {}", n[0], n[1]))
                    .replace("diode = 120, places = 80", &format!("diode = {}, places = {}", n[2], n[3]));
                let lines = expand(&Recipe::parse(&text).unwrap(), &two_sources(indoors, outdoor)).unwrap();
                lines.into_iter().map(|line| (line.id.clone(), line)).collect::<BTreeMap<_, _>>()
            };
            let mut more = pairs;
            more[which] += 1;
            let (few, many) = (with(pairs), with(more));
            prop_assert_eq!(many.len(), few.len() + 1);
            for (id, line) in &few {
                prop_assert_eq!(line, &many[id]);
            }
            prop_assert_eq!(few, with(pairs));
        }

        #[test]
        fn excluding_a_photograph_changes_only_its_own_scenes(
            indoors in 3usize..20, outdoor in 3usize..20, train in 1u32..60, test in 1u32..20, out in 0usize..100,
        ) {
            let recipe = recipe("ior = { uniform = [1.3, 1.7] }", train, test);
            let sources = two_sources(indoors, outdoor);
            let whole = expand(&recipe, &sources).unwrap();
            let out = whole[out % whole.len()].front.name().to_owned();
            let excluded = BTreeSet::from([out.clone()]);
            let made = expand_counted(&recipe, &sources, &excluded, None);
            if let Err(RecipeError::NoSubstitute { .. }) = &made {
                // A subset of two photographs has no substitute.
                return Ok(());
            }
            let made = made.unwrap();
            prop_assert_eq!(made.lines.len(), whole.len());
            for (before, after) in whole.iter().zip(&made.lines) {
                let names = |line: &SceneLine| [line.front.name().to_owned(), line.back.name().to_owned()];
                prop_assert!(!names(after).contains(&out));
                prop_assert_ne!(&names(after)[0], &names(after)[1]);
                for side in 0..2 {
                    prop_assert!(names(before)[side] == out || names(before)[side] == names(after)[side]);
                }
                prop_assert_eq!((&before.id, &before.glass), (&after.id, &after.glass));
            }
            let (train, test) = (colors(&made.lines, Split::Train), colors(&made.lines, Split::Test));
            prop_assert!(train.is_disjoint(&test));
        }

        #[test]
        fn splits_share_no_photograph_and_order_of_listing_does_not_matter(
            indoors in 0usize..20, outdoor in 0usize..20, train in 1u32..60, test in 1u32..20, seed: u64,
        ) {
            prop_assume!(indoors + outdoor >= 6);
            let mut recipe = recipe("", train, test);
            recipe.seed = seed;
            recipe.splits.push(SplitRecipe { name: Split::Validation, ..recipe.splits[1].clone() });
            let mut sources = two_sources(indoors, outdoor);
            let lines = expand(&recipe, &sources).unwrap();
            prop_assert_eq!(lines.len(), (train + 2 * test) as usize);
            let [train, validation, test] = Split::ALL.map(|split| colors(&lines, split));
            prop_assert!(train.is_disjoint(&test) && train.is_disjoint(&validation));
            prop_assert!(validation.is_disjoint(&test));
            sources.get_mut("diode").unwrap().reverse();
            prop_assert_eq!(expand(&recipe, &sources).unwrap(), lines);
        }
    }
}
