//! `glasshouse bench`: measures speed and error. The pipeline does not use this module.
//!
//! ```text
//! scenes -> kernels (-> dump)                                  bench trace: rays per second
//!        -> calibrate                                          plan: core seconds of a run
//!        -> reference, ladder -> deviation -> fit -> csv, plot bench error: error against CPU seconds
//! train_step                                                   bench train: CPU seconds of a step and its parts
//! farm                                                         bench farm: overhead, makespan, resuming
//! ```
//!
//! Times are CPU seconds of the working threads ([`thread_cpu_s`]), because machines are shared.

mod calibrate;
mod clock;
mod cpu;
mod csv;
mod deviation;
mod dump;
mod error;
mod error_report;
pub mod farm;
mod fit;
mod kernels;
mod ladder;
mod plot;
mod reference;
mod render;
mod scenes;
#[cfg(feature = "train")]
mod train_step;

pub use calibrate::calibrate;
pub use clock::thread_cpu_s;
pub use cpu::{cpu_name, on_cpu};
pub use csv::csv;
pub use deviation::{CELL_PX, Deviation};
pub use dump::RayDump;
pub use error::BenchError;
pub use error_report::{ERROR_SCHEMA, ErrorReport};
pub use fit::{Slope, log_log_slope};
pub use kernels::{
    BuildRow, KernelRow, KernelTiming, OnClass, TracerRow, TracerTiming, grid_builds, kernels,
    tracer,
};
pub use ladder::{Ladder, LayerRow, VARIANTS, Variant, climb, slopes};
pub use plot::error_plot;
pub use reference::{REFERENCE_SCHEMA, Reference, ReferenceRecord, own_reference, read_reference};
pub use render::{Rendering, Work, render};
pub use scenes::{BenchScene, indoor, outdoor, pair, stress};
#[cfg(feature = "train")]
pub use train_step::{TrainBench, TrainStep};
