//! Tests examples that the trainer composes of a real run's tuples: nothing drawn is the tuple, and bits depend on
//! neither readers, memory, restarts nor the progress of the farm.

use crate::support::program::run;
use crate::training::{Place, place, small};
use compose::{Composition, Exposure, Strength, TargetLight};
use crossbeam::channel::{Sender, bounded};
use glasshouse::{compose, plan, run::Run, store::Store};
use glasshouse_line::ids::SceneId;
use glasshouse_line::{Roots, SceneLine, Split};
use plan::{ExampleKind, TrainSettings};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use train::{
    Example, ExampleError, ExampleSampler, FeatureSource, Loader, PairSource, PixelSource,
    SceneSource, TupleFiles, TupleFilesError, TupleSource,
};

fn settings(examples: ExampleKind, composition: Composition) -> TrainSettings {
    TrainSettings {
        features: FeatureSource::None,
        batch: 3,
        crop_px: 40,
        examples,
        composition,
        ..TrainSettings::default()
    }
}

fn train_lines(place: &Place) -> Vec<SceneLine> {
    let run = Run::open(&place.run, &Roots::default()).unwrap();
    run.lines.into_iter().filter(|line| line.split == Split::Train).collect()
}

/// Returns a sampler of a run's train scenes, and the sender whose end stops it.
fn sampler_of(
    files: Arc<dyn TupleFiles>,
    lines: Vec<SceneLine>,
    settings: &TrainSettings,
    memory: usize,
) -> (ExampleSampler, Sender<()>) {
    let scenes = SceneSource::Tuples(TupleSource { files, lines, pixels: PixelSource::Exr });
    let (stop, stopped) = bounded(0);
    let real = PairSource { pairs: Vec::new() };
    (ExampleSampler::new(settings, scenes, real, memory, stopped).unwrap(), stop)
}

fn sampler(place: &Place, settings: &TrainSettings, memory: usize) -> (ExampleSampler, Sender<()>) {
    let store = Arc::new(Store::local(&place.run).unwrap());
    sampler_of(store, train_lines(place), settings, memory)
}

fn examples(place: &Place, settings: &TrainSettings, steps: u64) -> Vec<Vec<Example>> {
    let (sampler, _stop) = sampler(place, settings, 1 << 30);
    (0..steps).map(|step| sampler.examples(step).unwrap()).collect()
}

/// Kinds of examples of equal strengths, exposures and cameras.
const KINDS: [ExampleKind; 4] = [
    ExampleKind::Composed,
    ExampleKind::LinearMixtures,
    ExampleKind::ZhangMixtures,
    ExampleKind::CeilnetMixtures,
];

#[test]
fn composition_without_draws_is_the_rendered_example() {
    let place = place();
    let rendered = settings(ExampleKind::Rendered, Composition::default());
    let off = settings(ExampleKind::Composed, Composition::off());
    let (expected, made) = (examples(&place, &rendered, 6), examples(&place, &off, 6));
    assert!(expected == made);
    // The settings are not ignored.
    let drawn = settings(ExampleKind::Composed, Composition::default());
    assert!(examples(&place, &drawn, 6) != expected);
    // A tuple with its own reflection and exposure differs from the rendered example by rounding, as the curve is a table.
    let mut nearly = Composition::off();
    nearly.white_balance = 1e-9;
    let nearly = examples(&place, &settings(ExampleKind::Composed, nearly), 6);
    for (a, b) in nearly.iter().flatten().zip(expected.iter().flatten()) {
        let layers = [(&a.input, &b.input), (&a.transmission, &b.transmission)];
        for (a, b) in layers.into_iter().flat_map(|(a, b)| a.iter().zip(b)) {
            assert!((a - b).abs() < 2e-4, "{a} {b}");
        }
    }
}

#[test]
fn readers_and_memory_change_no_bit() {
    let place = place();
    for kind in KINDS {
        let settings = settings(kind, Composition::default());
        let expected = examples(&place, &settings, 12);
        // No tuple fits into the first memory, and one into the second.
        for (readers, memory) in [(1, 0), (2, 80_000), (5, 1 << 30)] {
            let (sampler, stop) = sampler(&place, &settings, memory);
            // A resumed training starts at a later step.
            let first = readers as u64;
            let mut loader = Loader::start(sampler, first..12, readers, stop);
            for step in first..12 {
                let made = loader.next_step(&AtomicBool::new(false)).unwrap().unwrap();
                assert!(
                    made == expected[step as usize],
                    "{kind:?}: step {step}, {readers} readers"
                );
            }
            assert!(loader.next_step(&AtomicBool::new(false)).is_none());
        }
    }
}

/// A run whose first scenes alone have tuples.
struct Unfinished {
    store: Store,
    lines: Vec<SceneLine>,
    rendered: AtomicUsize,
}

impl TupleFiles for Unfinished {
    fn get(&self, scene: &SceneId, file: &str) -> Result<Option<Vec<u8>>, TupleFilesError> {
        let index = self.lines.iter().position(|line| line.id == *scene).unwrap();
        if index >= self.rendered.load(Ordering::Relaxed) {
            return Ok(None);
        }
        TupleFiles::get(&self.store, scene, file)
    }

    fn is_quarantined(&self, _: &SceneId) -> Result<bool, TupleFilesError> {
        Ok(false)
    }

    fn count(&self, scenes: &[SceneId]) -> Result<usize, TupleFilesError> {
        Ok(scenes.len().min(self.rendered.load(Ordering::Relaxed)))
    }
}

/// With `follow`, an example of the first epoch needs the tuples before its own alone, and waiting changes no bit.
#[test]
fn examples_of_an_unfinished_run_use_the_scenes_before_theirs() {
    let place = place();
    let lines = train_lines(&place);
    let mut settings = settings(ExampleKind::Composed, Composition::default());
    (settings.follow, settings.batch) = (true, 1);
    settings.composition.other_share = 1.0;
    let expected = examples(&place, &settings, 2 * lines.len() as u64);
    let files = Arc::new(Unfinished {
        store: Store::local(&place.run).unwrap(),
        lines: lines.clone(),
        rendered: AtomicUsize::new(2),
    });
    let (sampler, stop) = sampler_of(files.clone(), lines.clone(), &settings, 1 << 30);
    for (step, example) in expected.iter().enumerate() {
        // The first scene also needs the second.
        files.rendered.store((step + 1).clamp(2, lines.len()), Ordering::Relaxed);
        assert!(sampler.examples(step as u64).unwrap() == *example, "step {step}");
    }
    drop(stop);
    files.rendered.store(1, Ordering::Relaxed);
    let (sampler, stop) = sampler_of(files, lines, &settings, 0);
    drop(stop);
    assert!(matches!(sampler.examples(1), Err(ExampleError::Stopped)));
}

/// Crops, factors and the other tuple are the same for all kinds, so targets with their own light are equal, and inputs are
/// not.
#[test]
fn kinds_share_their_numbers() {
    let place = place();
    let target_light = TargetLight::WithoutPane;
    let mut composition = Composition { target_light, ..Composition::default() };
    (composition.other_share, composition.none_share) = (1.0, 0.0);
    (composition.exposure, composition.camera.enabled) = (Exposure::OfTuple, false);
    let of = |kind| -> Vec<Example> {
        examples(&place, &settings(kind, composition.clone()), 4).into_iter().flatten().collect()
    };
    let [composed, mixtures @ ..] = KINDS.map(of);
    for (k, mixture) in mixtures.iter().enumerate() {
        for (at, (a, b)) in mixture.iter().zip(&composed).enumerate() {
            assert!(a.transmission == b.transmission, "{:?} {at}", KINDS[k + 1]);
            assert!(a.input != b.input);
            assert!(k == 0 || a.input != mixtures[0][at].input);
        }
    }
}

#[test]
fn strengths_and_exposures_vary() {
    let place = place();
    let brightness = |example: &Example| {
        example.transmission.iter().sum::<f32>() / example.transmission.len() as f32
    };
    let spread = |composition| {
        let all = examples(&place, &settings(ExampleKind::Composed, composition), 30);
        let mut means: Vec<f32> = all.iter().flatten().map(brightness).collect();
        means.sort_by(f32::total_cmp);
        means[80] - means[10]
    };
    let mut fixed = Composition::default();
    fixed.camera.enabled = false;
    let mut wide = fixed.clone();
    (fixed.exposure, fixed.strength) = (Exposure::OfTuple, Strength::OfTuple);
    wide.camera.enabled = false;
    let [fixed, wide] = [fixed, wide].map(spread);
    assert!(wide > fixed + 0.05, "{wide} {fixed}");
}

#[test]
fn training_on_composed_examples_resumes_with_the_same_bits() {
    let more = ["--no-a-priori", "--examples", "composed"];
    let model = |place: &Place| {
        std::fs::read(place.folder_of("separation", 6).join("model.safetensors")).unwrap()
    };
    let whole = place();
    let ended = whole.train("separation", "6", &small(&[&more[..], &["-j", "1"]].concat()));
    assert_eq!(ended["settings"]["examples"], "composed");
    assert_eq!(ended["settings"]["composition"]["camera"]["enabled"], true);
    let parts = place();
    parts.train("separation", "2", &small(&[&more[..], &["-j", "2"]].concat()));
    parts.train("separation", "6", &["-j", "2"]);
    assert!(model(&whole) == model(&parts));
    // Other distributions are another training.
    let refused = parts.arguments("separation", "7", &["--camera", "off"]);
    run(&refused).expect(5).says(&["composition.camera.enabled: true -> false"]);
    let without = place();
    without.train("separation", "6", &small(&[&more[..], &["--camera", "off"]].concat()));
    assert!(model(&whole) != model(&without));
    for kind in ["linear-mixtures", "zhang-mixtures", "ceilnet-mixtures"] {
        let mixed = place();
        mixed.train("separation", "2", &small(&["--no-a-priori", "--examples", kind]));
    }
    let png = small(&["--examples", "composed", "--pixels", "png"]);
    let ended = run(&place().arguments("backtrack", "2", &png));
    ended.expect(2).says(&["pixels is png, but must be exr"]);
}
