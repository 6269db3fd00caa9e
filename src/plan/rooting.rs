//! Puts the files of a manifest below named roots, so that lines, tuples and data sets contain no folder of the machine.

use glasshouse_line::{SceneLine, is_url};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Name of the root for the relative paths of a manifest.
const MANIFEST_ROOT: &str = "manifest";
/// Names of the roots for the folders of other paths, before their number.
const FOLDER_ROOT: &str = "folder-";

/// Replaces the plain paths of the lines by paths below roots, and adds these roots. Paths below `base`, the manifest's
/// folder, get the root `manifest`. Each other folder with files gets a root `folder-1`, `folder-2`, ... in the order of
/// the lines. With `keeps_absolute`, these other paths become absolute instead, as in plans of older versions.
pub(super) fn root_paths(
    lines: &mut [SceneLine],
    base: PathBuf,
    roots: &mut BTreeMap<String, PathBuf>,
    keeps_absolute: bool,
) {
    let prefix = |text: &str| text.split_once(':').map(|(name, _)| name.to_owned());
    let taken: BTreeSet<String> =
        lines.iter().flat_map(SceneLine::paths).filter_map(|(_, text)| prefix(text)).collect();
    let mut names = (1..).map(|n| format!("{FOLDER_ROOT}{n}")).filter(|name| {
        // A name in a line without a root stays an error.
        !taken.contains(name) && !roots.contains_key(name)
    });
    let mut folders: BTreeMap<PathBuf, String> = BTreeMap::new();
    for text in lines.iter_mut().flat_map(SceneLine::paths_mut) {
        let is_rooted = prefix(text).is_some_and(|name| roots.contains_key(&name));
        let path = base.join(text.as_str());
        let (Some(folder), Some(file)) = (path.parent(), path.file_name()) else {
            continue;
        };
        if is_rooted || is_url(&*text) || (keeps_absolute && Path::new(text.as_str()).is_absolute())
        {
            continue;
        }
        let stays = |part| matches!(part, Component::Normal(_) | Component::CurDir);
        *text = if Path::new(text.as_str()).components().all(stays) {
            format!("{MANIFEST_ROOT}:{text}")
        } else if keeps_absolute {
            path.to_string_lossy().into_owned()
        } else {
            let next = || names.next().expect("numbers do not end");
            let root = folders.entry(folder.to_owned()).or_insert_with(next);
            format!("{root}:{}", file.to_string_lossy())
        };
    }
    drop(names);
    roots.extend(folders.into_iter().map(|(folder, name)| (name, folder)));
    roots.entry(MANIFEST_ROOT.to_owned()).or_insert(base);
}

#[cfg(test)]
mod tests {
    use super::*;
    use glasshouse_line::{Side, parse_scene};

    fn line(front: [&str; 2], back: &str) -> SceneLine {
        let camera = r#""intrinsics":{"fx":1,"fy":1,"cx":0,"cy":0}"#;
        let [color, depth] = front;
        let text = format!(
            r#"{{"schema":"glasshouse.scene/1","id":"a","seed":1,"film":{{"width":9,"height":6,"spp":16}},
            "camera":{{"focal_length_mm":55,"aperture_radius_m":0,"focus":{{"at":"infinity"}}}},
            "glass":{{"distance_m":0.3,"thickness_m":0.01,"ior":1.6}},
            "front":{{"color":"{color}","depth":"{depth}",{camera}}},"back":{{"mesh":"{back}"}}}}"#
        );
        parse_scene(&text).unwrap()
    }

    fn paths(lines: &[SceneLine]) -> Vec<&str> {
        let sides = lines.iter().flat_map(|line| [&line.front, &line.back]);
        sides.flat_map(Side::paths).map(|(_, path)| path).collect()
    }

    #[test]
    fn paths_elsewhere_get_a_root_for_each_folder() {
        let lines = || {
            vec![
                line(["/data/a.png", "sub/a.npy"], "../b.ply"),
                line(["folder-1:x.png", "/data/c.npy"], "s3://bucket/d.ply"),
            ]
        };
        let base = || PathBuf::from("/m/n");
        let (mut rooted, mut roots) = (lines(), BTreeMap::new());
        root_paths(&mut rooted, base(), &mut roots, false);
        // The second line has an unknown root, which stays an error.
        let expected = [
            "folder-2:a.png",
            "manifest:sub/a.npy",
            "folder-3:b.ply",
            "manifest:folder-1:x.png",
            "folder-2:c.npy",
            "s3://bucket/d.ply",
        ];
        assert_eq!(paths(&rooted), expected);
        let folders = [("folder-2", "/data"), ("folder-3", "/m/n/.."), ("manifest", "/m/n")];
        let folders = folders.map(|(name, folder)| (name.to_owned(), PathBuf::from(folder)));
        assert_eq!(roots, folders.into());

        let (mut kept, mut roots) = (lines(), BTreeMap::new());
        root_paths(&mut kept, base(), &mut roots, true);
        assert_eq!(paths(&kept)[..3], ["/data/a.png", "manifest:sub/a.npy", "/m/n/../b.ply"]);
        assert_eq!(roots.len(), 1);
    }
}
