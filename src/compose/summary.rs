//! Mean scores of a method over a group of pictures, and its comparison with the input and with the veil rule.

use super::bootstrap::Interval;
use super::per_image::Row;
use super::score::Scores;
use super::seeds::{SeedGroup, Spread};
use serde::Serialize;

/// Name of the group of all pictures.
pub const ALL: &str = "all";

/// Name of the row of the unchanged inputs.
pub const INPUT: &str = "input";

/// A picture wins if its PSNR is better than the other's by more than this, dB.
const WIN_DB: f64 = 0.01;

/// Scores of a method over some pictures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Number of pictures.
    pub count: usize,
    #[serde(flatten)]
    pub scores: Scores,
    /// Pictures whose PSNR is better than the input's.
    pub wins: usize,
    /// Pictures whose PSNR after their own best factor is better than the input's after its own.
    pub wins_own_factor: usize,
    /// The same against the veil rule; `None` without such a row.
    pub wins_veil: Option<usize>,
    pub wins_veil_own_factor: Option<usize>,
    /// PSNR minus that of the veil rule, dB; `None` without such a row.
    pub over_veil_db: Option<Interval>,
    pub over_veil_own_factor_db: Option<Interval>,
}

/// A method's scores over a group.
#[derive(Clone, Debug, Serialize)]
pub struct MethodSummary {
    pub method: String,
    /// True if the method knows the truth, so that a network need not beat it.
    pub oracle: bool,
    /// Name of the group; [`ALL`] for all pictures.
    pub group: String,
    #[serde(flatten)]
    pub all: Summary,
    /// The same over the aligned pairs; `None` without measured shifts.
    pub aligned: Option<Summary>,
    /// For a row of means over seeds: their spread over all pictures of the group.
    pub spread: Option<Spread>,
    /// For a seed: the name of the row of means.
    pub seed_of: Option<String>,
}

/// Lists the groups of the rows: [`ALL`], then the named ones in the order of their first pictures.
pub fn groups(rows: &[Row]) -> Vec<String> {
    let mut groups = vec![ALL.to_owned()];
    for group in rows.iter().filter_map(|row| row.group.as_ref()) {
        if !groups.contains(group) {
            groups.push(group.clone());
        }
    }
    groups
}

/// Summarises every method over every group, in the order of the groups, then of the methods' first rows, and last the
/// means over seeds. `veil` is the name of the veil rule's row.
pub fn summaries(rows: &[Row], veil: Option<&str>, seeds: &[SeedGroup]) -> Vec<MethodSummary> {
    let means = seeds.iter().flat_map(|seeds| seeds.mean_rows(rows));
    let rows: &[Row] = &rows.iter().cloned().chain(means).collect::<Vec<Row>>();
    let mut methods: Vec<(&str, bool)> = Vec::new();
    for row in rows {
        if !methods.iter().any(|(method, _)| *method == row.method) {
            methods.push((&row.method, row.oracle));
        }
    }
    let is_measured = rows.iter().any(|row| row.shift_px.is_some());
    let of = |group: &str, method: &str, is_wanted: fn(&Row) -> bool| {
        let select = |method: &str| -> Vec<Scores> {
            let own = rows.iter().filter(|row| row.method == method && row.counts_for(group));
            own.filter(|row| is_wanted(row)).map(|row| row.scores).collect()
        };
        let veil = veil.map(select);
        Summary::of(&select(method), &select(INPUT), veil.as_deref())
    };
    let spread = |group: &str, method: &str| {
        let of_method = seeds.iter().find(|seeds| seeds.method == method)?;
        let mean = |member: &String| of(group, member, |_| true).scores;
        let means: Vec<Scores> = of_method.members.iter().map(mean).collect();
        Some(Spread::of(&means))
    };
    let seed_of = |method: &str| {
        let of_method = seeds.iter().find(|seeds| seeds.members.iter().any(|m| m == method));
        of_method.map(|seeds| seeds.method.clone())
    };
    let mut all = Vec::new();
    for group in groups(rows) {
        for &(method, oracle) in &methods {
            all.push(MethodSummary {
                method: method.to_owned(),
                oracle,
                all: of(&group, method, |_| true),
                aligned: is_measured.then(|| of(&group, method, Row::is_aligned)),
                spread: spread(&group, method),
                seed_of: seed_of(method),
                group: group.clone(),
            });
        }
    }
    all
}

impl Summary {
    /// Summarises the scores of the same pictures by a method, of the inputs and by the veil rule.
    fn of(scores: &[Scores], inputs: &[Scores], veil: Option<&[Scores]>) -> Self {
        let raw = |scores: &Scores| scores.psnr_colour_db;
        let own = |scores: &Scores| scores.psnr_own_factor_db;
        Self {
            count: scores.len(),
            scores: Scores::mean(scores),
            wins: wins(scores, inputs, raw),
            wins_own_factor: wins(scores, inputs, own),
            wins_veil: veil.map(|veil| wins(scores, veil, raw)),
            wins_veil_own_factor: veil.map(|veil| wins(scores, veil, own)),
            over_veil_db: veil.and_then(|veil| Interval::of(&differences(scores, veil, raw))),
            over_veil_own_factor_db: veil
                .and_then(|veil| Interval::of(&differences(scores, veil, own))),
        }
    }
}

fn differences(scores: &[Scores], others: &[Scores], of: fn(&Scores) -> f64) -> Vec<f64> {
    // Two infinite PSNRs do not differ.
    let difference = |(a, b): (f64, f64)| if a == b { 0.0 } else { a - b };
    scores.iter().map(of).zip(others.iter().map(of)).map(difference).collect()
}

fn wins(scores: &[Scores], others: &[Scores], of: fn(&Scores) -> f64) -> usize {
    differences(scores, others, of).into_iter().filter(|&difference| difference > WIN_DB).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(method: &str, image: &str, group: &str, psnr_db: f64) -> Row {
        Row {
            method: method.to_owned(),
            oracle: method == "best",
            image: image.to_owned(),
            group: (!group.is_empty()).then(|| group.to_owned()),
            only_for: None,
            width: 4,
            height: 3,
            shift_px: None,
            scores: Scores {
                psnr_colour_db: psnr_db,
                psnr_own_factor_db: psnr_db + 1.0,
                ssim_grey: 0.5,
                psnr_channels_db: psnr_db,
                ssim_channels: 0.5,
            },
        }
    }

    #[test]
    fn groups_are_compared_picture_by_picture() {
        let infinite = f64::INFINITY;
        let rows = [
            row("input", "1", "a", 20.0),
            row("input", "2", "a", 21.0),
            row("input", "3", "b", infinite),
            row("veil", "1", "a", 20.5),
            row("veil", "2", "a", 20.0),
            row("veil", "3", "b", infinite),
            row("net", "1", "a", 20.009),
            row("net", "2", "a", 21.02),
            row("net", "3", "b", infinite),
        ];
        let found = summaries(&rows, Some("veil"), &[]);
        let names: Vec<(&str, &str)> =
            found.iter().map(|row| (row.group.as_str(), row.method.as_str())).collect();
        let methods = ["input", "veil", "net"];
        let expected: Vec<(&str, &str)> =
            ["all", "a", "b"].into_iter().flat_map(|g| methods.map(|m| (g, m))).collect();
        assert_eq!(names, expected);
        let wins: Vec<(usize, Option<usize>)> =
            found.iter().map(|row| (row.all.wins, row.all.wins_veil)).collect();
        let net = (1, Some(1));
        let of_a = [(0, Some(1)), (1, Some(0)), net];
        assert_eq!(wins, [of_a, of_a, [(0, Some(0)); 3]].concat());
        // Differences of infinite scores are 0.
        let over = found[2].all.over_veil_db.unwrap();
        assert!((over.mean - (20.009 - 20.5 + 1.02) / 3.0).abs() < 1e-12, "{over:?}");
        assert_eq!(found[8].all.over_veil_db.unwrap().high, 0.0);
        assert_eq!((found[2].all.scores.psnr_colour_db, found[5].all.count), (infinite, 2));
        assert!(found.iter().all(|row| row.aligned.is_none() && !row.oracle));
    }

    #[test]
    fn rows_of_one_group_count_for_it_alone() {
        let mut rows = vec![row("input", "1", "a", 20.0), row("input", "2", "b", 10.0)];
        for (only_for, image, group, psnr_db) in
            [("all", "1", "a", 21.0), ("all", "2", "b", 11.0), ("a", "1", "a", 22.0)]
        {
            let only_for = Some(only_for.to_owned());
            rows.push(Row { only_for, ..row("best", image, group, psnr_db) });
        }
        let found = summaries(&rows, None, &[]);
        let of = |group: &str| {
            let row = found.iter().find(|row| row.group == group && row.method == "best");
            (row.unwrap().all.count, row.unwrap().all.scores.psnr_colour_db)
        };
        assert_eq!((of("all"), of("a")), ((2, 16.0), (1, 22.0)));
        assert!(found[1].oracle && found[1].all.over_veil_db.is_none());
        let json = serde_json::to_value(&found[1]).unwrap();
        assert_eq!(
            (&json["group"], &json["count"], &json["wins"]),
            (&"all".into(), &2.into(), &2.into())
        );
        assert!(json["wins_veil"].is_null());
    }

    #[test]
    fn aligned_pairs_are_summarised_alone() {
        let mut rows = vec![row("input", "1", "", 20.0), row("input", "2", "", 30.0)];
        rows[0].shift_px = Some(9.0);
        rows[1].shift_px = Some(0.5);
        let found = summaries(&rows, None, &[]);
        assert_eq!((found.len(), found[0].all.count), (1, 2));
        let aligned = found[0].aligned.as_ref().unwrap();
        assert_eq!((aligned.count, aligned.scores.psnr_colour_db), (1, 30.0));
    }
    #[test]
    fn seeds_have_means_and_a_spread() {
        let mut rows = vec![row("input", "1", "", 20.0), row("input", "2", "", 20.0)];
        for (seed, psnrs_db) in [("s1", [19.0, 23.0]), ("s2", [20.0, 24.0]), ("s3", [22.0, 25.0])] {
            rows.extend([row(seed, "1", "", psnrs_db[0]), row(seed, "2", "", psnrs_db[1])]);
        }
        let members = ["s1", "s2", "s3"].map(str::to_owned).to_vec();
        let seeds = SeedGroup { method: "net".to_owned(), members };
        let found = summaries(&rows, None, &[seeds]);
        let names: Vec<&str> = found.iter().map(|row| row.method.as_str()).collect();
        assert_eq!(names, ["input", "s1", "s2", "s3", "net"]);
        let net = &found[4];
        // Means over both pictures: 21, 22, 23.5.
        assert!((net.all.scores.psnr_colour_db - 66.5 / 3.0).abs() < 1e-12);
        let spread = net.spread.unwrap();
        let [mean, squares] = [66.5 / 3.0, 21.0f64.powi(2) + 22.0f64.powi(2) + 23.5f64.powi(2)];
        let deviation = ((squares - 3.0 * mean * mean) / 2.0).sqrt();
        assert!((spread.psnr_colour_db - deviation).abs() < 1e-9, "{spread:?}");
        assert_eq!((spread.seeds, spread.ssim_grey), (3, 0.0));
        // Means of the pictures: 20.33 and 24.
        assert_eq!((net.all.wins, net.all.count), (2, 2));
        assert_eq!(found[1].seed_of.as_deref(), Some("net"));
        assert!(net.seed_of.is_none() && found[0].spread.is_none());
    }
}
