//! Scores pictures in a folder: the outputs of any program.

use super::EvaluateError;
use super::lanczos::{resize, shrunk_size_px};
use super::method::{Given, Method, Unmade};
use super::picture::read_picture;
use super::subject::Subject;
use image::RgbImage;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Outputs in a folder, one PNG file for each picture of a subject.
///
/// The file of a picture is `NAME.png`, where NAME is the picture's name (`real20/4`), or `STEM.png`, where STEM is the
/// name of its file without the ending (`4`) and of no other picture's. It has the size of the input, or of the input's
/// file if inputs are scaled down; then it is scaled down alike.
pub struct OutputFolder {
    folder: PathBuf,
    /// Name of each picture, and its file's stem with the number of pictures that share it.
    pictures: Vec<(String, String, usize)>,
}

impl OutputFolder {
    /// Opens a folder with outputs for the pictures of a subject. Fails if it is not a folder.
    pub fn open(folder: &Path, subject: &dyn Subject) -> Result<Self, EvaluateError> {
        let failed = |source| EvaluateError::Read { path: folder.to_owned(), source };
        std::fs::read_dir(folder).map_err(failed)?;
        let stems: Vec<String> = (0..subject.count()).map(|k| subject.file_stem(k)).collect();
        let mut counts = BTreeMap::new();
        for stem in &stems {
            *counts.entry(stem.clone()).or_insert(0) += 1;
        }
        let picture = |(index, stem): (usize, String)| {
            let count = counts[&stem];
            (subject.name(index), stem, count)
        };
        Ok(Self {
            folder: folder.to_owned(),
            pictures: stems.into_iter().enumerate().map(picture).collect(),
        })
    }

    /// Finds the file of a picture.
    fn file(&self, index: usize) -> Result<PathBuf, String> {
        let (name, stem, sharing) = &self.pictures[index];
        let by_name = self.folder.join(format!("{name}.png"));
        let by_stem = self.folder.join(format!("{stem}.png"));
        if by_name.is_file() {
            Ok(by_name)
        } else if *sharing > 1 {
            Err(format!(
                "{} does not exist, and {sharing} pictures share the name {stem}; add the output under the picture's own name",
                by_name.display()
            ))
        } else if by_stem.is_file() {
            Ok(by_stem)
        } else {
            Err(format!("{} does not exist; add the output of this picture", by_stem.display()))
        }
    }
}

impl Method for OutputFolder {
    fn make(&self, given: &Given) -> Result<RgbImage, Unmade> {
        let path = self.file(given.index).map_err(Unmade::LeftOut)?;
        let output = read_picture(&path).map_err(|e| Unmade::LeftOut(e.to_string()))?;
        let (wanted_px, found_px) = (given.input.dimensions().into(), output.dimensions().into());
        if found_px == wanted_px {
            return Ok(output);
        }
        let longest_px = given.input.width().max(given.input.height());
        if found_px == given.file_px && shrunk_size_px(found_px, longest_px) == wanted_px {
            return Ok(resize(output, wanted_px));
        }
        let [[w, h], [fw, fh]] = [wanted_px, found_px];
        Err(Unmade::LeftOut(format!(
            "{} has {fw} x {fh} px, but the picture has {w} x {h} px; make the output at the picture's size",
            path.display()
        )))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanczos::shrink_to;
    use crate::subject::{Unread, WithTruth};
    use image::Rgb;

    /// Pictures with these names and stems.
    struct Names(Vec<(&'static str, &'static str)>);

    impl Subject for Names {
        fn count(&self) -> usize {
            self.0.len()
        }

        fn name(&self, index: usize) -> String {
            self.0[index].0.to_owned()
        }

        fn file_stem(&self, index: usize) -> String {
            self.0[index].1.to_owned()
        }

        fn read(&self, _: usize) -> Result<WithTruth, Unread> {
            Err(Unread::Missing("it has no pixels".to_owned()))
        }

        fn is_aligned(&self) -> bool {
            true
        }
    }

    fn picture(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| Rgb([x * 5, y * 9, x * y].map(|v| v as u8)))
    }

    #[test]
    fn outputs_are_found_by_the_names_of_pictures_and_files() {
        let folder = tempfile::tempdir().unwrap();
        let save = |name: &str, picture: RgbImage| {
            let path = folder.path().join(name);
            render::atomic_file::create_dir(path.parent().unwrap()).unwrap();
            picture.save(path).unwrap();
        };
        save("b/4.png", picture(40, 30));
        save("4.png", picture(40, 30));
        save("7.png", picture(41, 30));
        save("large.png", picture(80, 60));
        let names = [("a/4", "4"), ("b/4", "4"), ("a/7", "7"), ("a/9", "9"), ("large", "large")];
        let outputs = OutputFolder::open(folder.path(), &Names(names.to_vec())).unwrap();
        let input = picture(40, 30);
        let make = |index| {
            let file_px = if index == 4 { [80, 60] } else { [40, 30] };
            outputs.make(&Given { index, input: &input, file_px })
        };
        assert_eq!(make(1).unwrap(), input);
        assert_eq!(make(4).unwrap(), shrink_to(picture(80, 60), 40));
        for (index, words) in [
            (0, "2 pictures share the name 4"),
            (2, "has 41 x 30 px, but the picture has 40 x 30 px"),
            (3, "9.png does not exist"),
        ] {
            let Err(Unmade::LeftOut(reason)) = make(index) else {
                panic!("{index}");
            };
            assert!(reason.contains(words), "{reason}");
        }
        assert!(OutputFolder::open(&folder.path().join("none"), &Names(Vec::new())).is_err());
    }
}
