//! Pictures that state an orientation, pictures that are damaged, and depths in another unit.

use crate::support::program::{Ended, run, text};
use crate::support::scenes::{npy, photographs, scene, write_lines};
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ImageEncoder};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder with the photographs `a` and `b` and a scene of them.
struct Place {
    folder: TempDir,
    scene: Value,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        photographs(folder.path());
        Self { folder, scene: scene("one") }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn render(&self, scene: &Value, out: &str) -> Ended {
        let path = self.path("scene.json");
        std::fs::write(&path, scene.to_string()).unwrap();
        run(&["render", text(&path), "--out", text(&self.path(out))])
    }

    fn plan(&self, scene: &Value, out: &str) -> Ended {
        let path = self.path("scenes.jsonl");
        write_lines(&path, std::slice::from_ref(scene));
        run(&["plan", text(&path), "--out", text(&self.path(out)), "--json"])
    }

    fn pixels(&self, out: &str) -> Vec<u8> {
        std::fs::read(self.path(out).join("input.exr")).unwrap()
    }
}

/// EXIF data with orientation 6: a little-endian TIFF directory with one entry, tag 0x112, one 16-bit number.
const ORIENTATION_6: &[u8] = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";

/// Writes a picture as a PNG with orientation 6.
fn write_turned(path: &Path, picture: &DynamicImage) {
    let mut bytes = Vec::new();
    let mut encoder = PngEncoder::new(&mut bytes);
    encoder.set_exif_metadata(ORIENTATION_6.to_vec()).unwrap();
    let picture = picture.to_rgb8();
    let (width, height) = picture.dimensions();
    encoder.write_image(&picture, width, height, image::ExtendedColorType::Rgb8).unwrap();
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_turned_photograph_is_its_upright_twin() {
    let place = Place::new();
    place.render(&place.scene, "upright").expect(0);
    let upright = image::open(place.path("a.png")).unwrap();
    // Orientation 6 means that the viewer turns the rows clockwise.
    write_turned(&place.path("turned.png"), &upright.rotate270());
    let mut turned = place.scene.clone();
    turned["front"]["color"] = "turned.png".into();
    place.render(&turned, "turned").expect(0);
    assert_eq!(place.pixels("turned"), place.pixels("upright"));
    let inspected = run(&["inspect", text(&place.path("turned.png"))]).expect(0).stdout;
    for words in ["64 x 48 px", "6 (EXIF): 48 x 64 px are stored"] {
        assert!(inspected.contains(words), "{inspected}");
    }

    // A depth of the stored rows is refused by plan and render.
    std::fs::write(place.path("stored.npy"), npy("(64, 48)", &[2.0; 64 * 48])).unwrap();
    let mut stored = turned.clone();
    stored["front"]["depth"] = "stored.npy".into();
    stored["front"].as_object_mut().unwrap().remove("mask");
    let words = ["EXIF orientation 6", "48x64", "\"orientation\": \"stored\""];
    place.render(&stored, "wrong").expect(4).says(&words);
    place.plan(&stored, "run").says(&words[..1]);
    stored["front"]["orientation"] = "stored".into();
    place.render(&stored, "stored").expect(0);
    let planned = place.plan(&stored, "other").expect(0).json();
    assert_eq!(planned["invalid"], json!([]));
}

#[test]
fn a_damaged_jpeg_is_refused() {
    let place = Place::new();
    let picture = image::open(place.path("a.png")).unwrap().into_rgb8();
    picture.save(place.path("a.jpg")).unwrap();
    let whole = std::fs::read(place.path("a.jpg")).unwrap();
    let mut scene = place.scene.clone();
    scene["front"]["color"] = "a.jpg".into();
    place.render(&scene, "whole").expect(0);
    let cut = [&whole[..whole.len() / 2], b"\xff\xd9"].concat();
    std::fs::write(place.path("a.jpg"), cut).unwrap();
    let words = ["a.jpg as JPEG", "they end early", "fetch it again"];
    place.render(&scene, "cut").expect(4).says(&words);
    let inspected = run(&["inspect", text(&place.path("a.jpg"))]).expect(4).stdout;
    assert!(inspected.contains("they end early"), "{inspected}");
}

#[test]
fn a_depth_in_millimetres_is_noted() {
    let place = Place::new();
    let depths: Vec<f32> = (0..64 * 48).map(|k| 1500.0 + (k % 64) as f32).collect();
    std::fs::write(place.path("mm.npy"), npy("(48, 64)", &depths)).unwrap();
    let mut scene = place.scene.clone();
    scene["front"]["depth"] = "mm.npy".into();
    let words = ["its median depth is 15", "depth_unit_m must be 0.001"];
    place.render(&scene, "far").expect(0).says(&words);
    place.plan(&scene, "run").expect(0).says(&words);
    scene["front"]["depth_unit_m"] = 0.001.into();
    let near = place.render(&scene, "near").expect(0);
    assert!(!near.stderr.contains("median depth"), "{}", near.stderr);
    let planned = place.plan(&scene, "other").expect(0);
    assert!(!planned.stderr.contains("median depth"), "{}", planned.stderr);
}

#[test]
fn a_depth_of_another_shape_is_noted() {
    let place = Place::new();
    std::fs::write(place.path("tall.npy"), npy("(64, 48)", &[2.0; 64 * 48])).unwrap();
    let mut scene = place.scene.clone();
    scene["front"]["depth"] = "tall.npy".into();
    scene["front"].as_object_mut().unwrap().remove("mask");
    let words = ["depth image has 48x64 pixels and its colour image 64x48", "turned or cropped?"];
    place.render(&scene, "tall").expect(0).says(&words);
    place.plan(&scene, "run").expect(0).says(&words);
    let plain = place.render(&place.scene, "plain").expect(0);
    assert!(!plain.stderr.contains("turned or cropped"), "{}", plain.stderr);
}
