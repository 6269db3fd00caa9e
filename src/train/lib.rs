//! Trains networks for reflection removal on tuples, real pairs or mixed photographs.
//!
//! ```text
//! examples (crate: the examples of every step) -> batch -> learner (networks, losses, Adam: one step)
//!     -> session (all steps, checkpoints, logs)
//!
//! ops/              operations that candle computes slowly or with wrong gradients
//! vgg, vgg_file     frozen features of images           checkpoint    a folder per step, written atomically
//! generator         architecture of SP-net and BT-net   logs, metrics, events, grid    logs of training
//! unet, unet_op, unet_images    the U-Net, as one operation    separation_net    either network
//! learner_losses    losses of a batch
//! discriminator     conditional PatchGAN                inference     networks on images of any size
//! loss, adam        losses and optimiser                separator     the networks of a checkpoint
//! work_size         networks at another size than the picture's
//! jumps             warning of jumps of the loss
//! random            tensors of random numbers           initial       weights of new networks
//! scoring, evaluation    scores of networks on pictures    validation    scores of a training's networks
//! similarity        rendered pictures and mixtures beside a camera's picture
//! trained_on        the tuples of a training, which must stay
//! run, resume       a stage's training in a run's folder, resumed from its checkpoints
//! ```
//!
//! The weights depend on the settings, the data and the CPU's instruction set, not on threads, time or interruptions.

pub mod ops;

mod adam;
mod batch;
mod check_images;
mod checkpoint;
mod checks;
mod discriminator;
mod error;
mod evaluation;
mod evaluation_notes;
mod events;
mod example_baselines;
mod generator;
mod grid;
mod inference;
mod initial;
mod jumps;
mod learner;
mod learner_losses;
mod logs;
mod loss;
mod metrics;
mod names;
mod pickle_scan;

mod random;
mod resume;
mod run;
mod scoring;
mod separation_net;
mod separator;
mod session;
mod shipped;
mod similarity;
mod tiles;
mod trained_on;
mod unet;
mod unet_images;
mod unet_op;
mod validation;
mod vgg;
mod vgg_file;
mod work_size;

pub use candle_core;
pub use plan::{
    ExampleKind, FeatureSource, FeatureStyle, NetworkKind, OptimizerKind, PixelSource,
    ScheduleKind, SettingError, Stage, Start, TrainSettings,
};
pub use safetensors;

pub use adam::{Adam, AdamOptions, Averages, Moments};
pub use batch::Batch;
pub use checkpoint::{
    CHECKPOINT_SCHEMA, Change, Checkpoint, CheckpointError, CheckpointState, Origin, Past,
    checkpoint_folder, clear, code_path, prune, stage_folder, steps, training_folder,
    write_checkpoint,
};
pub use checks::ChosenOn;
pub use compose::Cut;
pub use discriminator::Discriminator;
pub use error::TrainError;
pub use evaluation::{
    Conditions, EVALUATION_SCHEMA, Evaluation, EvaluationError, ScoredNetwork, ScoredOutputs,
};
pub use examples::{
    Base, Example, ExampleError, ExampleSampler, Loader, PairSource, PhotographSource, Picture,
    Planes, SceneSource, TupleFiles, TupleFilesError, TupleSource, bytes_of_planes, mixture,
    planes_of_bytes, planes_of_linear,
};
pub use generator::{DILATIONS, Generator, GeneratorOptions, SLOPE};
pub use grid::{Grid, rgb_grid, shrunk};
pub use inference::{LEAST_PX, Networks};
pub use initial::initial_weights;
pub use learner::{Lap, Learner, StepLosses, Term};
pub use loss::{FEATURE_DIVISORS, adversarial_loss, discriminator_loss, feature_difference, l1};
pub use names::first_names;
pub use random::{RandomTensor, Stream};
pub use run::{Pace, TrainSummary, Training, run};
pub use scoring::Tiled;
pub use separation_net::{Separated, SeparationNet};
pub use separator::{Separation, Separator, SeparatorError};
pub use session::{Best, Schedule, Session, Trained, Watcher};
pub use shipped::SHIPPED;
pub use similarity::{BestMixture, Similarity, SimilarityError, best_mixture, similarity};
pub use trained_on::TrainedOn;
pub use unet::Unet;
pub use validation::Validated;
pub use vgg::{VGG_PLACES, VGG_WIDTHS, Vgg, VggError};
pub use vgg_file::{Features, FeaturesError, read_weights};
pub use work_size::WorkSize;

#[cfg(test)]
mod caffe_tests;
#[cfg(test)]
mod naming_tests;
#[cfg(test)]
mod run_tests;
#[cfg(test)]
mod step_tests;
#[cfg(test)]
mod unet_tests;
