//! `render SCENE.json --out DIR`: renders one scene.

use crate::cli::args::{Global, RootArgs, isa, parse_spp, threads};
use crate::cli::exit_code::{Exit, Failure, failure};
use crate::cli::output::Output;
use crate::cli::progress::Progress;
use crate::cli::signals::Signals;
use crate::cli::store_env;
use crate::outputs::Outputs;
use crate::run::Run;
use clap::Args as ClapArgs;
use compose::encode_tuple_image;
use glasshouse_line::color::SrgbEncoder;
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::Layer;
use glasshouse_line::{Roots, SceneLine, parse_scene};
use render::Loaded;
use render::atomic_file;
use render::formats::encode_rgb_exr;
use render::merge::{
    LabelRecord, LayerRecord, PhotographRecord, TUPLE_SCHEMA, TUPLE_SCHEMA_1, Tuple, TupleRecord,
    encode_png, light_notes, photographs,
};
use render::scene::{SceneFacts, read_files_by};
use render::shard::ShardLayout;
use render::trace::TRACER_VERSION;
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Endings of the file names of each layer.
const ENDINGS: [&str; 2] = ["exr", "png"];

#[derive(Debug, ClapArgs)]
pub(super) struct RenderArgs {
    /// Scene (glasshouse.scene/1), or a tuple.json
    scene: PathBuf,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Samples per pixel, a power of two from 1 to 65536 [default: the scene's]
    #[arg(long, value_name = "N", value_parser = parse_spp)]
    spp: Option<u32>,
    /// Side of a tile, px; does not change the result
    #[arg(long, value_name = "PX", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..=16384))]
    tile: u32,
    #[command(flatten)]
    roots: RootArgs,
}

/// A scene, the base folder and the roots of its paths, and its tuple's record if the scene comes from a tuple.
struct Source {
    line: SceneLine,
    base: PathBuf,
    roots: Roots,
    record: Option<TupleRecord>,
}

pub(super) fn run(args: &RenderArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let mut source = read_source(args)?;
    if let Some(spp) = args.spp {
        source.line.film.spp = spp;
    }
    let invalid = |e: anyhow::Error| Failure::new(Exit::InvalidInput, e.context(describe(args)));
    let outputs = outputs(args, &source)?;
    outputs.check()?;
    let clock = Instant::now();
    let inputs = store_env::inputs();
    let files = read_files_by(&source.line, &source.roots, &source.base, &|path| inputs.read(path))
        .map_err(|e| invalid(e.into()))?;
    let read_s = clock.elapsed().as_secs_f64();
    let clock = Instant::now();
    let mut loaded = Loaded::new(source.line.clone(), &files).map_err(|e| invalid(e.into()))?;
    loaded.threads = threads(global);
    let decode_s = clock.elapsed().as_secs_f64();
    if let Some(record) = &source.record
        && record.inputs != loaded.scene().inputs
    {
        output.warning(
            "the input files differ from those of the tuple, so the new pixels will differ, too",
        );
    }
    for note in loaded.scene().facts.notes() {
        output.warning(&note);
    }
    if global.dry_run {
        let planned =
            Planned { out: args.out.to_string_lossy(), dry_run: true, scene: &source.line.id };
        output.show("glasshouse.render/1", &planned);
        return Ok(Exit::Done);
    }

    let layout = ShardLayout::of(&source.line, args.tile);
    let signals = Signals::catch();
    let progress = Progress::new(global, "tiles", u64::from(layout.len()));
    let clock = Instant::now();
    let tuple = loaded.tuple(args.tile, isa(global)?, signals.stop(), &|| {
        progress.add(1, false);
    });
    progress.finish();
    let Some(tuple) = tuple else {
        return Err(failure!(signals.exit(), "stopped by a signal: nothing was written"));
    };
    let trace_s = clock.elapsed().as_secs_f64();
    let tuple = tuple.map_err(|e| invalid(e.into()))?;
    for note in light_notes(&tuple.record.layers) {
        output.warning(&note);
    }
    let clock = Instant::now();
    outputs.claim()?;
    write(&tuple, &args.out)?;
    let write_s = clock.elapsed().as_secs_f64();

    let rendered = Rendered {
        out: args.out.to_string_lossy(),
        scene: &source.line.id,
        spp: source.line.film.spp,
        layers: &tuple.record.layers,
        labels: &tuple.record.labels,
        photographs: tuple.record.photographs,
        facts: &tuple.record.facts,
        seconds: Seconds { read: read_s, decode: decode_s, trace: trace_s, write: write_s },
        target_error: tuple.record.scene.film.target_error,
    };
    output.show("glasshouse.render/1", &rendered);
    Ok(Exit::Done)
}

fn describe(args: &RenderArgs) -> String {
    format!("cannot render {}", args.scene.display())
}

/// Reads a scene file or a `tuple.json`. Named roots come from the command line and, for a tuple, also from the run
/// that contains the tuple.
fn read_source(args: &RenderArgs) -> Result<Source, Failure> {
    let invalid = |e: anyhow::Error| Failure::new(Exit::InvalidInput, e.context(describe(args)));
    let text = render::input_file::read_to_string(&args.scene).map_err(|e| {
        failure!(Exit::InvalidInput, "cannot read {}: {e}; check the path", args.scene.display())
    })?;
    let given = Roots::parse(&args.roots.roots)?;
    let folder = args.scene.parent().map_or_else(PathBuf::new, Path::to_owned);
    let value = serde_json::from_str::<serde_json::Value>(&text).unwrap_or_default();
    if value["schema"] != TUPLE_SCHEMA && value["schema"] != TUPLE_SCHEMA_1 {
        let line = parse_scene(&text).map_err(|e| invalid(e.into()))?;
        return Ok(Source { line, base: folder, roots: given, record: None });
    }
    let record: TupleRecord = serde_json::from_str(&text).map_err(|e| invalid(e.into()))?;
    if record.tracer_version != TRACER_VERSION {
        return Err(failure!(
            Exit::Disagrees,
            "tracer version {} made the tuple, but this program has {TRACER_VERSION}, so the pixels would \
             differ; use the tuple's version, or render the tuple's \"scene\" as a scene file",
            record.tracer_version
        ));
    }
    record.scene.validate().map_err(|e| invalid(e.into()))?;
    let base = folder.join(&record.base);
    let roots = Run::open(&base, &given).map_or(given, |run| run.roots);
    Ok(Source { line: record.scene.clone(), base, roots, record: Some(record) })
}

/// Returns the files to write, and the files that the command reads.
fn outputs<'a>(args: &'a RenderArgs, source: &Source) -> Result<Outputs<'a>, Failure> {
    let Source { line, base, roots, .. } = source;
    let layers = line.film.layers;
    let files = layers.names().flat_map(|name| ENDINGS.map(|e| format!("{name}.{e}").into()));
    let labels = layers.labels();
    let labels = labels.iter().map(|label| format!("{label}.exr").into());
    let files = files.chain(labels).chain(photographs(line).into_iter().map(PathBuf::from));
    let mut inputs = vec![args.scene.clone()];
    for (_, path) in line.paths() {
        inputs.push(roots.resolve(base, path)?);
    }
    Ok(Outputs { command: "render", folder: &args.out, files: files.collect(), inputs })
}

/// Writes each layer as EXR and PNG, each label as EXR, and the photographs of a sensor.
fn write(tuple: &Tuple, out: &Path) -> Result<(), Failure> {
    let encoder = SrgbEncoder::new();
    for (layer, pixels) in tuple.made() {
        let (w, h) = (tuple.width, tuple.height);
        let exr = encode_rgb_exr(pixels, w, h).map_err(|e| Failure::new(Exit::Failed, e))?;
        atomic_file::write(&out.join(format!("{layer}.exr")), &exr)?;
        let png = encode_png(&encoder, pixels, w, h).map_err(|e| Failure::new(Exit::Failed, e))?;
        atomic_file::write(&out.join(format!("{layer}.png")), &png)?;
    }
    for (label, values) in &tuple.labels {
        // Labels of one number have it in all three channels.
        let pixels: Vec<[f32; 3]> = match label.channels().len() {
            3 => values.chunks_exact(3).map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect(),
            _ => values.iter().map(|value| [*value; 3]).collect(),
        };
        let exr = encode_rgb_exr(&pixels, tuple.width, tuple.height);
        let exr = exr.map_err(|e| Failure::new(Exit::Failed, e))?;
        atomic_file::write(&out.join(format!("{label}.exr")), &exr)?;
    }
    for name in photographs(&tuple.record.scene) {
        let file = encode_tuple_image(tuple, &encoder, name);
        let file = file.map_err(|e| Failure::new(Exit::Failed, e))?;
        atomic_file::write(&out.join(name), &file)?;
    }
    Ok(())
}

#[derive(Serialize)]
struct Planned<'a> {
    out: Cow<'a, str>,
    dry_run: bool,
    scene: &'a SceneId,
}

impl fmt::Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "would render scene {} into {}", self.scene, self.out)
    }
}

#[derive(Serialize)]
struct Rendered<'a> {
    out: Cow<'a, str>,
    scene: &'a SceneId,
    spp: u32,
    layers: &'a BTreeMap<String, LayerRecord>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    labels: &'a BTreeMap<String, LabelRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    photographs: Option<PhotographRecord>,
    facts: &'a SceneFacts,
    seconds: Seconds,
    #[serde(skip)]
    target_error: Option<f64>,
}

#[derive(Serialize)]
struct Seconds {
    read: f64,
    decode: f64,
    trace: f64,
    write: f64,
}

impl fmt::Display for Rendered<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { out, scene, spp, layers, .. } = self;
        match self.target_error {
            None => write!(f, "{scene}: {spp} samples per pixel")?,
            Some(target) => {
                let means = layers.values().filter_map(|layer| layer.mean_samples);
                let most = means.fold(0.0, f64::max);
                write!(
                    f,
                    "{scene}: {most:.0} samples per pixel on average, for a target error of {target:.1e}"
                )?;
            }
        }
        f.write_str(", estimated error")?;
        for (name, symbol) in Layer::ALL.map(|layer| (layer.name(), layer.symbol())) {
            match layers.get(name).map(|layer| layer.error_rms) {
                None => {}
                Some(None) => write!(f, " {symbol} ?")?,
                Some(Some(0.0)) => write!(f, " {symbol} 0")?,
                Some(Some(error)) => write!(f, " {symbol} {error:.1e}")?,
            }
        }
        let Seconds { read, decode, trace, write } = self.seconds;
        write!(
            f,
            " (linear RMS); read {read:.3} s, decode {decode:.3} s, trace {trace:.3} s, write {write:.3} s\nsee {out}"
        )
    }
}
