//! Defines the golden scenes: small scenes of photographs that together cover most branches of the tracer and of the
//! readers of pictures.
//!
//! A new scene needs a row in [`SCENES`], its digest in the table of `golden.rs` (the test prints it), a reference
//! image (see `tests/physics/golden.rs`) and a new name of the set, [`super::golden::SET`].

use crate::formats::NamedBytes;
use crate::label::LabelSet;
use crate::layer::PerLayer;
use crate::line::Apex;
use crate::scene::{BackCamera, decode_srgb_image};
use crate::trace::{
    Cover, FilmPlane, FilterTable, Grid, Lens, OrderPlan, Pose, Sampling, Scene, Slab, Texture,
    View,
};
use glam::DVec3;

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
    /// File of the front's colour image; none for a texture of hashes.
    photograph: Option<Photograph>,
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
        Scene {
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
            orders: OrderPlan::new(&slab, &cosines, radiance, self.order_tolerance),
            slab,
            stack: None,
            bow: None,
            rough: None,
            cover: Cover::default(),
            front: front.into(),
            back: back.into(),
        }
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
const SCENES: [(&str, Change); 19] = [
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
        for thinning in [1, 2, 16] {
            any(&format!("orders thinned by {thinning}"), &|s| {
                s.orders.back.iter().any(|f| f.thinning == thinning)
            });
        }
        any("many orders", &|s| s.orders.back.len() >= 8);
        any("a target error", &|s| s.target_error.is_some());
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
