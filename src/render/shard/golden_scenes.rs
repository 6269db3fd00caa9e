//! Defines the golden scenes: small scenes of photographs that together cover most branches of the tracer and of the
//! readers of pictures.
//!
//! A new scene needs a row in [`SCENES`], its digest in the table of `golden.rs` (the test prints it), a reference
//! image (see `tests/physics/golden.rs`) and a new name of the set, `SETS` there.

use crate::formats::NamedBytes;
use crate::scene::{BackCamera, decode_srgb_image};
use crate::trace::{
    Bow, Card, Coating, Cover, FilmPlane, FilterTable, Grid, Lens, OrderPlan, Outline, Pose,
    RoughPane, RoughShape, Sampling, Scene, Slab, Smear, SmearedPane, Smudges, Stack, StackLayer,
    StackOptics, Texture, View, Wave, Zones,
};
use glam::{DMat3, DVec3};
use glasshouse_line::Apex;
use glasshouse_line::curve::Curve;
use glasshouse_line::label::LabelSet;
use glasshouse_line::layer::PerLayer;
use std::sync::Arc;

/// A scene of the golden set.
pub struct GoldenScene {
    pub name: &'static str,
    /// Scene with a film of 16 x 10 px.
    pub scene: Scene,
}

/// Parameters of a golden scene; [`Parameters::new`] returns the defaults.
struct Parameters {
    /// Width and height of the film, px.
    film_px: [u32; 2],
    spp: u32,
    gaussian: bool,
    aperture_radius_m: f64,
    inverse_focus_per_m: f64,
    thickness_m: f64,
    ior: f64,
    absorption_per_m: [f64; 3],
    tilt_deg: [f64; 2],
    /// True for a back scene with apex `camera`, false for apex `mirror`.
    from_camera: bool,
    /// Width and height of the depth images, px.
    depth_px: [usize; 2],
    /// Gain of every 97th texel; the other texels are at most 1.
    light: f32,
    order_tolerance: f64,
    target_error: Option<f64>,
    layers: [bool; 4],
    pane: Pane,
    /// File of the front's colour image; none for a texture of hashes.
    photograph: Option<Photograph>,
}

/// Makes of panes beyond a plain one.
#[derive(Clone, Copy, PartialEq)]
enum Pane {
    Plain,
    /// Two layers and a gap, with a coating that depends on angle and side.
    Double,
    /// A sphere with its centre on the camera's side.
    Bent,
    /// A double pane with rough faces.
    Rough,
    /// Faces with waves and wedges.
    Waved,
    /// Edges with a frame, and a card on either side.
    Framed,
    /// A rough double pane with smudges.
    Smudged,
}

impl Pane {
    /// Returns the layers of a pane that is not plain.
    fn stack(self) -> Option<Stack> {
        if !matches!(self, Self::Double | Self::Rough | Self::Waved | Self::Smudged) {
            return None;
        }
        let layer = |thickness_m, ior| StackLayer { thickness_m, ior, absorption_per_m: [0.0; 3] };
        let curve = |values: [f64; 3]| {
            let rows = values.map(|v| [v, 0.8 * v, 0.9 * v]);
            Curve::through(vec![0.0, 0.6, 1.0], rows.to_vec())
        };
        let coating = Coating {
            reflectance: curve([1.0, 0.15, 0.1]),
            reflectance_back: curve([1.0, 0.2, 0.05]),
            transmittance: curve([0.0, 0.75, 0.8]),
        };
        let layers = vec![layer(0.004, 1.52), layer(0.016, 1.0), layer(0.004, 1.5)];
        Some(Stack::new(layers, vec![None, Some(coating), None, None]))
    }

    /// Returns smudges of random shares, turned against the pane.
    fn smudges(self) -> Option<Smudges> {
        let smear = Smear { roughness: 0.05, share: 0.7, transmittance: 0.8 };
        let shares: Vec<f32> = (0..6 * 5).map(|q| (hash(q, 9) % 256) as f32 / 255.0).collect();
        let axes = [DVec3::new(0.8, 0.6, 0.0), DVec3::new(-0.6, 0.8, 0.0)];
        (self == Self::Smudged)
            .then(|| Smudges::new(smear, (6, &shares), (axes, 0.01, [1.3, 0.4]), true))
    }

    /// Returns waves that run askew to the film.
    fn wave(self) -> Option<Wave> {
        (self == Self::Waved).then_some(Wave {
            amplitude_m: 2e-4,
            length_m: 0.08,
            across_crests: DVec3::new(0.6, 0.8, 0.0),
            distance_m: 0.3,
        })
    }

    /// Returns the edges of the pane and its cards; cards have a texture of their own and alphas of its red.
    fn cover(self, slab: &Slab, camera: &BackCamera) -> Cover {
        if self != Self::Framed {
            return Cover::default();
        }
        let texel = |q: usize| {
            let alpha = (hash(q, 7) % 256) as f32 / 255.0;
            [0.4 * alpha, 0.2 * alpha, 0.1 * alpha, alpha]
        };
        let texels: Vec<[f32; 4]> = (0..12 * 10).map(texel).collect();
        let picture = Arc::new(Texture::from_vec(12, 10, texels));
        let [across, down] = [DVec3::X, DVec3::Y];
        let front =
            Card::new(DVec3::new(-0.05, -0.2, 0.5), 0.3 * across, 0.25 * down, picture.clone());
        let [corner, right] = [DVec3::new(0.02, -0.1, -0.1), DVec3::new(-0.15, 0.0, 0.0)];
        let [right, below] = [right, 0.12 * down].map(|v| camera.mirrored_direction(v));
        let back = Card::new(camera.mirrored_point(corner), right, below, picture);
        let outline = Outline {
            axes: [across, down],
            distance_m: slab.plane_distance_m / slab.normal.z,
            glass_m: [[-0.06, 0.05], [-0.1, 0.04]],
            frame_m: 0.01,
            frame_radiance: [0.3, 0.2, 0.1],
        };
        Cover { outline: Some(outline), cards: [vec![front], vec![back]] }
    }
}

/// The name and the bytes of a picture that `tests/physics/golden/pictures.py` has made.
type Photograph = (&'static str, &'static [u8]);

const PROGRESSIVE: Photograph =
    ("progressive.jpg", include_bytes!("golden_pictures/progressive.jpg"));
const TURNED: Photograph = ("turned.jpg", include_bytes!("golden_pictures/turned.jpg"));
const DISPLAY_P3: Photograph = ("p3.png", include_bytes!("golden_pictures/p3.png"));

impl Parameters {
    /// Returns the defaults, such as a wide lens, an untilted pane and apex `mirror`.
    fn new() -> Self {
        Self {
            film_px: [16, 10],
            spp: 64,
            gaussian: false,
            aperture_radius_m: 0.02,
            inverse_focus_per_m: 0.4,
            thickness_m: 0.01,
            ior: 1.6,
            absorption_per_m: [0.0; 3],
            tilt_deg: [0.0; 2],
            from_camera: false,
            depth_px: [64, 64],
            light: 1.0,
            order_tolerance: 7.6e-5,
            target_error: None,
            layers: [true; 4],
            pane: Pane::Plain,
            photograph: None,
        }
    }

    fn scene(&self) -> Scene {
        let normal =
            if self.tilt_deg == [0.0; 2] { DVec3::Z } else { Slab::tilted_normal(self.tilt_deg) };
        let slab = Slab {
            normal,
            plane_distance_m: 0.3 * normal.z,
            thickness_m: self.thickness_m,
            ior: self.ior,
            absorption_per_m: self.absorption_per_m,
        };
        let [width, height] = self.film_px;
        let film = FilmPlane {
            width,
            height,
            tan_half_fov: FilmPlane::tan_half_fov(width, height, 55.0),
            filter: self.gaussian.then(FilterTable::gaussian),
        };
        let camera = BackCamera::new(Apex::Camera, &slab);
        let (pose, sign) = if self.from_camera && slab.is_tilted() {
            let (rotation, translation_m) = camera.capture_from_lens();
            let pose = Pose::General { rotation, translation_m };
            (pose, 1.0)
        } else {
            let extra_m = if self.from_camera { camera.twice_distance_m() } else { 0.0 };
            (Pose::Aligned { extra_m }, -1.0)
        };
        // Cosines at the centre and at the corners of film and lens; `scene::assemble` uses more.
        let [tx, ty] =
            film.tan_half_fov.map(|t| t + self.aperture_radius_m * self.inverse_focus_per_m);
        let corners = [(0.0, 0.0), (-tx, -ty), (-tx, ty), (tx, -ty), (tx, ty)];
        let cosines = corners.map(|(x, y)| DVec3::new(x, y, 1.0).normalize().dot(normal));
        let mut front = self.view(1, Pose::Aligned { extra_m: 0.0 }, 1.0);
        if let Some((name, bytes)) = self.photograph {
            front.texture = texture(name, bytes).into();
        }
        let back = self.view(100, pose, sign);
        let radiance = [&front, &back].map(|view| f64::from(view.texture.max_radiance()));
        let between = [
            cosines.into_iter().fold(1.0, f64::min),
            // The normal itself may lie between the directions.
            1.0,
        ];
        let tolerance = self.order_tolerance;
        let mut orders = OrderPlan::new(&slab, &cosines, radiance, tolerance);
        let layers = self.pane.stack();
        let stack = layers.as_ref().filter(|_| self.pane == Pane::Double).map(|layers| {
            let (stack, of_stack) = StackOptics::new(layers, between, radiance, tolerance);
            orders = of_stack;
            stack
        });
        let bow =
            (self.pane == Pane::Bent).then_some(Bow { curvature_per_m: 0.2, distance_m: 0.3 });
        let (wave, smudges) = (self.pane.wave(), self.pane.smudges());
        let alphas = [0.01, 0.02, 0.0, 0.01].map(|alpha| if wave.is_some() { 0.0 } else { alpha });
        let [x, y] = [DMat3::from_rotation_x(0.01), DMat3::from_rotation_y(0.01)];
        let turned = [DMat3::IDENTITY, y, x, DMat3::IDENTITY];
        let shape = RoughShape {
            slab: &slab,
            distance_m: 0.3,
            bow: None,
            wave: wave.as_ref(),
            turned: wave.is_some().then_some(turned.as_slice()),
        };
        let uneven = layers.filter(|_| self.pane != Pane::Double);
        let pane_of = |of| RoughPane::new(of, &alphas, shape, between, radiance, tolerance);
        let (rough, orders) = uneven
            .as_ref()
            .map(pane_of)
            .map_or((None, orders), |(pane, of_paths)| (Some(pane), of_paths));
        let smeared = uneven.zip(smudges).map(|(layers, smudges)| {
            SmearedPane::new(&layers, &alphas, shape, between, radiance, tolerance, &smudges)
        });
        let mut scene = Scene {
            seed: 2020,
            sampling: Sampling::Sobol,
            spp: self.spp,
            target_error: self.target_error,
            layers: PerLayer(self.layers),
            labels: LabelSet::default(),
            first_reflection_alone: false,
            film,
            lens: Lens {
                aperture_radius_m: self.aperture_radius_m,
                inverse_focus_per_m: self.inverse_focus_per_m,
            },
            orders,
            zones: Zones::default(),
            cover: self.pane.cover(&slab, &camera),
            slab,
            stack,
            bow,
            wave,
            rough,
            smeared,
            front: front.into(),
            back: back.into(),
        };
        scene.finish_orders(0.3, radiance, tolerance);
        scene
    }

    /// Makes a view of plates of 8 x 8 depth pixels, at 0.9 to 10 m, with a texture of 48 x 40 texels.
    fn view(&self, salt: u32, pose: Pose, sign: f64) -> View {
        let [nx, ny] = self.depth_px;
        let plate = |q: usize| (q / nx / 8) * 8 + q % nx / 8;
        let w = (0..nx * ny).map(|q| 0.1 + (hash(plate(q), salt) % 1024) as f32 / 1024.0);
        let texel = |q: usize| {
            let value = [1, 2, 3].map(|k| (hash(q, salt + k) % 256) as f32 / 255.0);
            let gain = if q % 97 == 50 { self.light } else { 1.0 };
            [value[0] * gain, value[1] * gain, value[2] * gain, 0.0]
        };
        let texels: Vec<[f32; 4]> = (0..48 * 40).map(texel).collect();
        View {
            grid: Grid::new(nx, ny, w.collect()).into(),
            texture: Texture::new(48, 40, &texels).into(),
            focal_px: [sign * 1.25 * nx as f64, 1.25 * ny as f64],
            principal: [nx as f64 / 2.0 - 0.5, ny as f64 / 2.0 - 0.7],
            pose,
            photograph_size: (nx, ny),
        }
    }
}

/// Decodes a picture like the colour image of a scene.
fn texture(name: &str, bytes: &[u8]) -> Texture {
    let file = NamedBytes { path: name.into(), bytes: bytes.to_vec() };
    let color = decode_srgb_image(&file).expect("the program holds whole pictures");
    let (width, height, radiance) = color;
    Texture::new(width, height, &radiance)
}

fn hash(q: usize, salt: u32) -> u32 {
    let mut x = (q as u32).wrapping_mul(0x9e37_79b9) ^ salt;
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^ (x >> 15)
}

type Change = fn(&mut Parameters);

/// Names of the scenes and their changes to [`Parameters::new`], in a fixed order.
const SCENES: [(&str, Change); 26] = [
    // With apex `mirror`, R is in closed form.
    ("mirror", |_| {}),
    ("mirror-gaussian", |w| w.gaussian = true),
    ("camera", |w| w.from_camera = true),
    ("tilted-absorbing", |w| {
        w.tilt_deg = [9.0, -14.0];
        w.absorption_per_m = [3.0, 1.0, 2.0];
    }),
    ("tilted-camera-gaussian", |w| {
        w.tilt_deg = [-6.0, 12.0];
        w.from_camera = true;
        w.gaussian = true;
    }),
    // Lights are brighter than white, so the first orders and R take all samples.
    ("lights", |w| w.light = 1e4),
    ("pinhole", |w| {
        w.aperture_radius_m = 0.0;
        w.inverse_focus_per_m = 0.0;
    }),
    ("thin-pane", |w| w.thickness_m = 0.0),
    ("air", |w| w.ior = 1.0),
    // A tilt of 60 degrees makes about ten orders visible on each side; the last ones are thinned.
    ("steep", |w| {
        w.tilt_deg = [0.0, 60.0];
        w.thickness_m = 0.03;
        w.order_tolerance = 1e-6;
    }),
    // Two ranges of 256 samples. The first contains all samples of R, or both all of its closed form.
    ("two-ranges", |w| w.spp = 512),
    ("camera-two-ranges", |w| {
        w.spp = 512;
        w.from_camera = true;
    }),
    // Fewer samples than lanes in a group, and depth images of one row or one column.
    ("one-row", |w| {
        w.spp = 4;
        w.depth_px = [40, 1];
    }),
    ("one-column", |w| {
        w.spp = 1;
        w.depth_px = [1, 40];
    }),
    ("adaptive", |w| {
        w.spp = 256;
        w.target_error = Some(0.02);
    }),
    ("two-layers", |w| w.layers = [false, true, false, true]),
    // Decoders that select instructions, and everything that a file can say about its pixels.
    ("jpeg", |w| w.photograph = Some(PROGRESSIVE)),
    ("turned", |w| w.photograph = Some(TURNED)),
    ("display-p3", |w| w.photograph = Some(DISPLAY_P3)),
    ("double", |w| {
        w.pane = Pane::Double;
        w.tilt_deg = [4.0, -9.0];
    }),
    ("bent", |w| w.pane = Pane::Bent),
    ("rough", |w| w.pane = Pane::Rough),
    ("waved", |w| w.pane = Pane::Waved),
    ("framed", |w| w.pane = Pane::Framed),
    ("framed-camera", |w| {
        w.pane = Pane::Framed;
        w.from_camera = true;
    }),
    ("smudged", |w| w.pane = Pane::Smudged),
];

/// Makes all golden scenes, in a fixed order.
pub fn golden_scenes() -> Vec<GoldenScene> {
    SCENES
        .into_iter()
        .map(|(name, change)| {
            let mut parameters = Parameters::new();
            change(&mut parameters);
            GoldenScene { name, scene: parameters.scene() }
        })
        .collect()
}

/// Makes a golden scene with another film and another number of samples.
#[cfg(test)]
pub(super) fn variant(name: &str, film_px: [u32; 2], spp: u32) -> Scene {
    let (_, change) = SCENES.into_iter().find(|(other, _)| *other == name).expect("a scene");
    let mut parameters = Parameters::new();
    change(&mut parameters);
    Parameters { film_px, spp, ..parameters }.scene()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::Surface;

    #[test]
    fn golden_scenes_cover_the_listed_features() {
        let scenes = golden_scenes();
        let any = |what: &str, has: &dyn Fn(&Scene) -> bool| {
            assert!(scenes.iter().any(|g| has(&g.scene)), "no scene with {what}");
        };
        let sheet = |surface: &Surface| match surface {
            Surface::Sheet(view) => (view.pose.clone(), view.photograph_size),
            Surface::Mesh(_) => panic!("the golden scenes are sheets"),
        };
        let pose = |s: &Scene| sheet(&s.back).0;
        let general = |s: &Scene| matches!(pose(s), Pose::General { .. });
        any("a general pose", &general);
        any(
            "apex camera, untilted",
            &|s| matches!(pose(s), Pose::Aligned { extra_m } if extra_m > 0.0),
        );
        any("a tilted mirror", &|s| s.slab.is_tilted() && !general(s));
        any("absorption", &|s| s.slab.absorbs());
        any("a Gaussian filter", &|s| s.film.filter.is_some());
        any("lights", &|s| !s.orders.thin_clean_reflection);
        any("a pinhole", &|s| s.lens.aperture_radius_m == 0.0);
        any("focus at infinity", &|s| s.lens.inverse_focus_per_m == 0.0);
        any("a pane without thickness", &|s| s.slab.thickness_m == 0.0);
        any("an invisible reflection", &|s| s.orders.back.is_empty());
        for thinning in [1, 2, 16, 64] {
            any(&format!("orders thinned by {thinning}"), &|s| {
                s.orders.back.iter().any(|f| f.thinning(0) == thinning)
            });
        }
        any("many orders", &|s| s.orders.back.len() >= 8);
        any("a target error", &|s| s.target_error.is_some());
        any("a stack of layers", &|s| s.stack.is_some());
        any("a bent pane", &|s| s.bow.is_some());
        any("rough faces", &|s| s.rough.is_some() && s.wave.is_none());
        any("waves", &|s| s.wave.is_some());
        any("a frame and cards", &|s| {
            s.cover.outline.is_some() && s.cover.cards.iter().all(|cards| !cards.is_empty())
        });
        any("omitted layers", &|s| s.layers.0 != [true; 4]);
        any("several blocks", &|s| s.spp > 256);
        any("one sample", &|s| s.spp == 1);
        let size = |(name, bytes): Photograph| {
            let texture = texture(name, bytes);
            (texture.width(), texture.height())
        };
        assert_eq!([PROGRESSIVE, TURNED, DISPLAY_P3].map(size), [(47, 39), (47, 39), (32, 24)]);
        any("a depth image of one row", &|s| sheet(&s.front).1.1 == 1);
        any("a depth image of one column", &|s| sheet(&s.front).1.0 == 1);
        let mut names: Vec<&str> = scenes.iter().map(|g| g.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), scenes.len());
    }
}
