//! Notes below the tables of an evaluation: what its rows and columns mean.

use super::evaluation::{Evaluation, counted};
use compose::{ALL, INPUT, Rules, SeedGroup};
use std::fmt::Write;

impl Evaluation {
    /// Returns one line for each note.
    pub(super) fn notes(&self) -> String {
        let conditions = &self.conditions;
        let size = match conditions.longest_px {
            Some(px) => format!("longest sides scaled down to {px} px"),
            None => "no resizing".to_owned(),
        };
        let mut notes = format!(
            "Protocol: {size}; scored as 8-bit sRGB. Means over images.\n\
             Own factor: PSNR after each picture's own best factor of linear light, dB.\n\
             Wins, Over veil: pictures 0.01 dB above the input and the veil rule, raw / after own factors.\n\
             {INPUT}: the unchanged pictures.\n"
        );
        rules(&conditions.baselines, &mut notes);
        let factors = self.group_factors();
        let _ = writeln!(
            notes,
            "Oracles: the input times factors that are chosen on the scored pictures ({factors})."
        );
        for network in &conditions.networks {
            let _ = writeln!(notes, "{}: {}.", network.method, network.path.display());
        }
        for SeedGroup { method, members } in &conditions.seeds {
            let _ = writeln!(
                notes,
                "{method}: means of {}; ± standard deviation over seeds; wins of each picture's mean.",
                members.join(", ")
            );
        }
        for outputs in &conditions.outputs {
            let _ = writeln!(notes, "{}: pictures of {}.", outputs.method, outputs.path.display());
        }
        let Some(tile_px) = conditions.tile_px.filter(|_| !conditions.networks.is_empty()) else {
            return notes;
        };
        let inputs = self.rows.iter().filter(|row| row.method == INPUT);
        let tiled = inputs.filter(|row| row.width.max(row.height) > tile_px).count();
        if tiled > 0 {
            let _ = writeln!(
                notes,
                "Networks processed {} in overlapping tiles of {tile_px} px and normalised each tile separately.",
                counted(tiled, "picture"),
            );
        }
        notes
    }

    /// Lists the best factors of the groups.
    fn group_factors(&self) -> String {
        let factor =
            |(group, factor): (&String, &compose::Factor)| format!("{group} {:.2}", factor.0);
        let all = self.group_factors.iter().filter(|(group, _)| *group == ALL);
        let others = self.group_factors.iter().filter(|(group, _)| *group != ALL);
        all.chain(others).map(factor).collect::<Vec<_>>().join(", ")
    }
}

/// Describes the rules, and where their numbers come from.
fn rules(rules: &Rules, notes: &mut String) {
    let fitted = rules.fitted.as_ref();
    let source = |is_fitted: bool| match fitted {
        Some(fitted) if is_fitted => {
            format!("the best on {} of {}", counted(fitted.images, "picture"), fitted.fitted_to)
        }
        _ => "as given".to_owned(),
    };
    if let Some(factor) = rules.factor {
        let source = source(fitted.is_some_and(|fitted| fitted.factor == factor));
        let _ = writeln!(
            notes,
            "{}: linear light times a factor, {source}; the effect of brightness alone.",
            factor.row_name()
        );
    }
    if let Some(veil) = rules.veil {
        let source = source(fitted.is_some_and(|fitted| fitted.veil == veil));
        let _ = writeln!(
            notes,
            "{}: g (I - k b), g and k {source}; b is the 0.5 % percentile of each channel.",
            veil.row_name(),
        );
    }
}
