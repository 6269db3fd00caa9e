//! Choice of the examples of a step, as a function of the settings, the seed and the step.

use super::example::Example;
use super::mixture::MixtureRecipe;
use super::shards::ShardSource;
use super::source::{Base, ExampleError, PairSource, PhotographSource, TupleSource};
use compose::{Cut, Stream};
use crossbeam::channel::{Receiver, RecvTimeoutError};
use image::{Rgb32FImage, imageops};
use plan::{ExampleKind, TrainSettings};
use std::collections::HashMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Largest short edge of scaled-down real photographs, relative to the side of the crop (Zhang et al.: 479 / 256).
const LARGEST: f64 = 479.0 / 256.0;

/// Interval between checks for a missing tuple.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// Source of the scenes' examples.
pub enum SceneSource {
    Tuples(TupleSource),
    /// Exported tuples, for composed examples.
    Shards(ShardSource),
    /// Photographs to mix in image space.
    Photographs(PhotographSource),
}

impl SceneSource {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Tuples(source) => source.lines.len(),
            Self::Shards(source) => source.lines.len(),
            Self::Photographs(source) => source.lines.len(),
        }
    }
}

/// Tuples, real pairs and photographs kept in memory for later epochs. What is kept changes no example. A full memory
/// keeps what it has: each epoch uses every scene once, and any scene is as likely as another to give a reflection, so
/// a newer one would not be used more often.
struct Kept {
    bytes: usize,
    bases: HashMap<(bool, usize), Arc<Base>>,
}

/// Permutations by name and epoch.
type Orders = HashMap<(&'static str, u64), Vec<usize>>;

/// Reader of the examples of every step.
pub struct ExampleSampler {
    pub(crate) settings: TrainSettings,
    pub(crate) scenes: SceneSource,
    real: PairSource,
    /// Memory for examples, bytes. A data set that fits is read once.
    memory: usize,
    kept: Mutex<Kept>,
    /// Permutations of the current and the next epoch of each order, by name.
    orders: Mutex<Orders>,
    /// Channel that is closed when the loader is dropped.
    stopped: Receiver<()>,
}

impl ExampleSampler {
    /// Creates a sampler; `memory` is in bytes.
    ///
    /// # Errors
    ///
    /// Fails if a source that the settings need is empty.
    pub fn new(
        settings: &TrainSettings,
        scenes: SceneSource,
        real: PairSource,
        memory: usize,
        stopped: Receiver<()>,
    ) -> Result<Self, ExampleError> {
        if scenes.len() == 0 && settings.real_share < 1.0 {
            return Err(ExampleError::None(
                "the run has no scene in the split \"train\": add one to its recipe".to_owned(),
            ));
        }
        if real.pairs.is_empty() && settings.real_share > 0.0 {
            return Err(ExampleError::None(
                "the settings need real photographs, but there are none: name a folder of pairs"
                    .to_owned(),
            ));
        }
        Ok(Self {
            settings: settings.clone(),
            scenes,
            real,
            memory,
            kept: Mutex::new(Kept { bytes: 0, bases: HashMap::new() }),
            orders: Mutex::new(HashMap::new()),
            stopped,
        })
    }

    /// Returns the examples of a step, all of one size, and all from real pairs or all from scenes.
    pub fn examples(&self, step: u64) -> Result<Vec<Example>, ExampleError> {
        let batch = self.settings.batch as u64;
        let real_before = share_of(step, self.settings.real_share);
        let is_real = share_of(step + 1, self.settings.real_share) > real_before;
        let first = if is_real { real_before } else { step - real_before } * batch;
        (0..batch)
            .map(|item| {
                let position = first + item;
                let name = if is_real { "real" } else { "scene" };
                let mut stream =
                    Stream::new(self.settings.seed, &format!("{name} example {position}"));
                if is_real {
                    let example = self.real_example(position, &mut stream)?;
                    self.cut(&example, &mut stream)
                } else {
                    self.scene_example(position, &mut stream)
                }
            })
            .collect()
    }

    /// Returns the real pair at a position of the endless sequence of pairs, scaled by [`Self::scaled`].
    fn real_example(&self, position: u64, stream: &mut Stream) -> Result<Example, ExampleError> {
        let index = self.place(position, self.real.pairs.len(), "real order");
        let read = || Ok(Some(Base::Example(self.real.read(index)?)));
        let example = self.drawn(self.base((true, index), read)?.as_deref(), stream)?;
        let example = example.ok_or(ExampleError::Stopped)?;
        Ok(self.scaled(example, stream))
    }

    /// Copies or mixes the example of a base; returns `None` without a base or if the recipe rejects the photographs.
    fn drawn(
        &self,
        base: Option<&Base>,
        stream: &mut Stream,
    ) -> Result<Option<Example>, ExampleError> {
        let (front, back) = match base {
            None | Some(Base::Linear(_)) => return Ok(None),
            Some(Base::Example(example)) => return Ok(Some(example.clone())),
            Some(Base::Photographs { front, back }) => (front, back),
        };
        let recipe = match self.settings.examples {
            ExampleKind::Ceilnet => MixtureRecipe::Ceilnet,
            _ => MixtureRecipe::Zhang,
        };
        let mixture =
            recipe.mix(front, back, stream).map_err(|e| ExampleError::None(e.to_string()))?;
        Ok(mixture.map(|mixture| Example {
            rows: front.rows,
            columns: front.columns,
            input: mixture.input.planes,
            transmission: mixture.transmission.planes,
            glass_reflection: Some(mixture.reflection.planes),
            clean_reflection: Some(mixture.clean_reflection.planes),
        }))
    }

    /// Returns the example at a position of the endless sequence of scenes, or the next usable example after it.
    fn scene_example(&self, position: u64, stream: &mut Stream) -> Result<Example, ExampleError> {
        let count = self.scenes.len();
        for further in 0..count as u64 {
            let place = position + further;
            let index = self.place(place, count, "scene order");
            let base = self.scene(index)?;
            // The next scene replaces a scene without a tuple, or with photographs that the recipe rejects.
            if let Some(Base::Linear(front)) = base.as_deref() {
                // With `follow`, the farm renders the scenes of the first epoch in order.
                let others =
                    if self.settings.follow && place < count as u64 { index } else { count - 1 };
                return self.composed(position, [index, others], front, stream);
            }
            if let Some(example) = self.drawn(base.as_deref(), stream)? {
                return self.cut(&example, stream);
            }
        }
        Err(ExampleError::None(
            "no scene of the split \"train\" has a usable example yet: `glasshouse work` renders tuples"
                .to_owned(),
        ))
    }

    /// Returns the tuple or the photographs of a scene; `None` without a tuple. With `follow`, waits until the scene has
    /// a tuple or is in quarantine.
    pub(crate) fn scene(&self, index: usize) -> Result<Option<Arc<Base>>, ExampleError> {
        let source = match &self.scenes {
            SceneSource::Photographs(source) => {
                return self.base((false, index), || source.read(index).map(Some));
            }
            SceneSource::Shards(source) => {
                return self.base((false, index), || source.read_linear(index).map(Some));
            }
            SceneSource::Tuples(source) => source,
        };
        let is_linear = self.settings.examples.is_composed();
        let read = || if is_linear { source.read_linear(index) } else { source.read(index) };
        loop {
            let found = self.base((false, index), read)?;
            if found.is_some() || !self.settings.follow || source.is_in_quarantine(index)? {
                return Ok(found);
            }
            // The farm has not finished the scene yet.
            match self.stopped.recv_timeout(LOOK_EVERY) {
                Err(RecvTimeoutError::Timeout) => {}
                _ => return Err(ExampleError::Stopped),
            }
        }
    }

    /// Maps a position to an index below `count`. Shuffles every epoch separately, except the first with `follow`.
    fn place(&self, position: u64, count: usize, name: &'static str) -> usize {
        let (epoch, place) = (position / count as u64, (position % count as u64) as usize);
        if self.settings.follow && epoch == 0 {
            return place;
        }
        let mut orders = self.orders.lock().expect("no holder of this lock panics");
        if let Some(order) = orders.get(&(name, epoch)) {
            return order[place];
        }
        let mut stream = Stream::new(self.settings.seed, &format!("{name} {epoch}"));
        let order = stream.permutation(count);
        let index = order[place];
        // Readers that are ahead use the next epoch.
        orders.retain(|(other, old), _| *other != name || *old + 1 >= epoch);
        orders.insert((name, epoch), order);
        index
    }

    /// Returns the kept base of a key, or the result of `read`, which is then kept if memory allows.
    fn base(
        &self,
        key: (bool, usize),
        read: impl FnOnce() -> Result<Option<Base>, ExampleError>,
    ) -> Result<Option<Arc<Base>>, ExampleError> {
        let kept = || self.kept.lock().expect("no holder of this lock panics");
        if let Some(base) = kept().bases.get(&key) {
            return Ok(Some(Arc::clone(base)));
        }
        let Some(base) = read()?.map(Arc::new) else {
            return Ok(None);
        };
        let mut kept = kept();
        // Another reader may have read the same base meanwhile.
        if kept.bytes + base.bytes() <= self.memory && !kept.bases.contains_key(&key) {
            kept.bytes += base.bytes();
            kept.bases.insert(key, Arc::clone(&base));
        }
        Ok(Some(base))
    }

    fn cut(&self, example: &Example, stream: &mut Stream) -> Result<Example, ExampleError> {
        let size = self.settings.crop_px;
        let cut = Cut::draw(example.rows, example.columns, size, self.settings.flip, stream);
        let cut = cut.ok_or_else(|| too_small(example.rows, example.columns, size))?;
        Ok(example.cut(cut))
    }

    /// Scales a real pair down to a random size (unless it is smaller), so that the crop covers a large part of it.
    fn scaled(&self, example: Example, stream: &mut Stream) -> Example {
        let crop = self.settings.crop_px as f64;
        let wanted = (crop * (1.0 + (LARGEST - 1.0) * stream.unit())).round() as usize;
        let short = example.rows.min(example.columns);
        if short <= wanted {
            return example;
        }
        let factor = wanted as f64 / short as f64;
        let side = |length: usize| ((length as f64 * factor).round() as usize).max(wanted);
        let (rows, columns) = (side(example.rows), side(example.columns));
        example.map([rows, columns], |planes| {
            let pixels = example.rows * example.columns;
            let picture =
                Rgb32FImage::from_fn(example.columns as u32, example.rows as u32, |x, y| {
                    let at = y as usize * example.columns + x as usize;
                    image::Rgb([0, 1, 2].map(|c| planes[c * pixels + at]))
                });
            let cubic = imageops::FilterType::CatmullRom;
            let small = imageops::resize(&picture, columns as u32, rows as u32, cubic);
            let mut out = vec![0.0; 3 * rows * columns];
            for (at, pixel) in small.pixels().enumerate() {
                for (c, value) in pixel.0.into_iter().enumerate() {
                    out[c * rows * columns + at] = value.clamp(0.0, 1.0);
                }
            }
            out
        })
    }
}

pub(crate) fn too_small(rows: usize, columns: usize, crop_px: usize) -> ExampleError {
    ExampleError::None(format!(
        "an example has {columns} x {rows} px, but the crop is {crop_px} px: make the crop smaller"
    ))
}

/// Returns the number of steps with real photographs among the first `steps`; such steps are evenly spread.
fn share_of(steps: u64, share: f64) -> u64 {
    (steps as f64 * share).floor() as u64
}
