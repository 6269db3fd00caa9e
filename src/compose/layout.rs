//! Meaning of file names in published layouts of pictures with ground truth.
//!
//! ```text
//! layer folders   blended/NAME.*  transmission_layer/NAME.*  reflection_layer/NAME.*  clean_reflection_layer/NAME.*
//! SIR2, folders   NAME/m.*  NAME/g.*  NAME/r.*               (mixed, ground truth, reflection)
//! SIR2, files     A-m-B.*   A-g-B.*   A-r-B.*                 also without -B
//! CEILNet         NAME-input.*  NAME-label1.*  NAME-label2.*
//! ```
//!
//! Endings are `.jpg`, `.jpeg`, `.jfif` or `.png` in any case, and may differ within a pair.

/// Role of a picture in its pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Blended,
    Transmission,
    Reflection,
    CleanReflection,
}

/// Naming scheme of a file; files of one pair share it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Layout {
    LayerFolders,
    Sir2Folders,
    Sir2Files,
    CeilNet,
}

/// Returns the role of all pictures in the layer folder `name`, or `None` if it is not the name of a layer folder.
pub(super) fn layer_folder(name: &str) -> Option<Role> {
    match name {
        "blended" => Some(Role::Blended),
        "transmission_layer" => Some(Role::Transmission),
        "reflection_layer" => Some(Role::Reflection),
        "clean_reflection_layer" => Some(Role::CleanReflection),
        _ => None,
    }
}

/// Strips the ending `.jpg`, `.jpeg`, `.jfif` or `.png` from a name; returns `None` for other endings.
pub fn picture_stem(name: &str) -> Option<&str> {
    let (stem, ending) = name.rsplit_once('.')?;
    let known = ["jpg", "jpeg", "jfif", "png"];
    known.iter().any(|k| ending.eq_ignore_ascii_case(k)).then_some(stem)
}

/// True if a file name has the ending of an unsupported picture format.
pub(super) fn is_other_picture(name: &str) -> bool {
    let others = ["bmp", "gif", "tif", "tiff", "webp", "ppm", "pgm", "exr", "hdr", "heic", "avif"];
    name.rsplit_once('.')
        .is_some_and(|(_, ending)| others.iter().any(|k| ending.eq_ignore_ascii_case(k)))
}

/// Returns layout, role and pair name of a picture outside layer folders, if known. An empty name means the folder's.
pub(super) fn recognise(stem: &str) -> Option<(Layout, Role, String)> {
    let letter = |letter: &str| match letter {
        "m" => Some(Role::Blended),
        "g" => Some(Role::Transmission),
        "r" => Some(Role::Reflection),
        _ => None,
    };
    if let Some(role) = letter(stem) {
        return Some((Layout::Sir2Folders, role, String::new()));
    }
    for (ending, role) in
        [("-input", Role::Blended), ("-label1", Role::Transmission), ("-label2", Role::Reflection)]
    {
        if let Some(name) = stem.strip_suffix(ending).filter(|name| !name.is_empty()) {
            return Some((Layout::CeilNet, role, name.to_owned()));
        }
    }
    // The last part that is a role's letter gives the role. The first part always belongs to the name.
    let parts: Vec<&str> = stem.split('-').collect();
    let (place, role) =
        (1..parts.len()).rev().find_map(|place| Some((place, letter(parts[place])?)))?;
    let name = [&parts[..place], &parts[place + 1..]].concat().join("-");
    Some((Layout::Sir2Files, role, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_determine_layout_and_role() {
        let found = |stem: &str| recognise(stem).unwrap();
        assert_eq!(found("g"), (Layout::Sir2Folders, Role::Transmission, String::new()));
        assert_eq!(found("7-m-11"), (Layout::Sir2Files, Role::Blended, "7-11".to_owned()));
        assert_eq!(found("a-r-m-3"), (Layout::Sir2Files, Role::Blended, "a-r-3".to_owned()));
        assert_eq!(found("12-r"), (Layout::Sir2Files, Role::Reflection, "12".to_owned()));
        assert_eq!(
            found("2007_1-label2"),
            (Layout::CeilNet, Role::Reflection, "2007_1".to_owned())
        );
        for stem in ["", "photo", "-input", "m-1", "a-mm-b"] {
            assert_eq!(recognise(stem), None, "{stem}");
        }
        assert_eq!(picture_stem("a.b.JPeG"), Some("a.b"));
        assert_eq!(picture_stem("png"), None);
        assert!(is_other_picture("a.TIF") && !is_other_picture("index.csv"));
    }
}
