//! The CPU clock of the calling thread, and medians and minima of measured seconds.

use rustix::time::{ClockId, clock_gettime};

/// Returns the CPU seconds (user and system) of the calling thread. Time in which another thread has the core does not
/// count; contention for shared units of a core does.
pub fn thread_cpu_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Returns the result of `work` and its CPU seconds on the calling thread.
pub(super) fn cpu_s<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = thread_cpu_s();
    let result = work();
    (result, thread_cpu_s() - start)
}

/// Returns the middle value, or the mean of the two middle values; NaN for an empty slice.
pub(super) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => f64::NAN,
        n => f64::midpoint(sorted[(n - 1) / 2], sorted[n / 2]),
    }
}

/// Returns the median and the minimum; NaN and infinity for an empty slice.
pub(super) fn median_and_best(seconds: &[f64]) -> (f64, f64) {
    (median(seconds), seconds.iter().copied().fold(f64::INFINITY, f64::min))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_runs_while_the_thread_computes_and_not_while_it_sleeps() {
        let start = thread_cpu_s();
        std::thread::sleep(std::time::Duration::from_millis(60));
        let slept = thread_cpu_s() - start;
        assert!((0.0..0.03).contains(&slept), "{slept}");
        let mut x = 1u64;
        while thread_cpu_s() - start < 0.05 {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
    }

    #[test]
    fn the_median_of_an_even_count_is_the_mean_of_the_middle_values() {
        assert_eq!(median_and_best(&[3.0, 1.0, 2.0]), (2.0, 1.0));
        assert_eq!(median_and_best(&[4.0, 1.0, 2.0, 3.0]), (2.5, 1.0));
        assert!(median(&[]).is_nan());
    }
}
