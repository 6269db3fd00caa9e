//! Spans, the unit that workers hold: shards in a row of one scene; and how a busy worker gives some away.
//!
//! One rule keeps everything covered: a worker that gives publishes first, waits until the queue has it, and only then
//! leaves those shards alone. Two workers may then trace the same shard, which costs time and changes nothing; that
//! nobody traces a shard cannot happen.

use std::ops::Range;

/// Shards in a row of one scene.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Span {
    /// Its place in the manifest, from 0.
    pub scene: u32,
    /// Numbers in the scene; not empty.
    pub shards: Range<u32>,
}

impl Span {
    /// Number of shards.
    pub fn shard_count(&self) -> u32 {
        self.shards.end - self.shards.start
    }
}

/// What a worker knows of a span that it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldSpan {
    /// As it holds it now: what it gave away is not in it.
    pub span: Span,
    /// Its scene is loaded, or being loaded.
    pub opened: bool,
    /// Shards at its end that nobody has begun.
    pub unbegun: Range<u32>,
    /// Estimated seconds until those are done.
    pub unbegun_s: f64,
    /// Seconds that another worker needs to load the scene.
    pub load_s: f64,
}

/// Giving a part of an opened span must save this many times what loading its scene again costs.
const WORTH_LOADS: f64 = 2.0;

/// What a worker publishes when another one has nothing to do: the later half of the spans that it has not opened, else
/// the later half of the longest rest of an opened one; nothing if that is not worth loading its scene twice.
pub fn what_to_give(held: &[HeldSpan]) -> Vec<Span> {
    let waiting: Vec<&HeldSpan> = held.iter().filter(|h| !h.opened).collect();
    if !waiting.is_empty() {
        let kept = waiting.len() / 2;
        return waiting[kept..].iter().map(|h| h.span.clone()).collect();
    }
    let longest = held
        .iter()
        .filter(|h| !h.unbegun.is_empty() && h.unbegun_s > WORTH_LOADS * h.load_s)
        .max_by(|a, b| a.unbegun_s.total_cmp(&b.unbegun_s));
    longest
        .map(|h| Span {
            scene: h.span.scene,
            shards: later_half(&h.unbegun),
        })
        .into_iter()
        .collect()
}

/// The later half, the larger one if the count is odd.
fn later_half(shards: &Range<u32>) -> Range<u32> {
    shards.start + (shards.end - shards.start) / 2..shards.end
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(scene: u32, shards: Range<u32>, begun: Option<u32>) -> HeldSpan {
        let unbegun = begun.map_or(shards.clone(), |b| shards.start + b..shards.end);
        HeldSpan {
            span: Span { scene, shards },
            opened: begun.is_some(),
            unbegun_s: f64::from(unbegun.end - unbegun.start),
            unbegun,
            load_s: 0.2,
        }
    }

    #[test]
    fn spans_that_are_not_open_are_given_first() {
        let all = [
            held(0, 0..16, Some(1)),
            held(1, 0..1, None),
            held(2, 0..4, None),
            held(3, 0..2, None),
        ];
        let given = what_to_give(&all);
        assert_eq!(given, [all[2].span.clone(), all[3].span.clone()]);
        assert_eq!(what_to_give(&all[..2]), [all[1].span.clone()]);
    }

    #[test]
    fn the_later_half_of_what_is_not_begun_is_given() {
        let all = [held(0, 0..16, Some(6)), held(1, 4..8, Some(1))];
        let given = what_to_give(&all);
        assert_eq!(
            given,
            [Span {
                scene: 0,
                shards: 11..16
            }]
        );
        let one = [held(0, 3..5, Some(1))];
        assert_eq!(
            what_to_give(&one),
            [Span {
                scene: 0,
                shards: 4..5
            }]
        );
    }

    #[test]
    fn what_is_not_worth_a_load_is_kept() {
        let mut all = [held(0, 0..16, Some(6))];
        all[0].load_s = 5.0;
        assert_eq!(what_to_give(&all), []);
        assert_eq!(what_to_give(&[held(0, 0..4, Some(4))]), []);
        assert_eq!(what_to_give(&[]), []);
    }
}
