//! Pairs of pictures and ground truths in a folder.

use super::EvaluateError;
use super::layout::{Layout, Role, is_other_picture, layer_folder, picture_stem, recognise};
use render::file_tree::{ListError, Visits, file_tree};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The files of a picture, of its truth and, if they exist, of its reflections.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pair {
    /// Common name of the files, with the folders that they share: `real20/4`.
    pub name: String,
    /// The picture with the reflection (I).
    pub blended: PathBuf,
    /// The picture without the reflection (T).
    pub transmission: PathBuf,
    /// The reflection in the glass (R~).
    pub reflection: Option<PathBuf>,
    /// The reflected scene without the glass (R).
    pub clean_reflection: Option<PathBuf>,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Pairs sorted by the bytes of their names: `103` before `22`.
    pub pairs: Vec<Pair>,
    /// Files and folders that were left out, with reasons, sorted by path.
    pub left_out: Vec<(PathBuf, String)>,
}

/// Finds the pairs of a folder and of the folders below it, in any mixture of the layouts in `layout.rs`.
///
/// Lists the files and folders that it leaves out, such as pictures without a partner or in other formats. Ignores
/// hidden files and folders, and files outside layer folders that are not pictures. A folder without pairs is an error.
pub fn find_pairs(dir: &Path) -> Result<Found, EvaluateError> {
    let failed = |e: ListError| EvaluateError::Read { path: e.path, source: e.source };
    let tree = file_tree(dir, Visits::Once, &|_| true).map_err(failed)?;
    let mut search = Search::default();
    for name in tree.odd {
        search.leave_out(&dir.join(name), "its name is not UTF-8; rename it");
    }
    for (name, other) in tree.other_names {
        let reason = format!(
            "is another name of the folder {other}, or of one around it; a folder is searched once"
        );
        search.leave_out(&dir.join(name), &reason);
    }
    for file in &tree.files {
        search.file(dir, file);
    }
    let found = search.settle();
    if found.pairs.is_empty() {
        return Err(EvaluateError::NoPairs {
            path: dir.to_owned(),
            left_out_count: found.left_out.len(),
        });
    }
    Ok(found)
}

/// The files found so far, by pair and role, and the files and folders left out.
#[derive(Default)]
struct Search {
    by_name: BTreeMap<(String, Layout), [Vec<PathBuf>; 4]>,
    left_out: Vec<(PathBuf, String)>,
}

impl Search {
    /// Adds a file below `root`.
    fn file(&mut self, root: &Path, file: &str) {
        let (folder, name) = file.rsplit_once('/').unwrap_or(("", file));
        if name.starts_with('.') {
            return;
        }
        let mut group = Vec::new();
        let mut folders = folder.split('/').filter(|folder| !folder.is_empty());
        while let Some(folder) = folders.next() {
            let Some(role) = layer_folder(folder) else {
                group.push(folder);
                continue;
            };
            // A folder in a layer's folder, which all of its files name.
            if let Some(inner) = folders.next() {
                let path = group.iter().chain([&folder, &inner]).collect();
                self.leave_folder_out(&root.join::<PathBuf>(path));
            } else if let Some(stem) = picture_stem(name) {
                let path = root.join(file);
                self.place(within(&group, stem), Layout::LayerFolders, role, path);
            } else {
                self.leave_out(&root.join(file), NO_PICTURE);
            }
            return;
        }
        self.loose(root, file, &group, name);
    }

    /// Adds a file outside of layer folders.
    fn loose(&mut self, root: &Path, file: &str, group: &[&str], name: &str) {
        let path = root.join(file);
        let Some(stem) = picture_stem(name) else {
            if is_other_picture(name) {
                self.leave_out(&path, NO_PICTURE);
            }
            return;
        };
        let Some((layout, role, own_name)) = recognise(stem) else {
            self.leave_out(&path, "its name fits no known layout; put it into blended/ or transmission_layer/, or name it NAME-input or NAME-label1");
            return;
        };
        let own_name = match (own_name.as_str(), group) {
            ("", []) => last_part(root),
            ("", _) => group.join("/"),
            (own_name, _) => within(group, own_name),
        };
        self.place(own_name, layout, role, path);
    }

    fn leave_folder_out(&mut self, folder: &Path) {
        let reason = "is a folder in a layer's folder; move its pictures up";
        if self.left_out.last().is_none_or(|(last, _)| last != folder) {
            self.leave_out(folder, reason);
        }
    }

    fn place(&mut self, name: String, layout: Layout, role: Role, path: PathBuf) {
        self.by_name.entry((name, layout)).or_default()[role as usize].push(path);
    }

    fn leave_out(&mut self, path: &Path, reason: &str) {
        self.left_out.push((path.to_owned(), reason.to_owned()));
    }

    fn settle(mut self) -> Found {
        let mut pairs = Vec::new();
        for ((name, _), files) in std::mem::take(&mut self.by_name) {
            let reason = if files.iter().any(|of_role| of_role.len() > 1) {
                format!("several files of {name} have the same role; keep one file per role")
            } else if files[Role::Blended as usize].is_empty() {
                format!("{name} has no blended picture; add it")
            } else if files[Role::Transmission as usize].is_empty() {
                format!("{name} has no transmission, which is its truth; add it")
            } else {
                pairs.push((name, files));
                continue;
            };
            self.leave_all_out(files, &reason);
        }
        let mut found = Found::default();
        // Two layouts in one folder can produce the same name.
        for same in pairs.chunk_by(|a, b| a.0 == b.0) {
            match same {
                [(name, [blended, transmission, reflection, clean])] => found.pairs.push(Pair {
                    name: name.clone(),
                    blended: blended[0].clone(),
                    transmission: transmission[0].clone(),
                    reflection: reflection.first().cloned(),
                    clean_reflection: clean.first().cloned(),
                }),
                _ => {
                    for (name, files) in same {
                        let reason = format!("several pairs are named {name}; rename one");
                        self.leave_all_out(files.clone(), &reason);
                    }
                }
            }
        }
        self.left_out.sort();
        found.left_out = self.left_out;
        found
    }

    fn leave_all_out(&mut self, files: [Vec<PathBuf>; 4], reason: &str) {
        for path in files.into_iter().flatten() {
            self.left_out.push((path, reason.to_owned()));
        }
    }
}

/// Returns the name of a pair in nested folders.
fn within(group: &[&str], name: &str) -> String {
    group.iter().copied().chain([name]).collect::<Vec<_>>().join("/")
}

const NO_PICTURE: &str = "is not a .jpg, .jpeg, .jfif or .png file; save it as one";

/// Returns the folder's own name, or `picture` for a path without a name in UTF-8.
fn last_part(dir: &Path) -> String {
    let name = dir.file_name().and_then(|name| name.to_str());
    name.unwrap_or("picture").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    /// Makes a folder with these empty files.
    fn folder(files: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for file in files {
            let path = dir.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::File::create(path).unwrap();
        }
        dir
    }

    fn names(found: &Found) -> Vec<&str> {
        found.pairs.iter().map(|pair| pair.name.as_str()).collect()
    }

    fn left_out(dir: &Path, found: &Found) -> Vec<(String, String)> {
        let relative = |path: &Path| path.strip_prefix(dir).unwrap().display().to_string();
        found.left_out.iter().map(|(path, reason)| (relative(path), reason.clone())).collect()
    }

    #[test]
    fn layer_folders_match_by_name() {
        let dir = folder(&[
            "blended/22.jpg",
            "blended/103.JPG",
            "blended/4.png",
            "blended/4.jpeg",
            "blended/alone.png",
            "blended/notes.txt",
            "transmission_layer/22.png",
            "transmission_layer/103.jpeg",
            "transmission_layer/4.png",
            "transmission_layer/truth.png",
            "reflection_layer/22.jpg",
            "clean_reflection_layer/103.jpg",
            ".hidden.png",
            "README.md",
            "stray.png",
            "scan.tiff",
        ]);
        let found = find_pairs(dir.path()).unwrap();
        assert_eq!(names(&found), ["103", "22"]);
        assert!(found.pairs[0].reflection.is_none() && found.pairs[1].reflection.is_some());
        assert!(found.pairs[0].transmission.ends_with("transmission_layer/103.jpeg"));
        assert!(found.pairs[0].clean_reflection.is_some());
        let left_out = left_out(dir.path(), &found);
        let expected = [
            ("blended/4.jpeg", "several files of 4 have"),
            ("blended/4.png", "several files"),
            ("blended/alone.png", "no transmission"),
            ("blended/notes.txt", "is not a .jpg"),
            ("scan.tiff", "is not a .jpg"),
            ("stray.png", "fits no known layout"),
            ("transmission_layer/4.png", "several files"),
            ("transmission_layer/truth.png", "no blended"),
        ];
        assert_eq!(left_out.len(), expected.len(), "{left_out:?}");
        for ((path, reason), (expected_path, part)) in left_out.iter().zip(expected) {
            assert!(path == expected_path && reason.contains(part), "{path} {reason}");
        }
    }

    #[test]
    fn pairs_are_found_in_other_layouts_and_subfolders() {
        let dir = folder(&[
            "wild/1/m.jpg",
            "wild/1/g.png",
            "wild/1/r.jpg",
            "wild/2/m.jpg",
            "post/3-m-7.png",
            "post/3-g-7.png",
            "post/3-r-7.png",
            "post/4-m.png",
            "post/4-g.png",
            "ceil/a-input.png",
            "ceil/a-label1.png",
            "ceil/a-label2.png",
            "own/blended/x.png",
            "own/transmission_layer/x.png",
        ]);
        let found = find_pairs(dir.path()).unwrap();
        assert_eq!(names(&found), ["ceil/a", "own/x", "post/3-7", "post/4", "wild/1"]);
        let with_reflection = found.pairs.iter().filter(|p| p.reflection.is_some()).count();
        assert_eq!(with_reflection, 3);
        assert_eq!(left_out(dir.path(), &found)[0].0, "wild/2/m.jpg");
        let one = find_pairs(&dir.path().join("wild/1")).unwrap();
        assert_eq!(names(&one), ["1"]);
    }

    #[test]
    fn a_folder_with_several_names_is_searched_once() {
        let dir = folder(&[
            "a/blended/x.png",
            "a/transmission_layer/x.png",
            "a/blended/deep/y.png",
            "a/blended/deep/z.png",
            "@eaDir/blended/x.png",
            "@eaDir/transmission_layer/x.png",
            "a/blended/._x.png",
        ]);
        symlink(".", dir.path().join("me")).unwrap();
        symlink("a", dir.path().join("0")).unwrap();
        let found = find_pairs(dir.path()).unwrap();
        assert_eq!(names(&found), ["a/x"]);
        let left_out = left_out(dir.path(), &found);
        let expected = [
            ("0", "another name of the folder a"),
            ("a/blended/deep", "is a folder in a layer's"),
            ("me", "a folder is searched once"),
        ];
        assert_eq!(left_out.len(), expected.len(), "{left_out:?}");
        for ((path, reason), (expected_path, part)) in left_out.iter().zip(expected) {
            assert!(path == expected_path && reason.contains(part), "{path} {reason}");
        }
    }

    #[test]
    fn one_name_in_two_layouts_is_ambiguous() {
        let dir = folder(&[
            "blended/a.png",
            "transmission_layer/a.png",
            "a-input.png",
            "a-label1.png",
            "b-input.png",
            "b-label1.png",
        ]);
        let found = find_pairs(dir.path()).unwrap();
        assert_eq!((names(&found), found.left_out.len()), (vec!["b"], 4));
    }

    #[test]
    fn folders_without_pairs_are_errors() {
        let dir = folder(&["a.png", "b-input.png", "notes.txt"]);
        let error = find_pairs(dir.path()).unwrap_err().to_string();
        assert!(error.contains("(2 files or folders left out)"), "{error}");
        let error = find_pairs(&dir.path().join("none")).unwrap_err();
        assert!(matches!(error, EvaluateError::Read { .. }), "{error}");
    }
}
