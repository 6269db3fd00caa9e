use super::super::{LoadedScene, SceneFiles, SideFiles, load};
use super::*;
use crate::formats::exr_raster::tests::exr;
use crate::formats::npy::tests::npy;
use crate::formats::raster::tests::png;
use crate::trace::{Isa, Tile, TileResult, trace_tile};
use ::exr::prelude::FlatSamples;
use glasshouse_line::{SceneLine, Side};
use std::f64::consts::PI;

/// Computes the direction of pixel (i, j) in a panorama of this width, independently of `equirect`.
fn direction(i: usize, j: usize, width: usize) -> DVec3 {
    let longitude = ((i as f64 + 0.5) / width as f64 - 0.5) * TAU;
    let latitude = ((j as f64 + 0.5) / (width / 2) as f64 - 0.5) * PI;
    // `libm` gives the pinned view the same bits on all machines.
    let (sin, cos) = libm::sincos(latitude);
    let (across, ahead) = libm::sincos(longitude);
    DVec3::new(cos * across, sin, cos * ahead)
}

fn all(width: usize) -> impl Iterator<Item = DVec3> {
    (0..width * width / 2).map(move |at| direction(at % width, at / width, width))
}

/// Returns the radiance of the test panoramas in direction `d`.
fn color(d: DVec3) -> [f64; 3] {
    let d = d.normalize();
    [0.5 + 0.4 * d.x, 0.5 + 0.4 * d.y, 0.5 + 0.4 * d.z]
}

fn panorama(width: usize) -> NamedBytes {
    let channel = |k: usize| {
        let values = all(width).map(|d| color(d)[k] as f32);
        FlatSamples::F32(values.collect())
    };
    let channels = [("R", channel(0)), ("G", channel(1)), ("B", channel(2))];
    exr(width, width / 2, &channels)
}

fn map(width: usize, distance_m: impl Fn(DVec3) -> f64) -> NamedBytes {
    let data: Vec<u8> = all(width).flat_map(|d| (distance_m(d) as f32).to_le_bytes()).collect();
    npy("<f4", false, &format!("({}, {width})", width / 2), &data)
}

/// Returns a scene of two panoramas with additional keys of film, camera, glass, front and back.
fn line(film: &str, camera: &str, glass: &str, front: &str, back: &str) -> SceneLine {
    serde_json::from_str(&format!(
        r#"{{"schema":"glasshouse.scene/1","id":"p","seed":5,"film":{{"width":16,"height":16,"spp":64{film}}},
        "camera":{{"focal_length_mm":55,{camera}}},"glass":{{"distance_m":0.3,{glass}}},
        "front":{{"panorama":"f","transfer":"linear"{front}}},"back":{{"panorama":"b","transfer":"linear"{back}}}}}"#
    ))
    .unwrap()
}

const PINHOLE: &str = r#""aperture_radius_m":0,"focus":{"at":"infinity"}"#;
const NO_GLASS: &str = r#""thickness_m":0,"ior":1"#;

fn made(line: &SceneLine, image: &NamedBytes, depth: Option<&NamedBytes>) -> LoadedScene {
    let side = |side: &Side| {
        let Side::Panorama(side) = side else { panic!() };
        let has_map = side.depth.is_some();
        SideFiles::Panorama(PanoramaFiles {
            panorama: image.clone(),
            depth: depth.filter(|_| has_map).cloned(),
        })
    };
    let files = SceneFiles::new(side(&line.front), side(&line.back));
    line.validate().unwrap();
    load(line, &files).unwrap()
}

fn traced(loaded: &LoadedScene) -> TileResult {
    let film = &loaded.scene.film;
    let tile = Tile { x: 0, y: 0, width: film.width, height: film.height };
    trace_tile(&loaded.scene, tile, 0..loaded.scene.spp, Isa::detect())
}

/// Returns the largest difference between a layer and `expected` of the ray (x, y, 1) through each pixel's centre.
fn difference(loaded: &LoadedScene, layer: usize, expected: impl Fn(DVec3) -> [f64; 3]) -> f64 {
    let film = &loaded.scene.film;
    let pixels = traced(loaded).pixels;
    let mut largest = 0f64;
    for (at, pixel) in pixels.iter().enumerate() {
        let (x, y) = (at as u32 % film.width, at as u32 / film.width);
        let [tx, ty] = film.tangent(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let expected = expected(DVec3::new(tx, ty, 1.0));
        for k in 0..3 {
            largest = largest.max((f64::from(pixel.mean[layer][k]) - expected[k]).abs());
        }
    }
    largest
}

/// Returns the view's axes in the panorama (right, down, forward) from the definition of the angles.
fn axes(yaw_deg: f64, pitch_deg: f64) -> [DVec3; 3] {
    let (yaw, pitch) = (yaw_deg.to_radians(), pitch_deg.to_radians());
    let right = DVec3::new(yaw.cos(), 0.0, -yaw.sin());
    let forward = DVec3::new(yaw.sin() * pitch.cos(), -pitch.sin(), yaw.cos() * pitch.cos());
    [right, forward.cross(right), forward]
}

#[test]
fn t_and_r_show_the_panorama_across_the_border_and_at_the_poles() {
    let image = panorama(512);
    for (yaw, pitch) in [
        (0.0, 0.0),
        (90.0, 0.0),
        (180.0, 0.0),
        (-180.0, 20.0),
        (37.0, -50.0),
        (0.0, 90.0),
        (200.0, -90.0),
        (-75.0, 80.0),
    ] {
        let turned = format!(r#","yaw_deg":{yaw},"pitch_deg":{pitch}"#);
        let line = line("", PINHOLE, NO_GLASS, &turned, &turned);
        let loaded = made(&line, &image, None);
        let [right, down, forward] = axes(yaw, pitch);
        let seen = |ray: DVec3| color(right * ray.x + down * ray.y + forward * ray.z);
        let t = difference(&loaded, 1, seen);
        // R is the mirror image of the back.
        let r = difference(&loaded, 3, |ray| seen(DVec3::new(-ray.x, ray.y, 1.0)));
        // A film pixel spans 0.035 rad: its colours are not quite linear, and the mean of 64 samples has noise.
        assert!(t < 1e-4 && r < 1e-4, "yaw {yaw}, pitch {pitch}: {t:e} {r:e}");
    }
}

#[test]
fn a_constant_distance_is_a_sphere() {
    let image = panorama(512);
    let (distance_m, radius_m) = (0.3, 1.2);
    let line = line(
        "",
        r#""aperture_radius_m":0,"focus":{"at":"front_center"}"#,
        r#""thickness_m":0,"ior":1.5"#,
        r#","depth_m":1.2"#,
        r#","depth_m":1.2,"apex":"camera""#,
    );
    let loaded = made(&line, &image, None);
    let focus_m = loaded.facts.focus_distance_m.unwrap();
    assert!((focus_m - radius_m).abs() < 1e-3, "{focus_m}");
    // In the back camera's coordinates, the reflected ray starts at twice the pane's distance behind the camera.
    let seen = |ray: DVec3| {
        let d = DVec3::new(-ray.x, ray.y, 1.0).normalize();
        let start = DVec3::new(0.0, 0.0, -2.0 * distance_m);
        let along = start.dot(d);
        let t = (along * along + radius_m * radius_m - start.length_squared()).sqrt() - along;
        color(start + d * t)
    };
    let off = difference(&loaded, 3, seen);
    // Without parallax, the difference is far larger, so the test is sensitive to the distance.
    let flat = difference(&loaded, 3, |ray| color(DVec3::new(-ray.x, ray.y, 1.0)));
    assert!(off < 2e-4 && flat > 0.02, "{off:e} {flat:e}");
}

#[test]
fn no_path_ends_on_the_continuation_of_a_border() {
    let image = panorama(64);
    let wide = r#""aperture_radius_m":0.02,"focus":{"distance_m":0.8}"#;
    let paper = r#""aperture_radius_m":0.00893,"focus":{"at":"front_center"}"#;
    let gaussian = r#","filter":"gaussian","order_tolerance":1e-9"#;
    for (film, camera, glass, side, apex) in [
        ("", paper, r#""thickness_m":0.01,"ior":1.6"#, "", "mirror"),
        ("", paper, r#""thickness_m":0.01,"ior":1.6"#, "", "camera"),
        (gaussian, wide, r#""thickness_m":0.04,"ior":1.6"#, r#","depth_m":1"#, "mirror"),
        (gaussian, wide, r#""thickness_m":0.04,"ior":1.6"#, r#","depth_m":1"#, "camera"),
        (
            gaussian,
            wide,
            r#""thickness_m":0.02,"ior":1.5,"tilt_deg":[10,25]"#,
            r#","depth_m":2,"pitch_deg":-30"#,
            "mirror",
        ),
        (
            gaussian,
            wide,
            r#""thickness_m":0.02,"ior":1.5,"tilt_deg":[-5,20]"#,
            r#","depth_m":2"#,
            "camera",
        ),
        (
            "",
            r#""aperture_radius_m":0.01,"focus":{"at":"infinity"}"#,
            r#""thickness_m":0.005,"ior":1.5"#,
            r#","depth":"d""#,
            "camera",
        ),
    ] {
        let back = format!(r#"{side},"apex":"{apex}""#);
        let line = line(film, camera, glass, side, &back);
        // A floor 1.2 m below and a round wall at 4 m.
        let depth = map(128, |d| {
            let floor = if d.y > 0.0 { 1.2 / d.y } else { f64::INFINITY };
            let wall = 4.0 / (d.x * d.x + d.z * d.z).sqrt();
            floor.min(wall)
        });
        let loaded = made(&line, &image, Some(&depth));
        let result = traced(&loaded);
        assert_eq!(result.misses.0, [0; 4], "{apex} {glass} of {:?}", result.paths);
        assert!(result.paths.0.iter().all(|&paths| paths > 0));
    }
}

fn sheet(side: &str, image: &NamedBytes, depth: &NamedBytes) -> Result<Sheet, SceneError> {
    let line = line("", PINHOLE, NO_GLASS, side, "");
    let Side::Panorama(panorama) = &line.front else { panic!() };
    let files = PanoramaFiles { panorama: image.clone(), depth: Some(depth.clone()) };
    decode_panorama(panorama, &files, &Sight::front(&line))
}

#[test]
fn a_map_of_a_wall_is_a_wall() {
    // Walls 3 m ahead and 5 m to the right. Map and image differ in size.
    let wall = |d: DVec3| {
        let ahead = if d.z > 0.0 { 3.0 / d.z } else { f64::INFINITY };
        let right = if d.x > 0.0 { 5.0 / d.x } else { f64::INFINITY };
        ahead.min(right).min(50.0)
    };
    let (image, depth) = (panorama(64), map(512, wall));
    for (side, z_m) in [
        (r#","depth":"d""#, 3.0),
        (r#","depth":"d","yaw_deg":90"#, 5.0),
        (r#","depth":"d","depth_unit_m":0.5"#, 1.5),
    ] {
        let sheet = sheet(side, &image, &depth).unwrap();
        assert!(sheet.valid.iter().all(|valid| *valid) && sheet.filled_share == 0.0);
        let off = sheet
            .inverse_depths_per_m()
            .fold(0f64, |off, w| off.max((f64::from(w) * z_m - 1.0).abs()));
        assert!(off < 1e-4, "{side}: {off:e}");
        assert!((sheet.front_center_z_m / z_m - 1.0).abs() < 1e-4);
        // In its middle, the view has as many pixels per radian as the map.
        assert!((sheet.intrinsics.fx - 512.0 / TAU).abs() < 1e-9);
    }
}

#[test]
fn holes_are_filled_and_counted_and_relative_depths_get_metres() {
    let image = panorama(64);
    let sky = map(256, |d| if d.y < 0.0 { f64::NAN } else { 4.0 });
    let far = sheet(r#","depth":"d","fill":"far""#, &image, &sky).unwrap();
    assert!((far.filled_share - 0.5).abs() < 0.05, "{}", far.filled_share);
    let farthest = far.inverse_depths_per_m().fold(1.0, f32::min);
    assert!(1.0 / farthest < 4.01);
    let none = map(64, |_| -1.0);
    let error = sheet(r#","depth":"d""#, &image, &none).err().unwrap();
    assert!(matches!(error, SceneError::NoDepth { .. }), "{error}");

    // Inverse distances with gain and shift, like those of an estimator.
    let relative = map(256, |d| 700.0 * (0.25 + 0.25 * d.z * d.z) - 30.0);
    let side = r#","depth":"d","depth_kind":"relative_inverse","depth_range":{"near_m":2,"far_m":4,"percentiles":[0,100]}"#;
    let sheet = sheet(side, &image, &relative).unwrap();
    let ends = sheet.relative.unwrap();
    assert_eq!((ends.near_m, ends.far_m), (2.0, 4.0));
    assert!((sheet.front_center_z_m - 2.0).abs() < 0.01, "{}", sheet.front_center_z_m);
}

#[test]
fn images_of_a_wrong_shape_or_transfer_are_refused() {
    let depth = map(64, |_| 3.0);
    let message = |side: &str, image: &NamedBytes, depth: &NamedBytes| {
        sheet(side, image, depth).err().unwrap().to_string()
    };
    let grey = |width: u32, height: u32| {
        let pixels = vec![100; (width * height) as usize];
        png(&pixels, width, height, image::ExtendedColorType::L8)
    };
    let error = message("", &grey(60, 60), &depth);
    assert!(error.contains("holds 60x60 pixels; give an equirectangular image"), "{error}");
    // The aspect ratio of 201 x 100 is within one percent of 2:1; that of 103 x 50 is not.
    sheet("", &grey(201, 100), &depth).unwrap();
    message("", &grey(103, 50), &depth);
    let square = npy("<f4", false, "(2, 2)", &[0; 16]);
    let error = message(r#","depth":"d""#, &grey(64, 32), &square);
    assert!(error.contains("holds 2x2 pixels"), "{error}");

    let coded: PanoramaFile = match serde_json::from_str(r#"{"panorama":"p"}"#).unwrap() {
        Side::Panorama(coded) => coded,
        other => panic!("{other:?}"),
    };
    let files = PanoramaFiles { panorama: panorama(64), depth: None };
    let sight = Sight::front(&line("", PINHOLE, NO_GLASS, "", ""));
    let error = decode_panorama(&coded, &files, &sight).err().unwrap();
    let error = error.to_string();
    assert!(error.contains("give \"transfer\": \"linear\""), "{error}");
}

#[test]
fn views_respect_their_size_limit_and_cover_their_window() {
    for (across, down, px_per_rad) in [
        ([-0.3, 0.3], [-0.3, 0.3], 652.0),
        ([-0.3, 0.3], [-0.3, 0.3], 2608.0),
        ([-4.0, 4.0], [-3.0, 3.0], 2608.0),
        ([0.5, 2.5], [-0.2, 0.4], 300.0),
        ([-11.4, -3.0], [-0.2, 0.4], 300.0),
    ] {
        let view = Raster::new(Window([across, down]), px_per_rad, MAX_VIEW_SIDE, DMat3::IDENTITY);
        let k = view.intrinsics;
        for ([least, most], count, focal_px, center) in
            [(across, view.width, k.fx, k.cx), (down, view.height, k.fy, k.cy)]
        {
            assert!(count <= MAX_VIEW_SIDE, "{count}");
            // The view extends one pixel before the window and one to two pixels after it.
            let before = least * focal_px + center - 0.5;
            let after = count as f64 - 0.5 - (most * focal_px + center);
            assert!((before - 1.0).abs() < 1e-9, "{before}");
            assert!((1.0..2.0 + 1e-9).contains(&after), "{after}");
        }
        // If the size limit allows it, the first row has at least the requested number of pixels per radian, to 2 %.
        if view.width < MAX_VIEW_SIDE - 4 {
            let rays: Vec<DVec3> = view.directions().take(view.width).map(|(d, _)| d).collect();
            let finest = rays.windows(2).map(|pair| pair[0].angle_between(pair[1]));
            let coarsest = finest.fold(0.0, f64::max);
            assert!(coarsest * px_per_rad < 1.02, "{}", coarsest * px_per_rad);
        }
    }
}

#[test]
fn a_view_s_bits_are_pinned() {
    let depth = map(128, |d| 3.0 + d.x);
    let side = r#","depth":"d","yaw_deg":33.3,"pitch_deg":-12.5"#;
    let sheet = sheet(side, &panorama(128), &depth).unwrap();
    let mut hasher = blake3::Hasher::new();
    hasher.update(bytemuck::cast_slice(&sheet.inverse_depths_per_m().collect::<Vec<_>>()));
    hasher.update(bytemuck::cast_slice(&sheet.radiance().copied().collect::<Vec<_>>()));
    // Another digest means that every scene with a panorama has changed.
    assert_eq!(&hasher.finalize().to_hex()[..16], "89e3e93d7dd5ab83");
}
