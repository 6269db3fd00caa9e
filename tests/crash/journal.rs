//! Turns the system calls of a process into operations of the model disk, and finds out when each becomes durable.

use super::calls::{Call, Moment};
use super::disk::{Disk, Ino, Operation};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An operation or a sync, in the order of the process.
#[derive(Debug)]
pub(crate) struct Event {
    /// `None` for a sync.
    pub(crate) operation: Option<Operation>,
    /// Number of events after which no crash loses the operation.
    pub(crate) durable_at: Option<usize>,
    /// The call, for messages.
    pub(crate) text: String,
}

/// All changes of a process below one folder.
pub(crate) struct Journal {
    /// The disk before the process, which no crash loses.
    pub(crate) before: Disk,
    /// The disk after all events.
    pub(crate) after: Disk,
    pub(crate) events: Vec<Event>,
    root: PathBuf,
    open: BTreeMap<i64, OpenFile>,
    /// Number of events at the entry of each thread's current sync: it covers no later operation.
    sync_from: BTreeMap<u32, usize>,
}

/// Returns the result of an entered call; `None` if its process ended first.
fn result(entered: &Call, later: &[Moment]) -> Option<i64> {
    later.iter().find_map(|moment| match moment {
        Moment::Left(call, result) if call.thread == entered.thread => Some(*result),
        _ => None,
    })
}

#[derive(Clone, Copy)]
struct OpenFile {
    ino: Ino,
    offset: usize,
    appends: bool,
}

impl Journal {
    /// Replays the calls of a process that ran in the folder `root` with the content `before`.
    pub(crate) fn of(root: &Path, before: Disk, moments: &[Moment]) -> Self {
        let mut journal = Self {
            after: before.clone(),
            before,
            events: Vec::new(),
            root: root.to_owned(),
            open: BTreeMap::new(),
            sync_from: BTreeMap::new(),
        };
        for (index, moment) in moments.iter().enumerate() {
            match moment {
                // Another thread may find the folder, and write into it, before this call returns.
                Moment::Entered(call) if call.name.starts_with("mkdir") => {
                    if result(call, &moments[index..]).is_some_and(|result| result >= 0) {
                        journal.leave(call, 0);
                    }
                }
                Moment::Left(call, _) if call.name.starts_with("mkdir") => {}
                Moment::Entered(call) => journal.enter(call),
                Moment::Left(call, result) if *result >= 0 => journal.leave(call, *result),
                Moment::Left(..) => {}
            }
        }
        journal
    }

    fn enter(&mut self, call: &Call) {
        match call.name.as_str() {
            // The system frees the number at the entry, and another thread may get it before this call returns.
            "close" => {
                self.open.remove(&call.fd(0).unwrap_or(-1));
            }
            "fsync" | "fdatasync" | "sync" | "syncfs" => {
                self.sync_from.insert(call.thread, self.events.len());
            }
            _ => {}
        }
    }

    fn leave(&mut self, call: &Call, result: i64) {
        match call.name.as_str() {
            "open" => self.opened(self.place(None, &call.path(0)), call, 1, result),
            "creat" => panic!("{call:?} is not modelled"),
            "openat" => self.opened(self.place(call.fd(0), &call.path(1)), call, 2, result),
            "write" | "writev" => self.written(call, None, result),
            "pwrite64" => self.written(call, Some(call.number(3)), result),
            "ftruncate" => {
                if let Some(file) = self.file(call) {
                    self.add(Operation::Truncate { ino: file.ino, length: call.number(1) }, call);
                }
            }
            "lseek" => {
                let fd = call.fd(0).unwrap_or(-1);
                if let Some(file) = self.open.get_mut(&fd) {
                    file.offset = result as usize;
                }
            }
            "fsync" | "fdatasync" => {
                if let Some(file) = self.file(call) {
                    self.synced(Some(file.ino), call);
                }
            }
            "sync" | "syncfs" => self.synced(None, call),
            "mkdir" => self.made(self.place(None, &call.path(0)), call),
            "mkdirat" => self.made(self.place(call.fd(0), &call.path(1)), call),
            "unlink" | "rmdir" => self.removed(self.place(None, &call.path(0)), call),
            "unlinkat" => self.removed(self.place(call.fd(0), &call.path(1)), call),
            "rename" => self
                .renamed([self.place(None, &call.path(0)), self.place(None, &call.path(1))], call),
            "renameat" | "renameat2" => self.renamed(
                [self.place(call.fd(0), &call.path(1)), self.place(call.fd(2), &call.path(3))],
                call,
            ),
            "link" => self.linked([None, None], [0, 1], call),
            "linkat" => self.linked([call.fd(0), call.fd(2)], [1, 3], call),
            "dup" | "dup2" | "dup3" => self.duplicated(call, result),
            "fcntl" if call.text(1).starts_with("F_DUPFD") => self.duplicated(call, result),
            _ => {}
        }
    }

    fn file(&self, call: &Call) -> Option<OpenFile> {
        self.open.get(&call.fd(0)?).copied()
    }

    fn duplicated(&mut self, call: &Call, result: i64) {
        if let Some(file) = self.file(call) {
            self.open.insert(result, file);
        }
    }

    /// Returns the folder and the name of a path; `None` if it lies elsewhere. The root has an empty name.
    fn place(&self, folder: Option<i64>, path: &str) -> Option<(Ino, String)> {
        let path = Path::new(path);
        let (mut ino, rest) = match (path.is_absolute(), folder) {
            (true, _) => (0, path.strip_prefix(&self.root).ok()?),
            (false, None) => (0, path),
            (false, Some(fd)) => (self.open.get(&fd)?.ino, path),
        };
        let mut names: Vec<&str> = rest.iter().map(|name| name.to_str().unwrap()).collect();
        names.retain(|name| *name != ".");
        assert!(!names.contains(&".."), "{} is not modelled", path.display());
        let last = names.pop().unwrap_or_default();
        for name in names {
            ino = *self.after.entries(ino)?.get(name)?;
        }
        Some((ino, last.to_owned()))
    }

    fn ino(&self, (folder, name): &(Ino, String)) -> Option<Ino> {
        if name.is_empty() {
            return Some(*folder);
        }
        self.after.entries(*folder)?.get(name).copied()
    }

    fn opened(&mut self, place: Option<(Ino, String)>, call: &Call, flags: usize, fd: i64) {
        let flags = call.text(flags);
        self.open.remove(&fd);
        let Some(place) = place else { return };
        let ino = match self.ino(&place) {
            // A file without a name until a linkat gives it one.
            Some(_) if flags.contains("O_TMPFILE") => self.node(false),
            Some(ino) => ino,
            // Another thread created or removed the file at the same moment.
            None if !flags.contains("O_CREAT") => return,
            None => {
                let (ino, (folder, name)) = (self.node(false), place);
                self.add(Operation::Link { folder, name, ino }, call);
                ino
            }
        };
        if flags.contains("O_TRUNC") && !self.after.bytes(ino).is_empty() {
            self.add(Operation::Truncate { ino, length: 0 }, call);
        }
        self.open.insert(fd, OpenFile { ino, offset: 0, appends: flags.contains("O_APPEND") });
    }

    /// Adds a node to both disks. Before the process it has no name.
    fn node(&mut self, is_folder: bool) -> Ino {
        self.before.add(is_folder);
        self.after.add(is_folder)
    }

    fn written(&mut self, call: &Call, at: Option<usize>, count: i64) {
        let Some(file) = self.file(call) else { return };
        let end = self.after.bytes(file.ino).len();
        let offset = at.unwrap_or(if file.appends { end } else { file.offset });
        let mut bytes = call.bytes(1);
        bytes.truncate(count as usize);
        if at.is_none() {
            let fd = call.fd(0).unwrap_or(-1);
            self.open.insert(fd, OpenFile { offset: offset + bytes.len(), ..file });
        }
        self.add(Operation::Write { ino: file.ino, offset, bytes: Arc::new(bytes) }, call);
    }

    fn made(&mut self, place: Option<(Ino, String)>, call: &Call) {
        if let Some((folder, name)) = place {
            let ino = self.node(true);
            self.add(Operation::Link { folder, name, ino }, call);
        }
    }

    fn removed(&mut self, place: Option<(Ino, String)>, call: &Call) {
        if let Some((folder, name)) = place {
            self.add(Operation::Unlink { folder, name }, call);
        }
    }

    fn renamed(&mut self, places: [Option<(Ino, String)>; 2], call: &Call) {
        let [Some(from), Some(to)] = places else { return };
        let ino = self.ino(&from).unwrap_or_else(|| panic!("{call:?} has no source"));
        self.add(Operation::Rename { from, to, ino }, call);
    }

    fn linked(&mut self, folders: [Option<i64>; 2], paths: [usize; 2], call: &Call) {
        let source = call.path(paths[0]);
        let ino = match source.strip_prefix("/proc/self/fd/") {
            Some(fd) => fd.parse().ok().and_then(|fd: i64| Some(self.open.get(&fd)?.ino)),
            None => self.place(folders[0], &source).and_then(|place| self.ino(&place)),
        };
        let to = self.place(folders[1], &call.path(paths[1]));
        if let (Some(ino), Some((folder, name))) = (ino, to) {
            self.add(Operation::Link { folder, name, ino }, call);
        }
    }

    fn add(&mut self, operation: Operation, call: &Call) {
        self.after.apply(&operation, super::disk::Fate::Kept);
        let text = self.describe(&operation, call);
        self.events.push(Event { operation: Some(operation), durable_at: None, text });
    }

    /// Makes the operations on `ino`, or all, durable that were complete when the sync began.
    fn synced(&mut self, ino: Option<Ino>, call: &Call) {
        let end = self.events.len() + 1;
        let from = self.sync_from.remove(&call.thread).unwrap_or(0);
        for event in &mut self.events[..from] {
            let operation = event.operation.as_ref();
            let is_covered = operation.is_some_and(|o| ino.is_none_or(|ino| o.is_synced_with(ino)));
            if is_covered && event.durable_at.is_none() {
                event.durable_at = Some(end);
            }
        }
        let text = format!("{} {}", call.name, ino.map_or_else(String::new, |ino| self.path(ino)));
        self.events.push(Event { operation: None, durable_at: None, text });
    }

    fn describe(&self, operation: &Operation, call: &Call) -> String {
        let at = |folder: Ino, name: &str| format!("{}/{name}", self.path(folder));
        let of = match operation {
            Operation::Link { folder, name, .. } | Operation::Unlink { folder, name } => {
                at(*folder, name)
            }
            Operation::Rename { from, to, .. } => {
                format!("{} to {}", at(from.0, &from.1), at(to.0, &to.1))
            }
            Operation::Write { ino, offset, bytes } => {
                format!("{} ({} bytes at {offset})", self.path(*ino), bytes.len())
            }
            Operation::Truncate { ino, length } => format!("{} to {length}", self.path(*ino)),
        };
        format!("{} {of}", call.name)
    }

    /// Returns a present path of a node.
    fn path(&self, ino: Ino) -> String {
        for (folder, _) in self.after.nodes.iter().enumerate() {
            let entries = self.after.entries(folder).into_iter().flatten();
            if let Some((name, _)) = entries.clone().find(|(_, child)| **child == ino) {
                return if folder == 0 {
                    name.clone()
                } else {
                    format!("{}/{name}", self.path(folder))
                };
            }
        }
        String::from(if ino == 0 { "." } else { "(no name)" })
    }
}
