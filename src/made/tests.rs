use super::*;
use std::time::{Duration, SystemTime};

/// Writes a file in place.
fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    let mut file = std::fs::File::create(path).unwrap();
    std::io::Write::write_all(&mut file, text.as_bytes()).unwrap();
}

fn made(of: &[(&str, &str)], files: &[(&str, &str)]) -> Made {
    let digests = |list: &[(&str, &str)]| -> BTreeMap<String, String> {
        list.iter().map(|(name, text)| ((*name).to_owned(), digest(text.as_bytes()))).collect()
    };
    Made { of: digests(of), files: digests(files) }
}

#[test]
fn files_that_changed_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let (inputs, results) = (Files::inputs(root), Files::results(root));
    for (name, text) in [("a", "one"), ("b", "two"), ("x", "three"), ("y", "four")] {
        write(root, name, text);
    }
    let of = made(&[("a", "one"), ("b", "two")], &[("x", "three"), ("y", "four")]);
    let digests = Digests::open(root, false);
    assert_eq!(digests.differences(&of, &inputs, &results).unwrap(), []);
    write(root, "a", "ONE");
    std::fs::remove_file(root.join("b")).unwrap();
    write(root, "x", "");
    std::fs::remove_file(root.join("y")).unwrap();
    std::fs::create_dir(root.join("y")).unwrap();
    let found = digests.differences(&of, &inputs, &results).unwrap();
    let name = |name: &str| name.to_owned();
    assert_eq!(
        found,
        [
            Difference::Input(name("a")),
            Difference::InputGone(name("b")),
            Difference::File(name("x")),
            // A folder in the place of a file.
            Difference::FileGone(name("y")),
        ]
    );
    let mut remade = Remade::default();
    assert!(remade.is_none());
    remade.add(2, &found);
    assert_eq!(
        remade.to_string(),
        "2 made again, because a changed since, b is missing, x is damaged or of another program, and 1 more"
    );
}

/// A file is read again if any part of its stamp changed, and always when the call verifies; what was remembered too early is not
/// believed.
#[test]
fn digests_are_remembered_as_long_as_stamps_stay() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let files = Files::inputs(root);
    write(root, "a", "one");
    let digests = Digests::open(root, false);
    let stamp = files.stamp("a").unwrap().unwrap();
    // A wrong digest shows whether the file is read.
    digests.remember(&files, "a", Some(stamp.clone()), "remembered");
    assert_eq!(digests.of(&files, "a").unwrap().unwrap(), "remembered");
    digests.write(root).unwrap();
    let again = Digests::open(root, false);
    assert_eq!(again.of(&files, "a").unwrap().unwrap(), digest(b"one"), "the file is too new");

    std::thread::sleep(Duration::from_millis(120));
    digests.remember(&files, "a", Some(stamp), "remembered");
    digests.write(root).unwrap();
    let remembered = |verify| Digests::open(root, verify).of(&files, "a").unwrap().unwrap();
    assert_eq!(remembered(false), "remembered");
    assert_eq!(remembered(true), digest(b"one"));

    // Other bytes of the same size, with the time of modification set back.
    let modified = root.join("a").metadata().unwrap().modified().unwrap();
    write(root, "a", "two");
    let file = std::fs::File::options().append(true).open(root.join("a")).unwrap();
    file.set_modified(modified).unwrap();
    assert_eq!(remembered(false), digest(b"two"));

    // A damaged memory is no error.
    write(root, DIGESTS_FILE, "{");
    assert_eq!(remembered(false), digest(b"two"));
    assert!(SystemTime::now() > modified);
}
