//! What a coordinator shows of a run over HTTP: a page for people, JSON for scripts, metrics for Prometheus.
//!
//! [`FarmView`] is plain data: what there is to show, with ages in seconds. [`FarmSource`] hands it over; [`serve`]
//! answers requests with it. Nothing here changes a run, unless a token is set and given; even then it only passes an
//! [`Action`] on. No name from a request reaches a disk or a store but as a [`render::ids::SceneId`] and one of
//! [`render::trace::LAYERS`].

mod action;
mod metrics;
mod page;
mod routes;
mod server;
pub(crate) mod text;
mod view;
mod watch;

pub use action::{Action, MIN_TOKEN_CHARACTERS};
pub use server::{FarmSource, ServeError, Server, serve};
pub use view::{
    Count, FARM_SCHEMA, FarmState, FarmView, QuarantinedScene, QueueView, RecentTuple, WorkerState,
    WorkerView,
};
pub use watch::WatchedRun;
