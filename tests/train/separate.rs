//! Tests `separate`: colours and metadata of photographs, sizes, signals, and its former command line.

use super::training::{place, small};
use crate::support::outputs::files;
use crate::support::program::{command, run, text, wait_until};
use image::metadata::Orientation;
use image::{ExtendedColorType, ImageDecoder, ImageEncoder, Rgb, RgbImage};
use std::io::Cursor;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;

fn picture(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        Rgb([x * 3 + y, y * 5, (x * y) >> 4].map(|v| (v % 200 + 20) as u8))
    })
}

fn metadata(path: &Path) -> (Option<Vec<u8>>, Option<Vec<u8>>) {
    let bytes = std::fs::read(path).unwrap();
    let mut decoder = image::ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .unwrap()
        .into_decoder()
        .unwrap();
    (decoder.icc_profile().unwrap(), decoder.exif_metadata().unwrap())
}

#[test]
fn photographs_keep_size_profile_and_exif_data() {
    let place = place();
    place.train("separation", "2", &small(&["--no-a-priori"]));
    let folder = place.folder.path();
    let p3 = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/icc/p3.png");
    let (profile, _) = metadata(&p3);
    // One entry: the camera turned by 90 degrees, in a directory with the maker's name.
    let mut exif = b"II*\0\x08\0\0\0\x02\0".to_vec();
    exif.extend(b"\x0f\x01\x02\0\x04\0\0\0Lab\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0");
    let photo = folder.join("photo.png");
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    encoder.set_icc_profile(profile.clone().unwrap()).unwrap();
    encoder.set_exif_metadata(exif.clone()).unwrap();
    let large = picture(1700, 1100);
    encoder.write_image(&large, 1700, 1100, ExtendedColorType::Rgb8).unwrap();
    std::fs::write(&photo, bytes).unwrap();
    let out = folder.join("out");
    let arguments = ["separate", text(&photo), "--network", text(&place.run), "--out", text(&out)];
    let json = run(&[&arguments[..], &["--json"]].concat()).expect(0).json();
    let image = &json["images"][0];
    assert_eq!((&image["width"], &image["height"]), (&1100.into(), &1700.into()));
    for layer in ["transmission", "glass_reflection", "clean_reflection"] {
        let path = out.join(format!("photo.{layer}.png"));
        assert_eq!(image[layer], text(&path));
        let (icc, found) = metadata(&path);
        assert_eq!(icc, profile);
        let mut expected = exif.clone();
        assert_eq!(Orientation::remove_from_exif_chunk(&mut expected), Some(Orientation::Rotate90));
        assert_eq!(found, Some(expected));
        assert_eq!(image::open(&path).unwrap().into_rgb8().dimensions(), (1100, 1700));
    }
}

#[test]
fn a_signal_ends_a_long_separation_within_a_second() {
    let place = place();
    place.train(
        "separation",
        "1",
        &["--no-a-priori", "--crop", "40", "--discriminator-width", "2"],
    );
    let folder = place.folder.path();
    let photo = folder.join("photo.png");
    picture(2400, 1800).save(&photo).unwrap();
    let out = folder.join("out");
    let arguments = ["separate", text(&photo), "--network", text(&place.run), "--out", text(&out)];
    let mut child =
        command(&[&arguments[..], &["--work-px", "0", "-j", "1"]].concat()).spawn().unwrap();
    // The folder exists as soon as the picture is read; its separation takes much longer.
    assert!(wait_until(&mut child, || out.exists()));
    std::thread::sleep(std::time::Duration::from_millis(300));
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::TERM).unwrap();
    let ended = child.wait().unwrap();
    assert_eq!((ended.code(), ended.signal()), (Some(143), None));
    // No part of a picture is left.
    assert_eq!(files(&out), Vec::<std::path::PathBuf>::new());
}

#[test]
fn the_former_command_line_is_refused_with_the_new_one() {
    let folder = tempfile::tempdir().unwrap();
    let photo = folder.path().join("photo.png");
    picture(32, 32).save(&photo).unwrap();
    let out = folder.path().join("out");
    let made = folder.path().join("run");
    std::fs::create_dir(&made).unwrap();
    for name in ["spec.json", "manifest.jsonl"] {
        std::fs::write(made.join(name), "{}").unwrap();
    }
    let former = ["separate", text(&made), text(&photo), "--out", text(&out)];
    run(&former).expect(2).says(&["--network RUN"]);
    assert!(!out.exists());
}

#[test]
fn a_call_without_a_readable_picture_leaves_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let photo = folder.path().join("missing.png");
    run(&["separate", text(&photo), "--out", text(&out)]).expect(4).says(&["missing.png"]);
    assert!(!out.exists());
    // A missing picture before a readable one does not keep the latter from its folder.
    let other = folder.path().join("photo.png");
    picture(96, 80).save(&other).unwrap();
    let arguments = ["separate", text(&photo), text(&other), "--out", text(&out)];
    run(&arguments).expect(3).says(&["missing.png"]);
    assert!(out.join("photo.transmission.png").is_file());
}

#[test]
fn the_shipped_weights_need_no_network() {
    let folder = tempfile::tempdir().unwrap();
    let photo = folder.path().join("photo.png");
    picture(96, 80).save(&photo).unwrap();
    let out = folder.path().join("out");
    let arguments = ["separate", text(&photo), "--out", text(&out), "--json"];
    let json = run(&arguments).expect(0).json();
    assert_eq!((&json["checkpoint"], &json["failed"]), (&"shipped".into(), &serde_json::json!([])));
    assert!(json["images"][0]["clean_reflection"].is_null());
    let given = image::open(&photo).unwrap().into_rgb8();
    let made = image::open(out.join("photo.transmission.png")).unwrap().into_rgb8();
    // The output is not brighter than the input, and differs from it.
    assert!(made.iter().zip(given.iter()).all(|(made, given)| made <= given));
    assert!(made != given);
}

/// A folder stands for its pictures, and results keep its sub-folders; those of an earlier call in it are no pictures.
#[test]
fn folders_of_pictures_are_separated() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("photos");
    std::fs::create_dir_all(folder.join("sub")).unwrap();
    for name in ["a.jpg", "sub/a.PNG", "sub/b.jfif"] {
        let ending =
            if name.ends_with("PNG") { image::ImageFormat::Png } else { image::ImageFormat::Jpeg };
        picture(48, 40).save_with_format(folder.join(name), ending).unwrap();
    }
    std::fs::write(folder.join("notes.txt"), "mine").unwrap();
    let out = folder.join("clean");
    for _ in 0..2 {
        let json =
            run(&["separate", text(&folder), "--out", text(&out), "--json"]).expect(0).json();
        assert_eq!(json["images"].as_array().unwrap().len(), 3);
        for name in ["a", "sub/a", "sub/b"] {
            assert!(out.join(format!("{name}.transmission.png")).is_file(), "{name}");
        }
    }
    let empty = place.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    run(&["separate", text(&empty), "--out", text(&out)]).expect(4).says(&["holds no picture"]);
}
