//! Splits photographs between `train` and `test`. The sizes follow from the recipe's shares and never from the number
//! of scenes, so that adding a scene moves no photograph to another split.

use super::diode::SourceImage;
use super::draw::shuffled;
use super::recipe_error::RecipeError;
use procedural::Place;
use std::collections::BTreeSet;

/// Distributes the photographs of a source over splits in proportion to `shares` (all above 0).
///
/// Every split gets at least two photographs, and some of each place if possible. The subsets depend only on
/// the seed, the source's name, the photographs and the shares.
pub(super) fn split_photographs<'a>(
    dataset_seed: u64,
    source_name: &str,
    images: &'a [SourceImage],
    shares: &[f64],
) -> Result<Vec<Vec<&'a SourceImage>>, RecipeError> {
    let mut seen = BTreeSet::new();
    if let Some(twice) = images.iter().find(|image| !seen.insert(&image.color)) {
        return Err(RecipeError::ListedTwice {
            source_name: source_name.to_owned(),
            color: twice.color.clone(),
        });
    }
    let splits = shares.len();
    // Integer weights, because floating-point shares could round differently between machines.
    let weights: Vec<u32> = shares.iter().map(|s| (s * 1e9).round().max(1.0) as u32).collect();
    let weights = weights.as_slice();
    if images.len() < 2 * splits {
        return Err(RecipeError::TooFewImages {
            source_name: source_name.to_owned(),
            found: images.len(),
            needed: 2 * splits,
            splits,
        });
    }

    let of = |place: Place| {
        let there = images.iter().filter(|image| image.place == place);
        shuffled(dataset_seed, &["divide", source_name], there, |image| &image.color)
    };
    let (mut rare, mut common) = (of(Place::Indoors), of(Place::Outdoor));
    if rare.len() > common.len() {
        std::mem::swap(&mut rare, &mut common);
    }
    let rare_sizes = if rare.len() >= splits {
        apportion(rare.len(), weights, &vec![1; splits])
    } else {
        one_each(rare.len(), weights)
    };
    let least: Vec<usize> = rare_sizes.iter().map(|n| 2usize.saturating_sub(*n).max(1)).collect();
    let common_sizes = apportion(common.len(), weights, &least);

    let (mut rare, mut common) = (rare.into_iter(), common.into_iter());
    Ok(rare_sizes
        .into_iter()
        .zip(common_sizes)
        .map(|(m, n)| rare.by_ref().take(m).chain(common.by_ref().take(n)).collect())
        .collect())
}

/// Distributes `total` in proportion to `weights` by largest remainder, with the minima `least`. `total` is at least
/// the sum of the minima.
fn apportion(total: usize, weights: &[u32], least: &[usize]) -> Vec<usize> {
    let mut sizes = least.to_vec();
    let mut open: Vec<usize> = (0..weights.len()).collect();
    let mut left = total;
    let mut weight: u128 = weights.iter().map(|&w| u128::from(w)).sum();
    // A split with a share below its minimum gets the minimum, which lowers the share of the others.
    while let Some(position) = open
        .iter()
        .position(|&k| (left as u128) * u128::from(weights[k]) < (least[k] as u128) * weight)
    {
        let k = open.remove(position);
        left -= least[k];
        weight -= u128::from(weights[k]);
    }
    let mut given = 0;
    let mut remainders = Vec::new();
    for &k in &open {
        let share = (left as u128) * u128::from(weights[k]);
        sizes[k] = (share / weight) as usize;
        given += sizes[k];
        remainders.push((share % weight, k));
    }
    remainders.sort_by(|(a, i), (b, j)| b.cmp(a).then(i.cmp(j)));
    for &(_, k) in remainders.iter().take(left - given) {
        sizes[k] += 1;
    }
    sizes
}

/// Gives one photograph each to the `total` splits with the largest shares. `total` is less than the number of splits.
fn one_each(total: usize, weights: &[u32]) -> Vec<usize> {
    let mut by_share: Vec<usize> = (0..weights.len()).collect();
    by_share.sort_by_key(|&k| std::cmp::Reverse(weights[k]));
    let mut sizes = vec![0; weights.len()];
    for &k in by_share.iter().take(total) {
        sizes[k] = 1;
    }
    sizes
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Makes photographs in scans of four.
    pub(in super::super) fn set(indoors: usize, outdoor: usize) -> Vec<SourceImage> {
        let image = |place: Place, folder: &str, n: usize| SourceImage {
            depth_root: None,
            depth_range: None,
            color: format!("{folder}/scene_{}/scan_{}/{n}.png", n / 8, n / 4),
            depth: format!("{folder}/scene_{}/scan_{}/{n}_depth.npy", n / 8, n / 4),
            mask: None,
            place,
            scene: format!("scene_{}", n / 8),
            scan: format!("scan_{}", n / 4),
            side: None,
            values: std::collections::BTreeMap::new(),
            shared: None,
        };
        let inside = (0..indoors).map(|n| image(Place::Indoors, "indoors", n));
        let outside = (0..outdoor).map(|n| image(Place::Outdoor, "outdoor", n));
        inside.chain(outside).collect()
    }

    #[test]
    fn subsets_are_proportional_to_the_shares() {
        let images = set(400, 600);
        let subsets = split_photographs(1, "s", &images, &[0.96, 0.04]).unwrap();
        let sizes: Vec<_> = subsets.iter().map(Vec::len).collect();
        assert!(sizes[0] == 960, "{sizes:?}");
        let inside = subsets[1].iter().filter(|i| i.place == Place::Indoors).count();
        assert!(inside == 16, "{inside}");
    }

    #[test]
    fn too_few_or_repeated_photographs_are_errors() {
        let error = split_photographs(1, "s", &set(2, 1), &[0.8, 0.2]).unwrap_err().to_string();
        assert!(error.contains("has 3 photographs, but 2 splits"), "{error}");
        let mut twice = set(2, 2);
        twice.push(twice[0].clone());
        assert!(matches!(
            split_photographs(1, "s", &twice, &[1.0]),
            Err(RecipeError::ListedTwice { .. })
        ));
    }

    proptest! {
        #[test]
        fn every_photograph_has_one_split(
            indoors in 0usize..40, outdoor in 0usize..40, seed: u64,
            shares in prop::collection::vec(0.001f64..1.0, 1..4),
        ) {
            let images = set(indoors, outdoor);
            prop_assume!(images.len() >= 2 * shares.len());
            let subsets = split_photographs(seed, "s", &images, &shares).unwrap();
            prop_assert_eq!(subsets.len(), shares.len());
            let mut seen = BTreeSet::new();
            for subset in &subsets {
                prop_assert!(subset.len() >= 2);
                for image in subset {
                    prop_assert!(seen.insert(&image.color));
                }
                for (place, count) in [(Place::Indoors, indoors), (Place::Outdoor, outdoor)] {
                    let has = subset.iter().any(|image| image.place == place);
                    prop_assert!(has || count < shares.len());
                }
            }
            prop_assert_eq!(seen.len(), images.len());
        }
    }
}
