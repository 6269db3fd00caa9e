//! Runs random schedules of the simulated farms' tests.

/// Runs all seeds on two threads. Each thread replays its first failure with `run(seed, true)`, which prints all steps.
pub(super) fn run_all(seeds: std::ops::Range<u64>, run: fn(u64, bool) -> Result<(), String>) {
    let middle = u64::midpoint(seeds.start, seeds.end);
    std::thread::scope(|scope| {
        for mut part in [seeds.start..middle, middle..seeds.end] {
            scope.spawn(move || {
                if let Some(seed) = part.find(|&seed| run(seed, false).is_err()) {
                    let error = run(seed, true).expect_err("equal seeds give equal runs");
                    panic!("seed {seed}; `run({seed}, None, true)` replays it: {error}");
                }
            });
        }
    });
}
