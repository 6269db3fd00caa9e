//! Assembles two sheets or meshes, a pane, a lens and a film into a [`crate::trace::Scene`].

use super::aspect::OtherAspect;
use super::card::{back_cards, front_cards};
use super::check_geometry::check_geometry;
use super::error::AssembleError;
use super::facts::{SceneFacts, Sides, SidesWith};
use super::far::far_median_m;
use super::geometry::{
    BackCamera, bow, cosines_between, film_directions, film_plane, film_reach, layers, outline,
    roughness, slab, stack, turned_faces, wave,
};
use super::largest_code::largest_code_share;
use super::load::{DecodedScene, InputDigests};
use super::near::Near;
use super::negligible::Negligible;
use super::place::{DecodedSide, Placed};
use super::smudges::smudges;
use super::surface::{back_surface, front_surface};
use super::view::OddView;
use crate::trace::{
    Bow, Cover, Lens, OrderPlan, RoughPane, RoughShape, Sampling, Scene, Slab, SmearedPane,
    Smudges, StackOptics, Zones,
};
use glam::DVec3;
use glasshouse_line::{Focus, FocusAt, ReflectionOrders, SceneLine, Side};

/// Assembles a scene without a map of smudges from its decoded sides; see [`assemble_decoded`].
///
/// # Panics
///
/// If the line has such a map.
pub fn assemble(
    line: &SceneLine,
    front: impl Into<DecodedSide>,
    back: impl Into<DecodedSide>,
) -> Result<(Scene, SceneFacts), AssembleError> {
    let (front, back, inputs) = (front.into(), back.into(), InputDigests::default());
    assemble_decoded(line, DecodedScene { front, back, smudges: None, inputs })
}

/// Places the sides, focuses the lens, checks the geometry and selects the orders of the glass.
pub fn assemble_decoded(
    line: &SceneLine,
    decoded: DecodedScene,
) -> Result<(Scene, SceneFacts), AssembleError> {
    let DecodedScene { front, back, smudges: map, .. } = decoded;
    let max_radiance = Sides { front: front.max_radiance(), back: back.max_radiance() };
    let slab = slab(line);
    let back_camera = BackCamera::new(line.back.apex().unwrap_or_default(), &slab);
    let cover = cover(line, [&front, &back], &slab, &back_camera)?;
    let (front, back) = (front.surface, back.surface);
    let lateral_m = line.camera.aperture_radius_m + line.glass.total_thickness_m();
    // The capture coordinates of the front are those of the lens.
    let front = front.place("front", |x| x, lateral_m)?;
    let back = back.place("back", back_camera.lens_from_capture(), lateral_m)?;
    let odd_view = odd_view(line, &front, &back)?;
    let focus_distance_m = focus_distance_m(line, &front, &back, &back_camera)?;
    let lens = lens(line, focus_distance_m);
    check_geometry(line, lens.inverse_focus_per_m)?;
    let nearest_m = front.nearest_m().min(back.nearest_m()).min(line.glass.distance_m);
    let negligible = Negligible::of(line, &lens, nearest_m);
    let line = &*negligible.without(line);

    let film = film_plane(line);
    let reach = film_reach(&film, &lens);
    let directions = film_directions(reach);
    let bow = bow(line);
    let cosines = cosines(&directions, &slab, bow.as_ref());
    let brightest = [max_radiance.front, max_radiance.back];
    let tolerance = line.film.order_tolerance;
    let between = cosines_between(&cosines, reach);
    let (stack, orders) = match stack(line) {
        None => (None, OrderPlan::new(&slab, &cosines, brightest, tolerance)),
        Some(stack) => {
            let (stack, orders) = StackOptics::new(&stack, between, brightest, tolerance);
            (Some(stack), orders)
        }
    };
    let (wave, turned, smudges) = (wave(line), turned_faces(line), smudges(line, map.as_deref()));
    let shape = RoughShape {
        slab: &slab,
        distance_m: line.glass.distance_m,
        bow: bow.as_ref(),
        wave: wave.as_ref(),
        turned: turned.as_deref(),
    };
    let smeared = smudges.map(|of| smeared_pane(line, shape, between, brightest, &of));
    let (rough, orders) = rough_pane(line, shape, between, brightest)
        .map_or((None, orders), |(pane, of_paths)| (Some(pane), of_paths));

    let near = Near { slab: &slab, distance_m: line.glass.distance_m, reach };
    let too_near_share = Sides {
        front: near.share("front", &front, |p| p.dot(slab.normal))?,
        back: near.share("back", &back, |p| back_camera.height_m(p))?,
    };
    let mut facts = SceneFacts {
        focus_distance_m,
        orders: vec![],
        dropped: Sides { front: 0.0, back: 0.0 },
        shadowed: 0.0,
        negligible,
        search_was_bounded: false,
        filled_share: Sides { front: front.filled_share(), back: back.filled_share() },
        relative_depth: SidesWith { front: front.relative(), back: back.relative() },
        too_near_share,
        far_median_m: of_sides(line, [&front, &back], far_median_m),
        largest_code_share: of_sides(line, [&front, &back], largest_code_share),
        odd_view,
        other_aspect: SidesWith { front: OtherAspect::of(&front), back: OtherAspect::of(&back) },
        max_radiance,
        meshes: SidesWith { front: front.mesh_facts(), back: back.mesh_facts() },
    };
    let reach_m = lens.aperture_radius_m + 40.0 * slab.thickness_m;
    let front = front_surface(front, reach_m)?;
    let back = back_surface(back, line, &slab, &back_camera, &directions, reach_m)?;
    let mut scene = Scene {
        seed: line.seed,
        sampling: Sampling::Sobol,
        spp: line.film.spp,
        target_error: line.film.target_error,
        layers: line.film.layers.asked(),
        labels: line.film.layers.labels(),
        first_reflection_alone: line.film.glass_reflection_orders == ReflectionOrders::First,
        film,
        lens,
        slab,
        stack,
        bow,
        wave,
        rough,
        smeared,
        orders,
        zones: Zones::default(),
        cover,
        front,
        back,
    };
    scene.finish_orders(nearest_m, brightest, tolerance);
    facts.state_orders(&scene);
    Ok((scene, facts))
}

/// Checks the intrinsics of photographs.
fn odd_view(
    line: &SceneLine,
    front: &Placed,
    back: &Placed,
) -> Result<SidesWith<OddView>, AssembleError> {
    Ok(SidesWith {
        front: OddView::of(line, "front", front)?,
        back: OddView::of(line, "back", back)?,
    })
}

/// Finds a fact about each placed side.
fn of_sides<T>(
    line: &SceneLine,
    [front, back]: [&Placed; 2],
    fact: impl Fn(&Side, &Placed) -> Option<T>,
) -> SidesWith<T> {
    SidesWith { front: fact(&line.front, front), back: fact(&line.back, back) }
}

/// Places edges, frame and cards.
fn cover(
    line: &SceneLine,
    [front, back]: [&DecodedSide; 2],
    slab: &Slab,
    back_camera: &BackCamera,
) -> Result<Cover, AssembleError> {
    let cards = [
        front_cards(line.front.cards(), &front.cards, slab)?,
        back_cards(line.back.cards(), &back.cards, slab, back_camera)?,
    ];
    Ok(Cover { outline: outline(line), cards })
}

/// Returns the cosines of incidence of pinhole rays in these directions.
fn cosines(directions: &[DVec3], slab: &Slab, bow: Option<&Bow>) -> Vec<f64> {
    let cosine = |d: &DVec3| {
        let met = bow.and_then(|bow| bow.entry(slab, DVec3::ZERO, *d));
        d.normalize().dot(met.map_or(slab.normal, |(_, normal)| normal))
    };
    directions.iter().map(cosine).collect()
}

/// Returns a pane with rough faces, waves or a wedge, and the paths through it; `None` for other panes.
fn rough_pane(
    line: &SceneLine,
    shape: RoughShape<'_>,
    between: [f64; 2],
    brightest: [f64; 2],
) -> Option<(RoughPane, OrderPlan)> {
    let layers = layers(line);
    let smooth = || shape.is_free().then(|| vec![0.0; layers.coatings().len()]);
    let alphas = roughness(line).or_else(smooth)?;
    Some(RoughPane::new(&layers, &alphas, shape, between, brightest, line.film.order_tolerance))
}

/// Returns a line's pane as if its smudges covered all of it, and them.
fn smeared_pane(
    line: &SceneLine,
    shape: RoughShape<'_>,
    between: [f64; 2],
    brightest: [f64; 2],
    smudges: &Smudges,
) -> SmearedPane {
    let layers = layers(line);
    let alphas = roughness(line).unwrap_or_else(|| vec![0.0; layers.coatings().len()]);
    let tolerance = line.film.order_tolerance;
    SmearedPane::new(&layers, &alphas, shape, between, brightest, tolerance, smudges)
}

/// Makes the lens, with its focus distance, m; `None` is infinity.
fn lens(line: &SceneLine, focus_distance_m: Option<f64>) -> Lens {
    Lens {
        aperture_radius_m: line.camera.aperture_radius_m,
        inverse_focus_per_m: focus_distance_m.map_or(0.0, |z| 1.0 / z),
    }
}

/// Returns the focus distance, m; `None` for infinity.
fn focus_distance_m(
    line: &SceneLine,
    front: &Placed,
    back: &Placed,
    back_camera: &BackCamera,
) -> Result<Option<f64>, AssembleError> {
    Ok(match line.camera.focus {
        Focus::Distance { distance_m } => Some(distance_m),
        Focus::At { at } => match at {
            FocusAt::FrontCenter => Some(front.center_z_m("front", |x: DVec3| x)?),
            FocusAt::BackCenter => Some(back.center_z_m("back", back_camera.lens_from_capture())?),
            FocusAt::Infinity => None,
        },
    })
}
