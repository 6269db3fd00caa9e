//! What a worker keeps with a task whose scene is loaded.

use super::tasks::TaskId;
use crate::run::Task;
use render::job::SceneJob;

pub(super) struct ActiveTask<'a> {
    pub(super) id: TaskId,
    /// As it was leased.
    pub(super) leased: Task,
    pub(super) job: SceneJob<'a>,
}
