//! Plans of folders in which photographs have several names: no split and no scene has a photograph twice.

use super::*;
use glasshouse_line::{Roots, SceneLine, Side};
use render::atomic_file::{create_dir, write_relaxed};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

const HEAD: &str =
    "schema = \"glasshouse.recipe/1\"\nname = \"x\"\n[film]\nwidth = 32\nheight = 32\nspp = 4\n";

fn write(path: &Path, bytes: &[u8]) {
    create_dir(path.parent().unwrap()).unwrap();
    write_relaxed(path, bytes).unwrap();
}

/// A PNG of 40 x 30 px whose bytes depend on `number`.
fn picture(path: &Path, number: u8) {
    create_dir(path.parent().unwrap()).unwrap();
    let pixel = |x: u32, y: u32| image::Rgb([number * 9, (x * 5) as u8, (y * 7) as u8]);
    image::RgbImage::from_fn(40, 30, pixel).save(path).unwrap();
}

/// A depth map of 40 x 30 px.
fn depth(path: &Path) {
    let values = vec![3.0; 1200];
    write(
        path,
        &render::formats::encode_npy(&[30, 40], &values, glasshouse_line::ExrPrecision::Float),
    );
}

/// Drafts a recipe in a folder.
fn plan(dir: &Path, text: &str) -> Result<Drafted, DraftError> {
    let recipe = dir.join("recipe.toml");
    write(&recipe, text.as_bytes());
    let request = Request {
        roots: &Roots::default(),
        inputs: &LocalFiles,
        run: &dir.join("run"),
        begin_writing: None,
        left_out: BTreeSet::new(),
        planned: None,
        only: None,
        checks_files: true,
        skip_invalid: false,
        threads: 1,
    };
    draft(&recipe, &request, &|_, _, _| {})
}

/// Checks that no split shares bytes with another one, and no scene has the same on both sides. Returns the names in use.
fn check(drafted: &Drafted) -> BTreeSet<String> {
    let bytes = |side: &Side| {
        let (root, path) = side.name().split_once(':').unwrap();
        fs::read(drafted.roots[root].join(path)).unwrap()
    };
    let mut of_split = BTreeMap::<_, BTreeSet<Vec<u8>>>::new();
    for SceneLine { id, split, front, back, .. } in &drafted.lines {
        let both = [bytes(front), bytes(back)];
        assert_ne!(both[0], both[1], "{id}: {} and {}", front.name(), back.name());
        of_split.entry(format!("{split:?}")).or_default().extend(both);
    }
    let sets: Vec<_> = of_split.values().collect();
    assert_eq!(sets.len(), 2);
    assert!(sets[0].is_disjoint(sets[1]), "the splits share a photograph");
    let sides = drafted.lines.iter().flat_map(|line| [&line.front, &line.back]);
    sides.map(|side| side.name().to_owned()).collect()
}

fn with_splits(sources: &str, pairs: &str) -> String {
    let split = |name: &str, count: u32| {
        let pairs = pairs.replace('N', &count.to_string());
        format!("[[split]]\nname = \"{name}\"\npairs = {{ {pairs} }}\n")
    };
    format!("{HEAD}{sources}{}{}", split("train", 30), split("test", 12))
}

#[test]
fn a_folder_with_links_copies_and_thumbnails() {
    let dir = tempfile::tempdir().unwrap();
    let photos = dir.path().join("photos");
    for number in 0..6 {
        picture(&photos.join(format!("2024/p{number}.png")), number);
    }
    for number in 0..3 {
        let from = photos.join(format!("2024/p{number}.png"));
        let to = |name: &str| {
            let path = photos.join(format!("{name}/q{number}.png"));
            create_dir(path.parent().unwrap()).unwrap();
            path
        };
        symlink(&from, to("album")).unwrap();
        fs::hard_link(&from, to("hard")).unwrap();
        fs::copy(&from, to("z copies")).unwrap();
        picture(&to("@eaDir/SYNO"), 20 + number);
        picture(&to("__MACOSX/2024"), 20 + number);
        write(&photos.join(format!("2024/._p{number}.png")), b"resource");
    }
    for (target, name) in [(".", "me"), ("2024", "latest"), ("..", "2024/up"), ("/", "2024/disk")] {
        symlink(target, photos.join(name)).unwrap();
    }
    let sources = "[sources.photos]\nlayout = \"folder\"\nplace = \"outdoor\"\n";
    let drafted = plan(dir.path(), &with_splits(sources, "photos = N")).unwrap();
    let names = check(&drafted);
    assert!(
        names.len() == 6 && names.iter().all(|name| name.starts_with("photos:2024/p")),
        "{names:?}"
    );
    let notes = drafted.notes.join("\n");
    for words in [
        "4 names of them are left out (first: 2024/disk leads to",
        "6 further names of files are left out (first: album/q0.png is 2024/p0.png)",
        "3 files with the bytes of another one are left out (first: z copies/q0.png has those of 2024/p0.png)",
        "5 thumbnails or resources of other programs are skipped (first: 2024/._p0.png)",
    ] {
        assert!(notes.contains(words), "{words}: {notes}");
    }
    assert!(!notes.contains("cannot be read"), "{notes}");
}

#[test]
fn one_picture_with_a_link_to_its_folder_is_too_few() {
    let dir = tempfile::tempdir().unwrap();
    picture(&dir.path().join("photos/a.png"), 1);
    symlink(".", dir.path().join("photos/me")).unwrap();
    let error =
        plan(dir.path(), &with_splits("[sources.photos]\nlayout = \"folder\"\n", "photos = N"));
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("has 1 photographs, but 2 splits") && error.contains("count once"),
        "{error}"
    );
}

#[test]
fn other_layouts_with_links_and_copies() {
    let dir = tempfile::tempdir().unwrap();
    let photos = dir.path().join("photos");
    let places = |number: u8| format!("a/alley/{number}");
    let diode = |number: u8| format!("outdoor/scene_1/scan_{number}/{number}");
    for (layout, name) in [("places", &places as &dyn Fn(u8) -> String), ("diode", &diode)] {
        let _ = fs::remove_dir_all(&photos);
        let path = |number: u8, ending: &str| photos.join(format!("{}{ending}", name(number)));
        for number in 0..6 {
            picture(&path(number, ".png"), number % 4);
            depth(&path(number, "_depth.npy"));
            write(&path(number, ".png").with_file_name(format!("._{number}.png")), b"resource");
            write(
                &path(number, ".png").with_file_name(format!("._{number}_depth.npy")),
                b"resource",
            );
        }
        fs::remove_file(path(5, ".png")).unwrap();
        fs::hard_link(path(1, ".png"), path(5, ".png")).unwrap();
        write(
            &dir.path().join("ranges.toml"),
            b"schema = \"glasshouse.depth_ranges/1\"\n[category.alley]\nplace = \"outdoor\"\nrange = { mean_m = 12 }\nwhy = \"a guess\"\n",
        );
        let keys = match layout {
            "places" => {
                "depth_ranges = \"ranges.toml\"\ndepth_root = \"photos\"\ndepth_kind = \"relative_inverse\"\n"
            }
            _ => "",
        };
        let sources = format!(
            "[sources.photos]\nlayout = \"{layout}\"\n{keys}intrinsics = {{ fx = 40, fy = 40, cx = 20, cy = 15 }}\n"
        );
        let drafted = plan(dir.path(), &with_splits(&sources, "photos = N")).unwrap();
        assert_eq!(check(&drafted).len(), 4, "{layout}");
        let notes = drafted.notes.join("\n");
        assert!(
            notes.contains("1 further names of files") && notes.contains("1 files with the bytes"),
            "{notes}"
        );
    }
}

#[test]
fn lists_and_sources_that_share_photographs() {
    let dir = tempfile::tempdir().unwrap();
    let photos = dir.path().join("photos");
    let mut list = String::new();
    for number in 0..8u8 {
        let name = format!("p{number}.png");
        picture(&photos.join(&name), number);
        depth(&photos.join("d.npy"));
        fs::hard_link(photos.join(&name), photos.join(format!("q{number}.png"))).unwrap();
        for name in [&name, &format!("./{name}"), &format!("q{number}.png")] {
            let _ = writeln!(
                list,
                "{{\"schema\":\"glasshouse.photograph/1\",\"place\":\"outdoor\",\"color\":\"{name}\",\"depth\":\"d.npy\",\
                 \"intrinsics\":{{\"fx\":40,\"fy\":40,\"cx\":20,\"cy\":15}}}}"
            );
        }
    }
    write(&photos.join("photographs.jsonl"), list.as_bytes());
    // Sources of one root are refused, but a root may have two names.
    symlink("photos", dir.path().join("photos2")).unwrap();
    let sources = "[sources.aa]\nlayout = \"list\"\nroot = \"photos\"\n[sources.bb]\nlayout = \"folder\"\nroot = \"photos2\"\n";
    for pairs in ["aa = N, bb = N", "\"aa/bb\" = N", "aa = N, \"bb/aa\" = N"] {
        let drafted = plan(dir.path(), &with_splits(sources, pairs)).unwrap();
        check(&drafted);
        let notes = drafted.notes.join("\n");
        assert!(
            notes.contains("source aa: each file counts once, and 16 further names"),
            "{notes}"
        );
    }
    // All photographs of one source are in the only split of the other.
    let error = format!(
        "{HEAD}{sources}[[split]]\nname = \"train\"\npairs = {{ aa = 4 }}\n[[split]]\nname = \"test\"\npairs = {{ bb = 4 }}\n"
    );
    let error = plan(dir.path(), &error).unwrap_err().to_string();
    assert!(error.contains("source bb has fewer than two photographs for split test"), "{error}");
}
