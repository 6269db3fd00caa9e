//! Pane, film and back capture camera of a scene line in the lens's coordinates.

use crate::trace::{
    Bow, Coating, FilmPlane, FilterTable, Lens, Outline, Slab, Stack, StackLayer, Wave,
};
use glam::{DMat3, DVec3};
use glasshouse_line::{Apex, FaceCoating, Filter, GlassLayer, SceneLine};

/// Returns the pane of a line.
pub(super) fn slab(line: &SceneLine) -> Slab {
    let normal = if line.glass.tilt_deg == [0.0, 0.0] {
        DVec3::Z
    } else {
        Slab::tilted_normal(line.glass.tilt_deg)
    };
    let (ior, absorption_per_m) = line.glass.first_glass();
    Slab {
        normal,
        plane_distance_m: line.glass.distance_m * normal.z,
        thickness_m: line.glass.total_thickness_m(),
        ior,
        absorption_per_m,
    }
}

/// Returns the layers of a line's pane, if it is no plain one: if it has several, or coatings.
pub(super) fn stack(line: &SceneLine) -> Option<Stack> {
    let is_plain = line.glass.layers.is_empty() && line.glass.coatings.is_empty();
    (!is_plain).then(|| layers(line))
}

/// Returns the layers of a line's pane; a plain one has one.
pub(super) fn layers(line: &SceneLine) -> Stack {
    let glass = &line.glass;
    let of = glass.stack();
    let layer = |layer: &GlassLayer| match *layer {
        GlassLayer::Glass { glass_m, ior, absorption_per_m, .. } => {
            StackLayer { thickness_m: glass_m, ior, absorption_per_m }
        }
        GlassLayer::Gap { gap_m, .. } => {
            StackLayer { thickness_m: gap_m, ior: 1.0, absorption_per_m: [0.0; 3] }
        }
    };
    let mut coatings = vec![None; of.len() + 1];
    for coating in &glass.coatings {
        coatings[coating.face as usize] = Some(coating_of(coating));
    }
    Stack::new(of.iter().map(layer).collect(), coatings)
}

/// Returns a face's coating as functions of the angle.
pub fn coating_of(coating: &FaceCoating) -> Coating {
    let [reflectance, reflectance_back] =
        coating.reflectances().map(|shares| coating.curve(shares));
    Coating { reflectance, reflectance_back, transmittance: coating.curve(&coating.transmittance) }
}

/// Returns the curvature of a line's pane, if it is bent.
pub(super) fn bow(line: &SceneLine) -> Option<Bow> {
    let curvature_per_m = 1.0 / line.glass.bow_radius_m?;
    Some(Bow { curvature_per_m, distance_m: line.glass.distance_m })
}

/// Returns the waves of a line's pane, if it is not flat.
pub(super) fn wave(line: &SceneLine) -> Option<Wave> {
    let wave = line.glass.wave.filter(|wave| wave.amplitude_m > 0.0)?;
    let (sin, cos) = libm::sincos(wave.direction_deg.to_radians());
    let [right, down] = pane_axes(line);
    Some(Wave {
        amplitude_m: wave.amplitude_m,
        length_m: wave.length_m,
        across_crests: cos * right + sin * down,
        distance_m: line.glass.distance_m,
    })
}

/// Returns the rotation of each face of a line's pane against the first; `None` if all are parallel.
pub(super) fn turned_faces(line: &SceneLine) -> Option<Vec<DMat3>> {
    let layers = &line.glass.layers;
    if layers.iter().all(|layer| layer.wedge_deg() == [0.0; 2]) {
        return None;
    }
    let [right, down] = pane_axes(line);
    let pane = DMat3::from_cols(right, down, right.cross(down));
    let mut sum_deg = [0.0; 2];
    let mut turned = vec![DMat3::IDENTITY];
    for layer in layers {
        let [pitch_deg, yaw_deg] = layer.wedge_deg();
        sum_deg = [sum_deg[0] + pitch_deg, sum_deg[1] + yaw_deg];
        let [(sin_x, cos_x), (sin_y, cos_y)] = sum_deg.map(|deg| libm::sincos(deg.to_radians()));
        let about_x =
            DMat3::from_cols_array(&[1.0, 0.0, 0.0, 0.0, cos_x, sin_x, 0.0, -sin_x, cos_x]);
        let about_y =
            DMat3::from_cols_array(&[cos_y, 0.0, -sin_y, 0.0, 1.0, 0.0, sin_y, 0.0, cos_y]);
        turned.push(pane * about_y * about_x * pane.transpose());
    }
    Some(turned)
}

/// Returns the unit vectors of a line's pane that point right and down for an untilted pane.
pub(super) fn pane_axes(line: &SceneLine) -> [DVec3; 2] {
    let [pitch, yaw] = line.glass.tilt_deg.map(f64::to_radians);
    let (sin_pitch, cos_pitch) = libm::sincos(pitch);
    let (sin_yaw, cos_yaw) = libm::sincos(yaw);
    [
        DVec3::new(cos_yaw, 0.0, -sin_yaw),
        DVec3::new(sin_pitch * sin_yaw, cos_pitch, sin_pitch * cos_yaw),
    ]
}

/// Returns the roughness of each face of a line's pane, if one of them is rough.
pub(super) fn roughness(line: &SceneLine) -> Option<Vec<f64>> {
    let glass = &line.glass;
    let roughness = glass.roughness.as_ref().filter(|roughness| roughness.largest() > 0.0)?;
    roughness.of_faces(glass.layers.len().max(1) + 1)
}

/// Returns the largest roughness of each face of a line's pane, with its smudges, if one of them can be rough.
pub(super) fn largest_roughness(line: &SceneLine) -> Option<Vec<f64>> {
    let of_faces = roughness(line);
    let smear = line.glass.smudges.as_ref().map_or(0.0, |smudges| smudges.roughness);
    if smear == 0.0 {
        return of_faces;
    }
    let mut alphas = of_faces.unwrap_or_else(|| vec![0.0; line.glass.layers.len().max(1) + 1]);
    alphas[0] = alphas[0].max(smear);
    Some(alphas)
}

/// Returns the edges of a line's pane. The camera's exposure and white balance apply to the frame.
pub(super) fn outline(line: &SceneLine) -> Option<Outline> {
    let outline = line.glass.outline.as_ref()?;
    let balance = line.camera.white_balance.map(|balance| line.camera.exposure * balance);
    Some(Outline {
        axes: pane_axes(line),
        distance_m: line.glass.distance_m,
        glass_m: [outline.x_m, outline.y_m],
        frame_m: outline.frame_m,
        frame_radiance: [0, 1, 2].map(|c| (outline.frame_radiance[c] * balance[c]) as f32),
    })
}

/// Returns the interval of the cosines of incidence of rays that cover the film's `reach`, from the
/// cosines of [`film_directions`].
pub(super) fn cosines_between(cosines: &[f64], reach: [f64; 2]) -> [f64; 2] {
    let least = cosines.iter().copied().fold(1.0, f64::min);
    let most = cosines.iter().copied().fold(0.0, f64::max);
    // The least is at a corner. At the most, the cosine is flat, and the nearest direction is half a step of the grid away.
    let [x, y] = reach.map(|reach| reach / f64::from(FILM_STEPS));
    [least, (most + x * x + y * y).min(1.0)]
}

/// Returns the film of a line.
pub(super) fn film_plane(line: &SceneLine) -> FilmPlane {
    FilmPlane {
        filter: match line.film.filter {
            Filter::Box => None,
            Filter::Gaussian => Some(FilterTable::gaussian()),
        },
        ..unfiltered_film(line)
    }
}

/// Returns the film without the table of its filter, which is the slowest part to compute.
pub(super) fn unfiltered_film(line: &SceneLine) -> FilmPlane {
    let (width, height) = (line.film.width, line.film.height);
    FilmPlane {
        width,
        height,
        tan_half_fov: FilmPlane::tan_half_fov(width, height, line.camera.focal_length_mm),
        filter: None,
    }
}

/// Returns the distance by which a filter reaches beyond the film, px.
pub(super) fn filter_reach_px(filter: Filter) -> f64 {
    match filter {
        Filter::Box => 0.0,
        Filter::Gaussian => FilterTable::GAUSSIAN_RADIUS_PX,
    }
}

/// Returns the tangents of half the field of view, widened by the lens and the filter.
pub(super) fn film_reach(film: &FilmPlane, lens: &Lens) -> [f64; 2] {
    let spread = lens.aperture_radius_m * lens.inverse_focus_per_m;
    let beyond = film.filter.as_ref().map_or(0.0, FilterTable::radius_px);
    let pixel = film.pixel_tangent();
    [0, 1].map(|k| film.tan_half_fov[k] + beyond * pixel[k] + spread)
}

/// Number of steps of [`film_directions`] across and down.
const FILM_STEPS: u32 = 32;

/// Returns a dense set of camera directions: a grid over the film's reach.
pub(super) fn film_directions(reach: [f64; 2]) -> Vec<DVec3> {
    let at = |i: u32| 2.0 * f64::from(i) / f64::from(FILM_STEPS) - 1.0;
    (0..=FILM_STEPS)
        .flat_map(|j| {
            (0..=FILM_STEPS).map(move |i| DVec3::new(at(i) * reach[0], at(j) * reach[1], 1.0))
        })
        .collect()
}

/// The capture camera of the back in the mirrored world, where reflected rays continue straight.
pub(crate) struct BackCamera {
    pub(super) apex: Apex,
    normal: DVec3,
    plane_distance_m: f64,
}

impl BackCamera {
    pub(crate) fn new(apex: Apex, slab: &Slab) -> Self {
        Self { apex, normal: slab.normal, plane_distance_m: slab.plane_distance_m }
    }

    /// Returns the reflection H = I - 2 n n^T.
    fn mirror(&self) -> DMat3 {
        let n = self.normal;
        DMat3::IDENTITY - DMat3::from_cols(n * n.x, n * n.y, n * n.z) * 2.0
    }

    /// Returns the mirror image of a point of the world in the front face.
    pub(crate) fn mirrored_point(&self, point: DVec3) -> DVec3 {
        self.mirror() * point + self.normal * self.twice_distance_m()
    }

    /// Returns the mirror image of a direction.
    pub(crate) fn mirrored_direction(&self, direction: DVec3) -> DVec3 {
        self.mirror() * direction
    }

    /// Returns the distance of the mirrored lens from the lens, along the normal.
    pub(crate) fn twice_distance_m(&self) -> f64 {
        2.0 * self.plane_distance_m
    }

    /// Returns the map from capture coordinates to the lens's, in the mirrored world.
    pub(super) fn lens_from_capture(&self) -> impl Fn(DVec3) -> DVec3 + use<> {
        let (apex, mirror) = (self.apex, self.mirror());
        let twice = self.normal * self.twice_distance_m();
        move |x| match apex {
            // The capture camera is the lens's mirror image. In the mirrored world, it is at the lens for any tilt.
            Apex::Mirror => DVec3::new(-x.x, x.y, x.z),
            Apex::Camera => mirror * DVec3::new(-x.x, x.y, -x.z) + twice,
        }
    }

    /// Returns the inverse of `lens_from_capture`: an orthogonal matrix (with a reflection) and a translation.
    pub(crate) fn capture_from_lens(&self) -> (DMat3, DVec3) {
        match self.apex {
            Apex::Mirror => (DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)), DVec3::ZERO),
            // x = H x' + 2 D n mirrors the mirrored world back; then diag(-1, 1, -1) turns the camera round.
            Apex::Camera => {
                let turn = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0));
                let twice = self.normal * self.twice_distance_m();
                (turn * self.mirror(), turn * twice)
            }
        }
    }

    /// Returns the distance of a point in capture coordinates from the lens, along the pane's normal in the mirrored
    /// world.
    pub(super) fn height_m(&self, p: DVec3) -> f64 {
        match self.apex {
            Apex::Mirror => DVec3::new(-p.x, p.y, p.z).dot(self.normal),
            // A surface on the camera's side of the pane is beyond the pane in the mirrored world.
            Apex::Camera => self.twice_distance_m() - DVec3::new(-p.x, p.y, -p.z).dot(self.normal),
        }
    }
}
