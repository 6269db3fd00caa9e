//! What can be typed after `train`, `evaluate` and `separate`.

use super::args::Global;
use super::exit_code::{Exit, Failure};
use super::work_cmd::threads;

/// Makes the pool of threads that networks compute on, and says how many they are.
pub(super) fn use_threads(global: &Global) -> Result<usize, Failure> {
    let threads = threads(global);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| Failure::new(Exit::Failed, e))?;
    Ok(threads)
}
