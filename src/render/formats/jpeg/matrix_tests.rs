//! Compares decoded pictures with `djpeg`: sampling x scans x restarts x sizes. The files are made by `cjpeg`.

#![allow(clippy::print_stdout, reason = "prints counts and skipped tests")]
#![allow(
    clippy::disallowed_methods,
    reason = "writes inputs of other programs into a temporary folder"
)]

use super::*;
use crate::formats::files::{FileFormat, NamedBytes};
use crate::formats::raster::{self, Samples};
use std::path::Path;
use std::process::Command;

/// Limits of the difference to `djpeg -strict`, 8-bit codes: mean of the picture, and worst sample.
const MEAN: f64 = 1.0;
const WORST: u8 = 6;

/// Sampling factors of Y, Cb and Cr.
const SAMPLINGS: [&str; 20] = [
    "1x1,1x1,1x1",
    "2x1,1x1,1x1",
    "1x2,1x1,1x1",
    "2x2,1x1,1x1",
    "4x1,1x1,1x1",
    "4x1,2x1,1x1",
    "2x4,1x1,1x1",
    "3x1,1x1,1x1",
    "1x3,1x1,1x1",
    "2x1,2x1,2x1",
    "2x2,2x1,1x2",
    "2x2,1x2,1x2",
    "2x1,2x1,1x1",
    "1x1,2x1,2x1",
    "1x1,1x2,1x2",
    "1x1,2x2,2x2",
    "1x2,2x1,1x1",
    "1x1,2x1,1x1",
    "2x1,4x1,1x1",
    "1x4,1x2,1x1",
];

/// Those with a factor between 1 and the largest.
const BETWEEN: [&str; 3] = ["4x1,2x1,1x1", "2x1,4x1,1x1", "1x4,1x2,1x1"];

/// Scripts of scans; empty for one scan, `progressive` for the usual script of progressive files.
const SCANS: [&str; 11] = [
    "",
    "0;1;2;",
    "0;2;1;",
    "0;1,2;",
    "0,1;2;",
    "1;2;0;",
    "1,2;0;",
    "1;0,2;",
    "progressive",
    "1:0-0,0,0;2:0-0,0,0;0:0-0,0,0;0:1-63,0,0;1:1-63,0,0;2:1-63,0,0;",
    "0,1,2:0-0,0,1;1:1-63,0,1;2:1-63,0,0;0:1-5,0,2;0:6-63,0,2;0:1-63,2,1;0:1-63,1,0;1:1-63,1,0;0,1,2:0-0,1,0;",
];

/// Restart intervals: MCUs with `B`, or rows of MCUs.
const RESTARTS: [&str; 3] = ["", "1", "3B"];

const SIZES: [[usize; 2]; 3] = [[16, 16], [97, 65], [8, 200]];

fn picture([width, height]: [usize; 2]) -> Vec<u8> {
    let mut ppm = format!("P6\n{width} {height}\n255\n").into_bytes();
    let mut noise = 1u32;
    for y in 0..height {
        for x in 0..width {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let wave = (x as f64 / 7.0).sin() * (y as f64 / 9.0).cos();
            let base =
                [40 + 160 * x / width, 30 + 190 * y / height, (120.0 + 80.0 * wave) as usize];
            ppm.extend(base.map(|v| v as u8 + (noise >> 29) as u8));
        }
    }
    ppm
}

fn run(program: &str, arguments: &[&str], folder: &Path) -> Option<Vec<u8>> {
    let output = Command::new(program).args(arguments).current_dir(folder).output().ok()?;
    output.status.success().then_some(output.stdout)
}

/// Returns the samples of a P5 or P6 file.
fn samples(pnm: Vec<u8>) -> Vec<u8> {
    let file = NamedBytes { path: "reference.ppm".into(), bytes: pnm };
    match raster::decode(&file, FileFormat::Pnm).unwrap().samples {
        Samples::U8(samples) => samples,
        other => panic!("{other:?}"),
    }
}

fn decoded(bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    let file = NamedBytes { path: "a.jpg".into(), bytes };
    match raster::decode(&file, FileFormat::Jpeg).map_err(|e| e.to_string())?.samples {
        Samples::U8(samples) => Ok(samples),
        other => panic!("{other:?}"),
    }
}

/// Returns an error text if the file differs from `djpeg`.
fn compare(folder: &Path, name: &str) -> Result<(), String> {
    let expected = samples(run("djpeg", &["-strict", name], folder).ok_or("djpeg refuses it")?);
    let found = decoded(std::fs::read(folder.join(name)).unwrap())?;
    assert_eq!(found.len(), expected.len());
    let steps: Vec<u8> = found.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = steps.iter().map(|s| f64::from(*s)).sum::<f64>() / steps.len() as f64;
    let worst = steps.iter().copied().max().unwrap_or(0);
    if mean <= MEAN && worst <= WORST { Ok(()) } else { Err(format!("mean {mean}, worst {worst}")) }
}

/// Files that `djpeg -strict` reads are decoded to the same pixels but for the rounding of both decoders, or refused by
/// name: only several scans of [`BETWEEN`].
#[test]
fn sampling_scans_restarts_and_sizes_are_decoded_as_by_djpeg() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    std::fs::write(folder.join("a.ppm"), picture([16, 16])).unwrap();
    if run("cjpeg", &["-outfile", "a.jpg", "a.ppm"], folder).is_none() {
        println!("skipped: cjpeg and djpeg are needed (libjpeg-turbo)");
        return;
    }
    let (mut decoded, mut rare, mut refused, mut faults) = (0, 0, 0, Vec::new());
    for size in SIZES {
        std::fs::write(folder.join("a.ppm"), picture(size)).unwrap();
        for (k, scans) in SCANS.iter().enumerate() {
            std::fs::write(folder.join("scans"), scans.replace(';', ";\n")).unwrap();
            for (sampling, restart) in
                SAMPLINGS.iter().flat_map(|s| RESTARTS.iter().map(move |r| (*s, *r)))
            {
                let mut arguments = vec!["-quality", "90", "-sample", sampling];
                match *scans {
                    "" => {}
                    "progressive" => arguments.push("-progressive"),
                    _ => arguments.extend(["-scans", "scans"]),
                }
                if !restart.is_empty() {
                    arguments.extend(["-restart", restart]);
                }
                arguments.extend(["-outfile", "a.jpg", "a.ppm"]);
                run("cjpeg", &arguments, folder).unwrap();
                let kind = Head::find(&std::fs::read(folder.join("a.jpg")).unwrap()).kind();
                let is_named = |fault: &str| fault.contains("JPEG") && !fault.contains("again");
                match compare(folder, "a.jpg") {
                    Ok(()) => (decoded, rare) = (decoded + 1, rare + i32::from(kind == Kind::Rare)),
                    Err(fault) if BETWEEN.contains(&sampling) && is_named(&fault) => refused += 1,
                    Err(fault) => {
                        faults.push(format!("{sampling} scans {k}, {restart} {size:?}: {fault}"));
                    }
                }
            }
        }
    }
    println!(
        "{decoded} files are decoded, {rare} of them by the second decoder; {refused} are refused"
    );
    assert!(faults.is_empty(), "{}: {:#?}", faults.len(), &faults[..faults.len().min(9)]);
    // All scripts but that of one scan.
    assert_eq!(refused, BETWEEN.len() * (SCANS.len() - 1) * RESTARTS.len() * SIZES.len());
    let all = SIZES.len() * SCANS.len() * SAMPLINGS.len() * RESTARTS.len();
    assert_eq!(decoded + refused, all);
}

/// A sound file that no decoder here reads is refused by name, and the named command makes one that is read.
#[test]
fn other_kinds_are_refused_by_name_and_jpegtran_mends_them() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/formats/jpeg");
    for name in ["cmyk", "halved", "progressive"] {
        let file = format!("{name}.jpg");
        std::fs::copy(tests.join(&file), folder.join(&file)).unwrap();
    }
    std::fs::write(folder.join("scans"), "1;\n0;\n2;\n3;\n").unwrap();
    let cases: [(&str, &[&str], &str); 3] = [
        ("halved", &["-arithmetic"], "a JPEG with arithmetic coding"),
        ("progressive", &["-progressive", "-arithmetic"], "a JPEG with arithmetic coding"),
        ("cmyk", &["-scans", "scans"], "a JPEG in several scans"),
    ];
    for (name, change, words) in cases {
        let whole = format!("{name}.jpg");
        let arguments: Vec<&str> = [change, &["-outfile", "OLD.jpg", &whole]].concat();
        if run("jpegtran", &arguments, folder).is_none() {
            println!("skipped: jpegtran with arithmetic coding is needed (libjpeg-turbo)");
            return;
        }
        let read = |file: &str| decoded(std::fs::read(folder.join(file)).unwrap());
        let error = read("OLD.jpg").unwrap_err();
        assert!(error.contains(words) && !error.contains("again"), "{error}");
        let command = error.split('`').nth(1).unwrap();
        let mut parts = command.split(' ');
        let program = parts.next().unwrap();
        assert!(run(program, &parts.collect::<Vec<_>>(), folder).is_some(), "{command}");
        assert_eq!(read("NEW.jpg"), read(&whole), "{name}");
    }
}

/// Frames of kinds that `cjpeg` cannot write, from the frame of a sound file with other numbers.
#[test]
fn frames_of_other_kinds_are_named() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/formats/jpeg/baseline.jpg");
    let jpeg = std::fs::read(path).unwrap();
    let frame = jpeg.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    for (at, value, words) in [
        (1, 0xc3, "a lossless JPEG"),
        (1, 0xc5, "a hierarchical JPEG"),
        (4, 12, "samples of 12 bits"),
        (11, 0x32, "sampling factors are no multiples"),
    ] {
        let mut bytes = jpeg.clone();
        bytes[frame + at] = value;
        if at == 11 {
            bytes[frame + 14] = 0x22;
        }
        let error = decoded(bytes).unwrap_err();
        assert!(error.contains(words) && error.contains("give the picture as PNG"), "{error}");
    }
    let mut bytes = jpeg;
    bytes[frame + 5..frame + 7].fill(0);
    assert!(decoded(bytes).unwrap_err().contains("DNL"));
}
