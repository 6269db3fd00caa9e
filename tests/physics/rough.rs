//! Panes with rough faces: rays that are followed explicitly from facet to facet, widths of lobes, energy, and the smooth limit.

use crate::case::{CLEAN, Case, GLASS, I, Photo, T, bumpy};
use crate::optics::{Exit, face, mirrored};
use crate::reference::concentric;
use crate::smudges::Smudged;
use glam::{DMat3, DVec3};
use render::trace::{
    Coating, Meeting, PixelSeed, Smear, StackLayer, Wave, sample, visible_share, visible_shift,
};

/// A pane of a case, whose faces are planes, concentric spheres or height fields.
#[derive(Clone)]
pub(crate) struct RoughReference {
    normal: DVec3,
    pivot: DVec3,
    curvature_per_m: f64,
    layers: Vec<StackLayer>,
    coatings: Vec<Option<Coating>>,
    alphas: Vec<f64>,
    wave: Option<Wave>,
    /// Rotation of each face against the first.
    turned: Option<Vec<DMat3>>,
    smudges: Option<Smudged>,
    /// Axes of the pattern of smudges.
    axes: [DVec3; 2],
}

impl RoughReference {
    /// Returns the pane of a case with rough faces.
    pub(crate) fn new(case: &Case) -> Option<Self> {
        let (stack, wave, turned) = (case.layers(), case.waves(), case.turned());
        let is_free = wave.is_some() || turned.is_some();
        let smooth = || is_free.then(|| vec![0.0; stack.coatings().len()]);
        let alphas = case.roughness.clone().or_else(smooth)?;
        Some(Self {
            normal: case.pane().0,
            pivot: case.distance_m * DVec3::Z,
            curvature_per_m: case.bow_radius_m.map_or(0.0, |radius_m| 1.0 / radius_m),
            layers: stack.layers().to_vec(),
            coatings: stack.coatings().to_vec(),
            alphas,
            wave,
            turned,
            smudges: case.smudges.clone(),
            axes: case.axes(),
        })
    }

    /// Returns the pane of a case under its smudges, as if they covered all of it.
    pub(crate) fn smeared(case: &Case) -> Option<Self> {
        let smear = case.smudges.as_ref()?.smear;
        let mut pane = Self::of_any(case);
        pane.alphas[0] = smear.roughness;
        Some(pane)
    }

    /// Returns the pane of any case; its faces are smooth if the case does not say otherwise.
    pub(crate) fn of_any(case: &Case) -> Self {
        let faces = case.layers().coatings().len();
        let roughness = case.roughness.clone().unwrap_or_else(|| vec![0.0; faces]);
        let case = Case { roughness: Some(roughness), ..case.clone() };
        Self::new(&case).expect("faces with a roughness")
    }

    /// Follows sample `index` of a pixel until it leaves, and chooses at each face with the probability of the light whether it passes
    /// or is reflected, and in the proportion of the shares whether it meets smudges: `choice` has a random number for each meeting, and for
    /// the smudges. Returns the exit and whether it is to the front; `None` if no light is left.
    pub(crate) fn walk(
        &self,
        of: (&PixelSeed, u32),
        origin: DVec3,
        d: DVec3,
        choice: impl Fn(usize) -> f64,
    ) -> Option<(Exit, bool)> {
        if let Some(smudges) = &self.smudges {
            let mut pane = Self { smudges: None, ..self.clone() };
            let smear = (choice(usize::MAX) < self.share(origin, d)).then_some(smudges.smear);
            pane.alphas[0] = smear.map_or(self.alphas[0], |smear| smear.roughness);
            let (mut exit, is_front) = pane.walk(of, origin, d, choice)?;
            let passes = if is_front { 1 } else { 2 };
            let passed = smear.map_or(1.0, |smear| smear.transmittance.powi(passes));
            exit.share.as_flattened_mut().iter_mut().for_each(|share| *share *= passed);
            return Some((exit, is_front));
        }
        let (mut meetings, mut scale) = (vec![], 1.0);
        let (mut face, mut inward) = (0usize, true);
        loop {
            let ways = [false, true].map(|reflects| {
                let all = [meetings.as_slice(), &[Meeting { face, inward, reflects }]].concat();
                self.follow(&all, of, origin, d)
            });
            let light = ways.each_ref().map(|exit| exit.weight().into_iter().sum::<f64>());
            let all = light[0] + light[1];
            if all * scale < 1e-7 {
                return None;
            }
            let reflects = choice(meetings.len()) * all < light[1];
            scale *= all / light[usize::from(reflects)];
            meetings.push(Meeting { face, inward, reflects });
            inward = inward != reflects;
            let next = if inward { face.checked_add(1) } else { face.checked_sub(1) };
            let Some(next) = next.filter(|next| *next < self.alphas.len()) else {
                let [passed, reflected] = ways;
                let mut exit = if reflects { reflected } else { passed };
                exit.share.as_flattened_mut().iter_mut().for_each(|share| *share *= scale);
                return Some((exit, inward));
            };
            face = next;
        }
    }

    /// Returns the distance of a face from face 0, m.
    fn depth_m(&self, number: usize) -> f64 {
        self.layers[..number].iter().map(|layer| layer.thickness_m).sum()
    }

    /// Moves a ray to a face. Returns the length of the way.
    fn reach(&self, number: usize, point: DVec3, d: DVec3) -> f64 {
        let depth_m = self.depth_m(number);
        if self.curvature_per_m == 0.0 {
            let turned = self.turned(number);
            let origin = self.pivot + depth_m * self.normal;
            let [from, d] = [point - origin, d].map(|v| turned.transpose() * v);
            let way = |height_m: f64| (height_m - from.dot(self.normal)) / d.dot(self.normal);
            // The face over the height field, by a fixed point: each step is shorter by the slope times the tangent.
            return (0..60).fold(way(0.0), |reached, _| {
                self.wave.map_or(reached, |wave| way(wave.at(from + reached * d).0))
            });
        }
        let radius_m = 1.0 / self.curvature_per_m;
        let from = point - (self.pivot - radius_m * self.normal);
        let (along, reach_m) = (from.dot(d), radius_m + depth_m);
        let root = (along * along - (from.length_squared() - reach_m * reach_m)).sqrt();
        // Of the two points of the sphere, the one near the pivot.
        let ways = [-along - root, -along + root];
        let near = |way: f64| (point + way * d).distance(self.pivot);
        if near(ways[0]) < near(ways[1]) { ways[0] } else { ways[1] }
    }

    /// Returns the rotation of a face against the first.
    fn turned(&self, number: usize) -> DMat3 {
        self.turned.as_ref().map_or(DMat3::IDENTITY, |turned| turned[number])
    }

    /// Returns two tangents and the unit normal of a face at a point.
    fn frame(&self, number: usize, point: DVec3) -> [DVec3; 3] {
        let turned = self.turned(number);
        let origin = self.pivot + self.depth_m(number) * self.normal;
        let from = point - self.pivot;
        let in_face = turned.transpose() * (point - origin);
        let waved = self.wave.map_or(DVec3::ZERO, |w| w.at(in_face).1 * w.across_crests);
        let n = (self.normal + self.curvature_per_m * from - waved).normalize();
        let of_pane = (DVec3::X - self.normal.x * self.normal).normalize();
        let across = (of_pane - of_pane.dot(n) * n).normalize();
        [across, n.cross(across), n].map(|axis| turned * axis)
    }

    /// Returns the point of face 0 that a ray meets, and its direction mirrored in the smooth face.
    pub(crate) fn mirrored(&self, origin: DVec3, d: DVec3) -> (DVec3, DVec3) {
        let point = origin + self.reach(0, origin, d) * d;
        (point, mirrored(d, self.frame(0, point)[2]))
    }

    /// Follows a ray through smooth faces.
    pub(crate) fn straight(&self, origin: DVec3, d: DVec3) -> Exit {
        let alphas = vec![0.0; self.alphas.len()];
        let smooth = Self { alphas, ..self.clone() };
        let meeting = |face| Meeting { face, inward: true, reflects: false };
        let meetings: Vec<Meeting> = (0..self.alphas.len()).map(meeting).collect();
        smooth.follow(&meetings, (&PixelSeed::new(0, 0, 0), 0), origin, d)
    }

    /// Returns the smear of a pane with smudges.
    pub(crate) fn smear(&self) -> Smear {
        self.smudges.as_ref().expect("a pane with smudges").smear
    }

    /// Returns the share of a ray's light that meets smudges.
    pub(crate) fn share(&self, origin: DVec3, d: DVec3) -> f64 {
        let from_pivot = origin + self.reach(0, origin, d) * d - self.pivot;
        self.smudges.as_ref().map_or(0.0, |smudges| smudges.share(self.axes, from_pivot))
    }

    /// True if the faces are no parallel planes or spheres.
    pub(crate) fn is_free(&self) -> bool {
        self.wave.is_some() || self.turned.is_some()
    }

    /// Follows sample `index` of a pixel along a path.
    pub(crate) fn follow(
        &self,
        meetings: &[Meeting],
        (seed, index): (&PixelSeed, u32),
        origin: DVec3,
        d: DVec3,
    ) -> Exit {
        let (mut point, mut d, mut share) = (origin, d.normalize(), [[1.0; 3]; 2]);
        // Coatings have the shares of the camera ray's angle; coated panes are flat.
        let cos_i = d.dot(self.normal);
        let mut before: Option<usize> = None;
        let ior = |layer: Option<usize>| {
            layer.and_then(|layer| self.layers.get(layer)).map_or(1.0, |layer| layer.ior)
        };
        for (k, &Meeting { face: number, inward, reflects }) in meetings.iter().enumerate() {
            let way_m = self.reach(number, point, d);
            // A flat ray in a bent pane may miss the inner sphere.
            if way_m.is_nan() {
                return Exit { point, direction: d, share: [[0.0; 3]; 2] };
            }
            point += way_m * d;
            if let Some(before) = before {
                let absorption = self.layers[before.min(number)].absorption_per_m;
                for share in &mut share {
                    (0..3).for_each(|c| share[c] *= (-absorption[c] * way_m).exp());
                }
            }
            before = Some(number);
            let [across, down, n] = self.frame(number, point);
            let [u, v, ..] = sample(&seed.of_meeting(k as u32), index);
            let alpha = self.alphas[number];
            let [x, y] = visible_slopes(alpha, [d.dot(across), d.dot(down), d.dot(n)], [u, v]);
            // The face's and the facet's normals on the far side of the light.
            let side = if inward { 1.0 } else { -1.0 };
            let m = side * (n + x * across + y * down).normalize();
            let n = side * n;
            let (near, far) = (ior(number.checked_sub(1)), ior(Some(number)));
            let (from, to) = if inward { (near, far) } else { (far, near) };
            let (refracted, r) = face(d, m, from, to);
            // Total reflection has no refracted direction.
            let is_total = !refracted.is_finite();
            let r = if is_total { [1.0; 2] } else { r };
            let (out, fresnel) = if reflects {
                (mirrored(d, m), r.map(|r| [r; 3]))
            } else {
                (refracted, r.map(|r| [1.0 - r; 3]))
            };
            let shares = match &self.coatings[number] {
                Some(coating) if reflects => {
                    // A facet that reflects totally keeps what the coating would let pass.
                    let (r, t) = (coating.reflectance(inward), &coating.transmittance);
                    let kept = |c: usize| if is_total { t.at(cos_i)[c] } else { 0.0 };
                    [[0, 1, 2].map(|c| r.at(cos_i)[c] + kept(c)); 2]
                }
                Some(coating) => [coating.transmittance.at(cos_i); 2],
                None => fresnel,
            };
            let leaves = out.dot(n) * if reflects { -1.0 } else { 1.0 };
            let is_possible = d.dot(n) > LEAST_COS
                && d.dot(m) > 0.0
                && leaves > LEAST_COS
                && (reflects || !is_total);
            let b = alpha * (1.0 - leaves * leaves).max(0.0).sqrt() / leaves;
            let seen = if is_possible { visible_share(b) } else { 0.0 };
            for (share, of_face) in share.iter_mut().zip(shares) {
                let of = |c: usize| if is_possible { of_face[c] * seen } else { 0.0 };
                (0..3).for_each(|c| share[c] *= of(c));
            }
            let straight = if reflects { mirrored(d, n) } else { d };
            d = if is_possible { out } else { straight };
        }
        Exit { point, direction: d, share }
    }
}

/// Least cosine of a direction to the normal of a face with which light goes on.
const LEAST_COS: f64 = 1e-4;

/// Returns the slopes of the facet that a ray with the direction `d` in a face's coordinates meets, for a point of the unit square.
fn visible_slopes(alpha: f64, [dx, dy, dz]: [f64; 3], [u, v]: [f32; 2]) -> [f64; 2] {
    let (x, y) = concentric(f64::from(u), f64::from(v));
    let square = (x * x + y * y).min(1.0 - 2f64.powi(-24));
    if alpha == 0.0 || square == 0.0 {
        return [0.0; 2];
    }
    let scale = (-(1.0 - square).ln() / square).sqrt();
    let of_all = [scale * x, scale * y];
    let tangent = [dx / dz, dy / dz];
    let length = tangent[0].hypot(tangent[1]);
    if length == 0.0 {
        return of_all.map(|slope| alpha * slope);
    }
    let away = tangent.map(|v| -v / length);
    let along = of_all[0] * away[0] + of_all[1] * away[1];
    let shift = visible_shift(along, alpha * length);
    [0, 1].map(|k| alpha * (of_all[k] + shift * away[k]))
}

/// Between white photographs, a pane with rough faces is white: the weights of all paths are 1 in the mean, without multiple
/// scattering within a face.
#[test]
fn rough_panes_lose_no_light() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    (case.film, case.spp, case.tolerance) = ([6, 4], 4096, 1e-7);
    for (alpha, tilt_deg, bow_radius_m) in [
        (0.01, [0.0, 0.0], None),
        (0.1, [0.0, 0.0], None),
        (0.05, [25.0, -20.0], None),
        (0.05, [10.0, 10.0], Some(3.0)),
    ] {
        (case.roughness, case.tilt_deg) = (Some(vec![alpha; 2]), tilt_deg);
        case.bow_radius_m = bow_radius_m;
        let pixels = case.render();
        let mut mean = 0.0;
        for pixel in &pixels {
            assert_eq!((pixel.mean[T], pixel.mean[CLEAN]), ([1.0; 3], [1.0; 3]));
            mean += f64::from(pixel.mean[I][0]) / pixels.len() as f64;
        }
        println!("alpha {alpha}, tilt {tilt_deg:?}, radius {bow_radius_m:?}: I is {mean:.6}");
        assert!((mean - 1.0).abs() < 2e-4, "{mean}");
    }
}

/// A far plane with radiance a + b x + c x^2 measures the variance of the directions of light: that of a smooth pane is a constant less.
///
/// A facet with slope s turns light through a face by (n - 1) s outside of the glass, and reflected light by 2 s before, and by
/// 2 n s within the glass. Each slope has the variance alpha^2 / 2.
#[test]
fn lobes_have_the_width_of_their_closed_form() {
    const DEPTH_M: f64 = 1e4;
    // The square of the tangent, on a photograph of 0.8 to each side.
    let tangent = |i: usize| ((i as f64 + 0.5) / 256.0 - 1.0) * 0.8;
    let square = |_: usize, _: usize| DEPTH_M;
    let photo = Photo::new([512, 4], [512, 4], [0.8; 2], square, |i, _| [tangent(i).powi(2); 3]);
    let mut case = Case::new(photo.clone(), photo);
    (case.film, case.spp, case.tolerance) = ([4, 4], 16_384, 1e-6);
    (case.aperture_m, case.focal_length_mm) = (0.0, 500.0);
    let alpha: f64 = 0.02;
    let variance = alpha * alpha / 2.0;
    let n: f64 = case.ior;
    let r = ((n - 1.0) / (n + 1.0)).powi(2);
    let through = 2.0 * (n - 1.0).powi(2) * variance;
    let mean = |case: &Case, layer: usize| {
        let pixels = case.render();
        pixels.iter().map(|p| f64::from(p.mean[layer][0])).sum::<f64>() / pixels.len() as f64
    };
    let smooth = [mean(&case, I) - mean(&case, GLASS), mean(&case, GLASS)];
    case.roughness = Some(vec![alpha; 2]);
    let rough = [mean(&case, I) - mean(&case, GLASS), mean(&case, GLASS)];
    let weight_of = |k: i32| (1.0 - r).powi(2) * r.powi(k);
    // t_k has 2 k reflections in the glass, and r_k has 2 k - 1.
    let inside = 4.0 * n * n * variance;
    let of_front: f64 =
        (0..4).map(|k| weight_of(2 * k) * (through + f64::from(2 * k) * inside)).sum();
    let of_back: f64 = r * 4.0 * variance
        + (1..4)
            .map(|k| weight_of(2 * k - 1) * (through + f64::from(2 * k - 1) * inside))
            .sum::<f64>();
    for (side, expected) in [of_front, of_back].into_iter().enumerate() {
        let found = rough[side] - smooth[side];
        println!("side {side}: {found:.4e}, closed form {expected:.4e}");
        assert!((found / expected - 1.0).abs() < 0.01, "{found:e} {expected:e}");
    }
}

/// A tiny roughness is a smooth pane. T and R are those of the smooth pane for every roughness.
#[test]
fn the_smooth_limit_is_the_smooth_pane() {
    let mut case = Case::new(bumpy(3, false), bumpy(4, false));
    (case.film, case.tilt_deg, case.absorption_per_m) = ([11, 8], [4.0, 15.0], [6.0, 2.0, 4.0]);
    let smooth = case.render();
    for (alpha, limit) in [(0.0, 1.0 / 128.0), (1e-7, 1.0 / 128.0), (0.05, f32::INFINITY)] {
        case.roughness = Some(vec![alpha; 2]);
        let mut worst = 0f32;
        for (pixel, expected) in case.render().iter().zip(&smooth) {
            assert_eq!(pixel.mean[T], expected.mean[T]);
            assert_eq!(pixel.mean[CLEAN], expected.mean[CLEAN]);
            for c in 0..3 {
                worst = worst.max((pixel.mean[I][c] - expected.mean[I][c]).abs());
            }
        }
        println!("alpha {alpha}: I within {worst:.1e} of the smooth pane");
        // A ray may fall on the other side of an edge.
        assert!(worst <= limit, "{worst}");
        assert!(alpha < 1e-3 || worst > 1e-3, "roughness has an effect");
    }
}

/// Between white photographs, a pane lacks at most the light that it states as lost, even where facets turn light to total
/// reflection or hide each other; no pixel is brighter than the photographs but by noise.
#[test]
fn lost_light_is_stated() {
    let mut case = Case::new(bumpy(1, true), bumpy(2, true));
    (case.film, case.spp) = ([6, 4], 4096);
    for (alpha, yaw_deg, tolerance) in [
        (0.02, 0.0, 7.6e-5),
        (0.02, 0.0, 0.02),
        (0.1, 40.0, 7.6e-5),
        (0.1, 60.0, 7.6e-5),
        (0.05, 69.0, 7.6e-5),
    ] {
        (case.roughness, case.tilt_deg) = (Some(vec![alpha; 2]), [0.0, yaw_deg]);
        case.tolerance = tolerance;
        let scene = case.scene();
        let (dropped, shadowed) = (scene.orders.dropped, scene.orders.shadowed);
        let pixels = case.render();
        let sum: f64 = pixels.iter().map(|pixel| f64::from(pixel.mean[I][0])).sum();
        let missing = 1.0 - sum / pixels.len() as f64;
        println!(
            "alpha {alpha}, yaw {yaw_deg}: {missing:.1e} of the light is missing, stated {shadowed:.1e}; misplaced {dropped:?}"
        );
        assert!(missing < shadowed + 2e-4 && missing > -2e-4, "{missing}");
        // The bound is that of the worst pixel, and the balance of orders hands on a part.
        assert!(shadowed < 15.0 * missing.max(0.0) + 1e-3, "{shadowed}");
    }
}
