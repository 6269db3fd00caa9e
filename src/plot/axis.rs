//! Axes, which map values to positions and place ticks.

use maud::{Markup, html};

/// Scale of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Scale {
    Linear,
    Log,
}

/// Approximate number of ticks of a linear axis.
const TICKS: f64 = 5.0;

/// An axis of a plot.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    scale: Scale,
    /// Values at the ends.
    pub(crate) values: [f64; 2],
    /// Positions of the ends, px.
    pub(crate) ends: [f64; 2],
}

/// A tick and its label.
pub(crate) struct Tick {
    /// Position of the tick, px.
    pub(crate) at: f64,
    pub(crate) label: Markup,
}

impl Axis {
    /// Creates a logarithmic axis for positive values. It extends beyond the values by a factor of 1.3, or of up to
    /// 1.95 if the values differ by less than a factor of 1.5.
    pub(crate) fn log(values: impl Iterator<Item = f64>, ends: [f64; 2]) -> Self {
        let (lo, hi) = range(values);
        let (lo, hi) = (lo.min(hi / 1.5) / 1.3, hi.max(lo * 1.5) * 1.3);
        Self { scale: Scale::Log, values: [lo, hi], ends }
    }

    /// Creates a logarithmic axis between two values above 0.
    pub(crate) fn log_between(values: [f64; 2], ends: [f64; 2]) -> Self {
        Self { scale: Scale::Log, values, ends }
    }

    /// Creates a linear axis over the range of `values`. If all values are equal, it extends a little beyond them.
    pub(crate) fn linear(values: impl Iterator<Item = f64>, ends: [f64; 2]) -> Self {
        let (lo, hi) = range(values);
        let values = if lo < hi {
            [lo, hi]
        } else {
            let room = if lo == 0.0 { 1.0 } else { lo.abs() * 0.1 };
            [lo - room, lo + room]
        };
        Self { scale: Scale::Linear, values, ends }
    }

    pub(crate) fn at(&self, value: f64) -> f64 {
        let [a, b] = self.ends;
        a + (b - a) * self.place(value)
    }

    /// Returns the relative position of a value: 0 at the first end of the axis, 1 at the second.
    pub(crate) fn place(&self, value: f64) -> f64 {
        let [lo, hi] = self.values;
        match self.scale {
            Scale::Linear => (value - lo) / (hi - lo),
            Scale::Log => libm::log10(value / lo) / libm::log10(hi / lo),
        }
    }

    pub(crate) fn is_log(&self) -> bool {
        self.scale == Scale::Log
    }

    /// Returns the ticks of the axis, from the first end.
    pub(crate) fn ticks(&self) -> Vec<Tick> {
        match self.scale {
            Scale::Linear => self.linear_ticks(),
            Scale::Log => self.log_ticks(),
        }
    }

    /// Places ticks at multiples of 1, 2 or 5 times a power of 10.
    fn linear_ticks(&self) -> Vec<Tick> {
        let [lo, hi] = self.values;
        let rough = (hi - lo) / TICKS;
        let exponent = libm::log10(rough).floor();
        let unit = libm::pow(10.0, exponent);
        let step = unit
            * match rough / unit {
                r if r < 1.5 => 1.0,
                r if r < 3.5 => 2.0,
                r if r < 7.5 => 5.0,
                _ => 10.0,
            };
        let digits = (-libm::log10(step * 1.000001).floor()).clamp(0.0, 12.0) as usize;
        let room = step * 1e-6;
        let first = ((lo - room) / step).ceil();
        let values = (0..20).map(|k| (first + f64::from(k)) * step);
        values
            .take_while(|value| *value <= hi + room)
            .map(|value| {
                // Avoids the label -0.
                let value = if value.abs() < room { 0.0 } else { value };
                Tick { at: self.at(value), label: html! { (format_args!("{value:.digits$}")) } }
            })
            .collect()
    }

    /// Places ticks at powers of 10. An axis shorter than 2.2 decades also has ticks at 2 and 5, and one shorter than
    /// 0.7 decades has ticks at all digits. A long axis has ticks only at some powers of 10.
    fn log_ticks(&self) -> Vec<Tick> {
        let [lo, hi] = self.values;
        let (first, last) = (libm::log10(lo).floor() as i32, libm::log10(hi).ceil() as i32);
        let digits: &[i32] = match libm::log10(hi / lo) {
            decades if decades < 0.7 => &[1, 2, 3, 4, 5, 6, 7, 8, 9],
            decades if decades < 2.2 => &[1, 2, 5],
            _ => &[1],
        };
        let every = ((last - first) / 9 + 1) as usize;
        let is_plain = lo >= 0.005 && hi < 2000.0;
        let mut ticks = Vec::new();
        for exponent in (first..=last).step_by(every) {
            for &digit in digits {
                let value = f64::from(digit) * libm::pow(10.0, f64::from(exponent));
                if (lo * 0.999_999..=hi * 1.000_001).contains(&value) {
                    ticks.push(Tick {
                        at: self.at(value),
                        label: power_label(digit, exponent, is_plain),
                    });
                }
            }
        }
        ticks
    }
}

/// Formats the label of a digit times a power of 10.
fn power_label(digit: i32, exponent: i32, is_plain: bool) -> Markup {
    if is_plain {
        let value = f64::from(digit) * libm::pow(10.0, f64::from(exponent));
        let digits = (-exponent).max(0) as usize;
        return html! { (format_args!("{value:.digits$}")) };
    }
    let power = exponent.to_string().replace('-', "\u{2212}");
    html! {
        @if digit != 1 { (digit) "\u{b7}" }
        "10" tspan dy="-5" font-size="9" { (power) }
    }
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis) -> Vec<String> {
        axis.ticks().into_iter().map(|tick| tick.label.into_string()).collect()
    }

    #[test]
    fn linear_axes_have_round_ticks() {
        let axis = |lo, hi| Axis::linear([lo, hi].into_iter(), [0.0, 100.0]);
        assert_eq!(labels(&axis(0.0, 99.0)), ["0", "20", "40", "60", "80"]);
        assert_eq!(labels(&axis(1.3, 1.7)), ["1.3", "1.4", "1.5", "1.6", "1.7"]);
        assert_eq!(labels(&axis(-1.0, 1.0)), ["-1.0", "-0.5", "0.0", "0.5", "1.0"]);
        // A single value yields an axis from 4.5 to 5.5.
        assert_eq!(labels(&axis(5.0, 5.0)), ["4.6", "4.8", "5.0", "5.2", "5.4"]);
        assert_eq!(labels(&axis(0.0, 0.0)).len(), 5);
        assert_eq!(axis(0.0, 50.0).at(25.0), 50.0);
    }

    #[test]
    fn logarithmic_axes_have_decades() {
        let axis = |lo, hi| Axis::log_between([lo, hi], [0.0, 90.0]);
        assert_eq!(labels(&axis(1.0, 1000.0)), ["1", "10", "100", "1000"]);
        assert_eq!(labels(&axis(1.0, 10.0)), ["1", "2", "5", "10"]);
        assert_eq!(labels(&axis(0.3, 0.63)), ["0.3", "0.4", "0.5", "0.6"]);
        let small = labels(&axis(1e-5, 1e-1));
        assert_eq!(small.len(), 5);
        assert!(small[0].starts_with("10<tspan") && small[0].contains("\u{2212}5<"));
        assert!(labels(&axis(1e-30, 1e30)).len() <= 10);
        assert!((axis(1.0, 1000.0).at(10.0) - 30.0).abs() < 1e-9);
        // A single value also yields an axis.
        let one = Axis::log([3.0].into_iter(), [0.0, 1.0]);
        assert!(one.ticks().len() > 1 && one.is_log());
    }
}
