//! Tests the commands, queues, stores and web server of runs, with one worker and with many, and under faults.
#![allow(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    clippy::print_stderr,
    reason = "tests may panic in any function, damage files, and print why they are skipped"
)]

mod audit;
mod bench_farm;
mod bench_recipe;
mod checkpoint;
mod checks;
mod conflict;
mod control;
mod damage;
mod disks;
mod explain;
mod hopeless;
mod hostile;
mod idle;
mod kept_run;
mod kill;
mod late;
mod lost;
mod many;
mod merging;
mod photographs;
mod pictures;
mod planning;
mod poison;
mod processes;
mod quarantine;
mod queues;
mod retry;
mod roles;
mod serve;
mod serve_browser;
mod serve_busy;
mod serve_metrics;
mod serve_run;
mod siege;
mod snapshot;
mod status;
mod store_disk_full;
mod store_farm;
mod store_inputs;
mod store_tls;
mod stores;
#[path = "../support/mod.rs"]
mod support;
mod token;
mod writing;
