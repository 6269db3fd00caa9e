//! Checks the metrics page of the coordinator's web server against the rules of its text format.

use crate::serve_run::{HOSTILE, get, run, start, worker};
use glasshouse::serve::WorkerState;
use std::collections::{BTreeMap, BTreeSet};

/// One sample of the text format: name, labels, value.
type Sample = (String, BTreeMap<String, String>, f64);

/// Parses a line by the rules of the format.
fn sample(line: &str) -> Sample {
    let name: String =
        line.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
    let mut rest = &line[name.len()..];
    let mut labels = BTreeMap::new();
    if let Some(inside) = rest.strip_prefix('{') {
        rest = inside;
        loop {
            let (key, value) = rest.split_once("=\"").unwrap();
            let key = key.trim_start_matches(',');
            assert!(key.bytes().all(|b| b.is_ascii_lowercase() || b == b'_'), "{line}");
            let (mut text, mut at) = (String::new(), value.char_indices());
            let end = loop {
                match at.next().unwrap() {
                    (end, '"') => break end,
                    (_, '\\') => text.push(match at.next().unwrap().1 {
                        'n' => '\n',
                        c @ ('\\' | '"') => c,
                        c => panic!("\\{c} in {line}"),
                    }),
                    (_, c) => text.push(c),
                }
            };
            assert!(labels.insert(key.to_owned(), text).is_none(), "{line}");
            rest = &value[end + 1..];
            if let Some(after) = rest.strip_prefix('}') {
                rest = after;
                break;
            }
        }
    }
    let value = rest.strip_prefix(' ').unwrap().parse().unwrap();
    (name, labels, value)
}

#[test]
fn metrics_follow_the_text_format() {
    let run = run();
    {
        let mut view = run.view.lock().unwrap();
        view.name = HOSTILE.to_owned();
        view.workers[0].name = HOSTILE.to_owned();
        view.workers[0].version = "\\".to_owned();
        view.workers[1].last_progress_s = f64::NAN;
        // Two workers have the same name and host, as after a restart.
        view.workers.push(worker("three", WorkerState::Lost, 99.0));
        view.workers.push(worker("three", WorkerState::Working, 1.5));
        view.eta_s = None;
    }
    let server = start(&run, None);
    let answer = get(server.address(), "/metrics").expect(200);
    assert_eq!(answer.headers["content-type"], "text/plain; version=0.0.4; charset=utf-8");
    let (mut help, mut kind) = (BTreeSet::new(), BTreeMap::new());
    let mut samples: Vec<Sample> = Vec::new();
    assert!(answer.text().ends_with('\n'));
    for line in answer.text().lines() {
        if let Some(text) = line.strip_prefix("# HELP ") {
            let (name, text) = text.split_once(' ').unwrap();
            assert!(text.ends_with('.'));
            assert!(help.insert(name.to_owned()), "{name} is explained twice");
        } else if let Some(text) = line.strip_prefix("# TYPE ") {
            let (name, is) = text.split_once(' ').unwrap();
            assert!(matches!(is, "gauge" | "counter"), "{line}");
            assert!(kind.insert(name.to_owned(), is.to_owned()).is_none());
        } else {
            let sample = sample(line);
            assert!(sample.0.starts_with("glasshouse_"), "{line}");
            assert!(help.contains(&sample.0), "{line}");
            assert_eq!(kind[&sample.0] == "counter", sample.0.ends_with("_total"));
            let twice = samples.iter().any(|s| s.0 == sample.0 && s.1 == sample.1);
            assert!(!twice, "twice: {line}");
            samples.push(sample);
        }
    }
    let value = |name: &str, label: &str, text: &str| {
        let has = |s: &&Sample| s.0 == name && (label.is_empty() || s.1[label] == text);
        let found: Vec<&Sample> = samples.iter().filter(has).collect();
        assert_eq!(found.len(), 1, "{name} {label} {text}: {found:?}");
        found[0].2
    };
    assert_eq!(value("glasshouse_run_info", "name", HOSTILE), 1.0);
    assert_eq!(value("glasshouse_run_state", "state", "running"), 1.0);
    assert_eq!(value("glasshouse_run_state", "state", "paused"), 0.0);
    assert_eq!(value("glasshouse_scenes_done", "", ""), 1234.0);
    assert_eq!(value("glasshouse_scenes_per_second", "", ""), 0.5);
    assert_eq!(value("glasshouse_workers", "state", "lost"), 2.0);
    let age = |name| value("glasshouse_worker_last_progress_seconds", "worker", name);
    assert_eq!(age(HOSTILE), 0.5);
    assert!(age("two").is_nan());
    assert_eq!(age("three"), 1.5);
    assert_eq!(value("glasshouse_worker_info", "version", "\\"), 1.0);
    // The page leaves out unknown values.
    assert!(!answer.text().contains("eta_seconds"));
}
