//! Makes a folder with the files that the examples of `--help` name, and copies it for each use.

use super::outputs::copy_folder;
use super::program::{Ended, command};
use super::scenes::{photographs, scene};
use std::path::Path;
use std::sync::OnceLock;
use tempfile::TempDir;

/// Returns a copy of the folder for one use.
pub(crate) fn workplace() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy_folder(made(), folder.path());
    folder
}

/// Runs the program in a folder.
pub(crate) fn run_in(folder: &Path, arguments: &[&str]) -> Ended {
    command(arguments).current_dir(folder).output().unwrap().into()
}

/// Returns the original folder, made once. The networks of its finished run are absent if the program has no trainer.
fn made() -> &'static Path {
    static MADE: OnceLock<TempDir> = OnceLock::new();
    let folder = MADE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        make(folder.path());
        folder
    });
    folder.path()
}

fn make(folder: &Path) {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR"));
    std::fs::create_dir(folder.join("manifests")).unwrap();
    let recipe = std::fs::read_to_string(repository.join("manifests/smoke.toml")).unwrap();
    let small = recipe
        .replace("= 256", "= 64")
        .replace("count = 16", "count = 6\nwidth = 32\nheight = 24")
        .replace("sample = 6", "sample = 1")
        .replace("sample = 2 ", "sample = 1 ")
        .replace("backtrack_steps = 60", "backtrack_steps = 2")
        .replace("separation_steps = 160", "separation_steps = 2")
        .replace("width = 8\n", "width = 4\n")
        .replace("discriminator_width = 8", "discriminator_width = 2");
    assert!(small.contains("separation_steps = 2\n"), "{small}");
    // With this split, training writes `best.json`.
    let validation = "[[split]]\nname = \"validation\"\npairs = { sample = 1 }\n\n[train]\n";
    let small = small.replace("[train]\n", validation);
    std::fs::write(folder.join("manifests/smoke.toml"), small).unwrap();
    photographs(folder);
    std::fs::write(folder.join("scene.json"), scene("one").to_string()).unwrap();
    run_in(folder, &["run", "manifests/smoke.toml"]).expect(0);
    run_in(folder, &["render", "scene.json", "--out", "out"]).expect(0);
    // Photographs for the examples of `separate` and `evaluate`.
    std::fs::copy(folder.join("a.png"), folder.join("photo.jpg")).unwrap();
    for (layer, picture) in [("blended", "a.png"), ("transmission_layer", "b.png")] {
        let layer = folder.join("pairs").join(layer);
        std::fs::create_dir_all(&layer).unwrap();
        std::fs::copy(folder.join(picture), layer.join("1.png")).unwrap();
    }
    // A rendering stands for the camera in the example of `similarity`.
    let capture = folder.join("captures/window");
    std::fs::create_dir_all(&capture).unwrap();
    for side in ["a", "b"] {
        for ending in [".png", "_depth.npy", "_depth_mask.npy"] {
            let name = format!("{side}{ending}");
            std::fs::copy(folder.join(&name), capture.join(&name)).unwrap();
        }
    }
    std::fs::copy(folder.join("scene.json"), capture.join("scene.json")).unwrap();
    std::fs::copy(folder.join("out/input.png"), capture.join("captured.png")).unwrap();
    // The examples of `develop` and of folders of pictures.
    std::fs::write(folder.join("phone.toml"), "[sensor]\ncamera = \"imx686\"\n").unwrap();
    for name in ["holiday", "rooms"] {
        std::fs::create_dir(folder.join(name)).unwrap();
        for (picture, from) in ["a.png", "b.png"].into_iter().cycle().take(6).enumerate() {
            // Pictures of equal bytes would count once.
            let mut turned = image::open(folder.join(from)).unwrap().to_rgb8();
            turned
                .pixels_mut()
                .for_each(|pixel| pixel.0[0] = pixel.0[0].wrapping_add(picture as u8));
            turned.save(folder.join(name).join(format!("{picture}.png"))).unwrap();
        }
    }
    let mine = "schema = \"glasshouse.recipe/1\"\nname = \"mine\"\n[sources.diode]\nlayout = \"diode\"\n\
         [[split]]\nname = \"train\"\npairs = { diode = 1 }\n";
    std::fs::write(folder.join("my.toml"), mine).unwrap();
}
