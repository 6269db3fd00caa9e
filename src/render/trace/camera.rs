//! Camera samples of a patch, in lanes: film point, lens point, direction, and optics of the glass in this direction.

use super::bent::BentRays;
use super::cover::Entries;
use super::isa::Isa;
use super::lanes::{CHUNK, LANES, Lane, sin_cos_octant};
use super::patch::{PATCH_PX, Patch, all_over};
use super::rough::{CameraRays, RoughPane, RoughRays};
use super::sampler::{PixelSeed, SeedLanes, points};
use super::scene::Scene;
use super::smudges::SmearedPane;
use super::stack::StackOptics;

/// Samples of the sixteen pixels of a patch, one lane for each pixel; film points and directions are relative to the
/// pixel's centre direction.
pub(super) struct CameraChunk {
    pub(super) film: [[Lane; CHUNK]; 2],
    /// Directions of the rays through the lens points (x, y at z = 1).
    pub(super) direction: [[Lane; CHUNK]; 2],
    pub(super) lens: [[Lane; CHUNK]; 2],
    /// Ratio tan_t / tan_i (see [`super::slab`]).
    pub(super) gamma: [Lane; CHUNK],
    /// Reflectance of a face for s and p polarised light.
    pub(super) reflectance: [[Lane; CHUNK]; 2],
    /// Transmittance of a face, 1 - reflectance, for s and p polarised light.
    pub(super) transmittance: [[Lane; CHUNK]; 2],
    /// Values of 1 / cos_t; filled only if the glass absorbs light.
    pub(super) inverse_cos_t: [Lane; CHUNK],
    /// Cells of the tables of a stack (see [`super::stack`]); filled in place of the values above, like the positions.
    pub(super) cell: [[u32; LANES]; CHUNK],
    /// Positions in these cells.
    pub(super) within: [Lane; CHUNK],
    /// The rays at a bent pane; filled in place of gamma, reflectance and transmittance.
    pub(super) bent: Box<BentRays>,
    /// Rays behind rough faces, along all ways.
    pub(super) rough: Box<RoughRays>,
    /// The same behind the pane under smudges, and the shares of the rays' light that meets it.
    pub(super) smeared: Box<RoughRays>,
    pub(super) shares: [Lane; CHUNK],
    /// True if any share is above 0.
    pub(super) meets_smudges: bool,
    /// Places at which the rays meet the pane's plane.
    pub(super) entries: Entries,
    /// The same of R's rays, which pass no lens.
    pub(super) pinhole_entries: Entries,
}

impl CameraChunk {
    pub(super) fn new() -> Box<Self> {
        let lanes = [[0.0; LANES]; CHUNK];
        let pair = [lanes; 2];
        Box::new(Self {
            film: pair,
            direction: pair,
            lens: pair,
            gamma: lanes,
            reflectance: pair,
            transmittance: pair,
            inverse_cos_t: lanes,
            cell: [[0; LANES]; CHUNK],
            within: lanes,
            bent: BentRays::new(),
            rough: RoughRays::new(),
            smeared: RoughRays::new(),
            shares: lanes,
            meets_smudges: false,
            entries: Entries::new(),
            pinhole_entries: Entries::new(),
        })
    }

    /// Fills the chunk with samples `first .. first + count` of each pixel.
    #[inline(always)]
    pub(super) fn fill(&mut self, scene: &Scene, patch: &Patch, first: u32, count: usize) {
        let [size_x, size_y] = scene.film.pixel_tangent().map(|v| v as f32);
        let [film_x, film_y] = &mut self.film;
        points(scene.sampling, &patch.seeds, 0, first, &mut film_x[..count], &mut film_y[..count]);
        for s in 0..count {
            if let Some(table) = &scene.film.filter {
                film_x[s] = film_x[s].map(|u| table.offset_px(u) * size_x);
                film_y[s] = film_y[s].map(|u| table.offset_px(u) * size_y);
            } else {
                for l in 0..LANES {
                    film_x[s][l] = (film_x[s][l] - 0.5) * size_x;
                    film_y[s][l] = (film_y[s][l] - 0.5) * size_y;
                }
            }
        }
        let aperture = scene.lens.aperture_radius_m as f32;
        if aperture > 0.0 {
            let [lens_x, lens_y] = &mut self.lens;
            let (lens_x, lens_y) = (&mut lens_x[..count], &mut lens_y[..count]);
            points(scene.sampling, &patch.seeds, 1, first, lens_x, lens_y);
            for s in 0..count {
                for l in 0..LANES {
                    let (x, y) = concentric_disc(lens_x[s][l], lens_y[s][l]);
                    lens_x[s][l] = x * aperture;
                    lens_y[s][l] = y * aperture;
                }
            }
        }
        // Rays through film point p meet on the plane of focus: direction = p - a / zf, with a the lens point.
        let inverse_focus = scene.lens.inverse_focus_per_m as f32;
        for axis in 0..2 {
            for s in 0..count {
                for l in 0..LANES {
                    self.direction[axis][s][l] =
                        self.film[axis][s][l] - self.lens[axis][s][l] * inverse_focus;
                }
            }
        }
        self.meet_glass(scene, patch, count);
        self.rough.begin(first, count);
        self.smeared.begin(first, count);
    }

    /// Aims one ray of each pixel through the centres of pixel and lens.
    pub(super) fn aim(&mut self, scene: &Scene, patch: &Patch) {
        for axis in 0..2 {
            for lanes in [&mut self.film, &mut self.direction, &mut self.lens] {
                lanes[axis][0] = [0.0; LANES];
            }
        }
        self.meet_glass(scene, patch, 1);
        self.rough.begin(0, 1);
    }

    /// Computes the optics of the glass and the entries of the first `count` samples, from their directions and lens points.
    #[inline(always)]
    fn meet_glass(&mut self, scene: &Scene, patch: &Patch, count: usize) {
        match (&scene.bow, &scene.stack) {
            (Some(bow), _) => {
                let slab = &scene.slab;
                self.bent.fill(bow, slab, &patch.center, &self.direction, &self.lens, count);
            }
            (None, None) => self.fill_glass(scene, patch, count),
            (None, Some(stack)) => self.fill_stack(scene, stack, patch, count),
        }
        if let Some(outline) = &scene.cover.outline {
            let (slab, center) = (&scene.slab, &patch.center);
            let lens = Some(&self.lens);
            self.entries.find(outline, slab, center, &self.direction, lens, count);
            self.pinhole_entries.find(outline, slab, center, &self.film, None, count);
        }
    }

    /// Traces the rays of the chunk along the ways through a pane with rough faces: `taken` are the numbers of samples of each.
    #[inline(always)]
    pub(super) fn scatter(
        &mut self,
        scene: &Scene,
        pane: &RoughPane,
        patch: &Patch,
        taken: &[usize],
        isa: Isa,
    ) {
        let mut rays = camera_rays(scene, patch, &self.direction, &self.lens, taken);
        rays.form = scene.zones.forms.of(scene, pane, patch.corner);
        self.rough.follow(pane, &rays, isa);
    }

    /// Finds the shares of the chunk's light that meet smudges, and traces it along the ways through the pane under them, if there is any.
    #[inline(always)]
    pub(super) fn smear(
        &mut self,
        scene: &Scene,
        SmearedPane { pane, smudges, .. }: &SmearedPane,
        patch: &Patch,
        taken: &[usize],
        isa: Isa,
    ) {
        let rays = camera_rays(scene, patch, &self.direction, &self.lens, taken);
        self.meets_smudges = self.smeared.meet_smudges(pane, smudges, &rays, &mut self.shares);
        if self.meets_smudges {
            self.smeared.follow(pane, &rays, isa);
        }
    }

    /// Locates the rays' cosines of incidence in the tables of a stack.
    #[inline(always)]
    fn fill_stack(&mut self, scene: &Scene, stack: &StackOptics, patch: &Patch, count: usize) {
        let normal = scene.slab.normal.as_vec3();
        for s in 0..count {
            let mut cosines = [0.0; LANES];
            for l in 0..LANES {
                let dx = patch.center[0][l] + self.direction[0][s][l];
                let dy = patch.center[1][l] + self.direction[1][s][l];
                let along = dx * normal.x + dy * normal.y + normal.z;
                cosines[l] = along / (1.0 + (dx * dx + dy * dy)).sqrt();
            }
            (self.cell[s], self.within[s]) = stack.locate(&cosines);
        }
    }

    #[inline(always)]
    fn fill_glass(&mut self, scene: &Scene, patch: &Patch, count: usize) {
        let ior = scene.slab.ior as f32;
        let excess = (scene.slab.ior * scene.slab.ior - 1.0) as f32;
        let normal = scene.slab.normal.as_vec3();
        let center = &patch.center;
        let tilted = scene.slab.is_tilted();
        let absorbs = scene.slab.absorbs();
        for s in 0..count {
            for l in 0..LANES {
                let dx = center[0][l] + self.direction[0][s][l];
                let dy = center[1][l] + self.direction[1][s][l];
                let square = 1.0 + (dx * dx + dy * dy);
                // Without tilt, the dot product of (dx, dy, 1) and the normal is 1.
                let along = if tilted { dx * normal.x + dy * normal.y + normal.z } else { 1.0 };
                let root = (excess * square + along * along).sqrt();
                let gamma = along / root;
                self.gamma[s][l] = gamma;
                for (q, factor) in [1.0, ior * ior].into_iter().enumerate() {
                    let slope = factor * gamma;
                    let inverse = 1.0 / (1.0 + slope);
                    let amplitude = (1.0 - slope) * inverse;
                    self.reflectance[q][s][l] = amplitude * amplitude;
                    // 1 - R = 4 g / (1 + g)^2 with g = `slope` avoids cancellation at grazing incidence.
                    self.transmittance[q][s][l] = 4.0 * slope * inverse * inverse;
                }
                if absorbs {
                    self.inverse_cos_t[s][l] = ior * square.sqrt() / root;
                }
            }
        }
    }
}

/// Number of patches across and down the film whose rays are tried.
const SURVEY_PATCHES: u32 = 5;

/// Traces rays from all over a film along all ways of a pane with rough or turned faces, and of another under smudges, and shows each chunk. The rays do not
/// depend on the scene's seed.
pub(super) fn survey(
    scene: &Scene,
    rough: Option<&RoughPane>,
    smeared: Option<&SmearedPane>,
    mut show: impl FnMut(&Patch, &CameraChunk),
) {
    let isa = Isa::detect();
    let mut camera = CameraChunk::new();
    for (x, y) in all_over(&scene.film, SURVEY_PATCHES) {
        let seeds =
            SeedLanes::new(|l| PixelSeed::new(0, x + l as u32 % PATCH_PX, y + l as u32 / PATCH_PX));
        let patch = Patch { seeds, ..Patch::new(scene, x, y) };
        camera.fill(scene, &patch, 0, CHUNK);
        let panes = [rough, smeared.map(|smeared| &smeared.pane)];
        let CameraChunk { rough: of_rough, smeared: of_smeared, direction, lens, .. } =
            &mut *camera;
        for (pane, rays) in panes.into_iter().zip([of_rough, of_smeared]) {
            if let Some(pane) = pane {
                let taken = vec![CHUNK; pane.ways()];
                rays.follow(pane, &camera_rays(scene, &patch, direction, lens, &taken), isa);
            }
        }
        show(&patch, &camera);
    }
}

/// Returns the rays of a chunk for panes with rough faces.
#[inline(always)]
fn camera_rays<'a>(
    scene: &Scene,
    patch: &'a Patch,
    direction: &'a [[Lane; CHUNK]; 2],
    lens: &'a [[Lane; CHUNK]; 2],
    taken: &'a [usize],
) -> CameraRays<'a> {
    CameraRays { patch, sampling: scene.sampling, direction, lens, taken, form: None }
}

/// Applies Shirley and Chiu's concentric map from the unit square to the unit disc.
#[inline(always)]
pub(super) fn concentric_disc(u: f32, v: f32) -> (f32, f32) {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    let wide = a.abs() > b.abs();
    let (radius, other) = if wide { (a, b) } else { (b, a) };
    let radius = if radius == 0.0 { 1.0e-30 } else { radius };
    let (sin, cos) = sin_cos_octant(other / radius * std::f32::consts::FRAC_PI_4);
    if wide { (radius * cos, radius * sin) } else { (radius * sin, radius * cos) }
}

#[cfg(test)]
mod tests {
    use super::super::sampler::{PixelSeed, sample};
    use super::*;

    #[test]
    fn disc_points_are_uniform() {
        let seed = PixelSeed::new(1, 2, 3);
        let n = 1 << 16;
        let (mut x2, mut r2, mut inner) = (0.0, 0.0, 0);
        for i in 0..n {
            let s = sample(&seed, i);
            let (x, y) = concentric_disc(s[2], s[3]);
            let square = f64::from(x * x + y * y);
            assert!(square <= 1.000_001);
            x2 += f64::from(x * x);
            r2 += square;
            inner += u32::from(square < 0.25);
        }
        assert!((x2 / f64::from(n) - 0.25).abs() < 1e-4);
        assert!((r2 / f64::from(n) - 0.5).abs() < 1e-4);
        assert!((f64::from(inner) / f64::from(n) - 0.25).abs() < 1e-3);
        assert_eq!(concentric_disc(1.0, 0.5).0, 1.0);
        assert_eq!(concentric_disc(0.5, 1.0).1, 1.0);
        assert!(concentric_disc(0.5, 0.5).0.abs() < 1e-20);
    }
}
