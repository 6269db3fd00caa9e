//! Checks `[cover]` of a recipe before any scene is drawn.

use super::cover::CoverRecipe;
use super::recipe_check::bad;
use super::recipe_error::RecipeError;
use glasshouse_line::param::Param;

impl CoverRecipe {
    /// Checks shares, numbers of pictures and edges. The table of limits covers the other numbers.
    pub(super) fn check(&self) -> Result<(), RecipeError> {
        if !(1..=10_000).contains(&self.pictures) {
            let problem = format!("is {}, but must be 1 to 10000", self.pictures);
            return bad("cover.pictures", problem);
        }
        let person = self.photographer.iter().map(|one| ("photographer", one.share));
        let screens = self.screens().map(|(kind, screen)| (kind.name(), screen.share));
        let frame = self.frame.iter().map(|one| ("frame", one.share));
        for (name, share) in person.chain(screens).chain(frame) {
            if !(share > 0.0 && share <= 1.0) {
                return bad(
                    &format!("cover.{name}"),
                    format!(
                        "has the share {share}, but the share of scenes must be above 0 and at most 1; leave the key out for none"
                    ),
                );
            }
        }
        if let Some(frame) = &self.frame {
            for (key, [low, high]) in [("view_x", &frame.view_x), ("view_y", &frame.view_y)] {
                check_edges(&format!("cover.frame.{key}"), low, high)?;
            }
        }
        Ok(())
    }
}

/// Checks that the first of two edges is always before the second.
pub(super) fn check_edges(key: &str, low: &Param, high: &Param) -> Result<(), RecipeError> {
    if [low, high].contains(&&Param::FromSource) {
        // The edges of each photograph are checked with its scene line.
        return Ok(());
    }
    let (least, most) = (high.bounds().0, low.bounds().1);
    if most < least {
        return Ok(());
    }
    bad(
        key,
        format!(
            "can begin at {most} and end at {least}, but must begin before it ends: separate the ranges of its two numbers"
        ),
    )
}
