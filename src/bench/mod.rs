//! `glasshouse bench`: measures speed and error. Other commands use only its calibration and two message texts.
//!
//! ```text
//! scenes -> kernels (-> dump)                                  bench trace: rays per second
//!        -> reference, ladder -> deviation -> fit -> table, plot bench error: error against CPU seconds
//! calibrate                                                    plan: core seconds of a run
//! composition                                                  bench compose: examples per second by part
//! recipe                                                       bench recipe: cost by feature and by stage
//! train_step                                                   bench train: CPU seconds of a step and its parts
//! farm                                                         bench farm: overhead, makespan, resuming
//! ```
//!
//! Most times are CPU seconds, of a thread ([`thread_cpu_s`]) or of a process, because machines are shared.

mod calibrate;
mod clock;
mod composition;
mod cpu;
mod deviation;
mod dump;
mod error;
mod error_report;
pub mod farm;
mod fit;
mod kernels;
mod ladder;
mod plot;
mod recipe;
mod reference;
mod render;
mod scenes;
mod table;
#[cfg(feature = "train")]
mod train_step;

pub use calibrate::calibrate;
pub use clock::thread_cpu_s;
pub use composition::{CameraStage, CameraTimes, CompositionBench, CompositionRow};
pub use cpu::{cpu_name, on_cpu};
pub use deviation::Deviation;
pub use dump::RayDump;
pub use error::BenchError;
pub use error_report::{ERROR_SCHEMA, ErrorReport};
pub use fit::Slope;
pub use kernels::{BuildRow, KernelRow, TracerRow, grid_builds, kernels, tracer};
pub use ladder::{Ladder, LayerRow, VARIANTS, Variant, climb, slopes};
pub use plot::error_plot;
pub use recipe::{
    FeatureRow, PaneCost, SceneCost, StageCosts, by_feature, scene_cost, stage_costs,
};
pub use reference::{Reference, own_reference, read_reference, reference_files};
pub use render::{Rendering, Work, render};
pub use scenes::{BenchScene, indoor, outdoor, pair, stress};
#[cfg(feature = "train")]
pub use train_step::{TrainBench, TrainStep};
