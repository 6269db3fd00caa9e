//! Spans, the unit that workers hold: shards in a row of one scene; and how a busy worker gives some away.
//!
//! One rule keeps everything covered: a worker that gives publishes first, waits until the queue has it, and only then
//! leaves those shards alone. Two workers may then trace the same shard, which costs time and changes nothing; that
//! nobody traces a shard cannot happen.

use crate::run::Span;
use std::ops::Range;

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

/// What a worker publishes when another one has nothing to do, which needs `slowness` times as long for the same: the
/// later half of the spans that it has not opened, else the end of the longest rest of an opened one, so much that both
/// are done at the same time; nothing if that is not worth loading its scene twice.
pub fn what_to_give(held: &[HeldSpan], slowness: f64) -> Vec<Span> {
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
        .and_then(|h| {
            Some(Span {
                scene: h.span.scene,
                shards: later_share(h, slowness)?,
            })
        })
        .into_iter()
        .collect()
}

/// The later half, the larger one if the count is odd; a smaller part for a slower worker, none if that would take longer
/// there than all of it here.
fn later_share(held: &HeldSpan, slowness: f64) -> Option<Range<u32>> {
    let (shards, count) = (&held.unbegun, held.unbegun.len() as f64);
    let given = (count / (1.0 + slowness) + 0.5).floor().min(count);
    let shard_s = held.unbegun_s / count;
    // The giver has a shard in hand besides.
    let worth =
        slowness <= 1.0 || held.load_s + given * shard_s * slowness < held.unbegun_s + shard_s;
    (worth && given > 0.0).then(|| shards.end - given as u32..shards.end)
}

/// What of `0..shards` is in none of `covered`: in order, as long as possible.
///
/// A coordinator publishes this of a scene without tuple, `covered` being the ranges of its messages in the queue. A
/// range that is finished may be among it: whoever takes it finds its partials and is done.
pub fn uncovered(shards: u32, mut covered: Vec<Range<u32>>) -> Vec<Range<u32>> {
    covered.sort_unstable_by_key(|r| r.start);
    let mut gaps = Vec::new();
    let mut reached = 0;
    for range in covered {
        if range.start > reached {
            gaps.push(reached..range.start.min(shards));
        }
        reached = reached.max(range.end);
        if reached >= shards {
            return gaps;
        }
    }
    gaps.push(reached..shards);
    gaps
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
        let given = what_to_give(&all, 1.0);
        assert_eq!(given, [all[2].span.clone(), all[3].span.clone()]);
        assert_eq!(what_to_give(&all[..2], 1.0), [all[1].span.clone()]);
    }

    #[test]
    fn the_later_half_of_what_is_not_begun_is_given() {
        let all = [held(0, 0..16, Some(6)), held(1, 4..8, Some(1))];
        let given = what_to_give(&all, 1.0);
        assert_eq!(
            given,
            [Span {
                scene: 0,
                shards: 11..16
            }]
        );
        let one = [held(0, 3..5, Some(1))];
        assert_eq!(
            what_to_give(&one, 1.0),
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
        assert_eq!(what_to_give(&all, 1.0), []);
        assert_eq!(what_to_give(&[held(0, 0..4, Some(4))], 1.0), []);
        assert_eq!(what_to_give(&[], 1.0), []);
    }

    #[test]
    fn who_is_slower_gets_less() {
        let all = [held(0, 0..16, Some(6))];
        let given = |slowness| {
            let given = what_to_give(&all, slowness);
            given.first().map_or(0, Span::shard_count)
        };
        assert_eq!([given(1.0), given(2.0), given(4.0)], [5, 3, 2]);
        // One shard would take longer there than all ten here.
        assert_eq!(given(12.0), 0);
        assert_eq!(given(0.25), 8);
    }

    use proptest::prelude::*;

    fn some_held() -> impl Strategy<Value = HeldSpan> {
        let range = (0u32..40, 1u32..20, 0u32..20, any::<bool>());
        (range, 0u32..5, 0.0..10.0, 0.0..10.0).prop_map(
            |((start, count, begun, opened), scene, unbegun_s, load_s)| {
                let begun = if opened { begun.min(count) } else { 0 };
                HeldSpan {
                    span: Span {
                        scene,
                        shards: start..start + count,
                    },
                    opened,
                    unbegun: start + begun..start + count,
                    unbegun_s,
                    load_s,
                }
            },
        )
    }

    proptest! {
        /// What is given is whole spans that are not opened, or the end of one whose beginning the giver keeps or has begun.
        #[test]
        fn what_is_given_is_held_and_not_begun(
            held in prop::collection::vec(some_held(), 0..6),
            slowness in prop_oneof![Just(1.0), 0.1..10.0],
        ) {
            let given = what_to_give(&held, slowness);
            let waiting: Vec<_> = held.iter().filter(|h| !h.opened).collect();
            if waiting.is_empty() {
                prop_assert!(given.len() <= 1);
                for span in &given {
                    let from = held.iter().find(|h| h.span.scene == span.scene && h.unbegun.end == span.shards.end
                        && h.unbegun.start <= span.shards.start && h.unbegun_s > WORTH_LOADS * h.load_s);
                    prop_assert!(from.is_some());
                    prop_assert!(span.shard_count() > 0);
                    if slowness >= 1.0 {
                        prop_assert!(2 * span.shard_count() <= from.unwrap().unbegun.len() as u32 + 1);
                    }
                }
            } else {
                prop_assert_eq!(given.len(), waiting.len().div_ceil(2));
                prop_assert!(given.iter().all(|g| waiting.iter().any(|h| h.span == *g)));
            }
        }

        /// Gaps and cover together are the scene, gaps are apart, and no gap holds anything covered.
        #[test]
        fn gaps_are_the_rest(shards in 1u32..30, covered in prop::collection::vec((0u32..30, 1u32..10), 0..8)) {
            let ranges: Vec<Range<u32>> = covered.iter().map(|&(a, n)| a..a + n).collect();
            let gaps = uncovered(shards, ranges.clone());
            for s in 0..shards {
                let is_covered = ranges.iter().any(|r| r.contains(&s));
                prop_assert_eq!(gaps.iter().filter(|g| g.contains(&s)).count(), usize::from(!is_covered));
            }
            prop_assert!(gaps.iter().all(|g| !g.is_empty() && g.end <= shards));
            prop_assert!(gaps.windows(2).all(|g| g[0].end < g[1].start));
        }
    }
}
