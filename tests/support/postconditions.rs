//! Checks what every successful call of the program promises. The helper that starts the program makes these checks, so
//! that no test can leave them out: inputs are unchanged, the answer is whole, and the promised files are there, match
//! their digests and show what they should.

use super::outputs::{exr_channels, files};
use glasshouse::run::Run;
use glasshouse_line::layer::Layer;
use glasshouse_line::{Roots, SceneLine};
use image::RgbImage;
use render::merge::TupleRecord;
use sha2::{Digest, Sha256};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Largest number of tuples of a call whose pixels are compared.
const TUPLES: usize = 3;

/// A call of the program, as it was before its start.
pub(crate) struct Call {
    arguments: Vec<OsString>,
    folder: PathBuf,
    /// Files that the call reads, with the digests of their bytes.
    inputs: Vec<(PathBuf, blake3::Hash)>,
}

impl Call {
    pub(crate) fn new(command: &Command) -> Self {
        let arguments = command.get_args().map(OsStr::to_owned).collect();
        let folder = command.get_current_dir().unwrap_or(Path::new(".")).to_owned();
        let mut call = Self { arguments, folder, inputs: Vec::new() };
        call.inputs = call.read_inputs();
        call
    }

    /// Asserts what the call promises with this exit code. `stdout` is `None` if the test did not read it.
    #[track_caller]
    pub(crate) fn check(&self, code: Option<i32>, stdout: Option<&[u8]>) {
        for (path, digest) in &self.inputs {
            let bytes = std::fs::read(path).unwrap_or_default();
            assert_eq!(
                blake3::hash(&bytes),
                *digest,
                "{self} changed its input {}",
                path.display()
            );
        }
        if code != Some(0) || self.has("-n") || self.has("--dry-run") || self.has("--help") {
            return;
        }
        if let Some(stdout) = stdout {
            self.check_answer(stdout);
        }
        match self.arguments.first().and_then(|name| name.to_str()) {
            Some("plan") => drop(self.planned()),
            Some("run") => self.check_done(&self.planned()),
            // A worker of a queue ends with 0 when its run is over, even if scenes are in quarantine.
            Some("work") if self.has("--only") || self.has("--queue") => {}
            Some("work" | "merge" | "coordinate") if !self.has("--store") => {
                self.check_done(&open(&self.at(1)));
            }
            Some("render") => self.check_rendered(),
            Some("separate") => self.check_separated(),
            Some("evaluate") => {
                self.check_files(&["evaluation.md", "evaluation.csv", "evaluation.json"]);
            }
            Some("export") => self.check_export(),
            Some("report") => self.check_report(),
            _ => {}
        }
    }

    fn has(&self, option: &str) -> bool {
        self.arguments.iter().any(|argument| argument == option)
    }

    fn value(&self, option: &str) -> Option<PathBuf> {
        let at = self.arguments.iter().position(|argument| argument == option)?;
        self.arguments.get(at + 1).map(|value| self.folder.join(value))
    }

    /// Returns the path in the argument with this index.
    #[track_caller]
    fn at(&self, index: usize) -> PathBuf {
        let argument = &self.arguments[index];
        let is_option = argument.as_encoded_bytes().starts_with(b"-");
        assert!(!is_option, "{self}: write the path before all options");
        self.folder.join(argument)
    }

    /// Reads the files that the arguments name, except outputs, and the photographs of a scene or a list of scenes.
    fn read_inputs(&self) -> Vec<(PathBuf, blake3::Hash)> {
        let mut paths = Vec::new();
        for (index, argument) in self.arguments.iter().enumerate().skip(1) {
            if self.arguments[index - 1] == "--out" {
                continue;
            }
            let path = self.folder.join(argument);
            if !path.is_file() {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap_or_default();
            let lines = text.lines().chain([text.as_str()]);
            for line in lines.filter_map(|line| serde_json::from_str::<SceneLine>(line).ok()) {
                let base = path.parent().unwrap();
                paths.extend(line.paths().into_iter().map(|(_, file)| base.join(file)));
            }
            paths.push(path);
        }
        let is_read = |path: &PathBuf| {
            std::fs::metadata(path).is_ok_and(|data| data.is_file() && data.len() < 1 << 26)
        };
        let digest = |path: PathBuf| Some((path.clone(), blake3::hash(&std::fs::read(path).ok()?)));
        paths.into_iter().filter(is_read).filter_map(digest).collect()
    }

    #[track_caller]
    fn check_answer(&self, stdout: &[u8]) {
        let text = std::str::from_utf8(stdout).expect("an answer is UTF-8");
        assert!(text.ends_with('\n'), "{self}: the answer has no end: {text:?}");
        if self.has("--json") {
            for line in text.lines() {
                let object = serde_json::from_str::<serde_json::Value>(line);
                let has_schema = object.as_ref().is_ok_and(|object| object["schema"].is_string());
                assert!(has_schema, "{self}: {line:?} is no object with a schema: {object:?}");
            }
        }
    }

    /// Opens the run that `plan` or `run` made.
    #[track_caller]
    fn planned(&self) -> Run {
        let named = || {
            let text = std::fs::read_to_string(self.at(1)).unwrap();
            let stem = self.at(1).file_stem().unwrap().to_string_lossy().into_owned();
            let recipe: Option<toml::Table> = toml::from_str(&text).ok();
            let name = recipe.and_then(|recipe| Some(recipe.get("name")?.as_str()?.to_owned()));
            self.folder.join("runs").join(name.unwrap_or(stem))
        };
        open(&self.value("--out").unwrap_or_else(named))
    }

    /// Asserts that every scene has a whole tuple.
    #[track_caller]
    fn check_done(&self, run: &Run) {
        for (index, line) in run.lines.iter().enumerate() {
            let folder = run.root().join("tuples").join(line.id.as_str());
            let record = folder.join("tuple.json");
            let bytes = std::fs::read(&record)
                .unwrap_or_else(|error| panic!("{self}: {}: {error}", record.display()));
            let record: TupleRecord = serde_json::from_slice(&bytes).unwrap();
            for name in record.files.keys() {
                let bytes = std::fs::read(folder.join(name)).unwrap_or_default();
                let checked = record.check_file(name, &bytes);
                assert_eq!(checked, Ok(()), "{self}: {}/{name}", folder.display());
            }
            if index >= TUPLES {
                continue;
            }
            for layer in record.layers.keys() {
                check_picture(
                    &folder.join(format!("{layer}.png")),
                    &folder.join("tuple.exr"),
                    layer,
                );
            }
        }
    }

    #[track_caller]
    fn check_rendered(&self) {
        let out = self.value("--out").unwrap_or_else(|| self.folder.clone());
        // Labels have no PNG.
        let is_layer = |path: &PathBuf| {
            let stem = path.file_stem().and_then(|stem| stem.to_str());
            path.extension() == Some("exr".as_ref())
                && stem.is_some_and(|stem| Layer::from_name(stem).is_some())
        };
        for path in files(&out).into_iter().filter(is_layer) {
            check_picture(&out.join(path.with_extension("png")), &out.join(&path), "");
        }
    }

    #[track_caller]
    fn check_separated(&self) {
        let out = self.value("--out").expect("separate has --out");
        let names = files(&out);
        let is_picture = |path: &&PathBuf| path.extension() == Some("png".as_ref());
        let pictures: Vec<_> = names.iter().filter(is_picture).collect();
        assert!(pictures.len() >= 2, "{self}: {names:?}");
        for path in pictures {
            let path = out.join(path);
            image::open(&path)
                .unwrap_or_else(|error| panic!("{self}: {}: {error}", path.display()));
        }
    }

    #[track_caller]
    fn check_files(&self, names: &[&str]) {
        let Some(out) = self.value("--out") else { return };
        for name in names {
            let length = std::fs::metadata(out.join(name)).map_or(0, |data| data.len());
            assert!(length > 0, "{self}: {name} is missing");
        }
    }

    /// Asserts that the sums of an export match its files, and that no other file is there.
    #[track_caller]
    fn check_export(&self) {
        let out = self.value("--out").expect("export has --out");
        let sums = std::fs::read_to_string(out.join("SHA256SUMS")).unwrap_or_default();
        let mut summed = vec![PathBuf::from("SHA256SUMS")];
        for line in sums.lines() {
            let (sum, name) = line.split_once("  ").unwrap();
            let bytes = std::fs::read(out.join(name)).unwrap_or_default();
            let expected =
                (0..64).step_by(2).map(|k| u8::from_str_radix(&sum[k..k + 2], 16).unwrap());
            assert!(Sha256::digest(bytes).iter().copied().eq(expected), "{self}: {name}");
            summed.push(name.into());
        }
        summed.sort();
        assert_eq!(files(&out), summed, "{self}");
    }

    #[track_caller]
    fn check_report(&self) {
        let page = self.value("--out").unwrap_or_else(|| self.at(1).join("report/index.html"));
        let text = std::fs::read_to_string(&page).unwrap_or_default();
        let is_whole = text.starts_with("<!DOCTYPE html>") && text.trim_end().ends_with("</html>");
        assert!(is_whole, "{self}: {}", page.display());
    }
}

impl std::fmt::Display for Call {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let arguments = self.arguments.join(OsStr::new(" "));
        write!(f, "`glasshouse {}`", arguments.display())
    }
}

#[track_caller]
fn open(run: &Path) -> Run {
    // Checks the digest of the manifest.
    Run::open(run, &Roots::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Asserts that a PNG has the pixels of a layer of an EXR in sRGB, that all are finite, and that not all are equal.
#[track_caller]
fn check_picture(png: &Path, exr: &Path, layer: &str) {
    let channels = exr_channels(exr);
    let picture: RgbImage =
        image::open(png).unwrap_or_else(|e| panic!("{}: {e}", png.display())).into_rgb8();
    let mut differ = false;
    for (index, name) in ["R", "G", "B"].iter().enumerate() {
        let name = if layer.is_empty() { (*name).to_owned() } else { format!("{layer}.{name}") };
        let (kind, bits) = &channels[&name];
        assert_eq!(bits.len(), (picture.width() * picture.height()) as usize, "{}", png.display());
        for (bits, pixel) in bits.iter().zip(picture.pixels()) {
            let value = match *kind {
                "half" => exr::prelude::f16::from_bits(*bits as u16).to_f32(),
                _ => f32::from_bits(*bits),
            };
            assert!(value.is_finite() && value >= 0.0, "{}: {name} is {value}", exr.display());
            // The code is of the value before its rounding to a half float.
            let expected = srgb_code(value.into());
            let code = f64::from(pixel.0[index]);
            let limit = if *kind == "half" { 0.6 } else { 0.501 };
            assert!((code - expected).abs() < limit, "{}: {code}, {expected}", png.display());
            differ |= pixel != picture.get_pixel(0, 0);
        }
    }
    // A glass reflection may be black.
    if layer == "input" || png.ends_with("input.png") {
        assert!(differ, "{} has one colour", png.display());
    }
}

/// Returns the 8-bit sRGB code of a radiance (IEC 61966-2-1), not rounded.
fn srgb_code(value: f64) -> f64 {
    let value = value.clamp(0.0, 1.0);
    255.0 * if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}
