//! `glasshouse bench farm`: measures the farm with real processes, or simulates it.
//!
//! ```text
//! overhead       shards a second, 1 to N workers; the farm's CPU seconds per shard
//! makespan       ratio of a run's time to its lower bound, without and with faults
//! resume         time until a half-finished run resumes
//! simulation     the farm's rules in virtual time, for any number of workers (farm::simulate)
//!
//! place          temporary folder, queue and planned runs; process, server: child processes, killed on drop
//! recipe         recipes of measured runs; half_done makes about half of a run's results
//! ```

mod error;
mod half_done;
mod makespan;
mod makespan_report;
mod overhead;
mod overhead_report;
mod place;
mod process;
mod recipe;
mod resume;
mod server;
mod setup;
mod simulation;

pub use error::FarmBenchError;
pub use makespan::makespan;
pub use makespan_report::{Makespan, MakespanRun, Pass};
pub use overhead::overhead;
pub use overhead_report::{Overhead, OverheadRun};
pub use process::{SCENE_LOADED, WORK_BEGINS};
pub use resume::{Resume, Times, resume};
pub use setup::{Conditions, Setup, Watcher};
pub use simulation::{Simulation, simulate};
