//! Makes the first step of the shipped weights' training again: plans the recipe, renders only the scenes of the step, and
//! compares the model with the digest that the training left.

use compose::encode_tuple;
use glasshouse::{plan, render};
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Roots, SceneLine, Split};
use plan::{LocalFiles, ProceduralInput, Recipe, Request, TrainSettings, make_inputs};
use render::Loaded;
use render::scene::read_files;
use render::shard::scene_digest;
use render::trace::Isa;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use train::{
    Batch, Checkpoint, ExampleSampler, Learner, PairSource, PixelSource, SceneSource, Stage,
    TupleFiles, TupleFilesError, TupleSource, code_path,
};

/// Name of the training in the recipe.
const NAME: &str = "unet-seed-1";

/// Files of a tuple by name; `None` for a scene that cannot be rendered.
type Files = Option<BTreeMap<String, Vec<u8>>>;

/// The tuples of a run, each rendered when it is first read.
struct OnDemand {
    run: PathBuf,
    roots: Roots,
    lines: Vec<SceneLine>,
    pictures: Vec<ProceduralInput>,
    made: Mutex<BTreeMap<SceneId, Files>>,
}

impl OnDemand {
    fn make(&self, line: &SceneLine) -> Files {
        let of_line = line.paths().into_iter();
        let paths: BTreeSet<PathBuf> =
            of_line.map(|(_, path)| self.roots.resolve(&self.run, path).unwrap()).collect();
        let needed = self.pictures.iter();
        let needed: Vec<ProceduralInput> = needed
            .filter(|one| one.paths(&self.run).iter().any(|path| paths.contains(path)))
            .cloned()
            .collect();
        make_inputs(&self.run, &needed, 1, &|_, _| {}).unwrap();
        let files = read_files(line, &self.roots, &self.run).unwrap();
        // The farm quarantines such a scene, and training replaces it.
        let scene = Loaded::new(line.clone(), &files).ok()?;
        let tuple = scene.tuple(64, Isa::detect(), &AtomicBool::new(false), &|| {}).unwrap();
        Some(encode_tuple(&tuple.unwrap(), &SrgbEncoder::new()).unwrap().into_iter().collect())
    }
}

impl TupleFiles for OnDemand {
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Vec<u8>>, TupleFilesError> {
        let mut made = self.made.lock().unwrap();
        let files = made.entry(scene.clone()).or_insert_with(|| {
            let line = self.lines.iter().find(|line| line.id == *scene);
            self.make(line.unwrap())
        });
        Ok(files.as_ref().and_then(|files| files.get(file).cloned()))
    }

    fn is_quarantined(&self, _: &SceneId) -> Result<bool, TupleFilesError> {
        Ok(false)
    }

    fn count(&self, scenes: &[SceneId]) -> Result<usize, TupleFilesError> {
        Ok(scenes.len())
    }
}

fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// Plans the recipe in memory.
fn planned(recipe: &Path, run: &Path) -> OnDemand {
    let request = Request {
        roots: &Roots::default(),
        inputs: &LocalFiles,
        run,
        begin_writing: None,
        left_out: BTreeSet::new(),
        planned: None,
        only: None,
        checks_files: true,
        skip_invalid: false,
        threads: 1,
    };
    let drafted = plan::draft(recipe, &request, &|_, _, _| {}).unwrap();
    let root = |(name, folder): (String, PathBuf)| format!("{name}={}", run.join(folder).display());
    let roots: Vec<String> = drafted.roots.into_iter().map(root).collect();
    OnDemand {
        run: run.to_owned(),
        roots: Roots::parse(&roots).unwrap(),
        lines: drafted.lines.into_iter().filter(|line| line.split == Split::Train).collect(),
        pictures: drafted.to_make,
        made: Mutex::default(),
    }
}

/// Takes the first step of a training and returns the digest of its model's file.
fn first_step(files: OnDemand, settings: &TrainSettings) -> String {
    let lines = files.lines.clone();
    let files = Arc::new(files);
    let scenes = SceneSource::Tuples(TupleSource { files, lines, pixels: PixelSource::Exr });
    let (_stop, stopped) = crossbeam::channel::bounded(0);
    let pairs = PairSource { pairs: Vec::new() };
    let sampler = ExampleSampler::new(settings, scenes, pairs, 1 << 30, stopped).unwrap();
    let examples = sampler.examples(0).unwrap();
    let mut learner = Learner::new(Stage::Separation, settings, None).unwrap();
    learner.step(0, &Batch::new(&examples).unwrap(), &mut |_| {}).unwrap();
    let model = train::safetensors::serialize(learner.model(), None).unwrap();
    blake3::hash(&model).to_hex().to_string()
}

#[test]
fn the_first_step_of_the_shipped_training_can_be_made_again() {
    let recipe = repository("manifests/learn.toml");
    let trainings = Recipe::parse(&std::fs::read_to_string(&recipe).unwrap()).unwrap().train;
    let settings = trainings.unwrap().find(Some(NAME)).unwrap().settings;
    let shipped = Checkpoint::shipped().unwrap().state;
    assert_eq!(shipped.settings.differences(&settings), Vec::<String>::new());
    assert!(shipped.history.is_empty());
    let run = tempfile::tempdir().unwrap();
    let files = planned(&recipe, run.path());
    let digests: String = files.lines.iter().map(|line| scene_digest(line) + "\n").collect();
    assert_eq!(shipped.origin.scenes_blake3, blake3::hash(digests.as_bytes()).to_hex().as_str());

    let text = std::fs::read(repository("src/train/weights/first_step.json")).unwrap();
    let expected: BTreeMap<String, String> = serde_json::from_slice(&text).unwrap();
    let Some(expected) = expected.get(code_path()) else {
        eprintln!("skipped: the weights were trained with other instructions than {}", code_path());
        return;
    };
    assert_eq!(&first_step(files, &settings), expected);
}
