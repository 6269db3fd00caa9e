//! The commands. Each file or folder has the arguments and the code of one command; `control` has those of three.

mod audit;
mod bench;
mod completions;
mod control;
mod coordinate;
#[cfg(feature = "train")]
mod depth;
mod develop;
mod doctor;
#[cfg(feature = "train")]
mod evaluate;
mod explain;
mod export;
mod inspect;
mod man;
mod merge;
mod plan;
mod render;
mod report;
mod retry;
mod run;
mod sample;
mod schema;
#[cfg(feature = "train")]
mod separate;
#[cfg(feature = "train")]
mod similarity;
mod status;
#[cfg(feature = "train")]
mod train;
mod work;

use crate::cli::args::Global;
use crate::cli::exit_code::{Exit, Failure};
use crate::cli::output::Output;
use clap::{CommandFactory, Parser, Subcommand};

/// Farms physically based training data for single-image reflection removal.
#[derive(Debug, Parser)]
#[command(
    name = "glasshouse",
    version,
    max_term_width = 100,
    arg_required_else_help = true,
    after_help = "Examples:
  glasshouse doctor                       # check this machine
  glasshouse run manifests/smoke.toml     # every stage on a small data set, in seconds
  glasshouse run --help                   # every command has examples"
)]
pub struct Args {
    #[command(flatten)]
    pub(super) global: Global,
    #[command(subcommand)]
    command: Command,
}

/// The commands. `--help` lists them in this order.
#[derive(Debug, Subcommand)]
enum Command {
    /// Run all stages of a recipe on this machine, from plan to report; resumes an unfinished run
    #[command(after_help = "Examples:
  glasshouse run manifests/smoke.toml
  glasshouse run manifests/smoke.toml --out runs/again -j 1")]
    Run(run::RunArgs),
    /// Make procedural RGBD photographs (rooms and streets) in the layout of DIODE or of PLACES365
    #[command(after_help = "Examples:
  glasshouse sample /tmp/rooms --count 4
  glasshouse sample /tmp/rooms --count 4 --seed 7 --json
  glasshouse sample /tmp/places --layout places --count 68
  glasshouse sample /tmp/many --layout places --count 4160 --width 32 --height 24")]
    Sample(sample::SampleArgs),
    /// Turn a recipe or a .jsonl of scenes into a run's frozen manifest and spec
    #[command(after_help = "Examples:
  glasshouse plan manifests/smoke.toml -n
  glasshouse plan my.toml --root diode=/data/diode --out runs/mine
  glasshouse plan my.toml --root diode=/data/diode -n --json   # files, bytes, hours
  glasshouse plan my.toml --root diode=/data/diode --skip-invalid --out runs/mine")]
    Plan(plan::PlanArgs),
    /// Render one scene (a scene file or a tuple.json) to an EXR and a PNG per layer
    #[command(after_help = "Examples:
  glasshouse render scene.json --out out --spp 1024 -j 2
  glasshouse render runs/smoke/tuples/train-sample-000000/tuple.json --out again")]
    Render(render::RenderArgs),
    /// Trace the shards of a planned run until none are left, and merge each finished scene
    #[command(after_help = "Examples:
  glasshouse work runs/smoke
  glasshouse work runs/smoke --time-limit 55m   # exits with 75 if work is left")]
    Work(work::WorkArgs),
    /// Supply a farm of many machines with tasks until every scene is done; can be restarted at any time
    #[command(after_help = "Examples:
  glasshouse coordinate runs/mine --queue nats://localhost:4222
  glasshouse work runs/mine --queue nats://localhost:4222      # on any number of machines")]
    Coordinate(coordinate::CoordinateArgs),
    /// Merge the partials of complete scenes into tuples; refuses scenes with missing partials
    #[command(after_help = "Examples:
  glasshouse merge runs/smoke
  glasshouse merge runs/smoke -n --json")]
    Merge(merge::MergeArgs),
    /// Show the progress of a run: counts, workers, rate and time left
    #[command(after_help = "Examples:
  glasshouse status runs/smoke
  glasshouse status runs/smoke --json
  glasshouse status runs/smoke --watch")]
    Status(status::StatusArgs),
    /// Pause a run: workers finish their open scenes and start no others until it is resumed
    #[command(after_help = "Examples:
  glasshouse pause runs/smoke
  glasshouse pause runs/smoke --reason backup")]
    Pause(control::HoldArgs),
    /// Resume a run that was paused or cancelled
    #[command(after_help = "Examples:
  glasshouse resume runs/smoke")]
    Resume(control::ResumeArgs),
    /// Cancel a run: workers end after the shards in flight; finished tuples stay
    #[command(after_help = "Examples:
  glasshouse cancel runs/smoke
  glasshouse cancel runs/smoke --json")]
    Cancel(control::HoldArgs),
    /// Try scenes in quarantine again, or reset scenes so that workers make them again
    #[command(after_help = "Examples:
  glasshouse retry runs/smoke --all
  glasshouse retry runs/smoke --all --json   # or name the scenes")]
    Retry(retry::RetryArgs),
    /// Explain the state of a scene or a shard, and the next steps
    #[command(after_help = "Examples:
  glasshouse explain runs/smoke train-sample-000000
  glasshouse explain runs/smoke train-sample-000000:0")]
    Explain(explain::ExplainArgs),
    /// Trace some scenes again and compare every file with the run's, bit for bit
    #[command(after_help = "Examples:
  glasshouse audit runs/smoke
  glasshouse audit runs/smoke --share 0.2 --seed 7
  glasshouse audit runs/smoke --scene train-sample-000000")]
    Audit(audit::AuditArgs),
    /// Train BT-net or SP-net on a run's tuples; resumes from the newest checkpoint
    #[cfg(feature = "train")]
    #[command(after_help = "\
Checkpoints are in RUN/train/STAGE/step-NNNNNNN (model.safetensors, optimizer.safetensors, state.json),
beside metrics.csv, TensorBoard's event files and pictures/ (validation scenes: I, T*, T, R~*, R~, R*, R).
A kill loses the steps since the last checkpoint, Ctrl-C none; the same command resumes the training, with
equal bits on the same kind of CPU and any number of threads.

The separation stage comes second: the same command with --stage separation.

Examples:
  glasshouse train runs/smoke --stage backtrack --steps 200
  glasshouse train runs/smoke --stage separation --steps 200 --json")]
    Train(Box<train::TrainArgs>),
    /// Score trained networks and the unchanged pictures against the ground truth
    #[cfg(feature = "train")]
    #[command(after_help = "\
The table has the unchanged input, rules that know nothing of reflections, and networks or outputs of any
program. The rules are a factor of linear light and the veil rule T = g (I - k b), where b is the 0.5 %
percentile of each channel; both are fitted to train scenes, or given. A network must beat both, also after
each picture's own best factor. Oracles are factors that are chosen on the scored pictures.

PSNR and SSIM compare 8-bit pictures at their own size, or at --longest. The command names real pairs with
misaligned ground truth, and a second table leaves them out. In JSON the PSNR of equal pictures is the
string \"inf\".

Exit code 3: some pairs are missing or unreadable; `left_out` lists them. 4: nothing to score.

Examples:
  glasshouse evaluate runs/smoke
  glasshouse evaluate runs/smoke --split all --checkpoint runs/smoke/train/separation --json
  glasshouse evaluate pairs --checkpoint ours=runs/smoke --fit-to runs/smoke --out scores
  glasshouse evaluate pairs --longest 640 --factor 0.83 --veil 0.88,0.8")]
    Evaluate(evaluate::EvaluateArgs),
    /// Remove the reflections from photographs with a trained network
    #[cfg(feature = "train")]
    #[command(after_help = "\
Each picture becomes NAME.transmission.png (the scene behind the glass), NAME.glass_reflection.png
(the reflection on the glass) and, with a BT-net, NAME.clean_reflection.png (the reflected scene):
8-bit pictures of its size, upright, with its ICC profile and EXIF data.

Exit code 3: some pictures are unreadable or smaller than 16 px on a side; the others are separated.

Examples:
  glasshouse separate photo.jpg --out separated
  glasshouse separate photo.jpg --network runs/smoke --out separated --work-px 0 --json")]
    Separate(separate::SeparateArgs),
    /// Compare renderings and image-space mixtures with a camera's pictures of the same scenes
    #[cfg(feature = "train")]
    #[command(after_help = "\
Each folder of DIR has scene.json and the camera's picture of this scene: captured.png in sRGB, or
captured.exr in linear light, of the film's size (below 550 px a side, the limit of Zhang's mixtures).

ours                the rendered input
transmission alone  the rendered transmission, without any reflection
CEILNet, Zhang      mixtures of the rendered transmission (front) and clean reflection (back), the best of
                    --draws parameter sets: the camera's picture chooses, so these are upper bounds

The factor is each picture's best factor of linear light, 0.30 to 2.00; mixtures are chosen again after it.

Exit code 3: folders without a scene or a usable picture are left out. 4: no scene is left.

Examples:
  glasshouse similarity captures
  glasshouse similarity captures --spp 1024 --draws 20 --json")]
    Similarity(similarity::SimilarityArgs),
    /// Export a run's tuples as a data set for common loaders: tars, folders, OpenEXR files or tensors
    #[command(after_help = "\
webdataset   DIR/SPLIT-000000.tar with ID.LAYER.png and ID.json, for the WebDataset library
imagefolder  DIR/SPLIT/metadata.jsonl and DIR/SPLIT/LAYER/ID.png, for Hugging Face's datasets
pairs        DIR/SPLIT/blended/ID.png, transmission_layer/, reflection_layer/, clean_reflection_layer/
exr          DIR/SPLIT/ID.exr: OpenEXR with one part per layer, linear light
safetensors  DIR/SPLIT-000000.safetensors with tensors ID.LAYER, linear light, and DIR/SPLIT.jsonl, for PyTorch and NumPy

Every format adds a dataset card (README.md), export.json and SHA256SUMS; the first two also add
croissant.json. Equal runs give equal bytes. The same command resumes a stopped export, and refuses a
folder with other content. docs/datasets.md shows how to read each format in PyTorch.

Exit code 3: scenes in quarantine, or (with --partial) not merged yet, are missing. 75: the run is not
finished.

Examples:
  glasshouse export runs/smoke --format webdataset --out smoke-webdataset
  glasshouse export runs/smoke --format imagefolder --out smoke-imagefolder --split train
  glasshouse export runs/smoke --format pairs --encoding srgb16 --out smoke-pairs --json
  glasshouse export runs/smoke --format safetensors --out smoke-safetensors")]
    Export(export::ExportArgs),
    /// Estimate the depth of a folder's pictures with Depth Anything V2 and your weights; resumes
    #[cfg(feature = "train")]
    #[command(after_help = "\
Writes DIR/PICTURE_depth.npy (32-bit floats of the upright picture's size: relative inverse depth, or metres with --metric),
links the pictures beside them, and writes DIR/photographs.jsonl, a list for recipes with layout = \"list\".
The weights are not part of the program: docs/data.md has their sources and licences. Bad pictures are named and left out.

Examples:
  glasshouse depth holiday --weights depth_anything_v2_vits.pth --out holiday-depth
  glasshouse depth rooms --weights model.safetensors --metric 20 --out rooms-depth --json")]
    Depth(depth::DepthArgs),
    /// Photograph a run's tuples by another camera, without tracing them again; resumes
    #[command(after_help = "\
Writes DIR/SCENE/photo.jpg (the input behind the camera), photo_transmission.png and photo_glass_reflection.png (the same
camera's decisions, without noise), raw.dng where the sensor has `raw = true`, and photograph.json, with all drawn numbers.
docs/camera.md has the model, the keys of [sensor] and the calibrated sensors. A small sensor file is `[sensor]` and `camera = \"imx686\"`.

Examples:
  glasshouse develop runs/smoke --sensor phone.toml --out phone
  glasshouse develop runs/smoke --sensor phone.toml --out phone --split test --json")]
    Develop(develop::DevelopArgs),
    /// Write report/index.html: the whole run on one self-contained page
    #[command(after_help = "\
The page shows counts, a contact sheet of up to 32 tuples with noise maps, stated errors and their cost,
time by stage, parameters, quarantine, training and scores. It has no script, loads nothing, and has at
most about 10 MB for a run of any size. An unfinished run has a report, too. Training and scores are
read from RUN, even with --store.

Exit code 3: some tuples are damaged; the page and `damaged` list them.

Examples:
  glasshouse report runs/smoke
  glasshouse report runs/smoke --out smoke.html --json")]
    Report(report::ReportArgs),
    /// Explain files: their kind, their scene and any damage
    #[command(after_help = "\
Recognises, mostly by content: partials, tuples, specs, manifests, recipes, records of the farm, checkpoints, curves,
event files, scores, exported shards, report pages, input files, and folders of a run, a tuple or a checkpoint.

Exit code 4: a file is damaged, unknown or missing; the text names the damage, its place and a remedy.

Examples:
  glasshouse inspect runs/smoke
  glasshouse inspect runs/smoke/tuples/train-sample-000000/tuple.exr
  glasshouse inspect runs/smoke/spec.json runs/smoke/manifest.jsonl --json")]
    Inspect(inspect::InspectArgs),
    /// Check this machine, a run's disk, a store and a queue, and give advice
    #[command(after_help = "\
Checks processor and kernels, cores, memory, open files, clock, the bits of a reference shard, and the disk: space,
speed, exclusive creation, links, renames and locks. --store and --queue add checks of a store and a queue.
The checks create and remove files, an object and a stream.

Exit code 1: a check failed. With warnings only, the exit code is 0.

Examples:
  glasshouse doctor
  glasshouse doctor runs/smoke -j 2 --json
  glasshouse doctor --store s3://bucket/runs/mine --queue nats://localhost:4222")]
    Doctor(doctor::DoctorArgs),
    /// Print the JSON Schema of recipes or of scenes, for editors
    #[command(after_help = "Examples:
  glasshouse schema > recipe.schema.json
  glasshouse schema scene > scene.schema.json
  glasshouse schema --json")]
    Schema(schema::SchemaArgs),
    /// Measure speed and error on this machine; needs no data
    #[command(after_help = "Examples:
  glasshouse bench error
  glasshouse bench trace
  glasshouse bench error --help   # measures and method")]
    Bench(bench::BenchArgs),
    /// Print a shell completion script
    #[command(after_help = "Examples:
  glasshouse completions bash > glasshouse.bash   # then: source glasshouse.bash
  glasshouse completions zsh > _glasshouse        # into a folder of $fpath
  glasshouse completions fish --json")]
    Completions(completions::CompletionsArgs),
    /// Write a man page for every command, or print the main page
    #[command(after_help = "Examples:
  glasshouse man --out man      # then: man -l man/glasshouse-run.1
  glasshouse man > glasshouse.1")]
    Man(man::ManArgs),
}

impl Args {
    pub(super) fn run(&self, output: &Output) -> Result<Exit, Failure> {
        let global = &self.global;
        match &self.command {
            Command::Run(args) => run::run(args, global, output),
            Command::Sample(args) => sample::run(args, global, output),
            Command::Plan(args) => plan::run(args, global, output),
            Command::Render(args) => render::run(args, global, output),
            Command::Work(args) => work::run(args, global, output),
            Command::Coordinate(args) => coordinate::run(args, global, output),
            Command::Merge(args) => merge::run(args, global, output),
            Command::Status(args) => status::run(args, global, output),
            Command::Pause(args) => control::pause(args, global, output),
            Command::Resume(args) => control::resume(args, global, output),
            Command::Cancel(args) => control::cancel(args, global, output),
            Command::Retry(args) => retry::run(args, global, output),
            Command::Explain(args) => explain::run(args, output),
            Command::Audit(args) => audit::run(args, global, output),
            #[cfg(feature = "train")]
            Command::Train(args) => train::run(args, global, output),
            #[cfg(feature = "train")]
            Command::Evaluate(args) => evaluate::run(args, global, output),
            #[cfg(feature = "train")]
            Command::Separate(args) => separate::run(args, global, output),
            #[cfg(feature = "train")]
            Command::Similarity(args) => similarity::run(args, global, output),
            Command::Export(args) => export::run(args, global, output),
            #[cfg(feature = "train")]
            Command::Depth(args) => depth::run(args, global, output),
            Command::Develop(args) => develop::run(args, global, output),
            Command::Report(args) => report::run(args, global, output),
            Command::Schema(args) => Ok(schema::run(args, output)),
            Command::Bench(args) => bench::run(args, global, output),
            Command::Inspect(args) => Ok(inspect::run(args, output)),
            Command::Doctor(args) => doctor::run(args, global, output),
            Command::Completions(args) => completions::run(args, Self::command(), output),
            Command::Man(args) => man::run(args, Self::command(), global, output),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clap_accepts_the_definition_of_the_command_line() {
        Args::command().debug_assert();
    }
}
