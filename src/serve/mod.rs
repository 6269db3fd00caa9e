//! A coordinator's HTTP server: a page for people, JSON for scripts, metrics for Prometheus.
//!
//! [`FarmView`] is plain data with ages in seconds. A [`FarmSource`] provides views; [`WatchedRun`] makes them from a
//! coordinator's observations. [`serve`] answers requests with views. Only a request with the token can change a run:
//! it makes the source carry out an [`Action`]. Names from a request reach a disk or a store only as a
//! [`glasshouse_line::ids::SceneId`] and one of [`glasshouse_line::layer::Layer::NAMES`].

mod action;
mod metrics;
mod page;
mod routes;
mod server;
mod view;
mod watched_run;

pub use action::{Action, MIN_TOKEN_CHARACTERS};
pub use server::{FarmSource, ServeError, Server, serve};
pub use view::{
    Count, FARM_SCHEMA, FarmView, QuarantinedScene, QueueView, RecentTuple, WorkerState, WorkerView,
};
pub use watched_run::WatchedRun;
