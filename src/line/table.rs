//! Tables of keys in Markdown, for manifests/README.md and docs/formats.md.

use super::keys::Row;
use super::limits::Limit;
use std::collections::BTreeSet;

/// Which keys a table has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeysOf {
    Lines,
    Recipes,
}

/// Returns the table of `rows`.
pub fn key_table(rows: &[Row], of: KeysOf) -> String {
    let mut table =
        "| key | unit | default | allowed | meaning |\n|---|---|---|---|---|\n".to_owned();
    let mut seen = BTreeSet::new();
    for row in rows {
        let (has, default) = match of {
            KeysOf::Lines => (row.in_lines, row.key.default),
            KeysOf::Recipes => (row.in_recipes, row.key.recipe_default),
        };
        // Several forms of a section may share a key.
        if !has || !seen.insert(&row.path) {
            continue;
        }
        let unit = row.key.limits.first().map_or("", |limit| limit.unit);
        // The unit has a column of its own.
        let words =
            |limit: &Limit| limit.allowed.strip_suffix(unit).unwrap_or(limit.allowed).trim();
        let mut limits: Vec<&str> = row.key.limits.iter().map(words).collect();
        limits.dedup();
        let allowed = limits.join("; ");
        let default = match default {
            Some(default) => format!("`{default}`"),
            None if row.key.is_optional => "none".to_owned(),
            None => "required".to_owned(),
        };
        let (path, text) = (&row.path, row.key.text);
        table.extend([
            "| `", path, "` | ", unit, " | ", &default, " | ", &allowed, " | ", text, " |\n",
        ]);
    }
    table
}

/// Returns `document` with `table` between the lines `<!-- NAME -->` and `<!-- end of NAME -->`.
///
/// # Errors
///
/// A document without these lines, in words.
pub fn with_table(document: &str, name: &str, table: &str) -> Result<String, String> {
    let [begin, end] = [format!("<!-- {name} -->\n"), format!("<!-- end of {name} -->\n")];
    let parts = document.split_once(&begin).and_then(|(before, rest)| {
        let (_, after) = rest.split_once(&end)?;
        Some((before, after))
    });
    let (before, after) =
        parts.ok_or_else(|| format!("no lines {} and {}", begin.trim(), end.trim()))?;
    Ok(format!("{before}{begin}{table}{end}{after}"))
}

#[cfg(test)]
mod tests {
    use super::super::keys::{At, Keys, declared_rows};
    use super::super::{Card, MeshFile, PanoramaFile, Photograph};
    use super::*;
    use expect_test::expect_file;

    /// The rows below one of the sections.
    fn below(sections: &[&str]) -> Vec<Row> {
        let is_below = |row: &Row| {
            let is = |at: &&str| row.path == **at || row.path.starts_with(&format!("{at}."));
            sections.iter().any(is)
        };
        declared_rows().into_iter().filter(is_below).collect()
    }

    /// The rows of a side or of a part of it, without those of its cards.
    fn of<T: Keys>() -> Vec<Row> {
        let mut rows = vec![];
        T::rows(&At::section(""), &mut rows);
        rows.retain(|row| !row.path.starts_with("cards."));
        rows
    }

    #[test]
    fn generated_tables_of_keys() {
        use KeysOf::{Lines, Recipes};
        let scene = ["schema", "id", "split", "seed", "film", "camera", "glass"];
        let (recipes, formats) = ("manifests/README.md", "docs/formats.md");
        for (path, name, rows, kind) in [
            (recipes, "keys of film, camera and glass", below(&scene[4..]), Recipes),
            (formats, "keys of a scene", below(&scene), Lines),
            (formats, "keys of a photograph", of::<Photograph>(), Lines),
            (formats, "keys of a panorama", of::<PanoramaFile>(), Lines),
            (formats, "keys of a mesh", of::<MeshFile>(), Lines),
            (formats, "keys of a card", of::<Card>(), Lines),
            (formats, "keys of sensor", below(&["sensor"]), Lines),
        ] {
            let path = format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR"));
            let document = std::fs::read_to_string(&path).unwrap();
            let made = with_table(&document, name, &key_table(&rows, kind)).unwrap();
            expect_file![path].assert_eq(&made);
        }
    }
}
