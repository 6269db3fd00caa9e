//! What a coordinator shows of a run over HTTP: a page for people, JSON for scripts, metrics for Prometheus.
//!
//! [`FarmView`] is plain data with ages in seconds. A [`FarmSource`] makes it: [`WatchedRun`] from what a coordinator has
//! seen. [`serve`] answers requests with it. Nothing here changes a run without the token; with it, the source carries out an
//! [`Action`]. A name from a request reaches a disk or a store only as a [`render::ids::SceneId`] and one of
//! [`render::layer::Layer::NAMES`].

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
