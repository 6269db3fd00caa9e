//! Checks the processor, the cores and the limit of open files.

use super::finding::{Finding, Level};
use render::trace::Isa;
use rustix::process::{Resource, getrlimit};

/// Limit of open files that suffices for a worker, and for a coordinator with a status page.
const OPEN_FILES: u64 = 1024;
/// Lowest limit of open files with which the store works.
const FEWEST_OPEN_FILES: u64 = 128;

/// Checks the processor, and its cores against the number of compute threads.
pub fn check_cpu(isa: Isa, threads: usize) -> [Finding; 2] {
    let model = cpu_name().unwrap_or_else(|| "unknown processor".to_owned());
    let [avx2, avx512] = [Isa::Avx2, Isa::Avx512].map(Isa::is_available);
    let yes = |is: bool| if is { "yes" } else { "no" };
    let taken = match isa {
        Isa::Avx512 => "AVX-512",
        Isa::Avx2 => "AVX2",
        Isa::Baseline => "the baseline",
    };
    let text =
        format!("{model}; AVX2 {}, AVX-512 {}; the tracer uses {taken}", yes(avx2), yes(avx512));
    let kernels = Finding::ok("processor", text)
        .unless(
            isa != Isa::Baseline,
            Level::Warn,
            "no error: without AVX2, tracing computes the same bits, but takes a few times as long",
        )
        .with("model", model)
        .with("avx2", avx2)
        .with("avx512", avx512)
        .with("kernels", isa.name());
    let there = std::thread::available_parallelism().map_or(1, usize::from);
    let online = online().unwrap_or(there);
    let limited = if online > there {
        format!(" of the machine's {online} (a limit of the process or its container)")
    } else {
        String::new()
    };
    let cores = Finding::ok("cores", format!("{there}{limited}; workers use {threads} threads"))
        .unless(
            threads <= there,
            Level::Warn,
            format!("use -j {there}: more threads than cores take memory and save no time"),
        )
        .with("cores", there)
        .with("cores_of_machine", online)
        .with("threads", threads);
    [kernels, cores]
}

/// Returns the model name of the processor, if known.
pub fn cpu_name() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

/// Returns the number of the machine's cores, including cores that this process may not use.
fn online() -> Option<usize> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let count = text.lines().filter(|line| line.starts_with("processor")).count();
    (count > 0).then_some(count)
}

/// Checks the limit of open files.
pub fn check_open_files() -> Finding {
    let limit = getrlimit(Resource::Nofile);
    judge_open_files(limit.current, limit.maximum)
}

fn judge_open_files(soft: Option<u64>, hard: Option<u64>) -> Finding {
    let (Some(limit), text) =
        (soft, |limit: Option<u64>| limit.map_or("no limit".to_owned(), |n| n.to_string()))
    else {
        return Finding::ok("open files", "no limit");
    };
    let raise = if hard.is_none_or(|hard| hard >= OPEN_FILES) {
        format!("run `ulimit -n {OPEN_FILES}` before the program")
    } else {
        format!(
            "raise the hard limit to {OPEN_FILES} (limits.conf, or LimitNOFILE= of the service)"
        )
    };
    Finding::ok("open files", format!("{limit} allowed, {} at most", text(hard)))
        .unless(limit >= FEWEST_OPEN_FILES, Level::Fail, raise.clone())
        .unless(limit >= OPEN_FILES, Level::Warn, raise)
        .with("limit", limit)
        .with("hard_limit", hard)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn low_limits_of_open_files_are_reported() {
        assert_eq!(judge_open_files(None, None).level, Level::Ok);
        assert_eq!(judge_open_files(Some(1024), None).level, Level::Ok);
        let few = judge_open_files(Some(256), Some(4096));
        assert_eq!(few.level, Level::Warn);
        assert!(few.to_do.unwrap().contains("ulimit"));
        let fewer = judge_open_files(Some(64), Some(64));
        assert_eq!(fewer.level, Level::Fail);
        assert!(fewer.to_do.unwrap().contains("hard limit"));
    }

    #[test]
    fn more_threads_than_cores_are_reported() {
        let [kernels, cores] = check_cpu(Isa::Baseline, 100_000);
        assert_eq!((kernels.level, cores.level), (Level::Warn, Level::Warn));
        let [_, cores] = check_cpu(Isa::detect(), 1);
        assert_eq!(cores.level, Level::Ok);
    }
}
