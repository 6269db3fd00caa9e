//! `sample DIR --count N`

use super::args::{Global, SampleArgs};
use super::exit_code::{Exit, Failure};
use super::output::Output;
use super::progress::Progress;
use super::work_cmd::threads;
use crate::sample;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use serde_json::json;

pub(super) fn run(args: &SampleArgs, global: &Global, output: &Output) -> Result<Exit, Failure> {
    let photographs = sample::listing(args.count as usize, args.seed);
    if !global.dry_run {
        let progress = Progress::new(global, "photographs", photographs.len() as u64);
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads(global))
            .build()
            .map_err(|e| Failure::new(Exit::Failed, e))?;
        let written = pool.install(|| {
            photographs.par_iter().try_for_each(|photograph| {
                let result = sample::write(&args.dir, photograph, args.width, args.height);
                progress.add(1, false);
                result
            })
        });
        progress.finish();
        written.map_err(|e| Failure::new(Exit::Failed, e))?;
    }
    let paths: Vec<String> = photographs
        .iter()
        .map(|p| p.color_path().to_string_lossy().into_owned())
        .collect();
    let verb = if global.dry_run { "would make" } else { "made" };
    output.result(
        "glasshouse.sample/1",
        json!({
            "dir": args.dir, "count": photographs.len(), "seed": args.seed, "dry_run": global.dry_run,
            "width": args.width, "height": args.height, "color": paths,
        }),
        &format!(
            "{verb} {} photographs of {} x {} px with depth and mask in {}",
            photographs.len(),
            args.width,
            args.height,
            args.dir.display()
        ),
    );
    Ok(Exit::Done)
}
