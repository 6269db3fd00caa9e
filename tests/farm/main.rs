//! The program itself on real files: killed, stopped, damaged, moved, misused, and still the same pixels.
#![allow(
    clippy::unwrap_used,
    reason = "a test that cannot go on may panic, outside of its #[test] function too"
)]
#![allow(
    clippy::disallowed_methods,
    reason = "files are damaged here on purpose"
)]
#![allow(
    clippy::print_stderr,
    reason = "random moments are logged, and tests that cannot run here say so"
)]

mod audit;
mod bench;
mod bench_farm;
mod browser;
mod checkpoint;
mod checks;
mod completions;
mod conflict;
mod control;
mod damage;
mod doctor;
mod document_pages;
mod documents;
#[cfg(feature = "train")]
mod evaluate;
mod every_file;
mod every_file_left;
mod explain;
mod export;
mod export_killed;
mod export_readers;
mod export_refused;
mod hard_case_measures;
mod hard_cases;
mod help;
mod inspect;
mod inspect_damage;
mod json;
mod kill;
mod late;
mod layers;
mod light;
mod list;
mod many;
mod markup;
mod merging;
mod mesh;
mod moto;
mod outputs;
mod places;
mod planning;
mod poison;
mod program;
mod quarantine;
mod queues;
mod rendering;
mod report;
mod report_browser;
mod report_noise;
mod retry;
mod roles;
mod s3_server;
mod same;
mod scenes;
mod serve;
mod serve_browser;
mod serve_run;
mod server;
mod siege;
mod signals;
mod status;
mod store_disk_full;
mod store_farm;
mod store_inputs;
mod store_tls;
mod stores;
mod token;
#[cfg(feature = "train")]
mod training;
mod workplace;
mod writing;
