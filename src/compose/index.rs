//! Real pairs that a CSV file lists, with their groups.

use super::EvaluateError;
use super::pairs::Pair;
use super::subject::{LeftOut, Subject, Unread, WithTruth};
use super::summary::ALL;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A row of the file; other columns are ignored. Paths start from the file's folder.
#[derive(Deserialize)]
struct Line {
    id: String,
    group: String,
    /// `real` for photographs.
    kind: String,
    blended: PathBuf,
    transmission: PathBuf,
    /// `yes` if the pair's shift is small.
    aligned: String,
}

/// The pairs of an index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IndexedPairs {
    /// Pairs and their groups, in the order of the file.
    pairs: Vec<(Pair, String)>,
}

impl IndexedPairs {
    pub fn truncate(&mut self, count: usize) {
        self.pairs.truncate(count);
    }
}

/// Reads an index with the columns `id`, `group`, `kind`, `blended`, `transmission` and `aligned`. Relative paths start
/// from `root`. Selects the rows that are real and aligned, and lists the others with reasons.
pub fn read_index(path: &Path, root: &Path) -> Result<(IndexedPairs, Vec<LeftOut>), EvaluateError> {
    let bytes = render::input_file::read(path)
        .map_err(|source| EvaluateError::Read { path: path.to_owned(), source })?;
    let failed = |reason: String| EvaluateError::Index { path: path.to_owned(), reason };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(&bytes[..]);
    let (mut indexed, mut left_out) = (IndexedPairs::default(), Vec::new());
    let mut ids = BTreeSet::new();
    for line in reader.deserialize() {
        let line: Line = line.map_err(|error| failed(error.to_string()))?;
        if !ids.insert(line.id.clone()) {
            return Err(failed(format!("two rows have the id {:?}; rename one", line.id)));
        }
        if line.group == ALL {
            return Err(failed(format!(
                "the group of {:?} is {ALL:?}, which is the name for all rows; rename it",
                line.id
            )));
        }
        let reason = if line.kind != "real" {
            format!("its kind is {:?}, not \"real\"", line.kind)
        } else if line.aligned != "yes" {
            "it is not aligned".to_owned()
        } else if line.blended.as_os_str().is_empty() {
            "it has no blended picture".to_owned()
        } else if line.transmission.as_os_str().is_empty() {
            "it has no transmission, which is its truth".to_owned()
        } else {
            let pair = Pair {
                name: line.id,
                blended: root.join(line.blended),
                transmission: root.join(line.transmission),
                reflection: None,
                clean_reflection: None,
            };
            indexed.pairs.push((pair, line.group));
            continue;
        };
        left_out.push(LeftOut { image: line.id, reason, is_damaged: false });
    }
    if indexed.pairs.is_empty() {
        return Err(failed(format!(
            "none of its {} rows is real and aligned and has both pictures",
            left_out.len()
        )));
    }
    Ok((indexed, left_out))
}

impl Subject for IndexedPairs {
    fn count(&self) -> usize {
        self.pairs.len()
    }

    fn name(&self, index: usize) -> String {
        self.pairs[index].0.name.clone()
    }

    fn group(&self, index: usize) -> Option<String> {
        let group = &self.pairs[index].1;
        (!group.is_empty()).then(|| group.clone())
    }

    fn file_stem(&self, index: usize) -> String {
        self.pairs[index].0.file_stem()
    }

    fn read(&self, index: usize) -> Result<WithTruth, Unread> {
        self.pairs[index].0.read()
    }

    /// The index states which pairs are aligned.
    fn is_aligned(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<(IndexedPairs, Vec<LeftOut>), EvaluateError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("index.csv");
        render::atomic_file::write(&path, text.as_bytes()).unwrap();
        read_index(&path, Path::new("data"))
    }

    const HEAD: &str = "id,group,kind,blended,transmission,reflection,aligned\n";

    #[test]
    fn real_aligned_rows_are_selected() {
        let (indexed, left_out) = read(&format!(
            "{HEAD}a,g,real,b/1.jpg,t/1.jpg,,yes\r\n\
             b,g,synthetic,b/2.jpg,t/2.jpg,,yes\n\
             c,\"h, 2\",real,\"b/3,4.png\",/t/3.png,r,yes\n\
             d,,real,b/5.jpg,t/5.jpg,,no\n\
             e,,real,b/6.jpg,,,yes\n"
        ))
        .unwrap();
        let found: Vec<(String, Option<String>, String)> = (0..indexed.count())
            .map(|k| (indexed.name(k), indexed.group(k), indexed.file_stem(k)))
            .collect();
        let row = |id: &str, group: &str, stem: &str| {
            (id.to_owned(), Some(group.to_owned()), stem.to_owned())
        };
        assert_eq!(found, [row("a", "g", "1"), row("c", "h, 2", "3,4")]);
        assert_eq!(indexed.pairs[0].0.blended, Path::new("data/b/1.jpg"));
        assert_eq!(indexed.pairs[1].0.transmission, Path::new("/t/3.png"));
        let reasons: Vec<&str> = left_out.iter().map(|l| l.reason.as_str()).collect();
        assert!(reasons[0].contains("\"synthetic\""), "{reasons:?}");
        assert!(reasons[1].contains("aligned") && reasons[2].contains("no transmission"));
    }

    #[test]
    fn unusable_indices_are_refused() {
        for (text, words) in [
            ("id,group\na,b\n", "missing field"),
            (&format!("{HEAD}a,g,real,b,t,,yes\na,g,real,b,t,,yes\n"), "two rows have the id"),
            (&format!("{HEAD}a,all,real,b,t,,yes\n"), "rename it"),
            (&format!("{HEAD}a,g,real,b,t,,no\n"), "none of its 1 rows"),
            (&format!("{HEAD}a,g\n"), "line: 2"),
            ("", "none of its 0 rows"),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(error.contains(words) && error.contains("index.csv"), "{error}");
        }
        let error = read_index(Path::new("no/index.csv"), Path::new("no")).unwrap_err();
        assert!(matches!(error, EvaluateError::Read { .. }), "{error}");
    }
}
