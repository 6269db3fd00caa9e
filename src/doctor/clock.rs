//! Checks the clocks. Leases use the monotonic clock; ages and the signatures of bucket requests use the time of day.

use super::finding::{Finding, Level, seconds_text};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Time for which both clocks are compared.
const LOOK: Duration = Duration::from_millis(50);
/// Offset above which buckets refuse signed requests, s.
const REFUSED_S: f64 = 900.0;
/// Offset above which a clock is not synchronised, s.
const OFF_S: f64 = 5.0;
/// Start of 2025, before the first release, as Unix time.
const PAST_S: u64 = 1_735_689_600;

/// Checks that the clocks run forwards at the same rate, and that the time of day is plausible.
pub fn check_clock() -> Finding {
    let (start, day) = (Instant::now(), SystemTime::now());
    let mut last = start;
    let mut is_steady = true;
    while last.duration_since(start) < LOOK {
        let now = Instant::now();
        is_steady &= now.checked_duration_since(last).is_some();
        last = now;
    }
    let by_day = SystemTime::now().duration_since(day).unwrap_or_default();
    let apart = (by_day.as_secs_f64() - start.elapsed().as_secs_f64()).abs();
    let today = day.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    Finding::ok("clock", "runs forwards and evenly")
        .unless(is_steady, Level::Fail, "the monotonic clock ran backwards: leases do not work on this machine")
        .unless(
            today > PAST_S,
            Level::Fail,
            "the time of day is before the release of this program: set the clock (NTP), or TLS rejects certificates",
        )
        .unless(apart < 0.02, Level::Warn, "the time of day jumps: it is being set; check again in a minute")
        .with("unix_s", today)
        .with("apart_s", apart)
}

/// Compares this machine's time with another clock that showed `there` between `before` and `after`; `exact_s` is the
/// resolution of the other clock.
pub(super) fn compare(
    check: &'static str,
    there: SystemTime,
    [before, after]: [SystemTime; 2],
    exact_s: f64,
) -> Finding {
    let seconds =
        |time: SystemTime| time.duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
    let (there, before, after) = (seconds(there), seconds(before), seconds(after));
    // Times within the interval show no offset.
    let off = if there + exact_s < before {
        there + exact_s - before
    } else if there > after {
        there - after
    } else {
        0.0
    };
    let text = if off == 0.0 {
        "agrees with the clock of this machine".to_owned()
    } else {
        let way = if off > 0.0 { "ahead of" } else { "behind" };
        format!("{} {way} the clock of this machine", seconds_text(off.abs()))
    };
    Finding::ok(check, text)
        .unless(
            off.abs() < REFUSED_S,
            Level::Fail,
            "set this machine's clock (NTP): requests signed with this offset are refused",
        )
        .unless(
            off.abs() < OFF_S,
            Level::Warn,
            "set this machine's clock (NTP): ages in `status` are wrong by this offset",
        )
        .with("off_s", off)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_offsets_of_a_clock_are_reported() {
        let at = |s: u64| UNIX_EPOCH + Duration::from_secs(s);
        let of = |there| compare("c", at(there), [at(1000), at(1002)], 1.0);
        assert_eq!(of(1001).level, Level::Ok);
        // A bucket reports whole seconds.
        assert_eq!(of(999).measured["off_s"], 0.0);
        assert_eq!((of(990).level, of(1020).level), (Level::Warn, Level::Warn));
        assert_eq!((of(10).level, of(5000).level), (Level::Fail, Level::Fail));
        assert!(of(1020).value.contains("ahead"), "{}", of(1020).value);
        assert_eq!(check_clock().level, Level::Ok);
    }
}
