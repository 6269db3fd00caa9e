//! Pairs a front with a back photograph of one split.
//!
//! A pair is a function of the photographs and the pair's number, so additional pairs do not change the earlier pairs.

use super::diode::SourceImage;
use super::draw::{keyed, shuffled};
use procedural::Place;
use std::collections::BTreeMap;

/// A front and a back photograph.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair<'a> {
    pub(super) front: &'a SourceImage,
    pub(super) back: &'a SourceImage,
}

impl Pair<'_> {
    /// Returns the key of a photograph's scan, which is equal for all photographs from one standpoint.
    pub(super) fn scan_of(image: &SourceImage) -> (Place, &str, &str) {
        scan_of(image)
    }

    /// True if both photographs are from one standpoint.
    pub(super) fn is_same_scan(&self) -> bool {
        scan_of(self.front) == scan_of(self.back)
    }

    /// True if both photographs are indoors, or both outdoors.
    pub(super) fn is_same_place(&self) -> bool {
        self.front.place == self.back.place
    }
}

/// Makes `count` pairs from the two or more photographs of `subset`. Each pair has an indoor and an outdoor photograph
/// if both exist, else two of different scans if possible. Uses all photographs of a place equally often as front and
/// as back, unless all are of one place and most are of one scan.
/// The shuffles depend on `key` and the seed.
pub(super) fn pairs<'a>(
    dataset_seed: u64,
    key: [&str; 2],
    subset: &[&'a SourceImage],
    count: u32,
) -> Vec<Pair<'a>> {
    let indoors: Vec<_> = of(subset, |image| image.place == Place::Indoors);
    let outdoor: Vec<_> = of(subset, |image| image.place == Place::Outdoor);
    if !indoors.is_empty() && !outdoor.is_empty() {
        return across(dataset_seed, key, &indoors, &outdoor, count);
    }
    let mut scans: BTreeMap<Scan<'_>, usize> = BTreeMap::new();
    for image in subset {
        *scans.entry(scan_of(image)).or_default() += 1;
    }
    match scans.iter().max_by_key(|(_, size)| **size) {
        // One scan has more than half of all photographs, so its photographs are paired with the others.
        Some((largest, &size)) if scans.len() > 1 && 2 * size > subset.len() => {
            let inside = of(subset, |image| scan_of(image) == *largest);
            let outside = of(subset, |image| scan_of(image) != *largest);
            across(dataset_seed, key, &inside, &outside, count)
        }
        _ => within(dataset_seed, key, subset, scans.len() > 1, count),
    }
}

/// Makes `count` pairs with fronts from one source and backs from another. Uses the photographs of each equally often. No pair
/// has a photograph of both sources twice.
pub(super) fn pairs_between<'a>(
    dataset_seed: u64,
    key: [&str; 2],
    [front, back]: [&[&'a SourceImage]; 2],
    count: u32,
) -> Vec<Pair<'a>> {
    let deck = |role| Deck::new(dataset_seed, key, role);
    let (mut fronts, mut backs) = (deck("front"), deck("back"));
    let pair = |_| {
        let front = fronts.next(front);
        Pair { front, back: backs.next_but(back, front) }
    };
    (0..count).map(pair).collect()
}

type Scan<'a> = (Place, &'a str, &'a str);

fn scan_of(image: &SourceImage) -> Scan<'_> {
    (image.place, &image.scene, &image.scan)
}

fn of<'a>(subset: &[&'a SourceImage], keep: impl Fn(&SourceImage) -> bool) -> Vec<&'a SourceImage> {
    subset.iter().copied().filter(|image| keep(image)).collect()
}

/// Takes fronts alternately from `one` and `other`, and backs from the opposite group.
fn across<'a>(
    dataset_seed: u64,
    key: [&str; 2],
    one: &[&'a SourceImage],
    other: &[&'a SourceImage],
    count: u32,
) -> Vec<Pair<'a>> {
    let deck = |role| Deck::new(dataset_seed, key, role);
    let mut one_front = deck("first side, front");
    let mut one_back = deck("first side, back");
    let mut other_front = deck("second side, front");
    let mut other_back = deck("second side, back");
    let first = keyed(dataset_seed, &[key[0], key[1], "first front"]) & 1;
    (0..u64::from(count))
        .map(|number| {
            if number & 1 == first {
                Pair { front: one_front.next(one), back: other_back.next(other) }
            } else {
                Pair { front: other_front.next(other), back: one_back.next(one) }
            }
        })
        .collect()
}

/// A deck of photographs in random order. It is shuffled again after the last photograph.
struct Deck<'k, 'a> {
    dataset_seed: u64,
    key: [&'k str; 3],
    round: u32,
    /// Remaining photographs of the round, in reverse order.
    left: Vec<&'a SourceImage>,
}

impl<'k, 'a> Deck<'k, 'a> {
    fn new(dataset_seed: u64, key: [&'k str; 2], role: &'k str) -> Self {
        Self { dataset_seed, key: [key[0], key[1], role], round: 0, left: Vec::new() }
    }

    fn next(&mut self, images: &[&'a SourceImage]) -> &'a SourceImage {
        loop {
            if let Some(image) = self.left.pop() {
                return image;
            }
            let round = self.round.to_string();
            let key = [self.key[0], self.key[1], self.key[2], &round];
            self.left = shuffle(self.dataset_seed, &key, images);
            self.round += 1;
        }
    }

    /// Takes the next photograph that is not `other`, which stays the next one. The deck has two photographs or more.
    fn next_but(&mut self, images: &[&'a SourceImage], other: &SourceImage) -> &'a SourceImage {
        let first = self.next(images);
        if !first.is_shared_with(other) {
            return first;
        }
        let second = self.next_but(images, other);
        self.left.push(first);
        second
    }
}

fn shuffle<'a>(
    dataset_seed: u64,
    key: &[&str],
    images: &[&'a SourceImage],
) -> Vec<&'a SourceImage> {
    shuffled(dataset_seed, key, images.iter().copied(), |image| &image.color)
}

/// Pairs photographs of one pool in rounds; each round uses every photograph once as front and once as back.
///
/// A round sorts the photographs by group (the scan, or the photograph itself if all are of one scan) and pairs each
/// with the photograph `shift` positions later. No pair is within a group if the shift is between the size of the
/// largest group and the number of photographs outside that group.
fn within<'a>(
    dataset_seed: u64,
    key: [&str; 2],
    subset: &[&'a SourceImage],
    by_scan: bool,
    count: u32,
) -> Vec<Pair<'a>> {
    let mut made = Vec::with_capacity(count as usize);
    let mut round = 0u32;
    while made.len() < count as usize {
        let round_text = round.to_string();
        let round_key = |role| [key[0], key[1], role, round_text.as_str()];
        let mut ring = shuffle(dataset_seed, &round_key("ring"), subset);
        let mut largest = 1;
        if by_scan {
            let mut sizes: BTreeMap<Scan<'_>, usize> = BTreeMap::new();
            for image in &ring {
                *sizes.entry(scan_of(image)).or_default() += 1;
            }
            largest = sizes.values().copied().max().unwrap_or(1);
            ring.sort_by_cached_key(|image| {
                let (place, scene, scan) = scan_of(image);
                let order =
                    keyed(dataset_seed, &[key[0], key[1], "scan", &round_text, scene, scan]);
                (order, place, scene, scan)
            });
        }
        let shifts = ring.len() + 1 - 2 * largest;
        let chosen = keyed(dataset_seed, &round_key("shift")) % shifts as u64;
        let shift = largest + chosen as usize;
        let partner: BTreeMap<&str, &SourceImage> = ring
            .iter()
            .enumerate()
            .map(|(place, image)| (image.color.as_str(), ring[(place + shift) % ring.len()]))
            .collect();
        for front in shuffle(dataset_seed, &round_key("order"), subset) {
            let back = partner[front.color.as_str()];
            made.push(Pair { front, back });
        }
        round += 1;
    }
    made.truncate(count as usize);
    made
}

#[cfg(test)]
mod tests {
    use super::super::split::tests::set;
    use super::*;
    use proptest::prelude::*;

    fn refs(images: &[SourceImage]) -> Vec<&SourceImage> {
        images.iter().collect()
    }

    /// Returns the least and the largest number of uses among `images`, as fronts and as backs.
    fn uses(made: &[Pair<'_>], images: &[&SourceImage]) -> [(usize, usize); 2] {
        let roles: [fn(&Pair<'_>) -> String; 2] =
            [|p| p.front.color.clone(), |p| p.back.color.clone()];
        roles.map(|role| {
            let counts: Vec<usize> = images
                .iter()
                .map(|image| made.iter().filter(|p| role(p) == image.color).count())
                .collect();
            (*counts.iter().min().unwrap(), *counts.iter().max().unwrap())
        })
    }

    #[test]
    fn a_single_scan_gives_pairs_of_different_photographs() {
        let images = set(4, 0);
        for pair in pairs(3, ["train", "s"], &refs(&images), 20) {
            assert!(pair.is_same_scan());
            assert_ne!(pair.front.color, pair.back.color);
        }
    }

    #[test]
    fn a_scan_with_most_photographs_is_not_paired_with_itself() {
        // The set has a scan of four photographs and a scan of one photograph.
        let images = set(5, 0);
        let made = pairs(3, ["train", "s"], &refs(&images), 40);
        assert!(made.iter().all(|pair| !pair.is_same_scan()));
    }

    proptest! {
        #[test]
        fn pairs_cross_places_use_photographs_evenly_and_are_stable(
            indoors in 0usize..24, outdoor in 0usize..24, seed: u64, count in 1u32..90,
        ) {
            let images = set(indoors, outdoor);
            prop_assume!(images.len() >= 2);
            let subset = refs(&images);
            let made = pairs(seed, ["train", "s"], &subset, count);
            prop_assert_eq!(made.len(), count as usize);
            for pair in &made {
                prop_assert_ne!(&pair.front.color, &pair.back.color);
                prop_assert_eq!(pair.is_same_place(), indoors == 0 || outdoor == 0);
                prop_assert_eq!(pair.is_same_scan(), indoors.max(outdoor) <= 4 && pair.is_same_place());
            }

            // Uses are even within a place, unless all photographs are of one place and most of them of one scan.
            for side in [Place::Indoors, Place::Outdoor] {
                let side = of(&subset, |image| image.place == side);
                let lopsided = (indoors == 0 || outdoor == 0) && (5..8).contains(&side.len());
                if !side.is_empty() && !lopsided {
                    for (least, most) in uses(&made, &side) {
                        prop_assert!(most - least <= 1, "{least} {most}");
                    }
                }
            }

            let more = pairs(seed, ["train", "s"], &subset, count + 7);
            for (a, b) in made.iter().zip(&more) {
                prop_assert_eq!((&a.front.color, &a.back.color), (&b.front.color, &b.back.color));
            }
        }
    }
}
