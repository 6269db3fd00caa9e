//! Resolves the paths of a scene line: absolute, relative to the manifest, under a named root, or in an object store.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// A path or a root that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RootError {
    #[error(
        "root {argument:?} is not NAME=DIR with a NAME of two or more characters of [A-Za-z0-9_-]: write --root \
         diode=/path/to/diode"
    )]
    Argument { argument: String },
    #[error("root {name} is given twice, as {} and as {}: keep one", first.display(), second.display())]
    Twice { name: String, first: PathBuf, second: PathBuf },
    #[error(
        "path {text:?} is under the unknown root {name}: pass --root {name}=DIR, or write \"./{text}\" if it is the \
         name of a file"
    )]
    Unknown { text: String, name: String },
    #[error(
        "path {text:?} leaves its root: below a named root write a relative path without \"..\""
    )]
    Leaves { text: String },
    #[error("path {text:?} is empty: write the path of a file")]
    Empty { text: String },
}

/// Named folders, ordered by name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Roots(BTreeMap<String, PathBuf>);

impl Roots {
    /// Parses the arguments `NAME=DIR`.
    pub fn parse<S: AsRef<str>>(arguments: &[S]) -> Result<Self, RootError> {
        let mut roots = Self::default();
        for argument in arguments.iter().map(AsRef::as_ref) {
            match argument.split_once('=') {
                Some((name, folder)) if is_root_name(name) && !folder.is_empty() => {
                    roots.insert(name, PathBuf::from(folder))?;
                }
                _ => {
                    return Err(RootError::Argument { argument: argument.to_owned() });
                }
            }
        }
        Ok(roots)
    }

    /// Adds `folder` under `name`. A repeated name with the same folder is not an error.
    pub fn insert(&mut self, name: &str, folder: PathBuf) -> Result<(), RootError> {
        if !is_root_name(name) {
            return Err(RootError::Argument { argument: format!("{name}={}", folder.display()) });
        }
        match self.0.get(name) {
            Some(first) if *first != folder => Err(RootError::Twice {
                name: name.to_owned(),
                first: first.clone(),
                second: folder,
            }),
            _ => {
                self.0.insert(name.to_owned(), folder);
                Ok(())
            }
        }
    }

    /// Sets the folder of the root `name`, and replaces a previous folder.
    pub fn replace(&mut self, name: &str, folder: PathBuf) {
        self.0.insert(name.to_owned(), folder);
    }

    /// Returns the folder of the root `name`; `None` for an unknown root.
    pub fn get(&self, name: &str) -> Option<&Path> {
        self.0.get(name).map(PathBuf::as_path)
    }

    /// Iterates over names and folders, ordered by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Path)> {
        self.0.iter().map(|(name, folder)| (name.as_str(), folder.as_path()))
    }

    /// Resolves `text`, a path of a scene line in a manifest of the folder `base`.
    ///
    /// `NAME:rest` is below the root NAME; if the root is a URL, the result is a URL. Absolute paths and URLs
    /// ([`is_url`]) stay unchanged, and other paths are relative to `base`. A single letter before a colon is not a
    /// root, so that Windows drives stay paths.
    pub fn resolve(&self, base: &Path, text: &str) -> Result<PathBuf, RootError> {
        let text_owned = || text.to_owned();
        match text.split_once(':') {
            _ if is_url(text) => Ok(PathBuf::from(text)),
            Some((name, rest)) if is_root_name(name) => {
                let root = self.get(name).ok_or_else(|| RootError::Unknown {
                    text: text_owned(),
                    name: name.to_owned(),
                })?;
                if rest.is_empty() {
                    return Err(RootError::Empty { text: text_owned() });
                }
                let stays = Path::new(rest)
                    .components()
                    .all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
                if stays {
                    Ok(root.join(rest))
                } else {
                    Err(RootError::Leaves { text: text_owned() })
                }
            }
            _ if text.is_empty() => Err(RootError::Empty { text: text_owned() }),
            _ => Ok(base.join(text)),
        }
    }
}

/// True if `text` is a URL of the form `SCHEME://REST`, such as `s3://BUCKET/KEY`, and not a local path.
pub fn is_url(text: impl AsRef<Path>) -> bool {
    let text = text.as_ref().to_str();
    let scheme = text.and_then(|text| text.split_once("://"));
    scheme.is_some_and(|(scheme, rest)| is_root_name(scheme) && !rest.is_empty())
}

/// True if `name` consists of two or more characters of `[A-Za-z0-9_-]`.
pub fn is_root_name(name: &str) -> bool {
    let allowed = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b == b'-';
    name.len() >= 2 && name.bytes().all(allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resolve(text: &str) -> Result<PathBuf, RootError> {
        Roots::parse(&["diode=/data/diode", "my-set=sets/a=b"])
            .unwrap()
            .resolve(Path::new("/runs/m"), text)
    }

    #[test]
    fn relative_absolute_and_rooted_paths_resolve() {
        for (text, path) in [
            ("a.png", "/runs/m/a.png"),
            ("../x/a.png", "/runs/m/../x/a.png"),
            ("/abs/a.png", "/abs/a.png"),
            ("./odd:name.png", "/runs/m/./odd:name.png"),
            ("C:a.png", "/runs/m/C:a.png"),
            ("diode:val/indoors/a.png", "/data/diode/val/indoors/a.png"),
            ("my-set:a.png", "sets/a=b/a.png"),
            ("s3://bucket/a.png", "s3://bucket/a.png"),
        ] {
            assert_eq!(resolve(text).unwrap(), Path::new(path), "{text}");
        }
    }

    #[test]
    fn paths_under_a_url_are_urls() {
        let roots = Roots::parse(&["diode=s3://bucket/diode"]).unwrap();
        let found = roots.resolve(Path::new("/runs/m"), "diode:val/a.png");
        assert_eq!(found.unwrap(), Path::new("s3://bucket/diode/val/a.png"));
        assert!(roots.resolve(Path::new("/x"), "diode:../a.png").is_err());
        assert!(is_url("s3://bucket") && is_url(Path::new("gs://bucket/x")));
        for path in ["/a/s3", "s3:/bucket", "s3://", "a.png", "C://x", "://x"] {
            assert!(!is_url(path), "{path}");
        }
    }

    #[test]
    fn no_path_leaves_its_root() {
        for text in ["diode:../a.png", "diode:a/../../b", "diode:/etc/passwd", "diode:"] {
            assert!(resolve(text).is_err(), "{text}");
        }
        assert!(resolve("").is_err());
    }

    #[test]
    fn the_error_of_an_unknown_root_names_the_flag() {
        let error = resolve("places:a.jpg").unwrap_err().to_string();
        assert!(error.contains("pass --root places=DIR"), "{error}");
    }

    #[test]
    fn bad_arguments_are_refused() {
        for argument in ["diode", "=x", "d=x", "a b=x", "diode=", "../x=y"] {
            let error = Roots::parse(&[argument]).unwrap_err();
            assert!(matches!(error, RootError::Argument { .. }), "{argument}");
        }
        assert!(Roots::parse(&["aa=x", "aa=x"]).is_ok());
        let twice = Roots::parse(&["aa=x", "aa=y"]).unwrap_err();
        assert!(matches!(twice, RootError::Twice { .. }));
    }
}
