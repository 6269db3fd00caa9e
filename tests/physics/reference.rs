//! A brute-force f64 renderer, with the tracer's sample points.

mod balance;

use crate::bow::BentPane;
use crate::case::{Apex, Case};
use crate::cover::Place;
use crate::optics::{Exit, Pane, mirrored};
use crate::rough::RoughReference;
use crate::sheet::Sheet;
use balance::scattered_weight;
use glam::{DMat3, DVec3};
use render::trace::{
    Cut, Meeting, Order, PixelMeans, PixelSeed, RoughPane, Scene, Stack, StackOptics, sample,
};

/// Nodes and weights of the Gauss-Legendre rule with three points on [-1, 1], exact for polynomials of degree 5.
const GAUSS_LEGENDRE: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];

/// The faces that a path meets, the pixel and the number of its sample.
type Scattered<'a> = (&'a [&'a [Meeting]], (&'a PixelSeed, u32));

/// Round trips after which the light of a single layer is negligible.
const LAST_ROUND_TRIP: u32 = 60;

/// The f64 renderer of a case, with the tracer's sample points and choice of orders.
pub(crate) struct Reference<'a> {
    case: &'a Case,
    scene: &'a Scene,
    front: Sheet<'a>,
    back: Sheet<'a>,
    pane: Pane,
    /// The clean pane, and the pane under smudges, each with the light of the paths that are not followed.
    rough: Option<(RoughReference, Vec<Cut>)>,
    smeared: Option<(RoughReference, Vec<Cut>)>,
    /// Rotation and shift from world coordinates x to the back camera's coordinates `rotation * x + shift`.
    to_back: (DMat3, DVec3),
}

impl<'a> Reference<'a> {
    pub(crate) fn new(case: &'a Case, scene: &'a Scene) -> Self {
        let (normal, distance_m) = case.pane();
        let to_back = match case.apex {
            Apex::Camera => (DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)), DVec3::ZERO),
            Apex::Mirror => {
                let flip = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
                let householder = |x: DVec3| flip * (x - 2.0 * x.dot(normal) * normal);
                let rotation = DMat3::from_cols(
                    householder(DVec3::X),
                    householder(DVec3::Y),
                    householder(DVec3::Z),
                );
                (rotation, rotation * (-2.0 * distance_m * normal))
            }
        };
        Self {
            case,
            scene,
            front: Sheet::new(&case.front),
            back: Sheet::new(&case.back),
            pane: Pane {
                normal,
                distance_m,
                thickness_m: case.thickness_m,
                ior: case.ior,
                absorption_per_m: case.absorption_per_m,
            },
            rough: RoughReference::new(case).zip(scene.rough.as_ref().map(RoughPane::cuts)),
            smeared: RoughReference::smeared(case)
                .zip(scene.smeared.as_ref().map(|smeared| smeared.pane().cuts())),
            to_back,
        }
    }

    /// Returns the direction of a film point (px), with z = 1.
    pub(crate) fn pinhole(&self, u: f64, v: f64) -> DVec3 {
        let [w, h] = self.case.film.map(f64::from);
        let diagonal = 36.0f64.hypot(24.0) / (2.0 * self.case.focal_length_mm);
        DVec3::new(
            (2.0 * u / w - 1.0) * diagonal * w / w.hypot(h),
            (2.0 * v / h - 1.0) * diagonal * h / w.hypot(h),
            1.0,
        )
    }

    /// Returns a sample's pinhole direction, and the origin and direction of its lens ray.
    pub(crate) fn camera(&self, x: u32, y: u32, point: [f32; 4]) -> (DVec3, DVec3, DVec3) {
        let offset = |u: f32| match &self.scene.film.filter {
            Some(table) => f64::from(table.offset_px(u)),
            None => f64::from(u) - 0.5,
        };
        let u = f64::from(x) + 0.5 + offset(point[0]);
        let v = f64::from(y) + 0.5 + offset(point[1]);
        let pinhole = self.pinhole(u, v);
        let (a, b) = concentric(f64::from(point[2]), f64::from(point[3]));
        let lens = self.case.aperture_m * DVec3::new(a, b, 0.0);
        let direction = if self.case.focus_m.is_infinite() {
            pinhole
        } else {
            self.case.focus_m * pinhole - lens
        };
        (pinhole.normalize(), lens, direction.normalize())
    }

    /// Returns the radiance of a sample of I whose light `pane` lets choose its path at random.
    pub(crate) fn walked(
        &self,
        pane: &RoughReference,
        [x, y]: [u32; 2],
        (seed, index): (&PixelSeed, u32),
        choice: impl Fn(usize) -> f64,
    ) -> [f64; 3] {
        let (_, origin, d) = self.camera(x, y, sample(seed, index));
        let Some((exit, is_front)) = pane.walk((seed, index), origin, d, choice) else {
            return [0.0; 3];
        };
        let order = if is_front { Order::Transmitted(0) } else { Order::Reflected(0) };
        let (radiance, weight) = self.after(order, exit);
        [0, 1, 2].map(|c| radiance[c] * weight[c])
    }

    /// Returns the factor of smudges in the weight of an order, of the clean pane or of the pane under them.
    fn smudge_factor(&self, order: Order, origin: DVec3, d: DVec3, is_smeared: bool) -> f64 {
        let Some((pane, _)) = &self.smeared else { return 1.0 };
        if self.case.covered.place(self.case, origin, d) != Place::Glass {
            return 1.0;
        }
        let (share, smear) = (pane.share(origin, d), pane.smear());
        let passes = if matches!(order, Order::Transmitted(_)) { 1 } else { 2 };
        if is_smeared { share * smear.transmittance.powi(passes) } else { 1.0 - share }
    }

    /// Returns the radiance and the weight along an order, at the place where the ray meets the pane's plane. `rough` has the faces
    /// of its path, the pixel and the number of the sample; without it, the faces are smooth. A path through the smeared pane `is_smeared`.
    fn behind_pane(
        &self,
        (order, carries_dropped): (Order, bool),
        origin: DVec3,
        d: DVec3,
        (rough, is_smeared): (Option<Scattered<'_>>, bool),
    ) -> ([f64; 3], [f64; 3]) {
        let covered = &self.case.covered;
        let pane = if is_smeared { &self.smeared } else { &self.rough };
        match (covered.place(self.case, origin, d), order) {
            (Place::Glass, _) => match (pane, rough) {
                (Some((pane, cuts)), Some((paths, of))) => {
                    let follow = |path: &&[Meeting]| pane.follow(path, of, origin, d);
                    let exits: Vec<Exit> = paths.iter().map(follow).collect();
                    let side = usize::from(matches!(order, Order::Reflected(_)));
                    let exit = self.mean_line(&exits, side == 1);
                    let weight = scattered_weight(
                        (pane, cuts),
                        side,
                        carries_dropped,
                        (paths, of),
                        origin,
                        d,
                    );
                    (self.after(order, exit).0, weight)
                }
                (Some((pane, _)), None) if pane.is_free() => {
                    self.after(order, pane.straight(origin, d))
                }
                _ => self.behind_glass((order, carries_dropped), origin, d),
            },
            (Place::Frame, Order::Transmitted(0)) if !is_smeared => {
                let edges = covered.edges.as_ref().expect("a frame has edges");
                (edges.frame_radiance.map(f64::from), [1.0; 3])
            }
            (Place::Beside, Order::Transmitted(0)) if !is_smeared => {
                (self.seen_in_front(origin, d), [1.0; 3])
            }
            _ => ([0.0; 3], [0.0; 3]),
        }
    }

    fn behind_glass(
        &self,
        (order, carries_dropped): (Order, bool),
        origin: DVec3,
        d: DVec3,
    ) -> ([f64; 3], [f64; 3]) {
        if let (Some(stack), Some(optics)) = (&self.case.stack, &self.scene.stack) {
            return self.behind_stack((stack, optics), order, origin, d);
        }
        let exit = |order: Order| match self.bent() {
            Some(bent) => bent.follow(origin, d, order),
            None => self.pane.exit(origin, d, order),
        };
        let (radiance, mut weight) = self.after(order, exit(order));
        let longer: Box<dyn Iterator<Item = Order>> = match order {
            Order::Transmitted(k) => Box::new((k + 1..k + LAST_ROUND_TRIP).map(Order::Transmitted)),
            Order::Reflected(k) => Box::new((k + 1..k + LAST_ROUND_TRIP).map(Order::Reflected)),
        };
        for order in longer.filter(|_| carries_dropped) {
            let light = exit(order).weight();
            (0..3).for_each(|c| weight[c] += light[c]);
            if light.iter().all(|light| *light < 1e-12) {
                break;
            }
        }
        (radiance, weight)
    }

    /// Joins rays that have left the pane: all have their mean line, weighted by their light.
    fn mean_line(&self, exits: &[Exit], is_reflected: bool) -> Exit {
        if let [exit] = exits {
            return Exit { ..*exit };
        }
        // The line meets the plane z = 0 in a world that reflected rays see mirrored.
        let n = self.pane.normal;
        let seen = |point: DVec3, direction: DVec3| {
            if is_reflected {
                let height_m = point.dot(n) - self.pane.distance_m;
                (point - 2.0 * height_m * n, mirrored(direction, n))
            } else {
                (point, direction)
            }
        };
        let mut share = [[0.0; 3]; 2];
        let (mut all, mut point, mut direction) = (0.0, DVec3::ZERO, DVec3::ZERO);
        for exit in exits {
            let light: f64 = exit.weight().into_iter().sum();
            let (at, d) = seen(exit.point, exit.direction);
            let d = d / d.z;
            (point, direction) = (point + light * (at - at.z * d), direction + light * d);
            all += light;
            (0..2).for_each(|q| (0..3).for_each(|c| share[q][c] += exit.share[q][c]));
        }
        let (point, direction) = if all > 0.0 {
            seen(point / all, (direction / all).normalize())
        } else {
            (exits[0].point, exits[0].direction)
        };
        Exit { point, direction, share }
    }

    /// Returns the radiance along a ray that has left the pane, and its weight.
    fn after(&self, order: Order, exit: Exit) -> ([f64; 3], [f64; 3]) {
        let radiance = match order {
            Order::Transmitted(_) => self.seen_in_front(exit.point, exit.direction),
            Order::Reflected(_) => self.seen_in_back(exit.point, exit.direction),
        };
        (radiance, exit.weight())
    }

    fn bent(&self) -> Option<BentPane> {
        Some(BentPane {
            normal: self.pane.normal,
            pivot: self.case.distance_m * DVec3::Z,
            radius_m: self.case.bow_radius_m?,
            thickness_m: self.pane.thickness_m,
            ior: self.pane.ior,
            absorption_per_m: self.pane.absorption_per_m,
        })
    }

    /// [`Self::behind_glass`] of a stack, by the closed forms in f64, which are compared with rays traced from face to face elsewhere.
    fn behind_stack(
        &self,
        (stack, optics): (&Stack, &StackOptics),
        order: Order,
        origin: DVec3,
        d: DVec3,
    ) -> ([f64; 3], [f64; 3]) {
        let (side, index) = match order {
            Order::Transmitted(k) => (0, k as usize),
            Order::Reflected(k) => (1, k as usize),
        };
        let (n, cos_i) = (self.pane.normal, d.dot(self.pane.normal));
        let followed = optics.orders(side);
        let weights = stack.weights(&[cos_i], 1e-12, 64);
        let mut weight = weights[followed[index]][0];
        if index + 1 == followed.len() {
            // The last order has the light of those that are not followed.
            let total = stack.totals(cos_i)[1 - side];
            for c in 0..3 {
                let others = &followed[..index];
                weight[c] = total[c] - others.iter().map(|o| weights[*o][0][c]).sum::<f64>();
            }
        }
        let start = origin + stack.kappa_m(followed[index], cos_i) * n;
        let radiance = if side == 0 {
            self.seen_in_front(start, d)
        } else {
            let start = start - 2.0 * (start.dot(n) - self.pane.distance_m) * n;
            self.seen_in_back(start, d - 2.0 * cos_i * n)
        };
        (radiance, weight)
    }

    /// Returns the z coordinate of the first surface of the front along an order of a ray, without outline and cards.
    pub(crate) fn front_depth_m(&self, order: Order, origin: DVec3, d: DVec3) -> f64 {
        let (start, d) = match (&self.case.stack, self.bent()) {
            (Some(stack), _) => {
                let (n, cos_i) = (self.pane.normal, d.dot(self.pane.normal));
                (origin + stack.kappa_m(&stack.straight(), cos_i) * n, d)
            }
            (None, Some(bent)) => {
                let exit = bent.follow(origin, d, order);
                (exit.point, exit.direction)
            }
            (None, None) => {
                let exit = self.pane.exit(origin, d, order);
                (exit.point, exit.direction)
            }
        };
        self.front.first_hit(start, d).map_or(f64::INFINITY, |hit| hit.z)
    }

    fn seen_in_front(&self, origin: DVec3, d: DVec3) -> [f64; 3] {
        self.through_cards(false, [origin, d], self.front.seen(origin, d))
    }

    fn seen_in_back(&self, origin: DVec3, d: DVec3) -> [f64; 3] {
        let (rotation, shift) = self.to_back;
        let seen = self.back.seen(rotation * origin + shift, rotation * d);
        self.through_cards(true, [origin, d], seen)
    }

    /// Lays the cards of a side over the radiance of its surface, which a ray of the world meets after some lengths of `d`.
    fn through_cards(
        &self,
        is_back: bool,
        [origin, d]: [DVec3; 2],
        (mut radiance, surface): ([f64; 3], f64),
    ) -> [f64; 3] {
        for card in &self.case.covered.cards[usize::from(is_back)] {
            if let Some((at, [r, g, b, alpha])) = card.seen(is_back, origin, d)
                && at < surface
            {
                let laid = |behind: f64, card: f64| card + (1.0 - alpha) * behind;
                radiance = [laid(radiance[0], r), laid(radiance[1], g), laid(radiance[2], b)];
            }
        }
        radiance
    }

    /// Renders the four layers of a pixel, to compare them with those that the tracer rendered.
    pub(crate) fn pixel(&self, x: u32, y: u32, traced: &PixelMeans) -> [[f64; 3]; 4] {
        let spp = self.scene.spp;
        let seed = PixelSeed::new(self.scene.seed, x, y);
        let add = |sum: &mut [f64; 3], value: [f64; 3], weight: [f64; 3], n: u32| {
            for c in 0..3 {
                sum[c] += value[c] * weight[c] / f64::from(n);
            }
        };
        let mut layers = [[0.0; 3]; 4];
        let orders = &self.scene.orders;
        let smeared = self.scene.smeared.as_ref();
        let plans = [(orders, self.scene.rough.as_ref(), false)];
        let smeared = smeared.map(|smeared| (&smeared.orders, Some(smeared.pane()), true));
        for (plan, pane, is_smeared) in plans.into_iter().chain(smeared) {
            let followed = plan.front.iter().chain(&plan.back);
            let first = if is_smeared { orders.front.len() + orders.back.len() } else { 0 };
            let dimness = |number| self.scene.zones.dimness((x, y), first + number);
            let thinnings: Vec<u32> =
                followed.clone().enumerate().map(|(k, of)| of.thinning(dimness(k))).collect();
            let balance = self.balance((plan, pane, is_smeared), &thinnings, (x, y), &seed);
            for (number, followed) in followed.enumerate() {
                let taken = samples_of(thinnings[number], spp);
                let index = number.checked_sub(plan.front.len()).unwrap_or(number);
                let order = followed.order;
                let paths = pane.map(|pane| pane.paths(order, index));
                for s in (0..spp).filter(|s| s % 256 < taken.1) {
                    let (_, lens, d) = self.camera(x, y, sample(&seed, s));
                    let scattered = (paths.as_deref().map(|paths| (paths, (&seed, s))), is_smeared);
                    let of_order = (order, followed.carries_dropped);
                    let (radiance, weight) = self.behind_pane(of_order, lens, d, scattered);
                    let factor = self.smudge_factor(order, lens, d, is_smeared);
                    let balance = balance.get(&(s / 256, thinnings[number])).unwrap_or(&[1.0; 3]);
                    let weight = [0, 1, 2].map(|c| weight[c] * factor * balance[c]);
                    add(&mut layers[0], radiance, weight, taken.0);
                    match order {
                        Order::Transmitted(0) if !is_smeared => {
                            // T sees through the smooth pane.
                            let smooth = (None, false);
                            let (bare, _) = self.behind_pane((order, false), lens, d, smooth);
                            add(&mut layers[1], bare, [1.0; 3], taken.0);
                        }
                        Order::Transmitted(_) => {}
                        Order::Reflected(_) => add(&mut layers[2], radiance, weight, taken.0),
                    }
                }
            }
        }
        let clean = orders.clean_spp(spp);
        // The tracer samples R of a patch that edges or cards cover in part. R in closed form states no error.
        let covered = &self.case.covered;
        let is_covered = covered.edges.is_some() || !covered.cards[1].is_empty();
        let of_r = [traced.mean[3], traced.half[3], traced.quarter[3]];
        let mut has_closed_form = self.case.apex == Apex::Mirror
            && self.case.bow_radius_m.is_none()
            && self.case.wave.is_none()
            && (!is_covered || (of_r[0] == of_r[1] && of_r[0] == of_r[2]));
        for s in 0..clean {
            let (pinhole, _, _) = self.camera(x, y, sample(&seed, s));
            if covered.place(self.case, DVec3::ZERO, pinhole) != Place::Glass {
                has_closed_form = false;
                continue;
            }
            let (point, mirrored) = self.mirrored(pinhole);
            has_closed_form &=
                covered.cards[1].iter().all(|c| c.seen(true, point, mirrored).is_none());
            let seen = self.seen_in_back(point, mirrored);
            add(&mut layers[3], seen, [1.0; 3], clean);
            if has_closed_form {
                let of_direction = self.back.radiance(self.to_back.0 * mirrored);
                let close = (0..3).all(|c| (seen[c] - of_direction[c]).abs() < 1e-6);
                assert!(close, "R depends on depth: {seen:?}, {of_direction:?}");
            }
        }
        if has_closed_form {
            layers[3] = self.integrated_reflection(x, y);
        }
        layers
    }

    /// Returns the point of the pane that a ray from the pinhole meets, and the ray's mirrored direction.
    fn mirrored(&self, pinhole: DVec3) -> (DVec3, DVec3) {
        if let Some(bent) = self.bent() {
            let point = bent.entry(DVec3::ZERO, pinhole);
            return (point, bent.reflected(point, pinhole));
        }
        if let (Some((pane, _)), true) = (&self.rough, self.case.wave.is_some()) {
            return pane.mirrored(DVec3::ZERO, pinhole);
        }
        let (n, distance) = (self.pane.normal, self.pane.distance_m);
        (distance / pinhole.dot(n) * pinhole, pinhole - 2.0 * pinhole.dot(n) * n)
    }

    /// Integrates R over the filter of a pixel. The radiance of apex `mirror` depends on the direction alone (checked above) and
    /// is bilinear between texels, so a Gauss-Legendre rule between texel centres has no error but that of rounding.
    fn integrated_reflection(&self, x: u32, y: u32) -> [f64; 3] {
        let gaussian = self.scene.film.filter.is_some();
        let radius = if gaussian { 2.0 } else { 0.5 };
        let center = [f64::from(x) + 0.5, f64::from(y) + 0.5];
        let direction = |u: f64, v: f64| {
            let (_, mirrored) = self.mirrored(self.pinhole(u, v));
            self.to_back.0 * mirrored
        };
        let texel = |k: usize, u: f64| {
            let d =
                direction(if k == 0 { u } else { center[0] }, if k == 1 { u } else { center[1] });
            self.back.texel(k, d)
        };
        let axes = [0, 1].map(|k| {
            let (from, to) = (center[k] - radius, center[k] + radius);
            let (a, b) = (texel(k, from), texel(k, to));
            let mut ends: Vec<f64> =
                (0..=16).map(|i| from + f64::from(i) / 16.0 * (to - from)).collect();
            let whole = a.min(b).ceil() as i64..=a.max(b).floor() as i64;
            ends.extend(whole.map(|t| from + (t as f64 - a) / (b - a) * (to - from)));
            ends.sort_by(f64::total_cmp);
            let mut nodes = vec![];
            for pair in ends.windows(2) {
                for (at, weight) in GAUSS_LEGENDRE {
                    let u = 0.5 * ((pair[0] + pair[1]) + at * (pair[1] - pair[0]));
                    let off = u - center[k];
                    let density = if gaussian { (-2.0 * off * off).exp() } else { 1.0 };
                    nodes.push((u, weight * density * (pair[1] - pair[0])));
                }
            }
            let all: f64 = nodes.iter().map(|(_, weight)| weight).sum();
            nodes.into_iter().map(|(u, weight)| (u, weight / all)).collect::<Vec<_>>()
        });
        let mut sum = [0.0; 3];
        for (v, of_row) in &axes[1] {
            for (u, of_column) in &axes[0] {
                let radiance = self.back.radiance(direction(*u, *v));
                (0..3).for_each(|c| sum[c] += of_row * of_column * radiance[c]);
            }
        }
        sum
    }
}

/// Returns the number of samples of an order with this thinning in total, and in each block of at most 256.
fn samples_of(thinning: u32, spp: u32) -> (u32, u32) {
    let block = spp.min(256);
    let of_block = (block / thinning).max(1);
    (of_block * (spp / block), of_block)
}

/// Maps the unit square to the unit disc by Shirley and Chiu's concentric map.
pub(crate) fn concentric(u: f64, v: f64) -> (f64, f64) {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return (0.0, 0.0);
    }
    let (radius, angle) = if a.abs() > b.abs() {
        (a, std::f64::consts::FRAC_PI_4 * b / a)
    } else {
        (b, std::f64::consts::FRAC_PI_2 - std::f64::consts::FRAC_PI_4 * a / b)
    };
    (radius * angle.cos(), radius * angle.sin())
}
