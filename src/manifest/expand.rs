//! A recipe and its photographs become scene lines.

use super::diode::SourceImage;
use super::divide::divide;
use super::draw::{Draw, scene_seed};
use super::focus::FocusRecipe;
use super::line::{
    Apex, Camera, DepthKind, Film, Focus, FocusAt, Glass, Photograph, SCENE_SCHEMA, SceneLine,
    Split,
};
use super::pair::{Pair, pairs};
use super::param::Param;
use super::recipe::{Recipe, RecipeError, Source};
use super::refuse::refuse;
use crate::ids::SceneId;
use std::collections::BTreeMap;

/// How often a scene is drawn before its recipe is given up.
const MAX_ATTEMPTS: u32 = 100;

/// A manifest, and what was less than wished for.
#[derive(Clone, Debug, PartialEq)]
pub struct Expansion {
    /// Splits in the recipe's order, sources by name.
    pub lines: Vec<SceneLine>,
    /// Scenes whose photographs are both indoors or both outdoors, as their part had no others.
    pub same_place: u32,
    /// Scenes whose photographs are from one scan, as their part had no other.
    pub same_scan: u32,
    /// Draws that were refused and drawn again.
    pub redrawn: u32,
}

/// [`expand_counted`] without the counts.
pub fn expand(
    recipe: &Recipe,
    sources: &BTreeMap<String, Vec<SourceImage>>,
) -> Result<Vec<SceneLine>, RecipeError> {
    expand_counted(recipe, sources).map(|expansion| expansion.lines)
}

/// Draws all scenes of `recipe` from the photographs of its `sources`. Pure: the same arguments, the same
/// lines.
pub fn expand_counted(
    recipe: &Recipe,
    sources: &BTreeMap<String, Vec<SourceImage>>,
) -> Result<Expansion, RecipeError> {
    let mut parts = divide_all(recipe, sources)?;
    let mut expansion = Expansion {
        lines: Vec::new(),
        same_place: 0,
        same_scan: 0,
        redrawn: 0,
    };
    for split in &recipe.splits {
        let mut number = 0;
        for (source_name, &count) in &split.pairs {
            let Some(part) = parts.remove(&(split.name, source_name.as_str())) else {
                continue;
            };
            let split_name = split.name.to_string();
            let source = &recipe.sources[source_name];
            for pair in pairs(recipe.seed, [&split_name, source_name], &part, count) {
                let id = SceneId::new(format!("{split_name}-{number:06}"))
                    .expect("a split's name and digits make an id");
                let (line, attempts) =
                    draw_line(recipe, split.name, id, (source_name, source), pair)?;
                expansion.same_place += u32::from(pair.is_of_one_place());
                expansion.same_scan += u32::from(pair.is_of_one_scan());
                expansion.redrawn += attempts;
                expansion.lines.push(line);
                number += 1;
            }
        }
    }
    Ok(expansion)
}

/// The photographs of each split and source that has pairs.
fn divide_all<'a>(
    recipe: &'a Recipe,
    sources: &'a BTreeMap<String, Vec<SourceImage>>,
) -> Result<BTreeMap<(Split, &'a str), Vec<&'a SourceImage>>, RecipeError> {
    let mut parts = BTreeMap::new();
    for name in recipe.sources.keys() {
        let wanted: Vec<(Split, u32)> = recipe
            .splits
            .iter()
            .filter_map(|split| Some((split.name, *split.pairs.get(name)?)))
            .filter(|(_, count)| *count > 0)
            .collect();
        if wanted.is_empty() {
            continue;
        }
        let images = sources.get(name).ok_or_else(|| RecipeError::NotIndexed {
            source_name: name.clone(),
        })?;
        let counts: Vec<u32> = wanted.iter().map(|(_, count)| *count).collect();
        let divided = divide(recipe.seed, name, images, &counts)?;
        for ((split, _), part) in wanted.into_iter().zip(divided) {
            parts.insert((split, name.as_str()), part);
        }
    }
    Ok(parts)
}

/// Draws the scene `id`; also how many draws were refused on the way.
fn draw_line(
    recipe: &Recipe,
    split: Split,
    id: SceneId,
    source: (&str, &Source),
    pair: Pair<'_>,
) -> Result<(SceneLine, u32), RecipeError> {
    let dataset_seed = recipe.seed;
    let draw_of = |attempt| Draw {
        dataset_seed,
        scene: id.as_str(),
        attempt,
    };
    let first = draw_of(0);
    let mut back = photograph(
        source,
        pair.back,
        first.value("back.exposure", &recipe.back.exposure),
    );
    back.apex = (recipe.back.apex != Apex::default()).then_some(recipe.back.apex);
    let mut line = SceneLine {
        schema: SCENE_SCHEMA.to_owned(),
        id: id.clone(),
        split,
        seed: scene_seed(dataset_seed, id.as_str()),
        film: film(recipe, first),
        camera: camera(recipe, first),
        glass: glass(recipe, first),
        front: photograph(
            source,
            pair.front,
            first.value("front.exposure", &recipe.front.exposure),
        )
        .into(),
        back: back.into(),
    };
    let attempts = if deciding(recipe)
        .iter()
        .all(|(_, param)| param.is_constant())
    {
        1
    } else {
        MAX_ATTEMPTS
    };
    let mut refusal = None;
    for attempt in 0..attempts {
        line.camera = camera(recipe, draw_of(attempt));
        line.glass = glass(recipe, draw_of(attempt));
        line.validate().map_err(|source| RecipeError::Line {
            id: id.clone(),
            source,
        })?;
        // A focus on the photograph is not known yet; the tracer looks again when it is.
        let inverse_focus_distance_per_m = match line.camera.focus {
            Focus::Distance { distance_m } => 1.0 / distance_m,
            Focus::At { .. } => 0.0,
        };
        match refuse(&line, inverse_focus_distance_per_m) {
            Ok(()) => return Ok((line, attempt)),
            Err(reason) => refusal = Some(reason),
        }
    }
    Err(RecipeError::Refused {
        id,
        attempts,
        ranges: deciding(recipe)
            .iter()
            .map(|(name, param)| format!("{name} ({param})"))
            .collect::<Vec<_>>()
            .join(", "),
        source: refusal.expect("there was at least one attempt"),
    })
}

/// The parameters that decide whether a pane is refused.
fn deciding(recipe: &Recipe) -> Vec<(&'static str, &Param)> {
    let mut params = vec![
        ("camera.focal_length_mm", &recipe.camera.focal_length_mm),
        ("camera.aperture_radius_m", &recipe.camera.aperture_radius_m),
        ("glass.distance_m", &recipe.glass.distance_m),
        ("glass.tilt_deg[0]", &recipe.glass.tilt_deg[0]),
        ("glass.tilt_deg[1]", &recipe.glass.tilt_deg[1]),
    ];
    if let FocusRecipe::DistanceM(param) = &recipe.camera.focus {
        params.push(("camera.focus", param));
    }
    params
}

fn film(recipe: &Recipe, draw: Draw<'_>) -> Film {
    let film = &recipe.film;
    Film {
        width: draw.value("film.width", &film.width) as u32,
        height: draw.value("film.height", &film.height) as u32,
        spp: draw.value("film.spp", &film.spp) as u32,
        filter: film.filter,
        order_tolerance: draw.value("film.order_tolerance", &film.order_tolerance),
        exr: film.exr,
        target_error: film.target_error,
        layers: film.layers,
    }
}

fn camera(recipe: &Recipe, draw: Draw<'_>) -> Camera {
    let camera = &recipe.camera;
    Camera {
        focal_length_mm: draw.value("camera.focal_length_mm", &camera.focal_length_mm),
        aperture_radius_m: draw.value("camera.aperture_radius_m", &camera.aperture_radius_m),
        focus: match &camera.focus {
            FocusRecipe::FrontCenter => Focus::At {
                at: FocusAt::FrontCenter,
            },
            FocusRecipe::Infinity => Focus::At {
                at: FocusAt::Infinity,
            },
            FocusRecipe::DistanceM(param) => Focus::Distance {
                distance_m: draw.value("camera.focus", param),
            },
        },
    }
}

fn glass(recipe: &Recipe, draw: Draw<'_>) -> Glass {
    let glass = &recipe.glass;
    let each = |name: &str, index: usize, param| draw.value(&format!("{name}[{index}]"), param);
    Glass {
        distance_m: draw.value("glass.distance_m", &glass.distance_m),
        thickness_m: draw.value("glass.thickness_m", &glass.thickness_m),
        ior: draw.value("glass.ior", &glass.ior),
        absorption_per_m: std::array::from_fn(|index| {
            each(
                "glass.absorption_per_m",
                index,
                &glass.absorption_per_m[index],
            )
        }),
        tilt_deg: std::array::from_fn(|index| {
            each("glass.tilt_deg", index, &glass.tilt_deg[index])
        }),
    }
}

fn photograph((name, source): (&str, &Source), image: &SourceImage, exposure: f64) -> Photograph {
    let rooted = |path: &String| format!("{name}:{path}");
    Photograph {
        color: rooted(&image.color),
        depth: match &image.depth_root {
            Some(root) => format!("{root}:{}", image.depth),
            None => rooted(&image.depth),
        },
        mask: image.mask.as_ref().map(rooted),
        transfer: source.transfer,
        depth_unit_m: source.depth_unit_m,
        depth_kind: source.depth_kind,
        // A table of categories has them for estimates; metric depths need none.
        depth_range: match source.depth_kind {
            DepthKind::Relative | DepthKind::RelativeInverse => {
                image.depth_range.or(source.depth_range)
            }
            DepthKind::Z | DepthKind::Distance => None,
        },
        intrinsics: source.intrinsics,
        exposure,
        fill: source.fill,
        apex: None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::divide::tests::set;
    use super::super::jsonl::{parse_jsonl, to_jsonl};
    use super::super::recipe::tests::PAPER;
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn two_sources(indoors: usize, outdoor: usize) -> BTreeMap<String, Vec<SourceImage>> {
        ["diode", "places"]
            .map(|name| (name.to_owned(), set(indoors, outdoor)))
            .into()
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
    fn the_paper_s_set_has_5200_scenes_also_from_a_few_photographs() {
        let lines = expand(&Recipe::parse(PAPER).unwrap(), &two_sources(12, 12)).unwrap();
        assert_eq!(lines.len(), 5200);
        assert_eq!(lines[0].id.as_str(), "train-000000");
        assert_eq!(lines[5199].id.as_str(), "test-000199");
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
        // A change here changes every set that has been planned from a recipe.
        assert_eq!(lines[0].seed, 8_089_883_437_783_281);
        assert_eq!(lines[0].glass.ior, 1.57465236);
        let digest = blake3::hash(to_jsonl(&lines).as_bytes()).to_hex();
        assert_eq!(&digest[..16], "3d97b5cc33ce61d0");
    }

    #[test]
    fn a_new_distribution_changes_its_own_parameter_alone() {
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
            line.glass.absorption_per_m = [0.0; 3];
        }
        assert_eq!(plain, more);
    }

    #[test]
    fn refused_panes_are_drawn_again() {
        let sources = two_sources(6, 6);
        let steep = recipe("tilt_deg = [0, { uniform = [0, 89] }]", 60, 4);
        let expansion = expand_counted(&steep, &sources).unwrap();
        assert!(expansion.redrawn > 0);
        for line in &expansion.lines {
            refuse(line, 0.0).unwrap();
        }

        let hopeless = recipe("tilt_deg = [0, { uniform = [85, 89] }]", 4, 4);
        let error = expand(&hopeless, &sources).unwrap_err().to_string();
        assert!(error.contains("100 draws of"), "{error}");
        assert!(
            error.contains("glass.tilt_deg[1] (uniform 85 to 89)"),
            "{error}"
        );

        let constant = recipe("tilt_deg = [0, 88]", 4, 4);
        let error = expand(&constant, &sources).unwrap_err().to_string();
        assert!(error.contains("scene train-000000: 1 draws of"), "{error}");
    }

    #[test]
    fn missing_and_few_photographs_are_named() {
        let none = BTreeMap::new();
        let error = expand(&recipe("", 4, 4), &none).unwrap_err().to_string();
        assert!(
            error.starts_with("source diode has not been indexed"),
            "{error}"
        );
        let error = expand(&recipe("", 4, 4), &two_sources(1, 2))
            .unwrap_err()
            .to_string();
        assert!(error.contains("has 3 photographs"), "{error}");
    }

    #[test]
    fn scenes_at_the_end_leave_the_others_where_one_split_has_all_photographs() {
        let text = PAPER.split("[[split]]").next().unwrap().to_owned();
        let with = |count: u32| {
            let split = format!("[[split]]\nname = \"test\"\npairs = {{ diode = {count} }}");
            Recipe::parse(&format!("{text}{split}")).unwrap()
        };
        let sources = two_sources(7, 5);
        let few = expand(&with(20), &sources).unwrap();
        let many = expand(&with(50), &sources).unwrap();
        assert_eq!(few, many[..20]);
        assert_eq!(few[0].split, Split::Test);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn splits_share_no_photograph_and_order_of_listing_does_not_matter(
            indoors in 0usize..20, outdoor in 0usize..20, train in 1u32..60, test in 1u32..20,
        ) {
            prop_assume!(indoors + outdoor >= 4);
            let recipe = recipe("", train, test);
            let mut sources = two_sources(indoors, outdoor);
            let lines = expand(&recipe, &sources).unwrap();
            prop_assert_eq!(lines.len(), (train + test) as usize);
            prop_assert!(colors(&lines, Split::Train).is_disjoint(&colors(&lines, Split::Test)));
            sources.get_mut("diode").unwrap().reverse();
            prop_assert_eq!(expand(&recipe, &sources).unwrap(), lines);
        }
    }
}
