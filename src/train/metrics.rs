//! `metrics.csv`: one line per step.

use super::learner::StepLosses;
use super::validation::Validated;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// Terms of the loss, in the order of their columns.
pub(super) const TERMS: [&str; 10] = [
    "transmission_l1",
    "transmission_feature",
    "glass_reflection_l1",
    "glass_reflection_feature",
    "clean_reflection_l1",
    "clean_reflection_feature",
    "adversarial",
    "transmission_gradient",
    "glass_reflection_gradient",
    "clean_reflection_gradient",
];

pub(super) struct Metrics {
    file: File,
}

impl Metrics {
    /// Opens the file for training that continues at `step`; removes the lines of later steps, which training repeats.
    pub(super) fn open(path: &Path, step: u64) -> io::Result<Self> {
        let head = format!(
            "step,total,{},discriminator,validation_psnr_db,validation_light_ratio,wall_s",
            TERMS.join(",")
        );
        let mut text = format!("{head}\n");
        if let Some(old) = render::input_file::read_if_there(path)? {
            let old = String::from_utf8_lossy(&old);
            let mut lines = old.lines();
            let old_names: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
            // Files of earlier versions have fewer columns.
            let places: Vec<Option<usize>> =
                head.split(',').map(|name| old_names.iter().position(|old| *old == name)).collect();
            for line in lines {
                let cells: Vec<&str> = line.split(',').collect();
                let number = cells[0].parse::<u64>().ok();
                // A full disk may have cut the last line.
                let is_whole = cells.len() == old_names.len();
                if is_whole && number.is_some_and(|n| n <= step) {
                    let cells: Vec<&str> =
                        places.iter().map(|place| place.map_or("", |place| cells[place])).collect();
                    text += &cells.join(",");
                    text.push('\n');
                }
            }
        }
        render::atomic_file::write(path, text.as_bytes()).map_err(|e| e.source)?;
        let file = File::options().append(true).open(path)?;
        Ok(Self { file })
    }

    /// Makes all lines durable.
    pub(super) fn sync(&self) -> io::Result<()> {
        self.file.sync_data()
    }

    /// Adds a line. Absent numbers become empty fields.
    pub(super) fn add(
        &mut self,
        step: u64,
        losses: &StepLosses,
        validated: Validated,
        wall_s: f64,
    ) -> io::Result<()> {
        let mut line = format!("{step},{}", losses.total);
        let number = |value: Option<f64>| value.map_or_else(String::new, |v| format!("{v}"));
        for name in TERMS {
            let term = losses.terms.iter().find(|term| term.name == name);
            line.push(',');
            line += &term.map_or_else(String::new, |term| term.value.to_string());
        }
        line.push(',');
        line += &losses.discriminator.map_or_else(String::new, |v| v.to_string());
        let [psnr, light] = [validated.psnr_db, validated.light_ratio].map(number);
        let _ = writeln!(line, ",{psnr},{light},{wall_s:.4}");
        self.file.write_all(line.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Term;

    #[test]
    fn resuming_removes_later_lines() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("metrics.csv");
        let losses = |total| StepLosses {
            total,
            terms: vec![Term { name: "adversarial", value: 0.5 }],
            discriminator: None,
        };
        let mut metrics = Metrics::open(&path, 0).unwrap();
        for step in 1..=4 {
            let psnr_db = (step == 4).then_some(20.5);
            let validated = Validated { psnr_db, light_ratio: None };
            metrics.add(step, &losses(step as f32), validated, 0.1).unwrap();
        }
        let lines = || -> Vec<String> {
            let text = std::fs::read_to_string(&path).unwrap();
            text.lines().map(str::to_owned).collect()
        };
        assert_eq!(lines().len(), 5);
        assert!(lines()[4].contains(",20.5,,"), "{:?}", lines());
        let mut metrics = Metrics::open(&path, 2).unwrap();
        metrics.add(3, &losses(9.0), Validated::default(), 0.1).unwrap();
        render::atomic_file::write(&path, (lines().join("\n") + "\n3,0.5").as_bytes()).unwrap();
        Metrics::open(&path, 3).unwrap();
        let firsts: Vec<String> = lines()
            .iter()
            .map(|line| line.split(',').take(2).collect::<Vec<_>>().join(" "))
            .collect();
        assert_eq!(firsts, ["step total", "1 1", "2 2", "3 9"]);
        let columns = |line: &String| line.split(',').count();
        assert!(lines().iter().all(|line| columns(line) == columns(&lines()[0])));
    }

    #[test]
    fn lines_of_earlier_versions_keep_their_columns() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("metrics.csv");
        let old = "step,total,adversarial,validation_psnr_db,wall_s\n1,0.5,0.25,20.5,0.1\n2,0.4\n";
        render::atomic_file::write(&path, old.as_bytes()).unwrap();
        Metrics::open(&path, 2).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let (head, line) = (lines.next().unwrap(), lines.next().unwrap());
        let of = |name: &str| line[head.iter().position(|n| *n == name).unwrap()];
        let names = ["step", "total", "adversarial", "validation_psnr_db", "wall_s"];
        assert_eq!(names.map(of), ["1", "0.5", "0.25", "20.5", "0.1"]);
        assert_eq!((of("validation_light_ratio"), line.len()), ("", head.len()));
        assert!(lines.next().is_none());
    }
}
