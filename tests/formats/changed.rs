//! Results that are not those of their present input: tuples that were made again, pictures that were rewritten, damaged files.

use crate::export::{RECIPE, arguments, assert_equal, content, finished, ids};
use crate::support::outputs::files;
use crate::support::program::{Ended, command, run, text};
use crate::support::s3_server::{BUCKET, S3Server};
use depth::Model;
use image::RgbImage;
use std::fs;
use std::path::{Path, PathBuf};

const FORMATS: [&str; 5] = ["webdataset", "imagefolder", "pairs", "exr", "safetensors"];

/// Changes a photograph of a scene, and makes its tuple again.
fn repair(made: &Path, scene: &str) {
    let lines = crate::support::outputs::manifest(made);
    let line = lines.iter().find(|line| line["id"] == scene).unwrap();
    let color = line["front"]["color"].as_str().unwrap().replace(':', "/");
    let color = made.join("inputs").join(color);
    let mut picture = image::open(&color).unwrap().to_rgb8();
    image::imageops::invert(&mut picture);
    picture.save(&color).unwrap();
    run(&["retry", text(made), scene, "--anew", "-q"]).expect(0);
    run(&["work", text(made), "-q"]).expect(0);
}

/// Flips a bit of a file and restores its time of modification.
fn damage(path: &Path) {
    let modified = path.metadata().unwrap().modified().unwrap();
    let mut bytes = fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(path, bytes).unwrap();
    fs::File::options().append(true).open(path).unwrap().set_modified(modified).unwrap();
}

#[test]
fn exports_follow_tuples_that_were_made_again() {
    let (folder, made) = finished(RECIPE);
    let out = |format: &str, name: &str| folder.path().join(format!("{format}-{name}"));
    for format in FORMATS {
        run(&arguments(&made, &out(format, "old"), &["--format", format])).expect(0);
    }
    let scene = ids(&made, "train")[2].clone();
    repair(&made, &scene);
    for format in FORMATS {
        let (old, fresh) = (out(format, "old"), out(format, "fresh"));
        let more = ["--format", format];
        let foretold = run(&arguments(&made, &old, &["--format", format, "-n", "--json"]));
        assert_eq!(foretold.expect(0).json()["already_complete"], false, "{format}");
        let ended = run(&arguments(&made, &old, &more)).expect(0);
        let why = format!("5 made again, because tuples/{scene} changed since\n");
        ended.prints(&[&why]);
        run(&arguments(&made, &fresh, &more)).expect(0);
        assert_equal(&old, &fresh);
        run(&arguments(&made, &old, &more)).expect(0).prints(&["is complete, nothing to do"]);
        run(&arguments(&made, &old, &["--format", format, "--verify"]))
            .expect(0)
            .prints(&["is complete, nothing to do"]);
    }
}

#[test]
fn exports_follow_the_tuples_of_a_bucket() {
    let (folder, made) = finished(RECIPE);
    let server = S3Server::start(5);
    let bucket = server.store("runs/smoke");
    let put = || {
        for path in files(&made).iter().filter(|path| !path.ends_with("work.lock")) {
            bucket.replace(text(path), &fs::read(made.join(path)).unwrap()).unwrap();
        }
    };
    put();
    let [here, out, fresh] = ["here", "out", "fresh"].map(|name| folder.path().join(name));
    let address = format!("s3://{BUCKET}/runs/smoke");
    let export = |more: &[&str]| -> Ended {
        let more = [&["--format", "pairs", "--store", &address], more].concat();
        let mut command = command(&arguments(&here, &out, &more));
        server.tell(&mut command);
        command.output().unwrap().into()
    };
    export(&[]).expect(0).prints(&["exported 7 tuples"]);
    // The same bytes under other times are the same tuples.
    put();
    export(&[]).expect(0).prints(&["is complete, nothing to do"]);
    let scene = ids(&made, "test")[0].clone();
    repair(&made, &scene);
    put();
    export(&[]).expect(0).prints(&["2 made again", &format!("tuples/{scene} changed since")]);
    run(&arguments(&made, &fresh, &["--format", "pairs"])).expect(0);
    assert_equal(&out, &fresh);
}

#[test]
fn exports_mend_damaged_and_lost_files() {
    let (folder, made) = finished(RECIPE);
    for format in FORMATS {
        let out = folder.path().join(format);
        let more = ["--format", format];
        run(&arguments(&made, &out, &more)).expect(0);
        let whole = content(&out);
        for name in whole.keys().filter(|name| !name.ends_with("export.json")) {
            damage(&out.join(name));
            let ended = run(&arguments(&made, &out, &more)).expect(0);
            ended.prints(&["made again, because", text(name), "is damaged"]);
            assert!(content(&out) == whole, "{format}: {}", name.display());
        }
        let lost = whole.keys().next().unwrap();
        fs::remove_file(out.join(lost)).unwrap();
        run(&arguments(&made, &out, &more)).expect(0).prints(&[text(lost), "is missing"]);
        assert!(content(&out) == whole, "{format}");
        // Without its records, an export is made again.
        fs::remove_dir_all(out.join(".export")).unwrap();
        run(&arguments(&made, &out, &more)).expect(0).prints(&["7 made again"]);
        assert!(content(&out) == whole, "{format}");
    }
}

#[test]
fn photographs_follow_their_tuples_and_are_mended() {
    let (folder, made) = finished(RECIPE);
    let [sensor, out, fresh] =
        ["sensor.toml", "developed", "fresh"].map(|name| folder.path().join(name));
    fs::write(&sensor, "[sensor]\ncamera = \"imx686\"\n").unwrap();
    let develop =
        |out: &Path| run(&["develop", text(&made), "--sensor", text(&sensor), "--out", text(out)]);
    develop(&out).expect(0).prints(&["photographed 7 scenes"]);
    let scenes = ids(&made, "train");
    repair(&made, &scenes[0]);
    damage(&out.join(&scenes[1]).join("photo.jpg"));
    fs::write(out.join(&scenes[2]).join("photo.jpg"), "").unwrap();
    fs::copy(
        out.join(&scenes[4]).join("photograph.json"),
        out.join(&scenes[3]).join("photograph.json"),
    )
    .unwrap();
    let said = develop(&out).expect(0);
    let why = format!("tuples/{}/tuple.exr changed since", scenes[0]);
    said.prints(&["photographed 4 scenes", "3 were there already; 4 made again", &why]);
    develop(&fresh).expect(0);
    assert_equal(&out, &fresh);
    develop(&out).expect(0).prints(&["photographed 0 scenes", "7 were there already"]);

    // Photographs are not written through links.
    let elsewhere = folder.path().join("elsewhere");
    fs::rename(out.join(&scenes[0]), &elsewhere).unwrap();
    std::os::unix::fs::symlink(&elsewhere, out.join(&scenes[0])).unwrap();
    fs::write(elsewhere.join("photo.jpg"), "mine").unwrap();
    develop(&out).expect(3).prints(&["is a link"]);
    assert_eq!(fs::read(elsewhere.join("photo.jpg")).unwrap(), b"mine");
}

/// Writes weights of the smallest published network with small numbers.
fn weights(folder: &Path) -> PathBuf {
    let tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Model::Vits
        .config()
        .tensors()
        .into_iter()
        .map(|(name, shape)| {
            let count: usize = shape.iter().product();
            let mut state = name.len() as u32;
            let mut number = || {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (f64::from(state >> 8) / f64::from(1 << 24) - 0.5) as f32 * 0.1
            };
            let bytes = (0..count).flat_map(|_| number().to_le_bytes()).collect();
            (name, shape, bytes)
        })
        .collect();
    let views = tensors.iter().map(|(name, shape, bytes)| {
        let view =
            safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), bytes);
        (name.as_str(), view.unwrap())
    });
    let path = folder.join("vits.safetensors");
    fs::write(&path, safetensors::serialize(views, None).unwrap()).unwrap();
    path
}

#[test]
fn depth_maps_follow_their_pictures_and_are_mended() {
    let folder = tempfile::tempdir().unwrap();
    let [pictures, out] = ["pictures", "depth"].map(|name| folder.path().join(name));
    fs::create_dir(&pictures).unwrap();
    let weights = weights(folder.path());
    let picture = |name: &str, seed: u32, [width, height]: [u32; 2]| {
        let pixel = |x: u32, y: u32| {
            image::Rgb([x * 7 + seed, y * 5 + x * seed, 90 + seed].map(|v| v as u8))
        };
        // In place, as an editor of EXIF data does: a hard link in OUT shows the same bytes.
        let mut bytes = std::io::Cursor::new(Vec::new());
        RgbImage::from_fn(width, height, pixel)
            .write_to(&mut bytes, image::ImageFormat::Png)
            .unwrap();
        fs::write(pictures.join(name), bytes.into_inner()).unwrap();
    };
    for (seed, name) in ["a.png", "b.png", "c.png"].into_iter().enumerate() {
        picture(name, seed as u32, [42, 28]);
    }
    let depth = |more: &[&str]| {
        let call = ["depth", text(&pictures), "--weights", text(&weights), "--out", text(&out)];
        run(&[&call[..], more].concat())
    };
    depth(&[]).expect(0).prints(&["depth of 3 pictures"]);
    let map = |name: &str| fs::read(out.join(format!("{name}_depth.npy"))).unwrap();
    let [a, b, c] = ["a", "b", "c"].map(map);
    depth(&["--verify"]).expect(0).prints(&["depth of 0 pictures", "3 were there already"]);
    picture("a.png", 9, [28, 42]);
    fs::write(out.join("b_depth.npy"), "").unwrap();
    let said = depth(&[]).expect(0);
    said.prints(&[
        "1 were there already; 2 made again, because a.png changed since",
        "b_depth.npy is damaged",
    ]);
    assert!(map("a") != a && map("a").len() == a.len(), "of the new picture");
    assert_eq!([map("b"), map("c")], [b, c]);
    assert_eq!(fs::read(out.join("a.png")).unwrap(), fs::read(pictures.join("a.png")).unwrap());
}
