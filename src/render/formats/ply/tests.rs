use super::*;
use crate::scene::decode_mesh;
use glasshouse_line::MeshFile;
use std::path::PathBuf;

/// Returns a file with a quad, a triangle, a face of two corners and extra elements of other programs, in any coding.
fn file(coding: &str, colour: &str) -> NamedBytes {
    let mut bytes = format!(
        "ply\r\nformat {coding} 1.0\ncomment made by hand\nobj_info nothing\nelement camera 1\nproperty list uchar \
         short settings\nelement vertex 5\nproperty float x\nproperty double nx\nproperty double y\nproperty float \
         z\nproperty {colour} red\nproperty {colour} green\nproperty {colour} blue\nproperty uchar alpha\nelement face \
         3\nproperty char flags\nproperty list uchar uint vertex_indices\nproperty float area\nelement edge \
         0\nproperty int vertex1\nend_header\n"
    )
    .into_bytes();
    let mut put = |kind: &str, value: f64| {
        let value = match kind {
            "float" | "double" => value,
            _ => value.round(),
        };
        let raw = match kind {
            "uchar" | "char" => vec![value as i16 as u8],
            "short" | "ushort" => (value as i32 as u16).to_le_bytes().to_vec(),
            "uint" => (value as u32).to_le_bytes().to_vec(),
            "float" => (value as f32).to_le_bytes().to_vec(),
            _ => value.to_le_bytes().to_vec(),
        };
        match coding {
            "ascii" => bytes.extend(format!("{value} ").bytes()),
            "binary_little_endian" => bytes.extend(raw),
            _ => bytes.extend(raw.into_iter().rev()),
        }
    };
    for (kind, value) in [("uchar", 2.0), ("short", -300.0), ("short", 7.0)] {
        put(kind, value);
    }
    let scale = match colour {
        "uchar" => 255.0,
        "ushort" => 65535.0,
        _ => 1.0,
    };
    for k in 0..5 {
        let k = f64::from(k);
        for (kind, value) in [
            ("float", k - 2.0),
            ("double", 9.0),
            ("double", k * 0.1),
            ("float", 3.0),
            (colour, 0.2 * scale),
            (colour, k * 0.2 * scale),
            (colour, scale),
            ("uchar", 255.0),
        ] {
            put(kind, value);
        }
    }
    for corners in [&[0.0, 1.0, 2.0, 3.0][..], &[2.0, 3.0, 4.0], &[1.0, 2.0]] {
        put("char", -1.0);
        put("uchar", corners.len() as f64);
        for &corner in corners {
            put("uint", corner);
        }
        put("float", 0.5);
    }
    NamedBytes { path: PathBuf::from("a.ply"), bytes }
}

const CODINGS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

fn mesh_line(json: &str) -> MeshFile {
    let glasshouse_line::Side::Mesh(line) = serde_json::from_str(json).unwrap() else {
        panic!("a photograph")
    };
    line
}

#[test]
fn every_coding_gives_the_same_mesh() {
    for coding in CODINGS {
        for colour in ["uchar", "ushort", "float", "double"] {
            let ply = decode(&file(coding, colour)).unwrap_or_else(|e| panic!("{coding}: {e}"));
            assert_eq!(ply.triangles, [[0, 1, 2], [0, 2, 3], [2, 3, 4]]);
            assert_eq!(ply.empty_faces, 1);
            assert_eq!(ply.vertices.len(), 5);
            assert_eq!(ply.vertices[4], DVec3::new(2.0, 0.4, 3.0));
            for (k, color) in ply.colors.iter().enumerate() {
                for (value, expected) in color.iter().zip([0.2, k as f64 * 0.2, 1.0]) {
                    assert!((value - expected).abs() < 1e-6, "{coding} {colour}");
                }
            }
        }
    }
    // ASCII numbers may be on any number of lines.
    let mut lines = file("ascii", "uchar");
    lines.bytes =
        String::from_utf8(lines.bytes).unwrap().replace("3 51 ", "3\r\n51\t").into_bytes();
    assert_eq!(decode(&lines).unwrap().vertices.len(), 5);
}

#[test]
fn the_line_sets_pose_unit_and_exposure_of_a_mesh() {
    let file = file("binary_little_endian", "uchar");
    let line = mesh_line(
        r#"{"mesh":"a.ply","unit_m":0.5,"exposure":2,"pose":{"rotation":[[0,0,1],[0,1,0],[-1,0,0]],
            "translation_m":[10,20,30]}}"#,
    );
    let mesh = decode_mesh(&line, &file).unwrap();
    // (2, 0.4, 3) halved is (1, 0.2, 1.5); the rotation takes z to x and x to -z.
    assert_eq!(mesh.vertices_m[4], DVec3::new(11.5, 20.2, 29.0));
    // The expected value is twice the linear value of the sRGB code 51.
    assert!((mesh.radiance[0][0] - 2.0 * 0.033_104_77).abs() < 1e-6);
    assert_eq!(mesh.radiance[0][2..], [2.0, 0.0]);
    assert_eq!(mesh.max_radiance, 2.0);
    let linear = decode_mesh(&mesh_line(r#"{"mesh":"a.ply","transfer":"linear"}"#), &file).unwrap();
    assert_eq!(linear.radiance[0][0], 0.2);
}

#[test]
fn errors_name_the_element_and_the_remedy() {
    let text = |from: &str, to: &str| {
        let mut file = file("ascii", "float");
        let old = String::from_utf8(file.bytes).unwrap();
        let new = old.replacen(from, to, 1);
        assert_ne!(old, new, "{from}");
        file.bytes = new.into_bytes();
        file
    };
    for (from, to, words) in [
        ("ply\r\n", "plt\r\n", vec!["no known format", "give a PLY mesh"]),
        ("format ascii 1.0", "format ascii 2.0", vec!["format ascii 2.0 is unknown"]),
        ("property float z", "property float w", vec!["vertices without z", "give a PLY mesh"]),
        ("float red", "float r", vec!["vertices without red"]),
        ("property float z", "property int z", vec!["z not as float"]),
        ("vertex_indices", "vertices", vec!["faces without a list vertex_indices"]),
        ("uint vertex", "float vertex", vec!["faces without a list vertex_indices"]),
        ("list uchar uint", "list float uint", vec!["count of floating-point type"]),
        ("property float z", "property float x", vec!["element vertex has x twice"]),
        ("element edge", "element face", vec!["element face twice"]),
        ("element vertex 5", "element vertex 500", vec!["announces at least", "fetch it again"]),
        ("element vertex 5", "element vertex 99999999999", vec!["at most 16777216", "simplify"]),
        ("element vertex 5", "element vertex -1", vec!["count \"-1\""]),
        (
            "element vertex 5",
            "element vertex 6",
            vec!["invalid number in vertex 5 of 6", "write or fetch"],
        ),
        ("element face 3", "element face 4", vec!["invalid number in face 3 of 4"]),
        ("element face 3", "element face 2", vec!["follow the last element"]),
        ("element face 3", "element fac 3", vec!["no vertices or no faces"]),
        ("end_header", "end_head", vec!["\"end_head\" is invalid"]),
        ("9 0 3 ", "9 nan 3 ", vec!["vertex 0", "has NaN as y", "repair the file"]),
        ("9 0 3 ", "9 1e999 3 ", vec!["vertex 0", "has inf as y"]),
        ("9 0 3 ", "9 zero 3 ", vec!["invalid number in vertex 0 of 5"]),
        ("3 2 3 4 ", "3 2 3 5 ", vec!["triangle 2", "refers to vertex 5, but the file has 5"]),
        ("3 2 3 4 ", "3 2 -3 4 ", vec!["invalid number in face 1 of 3"]),
    ] {
        let error = decode(&text(from, to)).unwrap_err().to_string();
        assert!(error.contains("a.ply"), "{error}");
        for word in words {
            assert!(error.contains(word), "{to}: no {word:?} in {error}");
        }
    }
    let dark = text("0.2 0 1 ", "-0.2 0 1 ");
    let line = mesh_line(r#"{"mesh":"a.ply","transfer":"linear"}"#);
    let error = decode_mesh(&line, &dark).unwrap_err().to_string();
    assert!(error.contains("vertex 0 has the radiance"), "{error}");
    let line = mesh_line(r#"{"mesh":"a.ply","unit_m":1e8}"#);
    let error = decode_mesh(&line, &file("ascii", "uchar")).unwrap_err();
    assert!(error.to_string().contains("check unit_m"), "{error}");
    let png = NamedBytes { path: PathBuf::from("a.png"), bytes: b"\x89PNG\r\n".to_vec() };
    let error = decode(&png).unwrap_err().to_string();
    assert!(error.starts_with("a.png is a PNG file; give a PLY mesh"), "{error}");
}

/// A file that is cut anywhere, or has any byte changed, gives an error or a mesh, never a panic.
#[test]
fn hostile_bytes_do_no_harm() {
    let line = mesh_line(r#"{"mesh":"a.ply"}"#);
    let mut refused = 0;
    for coding in CODINGS {
        let whole = file(coding, "uchar");
        for length in 0..whole.bytes.len() {
            let cut =
                NamedBytes { path: whole.path.clone(), bytes: whole.bytes[..length].to_vec() };
            let is_refused = decode(&cut).is_err();
            // An ASCII file is also valid without its last space, and with fewer digits in its last number.
            assert!(is_refused || coding == "ascii" && length + 3 >= whole.bytes.len());
            refused += u32::from(is_refused);
        }
        for at in 0..whole.bytes.len() {
            for value in [0, 0x0a, b' ', b'9', 0x7f, 0x80, 0xff, whole.bytes[at] ^ 1] {
                let mut spoiled = whole.clone();
                spoiled.bytes[at] = value;
                refused += u32::from(decode_mesh(&line, &spoiled).is_err());
            }
        }
    }
    assert!(refused > 1000);
    // These counts would exhaust memory or time.
    for header in [
        "element vertex 16777216\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty \
         uchar green\nproperty uchar blue\n",
        "element vertex 18446744073709551615\nproperty float x\n",
        "element nothing 18446744073709551615\n",
        "element much 9223372036854775807\nproperty list uint double items\n",
    ] {
        for coding in CODINGS {
            let bytes =
                format!("ply\nformat {coding} 1.0\n{header}end_header\n\u{ff}\u{ff}\u{ff}\u{ff}");
            let file = NamedBytes { path: PathBuf::from("a.ply"), bytes: bytes.into_bytes() };
            assert!(decode(&file).is_err());
        }
    }
}
