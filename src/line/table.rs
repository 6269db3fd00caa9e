//! Tables of keys in Markdown, for manifests/README.md and docs/formats.md.

use super::keys::Row;
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
        let mut limits: Vec<&str> = row.key.limits.iter().map(|limit| limit.allowed).collect();
        limits.dedup();
        let limits = limits.join("; ");
        let unit = row.key.limits.first().map_or("", |limit| limit.unit);
        // The unit has a column of its own.
        let allowed = limits.strip_suffix(unit).unwrap_or(&limits).trim();
        let default = match default {
            Some(default) => format!("`{default}`"),
            None if row.key.is_optional => "none".to_owned(),
            None => "required".to_owned(),
        };
        let (path, text) = (&row.path, row.key.text);
        table.extend([
            "| `", path, "` | ", unit, " | ", &default, " | ", allowed, " | ", text, " |\n",
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
    use super::super::keys::declared_rows;
    use super::*;
    use expect_test::expect_file;

    #[test]
    fn generated_tables_of_keys() {
        for (path, of) in
            [("manifests/README.md", KeysOf::Recipes), ("docs/formats.md", KeysOf::Lines)]
        {
            let path = format!("{}/../../{path}", env!("CARGO_MANIFEST_DIR"));
            let document = std::fs::read_to_string(&path).unwrap();
            let made = with_table(
                &document,
                "keys of film, camera and glass",
                &key_table(&declared_rows(), of),
            );
            expect_file![path].assert_eq(&made.unwrap());
        }
    }
}
