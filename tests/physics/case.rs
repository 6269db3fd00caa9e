//! Small scenes with the parameters of a scene line, and their rendering.

use crate::cover::Covered;
use crate::smudges::Smudged;
use glam::{DMat3, DVec3};
use glasshouse_line::label::LabelSet;
use glasshouse_line::layer::PerLayer;
use render::trace::{
    Bow, FilmPlane, FilterTable, Grid, Isa, Lens, OrderPlan, PixelMeans, Pose, RoughPane,
    RoughShape, Sampling, Scene, Slab, SmearedPane, Stack, StackLayer, StackOptics, Texture, Tile,
    TileResult, View, Wave, Zones, trace_tile,
};

/// Indices of the layers.
pub(crate) const I: usize = 0;
pub(crate) const T: usize = 1;
pub(crate) const GLASS: usize = 2;
pub(crate) const CLEAN: usize = 3;

/// An RGB-D photograph; intrinsics are in pixels with the image's corner at (0, 0).
#[derive(Clone, Debug)]
pub(crate) struct Photo {
    pub(crate) size: [usize; 2],
    /// 1/z of each pixel, rounded as the tracer stores it.
    pub(crate) w: Vec<f32>,
    pub(crate) focal_px: [f64; 2],
    pub(crate) center_px: [f64; 2],
    pub(crate) texture_size: [usize; 2],
    pub(crate) texels: Vec<[f32; 4]>,
}

impl Photo {
    /// Makes a photograph from the tangents of its half fields of view, and from depth and radiance at (i, j).
    pub(crate) fn new(
        size: [usize; 2],
        texture_size: [usize; 2],
        tan: [f64; 2],
        depth_m: impl Fn(usize, usize) -> f64,
        radiance: impl Fn(usize, usize) -> [f64; 3],
    ) -> Self {
        let pixels = |[nx, ny]: [usize; 2]| (0..nx * ny).map(move |q| (q % nx, q / nx));
        let half = size.map(|n| n as f64 / 2.0);
        Self {
            size,
            w: pixels(size).map(|(i, j)| (1.0 / depth_m(i, j)) as f32).collect(),
            focal_px: [half[0] / tan[0], half[1] / tan[1]],
            center_px: half,
            texture_size,
            texels: pixels(texture_size)
                .map(|(i, j)| {
                    let [r, g, b] = radiance(i, j).map(|v| v as f32);
                    [r, g, b, 0.0]
                })
                .collect(),
        }
    }

    /// Makes a plane with constant depth and colour.
    pub(crate) fn flat(depth_m: f64, radiance: [f64; 3]) -> Self {
        Self::new([4, 4], [4, 4], [0.4; 2], |_, _| depth_m, |_, _| radiance)
    }

    fn view(&self, pose: Pose, mirrored: bool) -> View {
        let [nx, ny] = self.size;
        let [fx, fy] = self.focal_px;
        View {
            grid: Grid::new(nx, ny, self.w.clone()).into(),
            texture: Texture::new(self.texture_size[0], self.texture_size[1], &self.texels).into(),
            focal_px: [if mirrored { -fx } else { fx }, fy],
            principal: self.center_px.map(|c| c - 0.5),
            pose,
            photograph_size: (nx, ny),
        }
    }
}

/// Position of the back photograph's camera.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) enum Apex {
    Mirror,
    Camera,
}

/// Makes a photograph of random depths of 1 to 3 m, white or of random colours, that is narrower than the film.
pub(crate) fn bumpy(key: u64, is_white: bool) -> Photo {
    let colour = move |i: usize, j: usize| {
        [0, 1, 2].map(|c| if is_white { 1.0 } else { noise(i, j, key + c) })
    };
    let depth = move |i: usize, j: usize| 1.0 + 2.0 * noise(i, j, key);
    Photo::new([12, 12], [20, 20], [0.3; 2], depth, colour)
}

/// A scene; [`Case::new`] chooses the paper's camera and glass, and a small film.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    pub(crate) seed: u64,
    pub(crate) spp: u32,
    pub(crate) film: [u32; 2],
    pub(crate) gaussian: bool,
    pub(crate) focal_length_mm: f64,
    pub(crate) aperture_m: f64,
    pub(crate) focus_m: f64,
    pub(crate) distance_m: f64,
    pub(crate) thickness_m: f64,
    pub(crate) ior: f64,
    pub(crate) absorption_per_m: [f64; 3],
    /// Layers and coatings in place of thickness, index and absorption.
    pub(crate) stack: Option<Stack>,
    /// Radius of a bent pane.
    pub(crate) bow_radius_m: Option<f64>,
    /// Waves of the faces: amplitude and length, m, and the direction across the crests, degrees.
    pub(crate) wave: Option<[f64; 3]>,
    /// Rotation of each face against the first, degrees: pitch and yaw.
    pub(crate) turned_deg: Vec<[f64; 2]>,
    /// Roughness of each face.
    pub(crate) roughness: Option<Vec<f64>>,
    /// Smudges on the front face.
    pub(crate) smudges: Option<Smudged>,
    /// Objects that cover a part of the picture.
    pub(crate) covered: Covered,
    pub(crate) tilt_deg: [f64; 2],
    pub(crate) apex: Apex,
    pub(crate) tolerance: f64,
    /// False if all orders stay apart.
    pub(crate) joins: bool,
    pub(crate) labels: LabelSet,
    pub(crate) front: Photo,
    pub(crate) back: Photo,
}

impl Case {
    pub(crate) fn new(front: Photo, back: Photo) -> Self {
        Self {
            seed: 7,
            spp: 256,
            film: [16, 16],
            gaussian: false,
            focal_length_mm: 55.0,
            aperture_m: 0.00893,
            focus_m: 2.5,
            distance_m: 0.3,
            thickness_m: 0.01,
            ior: 1.6,
            absorption_per_m: [0.0; 3],
            stack: None,
            bow_radius_m: None,
            wave: None,
            turned_deg: vec![],
            roughness: None,
            smudges: None,
            covered: Covered::default(),
            tilt_deg: [0.0; 2],
            apex: Apex::Mirror,
            tolerance: 7.6e-5,
            joins: true,
            labels: LabelSet::default(),
            front,
            back,
        }
    }

    pub(crate) fn tan_half_fov(&self) -> [f64; 2] {
        FilmPlane::tan_half_fov(self.film[0], self.film[1], self.focal_length_mm)
    }

    /// Returns the pane's normal and the distance from the lens centre to the plane of its front face, m.
    pub(crate) fn pane(&self) -> (DVec3, f64) {
        let [pitch, yaw] = self.tilt_deg.map(f64::to_radians);
        let normal = DMat3::from_rotation_y(yaw) * (DMat3::from_rotation_x(pitch) * DVec3::Z);
        (normal, self.distance_m * normal.z)
    }

    /// Returns the rotation of the pane.
    fn rotation([pitch_deg, yaw_deg]: [f64; 2]) -> DMat3 {
        let [pitch, yaw] = [pitch_deg, yaw_deg].map(f64::to_radians);
        DMat3::from_rotation_y(yaw) * DMat3::from_rotation_x(pitch)
    }

    /// Returns the rotation of each face against the first.
    pub(crate) fn turned(&self) -> Option<Vec<DMat3>> {
        let pane = Self::rotation(self.tilt_deg);
        let of = |deg: &[f64; 2]| pane * Self::rotation(*deg) * pane.transpose();
        (!self.turned_deg.is_empty()).then(|| self.turned_deg.iter().map(of).collect())
    }

    /// Returns the unit vectors of the pane that point right and down without a tilt.
    pub(crate) fn axes(&self) -> [DVec3; 2] {
        let turned = Self::rotation(self.tilt_deg);
        [turned * DVec3::X, turned * DVec3::Y]
    }

    /// Returns the waves of the pane.
    pub(crate) fn waves(&self) -> Option<Wave> {
        let [amplitude_m, length_m, direction_deg] = self.wave?;
        let turned = Self::rotation(self.tilt_deg);
        let (sin, cos) = direction_deg.to_radians().sin_cos();
        let across_crests = turned * DVec3::new(cos, sin, 0.0);
        Some(Wave { amplitude_m, length_m, across_crests, distance_m: self.distance_m })
    }

    /// Returns a lower bound of the cosines of incidence over film, filter and lens.
    pub(crate) fn steepest_cos(&self) -> f64 {
        let (normal, _) = self.pane();
        let beyond_px = if self.gaussian { 2.0 } else { 0.0 };
        let spread = self.aperture_m / self.focus_m;
        let reach = [0, 1].map(|k| {
            self.tan_half_fov()[k] * (1.0 + 2.0 * beyond_px / f64::from(self.film[k])) + spread
        });
        let corner =
            |x: f64, y: f64| DVec3::new(x * reach[0], y * reach[1], 1.0).normalize().dot(normal);
        [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)]
            .into_iter()
            .map(|(x, y)| corner(x, y))
            .fold(1.0, f64::min)
    }

    /// Returns cosines of incidence on a grid that covers film and lens.
    fn cosines(&self) -> Vec<f64> {
        let (normal, _) = self.pane();
        let [tx, ty] = self.tan_half_fov();
        let spread = self.aperture_m / self.focus_m;
        let mut cosines = vec![];
        for a in 0..=32 {
            for b in 0..=32 {
                let at = |k: i32, t: f64| (f64::from(k) / 16.0 - 1.0) * (t + spread);
                cosines.push(DVec3::new(at(a, tx), at(b, ty), 1.0).normalize().dot(normal));
            }
        }
        cosines.push(normal.z);
        cosines
    }

    /// Returns the layers of the pane; a plain one has one.
    pub(crate) fn layers(&self) -> Stack {
        self.stack.clone().unwrap_or_else(|| {
            let layer = StackLayer {
                thickness_m: self.thickness_m,
                ior: self.ior,
                absorption_per_m: self.absorption_per_m,
            };
            Stack::new(vec![layer], vec![None; 2])
        })
    }

    /// Makes the tracer's scene.
    pub(crate) fn scene(&self) -> Scene {
        let (normal, distance_m) = self.pane();
        let slab = Slab {
            normal,
            plane_distance_m: distance_m,
            thickness_m: self.thickness_m,
            ior: self.ior,
            absorption_per_m: self.absorption_per_m,
        };
        let front = self.front.view(Pose::Aligned { extra_m: 0.0 }, false);
        // Mirrored coordinates are X' = M X + 2 D n; the capture coordinates of apex `camera` are
        // diag(-1, 1, -1) (M X' + 2 D n). The view's negative focal length changes the sign of x.
        let pose = match self.apex {
            Apex::Mirror => Pose::Aligned { extra_m: 0.0 },
            Apex::Camera if normal == DVec3::Z => Pose::Aligned { extra_m: 2.0 * distance_m },
            Apex::Camera => {
                let flip = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
                let mirror = DMat3::IDENTITY
                    - DMat3::from_cols(
                        2.0 * normal.x * normal,
                        2.0 * normal.y * normal,
                        2.0 * normal.z * normal,
                    );
                Pose::General {
                    rotation: flip * mirror,
                    translation_m: flip * (2.0 * distance_m * normal),
                }
            }
        };
        let back = self.back.view(pose, true);
        let radiance = [&front, &back].map(|view: &View| f64::from(view.texture.max_radiance()));
        let cosines = self.cosines();
        let between = [self.steepest_cos(), cosines.iter().copied().fold(0.0, f64::max)];
        // Between two directions of the grid, the cosine may be larger.
        let between = [between[0], (between[1] + 1e-3).min(1.0)];
        let (stack, mut orders) = match &self.stack {
            None => (None, OrderPlan::new(&slab, &cosines, radiance, self.tolerance)),
            Some(stack) => {
                let (stack, orders) = StackOptics::new(stack, between, radiance, self.tolerance);
                (Some(stack), orders)
            }
        };
        let bow = self
            .bow_radius_m
            .map(|radius_m| Bow { curvature_per_m: 1.0 / radius_m, distance_m: self.distance_m });
        let wave = self.waves();
        let layers = self.layers();
        let turned = self.turned();
        let smudges = self.smudges.as_ref().map(|smudges| smudges.tracer(self.axes()));
        let shape = RoughShape {
            slab: &slab,
            distance_m: self.distance_m,
            bow: bow.as_ref(),
            wave: wave.as_ref(),
            turned: turned.as_deref(),
        };
        let even = || vec![0.0; layers.coatings().len()];
        let smeared = smudges.map(|smudges| {
            let alphas = self.roughness.clone().unwrap_or_else(even);
            SmearedPane::new(&layers, &alphas, shape, between, radiance, self.tolerance, &smudges)
        });
        let smooth = || shape.is_free().then(even);
        let rough = self.roughness.clone().or_else(smooth).map(|alphas| {
            let (pane, of_paths) =
                RoughPane::new(&layers, &alphas, shape, between, radiance, self.tolerance);
            orders = of_paths;
            pane
        });
        let mut scene = Scene {
            first_reflection_alone: false,
            target_error: None,
            layers: PerLayer([true; 4]),
            labels: self.labels,
            seed: self.seed,
            sampling: Sampling::Sobol,
            spp: self.spp,
            film: FilmPlane {
                width: self.film[0],
                height: self.film[1],
                tan_half_fov: self.tan_half_fov(),
                filter: self.gaussian.then(FilterTable::gaussian),
            },
            lens: Lens {
                aperture_radius_m: self.aperture_m,
                inverse_focus_per_m: 1.0 / self.focus_m,
            },
            orders,
            zones: Zones::default(),
            slab,
            stack,
            bow,
            wave,
            rough,
            smeared,
            cover: self.covered.cover(self),
            front: front.into(),
            back: back.into(),
        };
        if self.joins {
            // All surfaces are behind the pane, seen from the lens.
            scene.join_orders(self.distance_m, radiance, self.tolerance);
        }
        scene.find_zones(radiance);
        scene
    }

    /// Renders all pixels with all samples.
    pub(crate) fn render(&self) -> Vec<PixelMeans> {
        whole_film(&self.scene(), Isa::detect()).pixels
    }
}

/// Traces the whole film.
pub(crate) fn whole_film(scene: &Scene, isa: Isa) -> TileResult {
    let tile = Tile { x: 0, y: 0, width: scene.film.width, height: scene.film.height };
    trace_tile(scene, tile, 0..scene.spp, isa)
}

/// Returns a pseudo-random number in [0, 1) that depends only on three integers.
pub(crate) fn noise(i: usize, j: usize, k: u64) -> f64 {
    let mut x = (i as u64) << 40 ^ (j as u64) << 16 ^ k.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    for _ in 0..2 {
        x = (x ^ (x >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (x >> 40) as f64 / f64::from(1 << 24)
}
