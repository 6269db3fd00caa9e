//! A model of a disk: folders and files, and the operations that a crash may lose.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Index of a node of [`Disk`]. Node 0 is the root.
pub(crate) type Ino = usize;

#[derive(Clone, Debug)]
pub(crate) enum Node {
    Folder(BTreeMap<String, Ino>),
    File(Arc<Vec<u8>>),
}

/// All files and folders (`None`) below a folder, by relative path.
pub(crate) type Tree = BTreeMap<PathBuf, Option<Arc<Vec<u8>>>>;

/// A change of one file or of one or two folders. A crash keeps or loses it as a whole, except that a write may be torn.
#[derive(Clone, Debug)]
pub(crate) enum Operation {
    Link { folder: Ino, name: String, ino: Ino },
    Unlink { folder: Ino, name: String },
    Rename { from: (Ino, String), to: (Ino, String), ino: Ino },
    Write { ino: Ino, offset: usize, bytes: Arc<Vec<u8>> },
    Truncate { ino: Ino, length: usize },
}

/// The fate of an operation in a crash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fate {
    Kept,
    Lost,
    /// Only the first half of a write reached the disk.
    Torn,
    /// The file grew, but the bytes of the write did not reach the disk.
    Zeros,
}

impl Operation {
    /// True if an fsync of `ino` makes the operation durable. A rename is durable with the folder of its new name.
    pub(crate) fn is_synced_with(&self, synced: Ino) -> bool {
        match self {
            Self::Link { folder, .. } | Self::Unlink { folder, .. } => *folder == synced,
            Self::Rename { to, .. } => to.0 == synced,
            Self::Write { ino, .. } | Self::Truncate { ino, .. } => *ino == synced,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Disk {
    pub(crate) nodes: Vec<Node>,
}

impl Disk {
    /// Reads a folder of the real disk.
    pub(crate) fn read(folder: &Path) -> Self {
        let mut disk = Self { nodes: vec![Node::Folder(BTreeMap::new())] };
        disk.read_into(0, folder);
        disk
    }

    fn read_into(&mut self, ino: Ino, folder: &Path) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let child = self.add(path.is_dir());
            if path.is_dir() {
                self.read_into(child, &path);
            } else {
                self.nodes[child] = Node::File(Arc::new(std::fs::read(&path).unwrap()));
            }
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            self.entries_mut(ino).insert(name, child);
        }
    }

    /// Adds an empty node without a name.
    pub(crate) fn add(&mut self, is_folder: bool) -> Ino {
        self.nodes.push(if is_folder {
            Node::Folder(BTreeMap::new())
        } else {
            Node::File(Arc::default())
        });
        self.nodes.len() - 1
    }

    /// Returns the entries of a folder; `None` for a file.
    pub(crate) fn entries(&self, ino: Ino) -> Option<&BTreeMap<String, Ino>> {
        match &self.nodes[ino] {
            Node::Folder(entries) => Some(entries),
            Node::File(_) => None,
        }
    }

    fn entries_mut(&mut self, ino: Ino) -> &mut BTreeMap<String, Ino> {
        match &mut self.nodes[ino] {
            Node::Folder(entries) => entries,
            Node::File(_) => panic!("node {ino} is a file"),
        }
    }

    /// Returns the bytes of a file.
    pub(crate) fn bytes(&self, ino: Ino) -> &Arc<Vec<u8>> {
        match &self.nodes[ino] {
            Node::File(bytes) => bytes,
            Node::Folder(_) => panic!("node {ino} is a folder"),
        }
    }

    /// Applies an operation with its fate. Operations on folders do not depend on the fate of earlier ones.
    pub(crate) fn apply(&mut self, operation: &Operation, fate: Fate) {
        if fate == Fate::Lost {
            return;
        }
        match operation {
            Operation::Link { folder, name, ino } => {
                self.entries_mut(*folder).insert(name.clone(), *ino);
            }
            Operation::Unlink { folder, name } => {
                self.entries_mut(*folder).remove(name);
            }
            Operation::Rename { from, to, ino } => {
                let old = self.entries_mut(from.0);
                if old.get(&from.1) == Some(ino) {
                    old.remove(&from.1);
                }
                self.entries_mut(to.0).insert(to.1.clone(), *ino);
            }
            Operation::Write { ino, offset, bytes } => self.write(*ino, *offset, bytes, fate),
            Operation::Truncate { ino, length } => {
                Arc::make_mut(self.bytes_mut(*ino)).resize(*length, 0);
            }
        }
    }

    fn bytes_mut(&mut self, ino: Ino) -> &mut Arc<Vec<u8>> {
        match &mut self.nodes[ino] {
            Node::File(bytes) => bytes,
            Node::Folder(_) => panic!("node {ino} is a folder"),
        }
    }

    fn write(&mut self, ino: Ino, offset: usize, bytes: &Arc<Vec<u8>>, fate: Fate) {
        let there = self.bytes_mut(ino);
        if fate == Fate::Kept && offset == 0 && there.len() <= bytes.len() {
            *there = Arc::clone(bytes);
            return;
        }
        let there = Arc::make_mut(there);
        let length = if fate == Fate::Torn { bytes.len() / 2 } else { bytes.len() };
        if there.len() < offset + length {
            there.resize(offset + length, 0);
        }
        let place = &mut there[offset..offset + length];
        match fate {
            Fate::Zeros => place.fill(0),
            _ => place.copy_from_slice(&bytes[..length]),
        }
    }

    /// Returns the files and folders that have a path.
    pub(crate) fn tree(&self) -> Tree {
        let mut tree = Tree::new();
        self.collect(0, Path::new(""), &mut tree);
        tree
    }

    fn collect(&self, ino: Ino, at: &Path, tree: &mut Tree) {
        for (name, &child) in self.entries(ino).into_iter().flatten() {
            let path = at.join(name);
            match &self.nodes[child] {
                Node::File(bytes) => {
                    tree.insert(path, Some(Arc::clone(bytes)));
                }
                Node::Folder(_) => {
                    tree.insert(path.clone(), None);
                    self.collect(child, &path, tree);
                }
            }
        }
    }
}

/// Writes a tree into an empty folder of the real disk.
pub(crate) fn put_tree(tree: &Tree, folder: &Path) {
    for (path, content) in tree {
        let path = folder.join(path);
        match content {
            Some(bytes) => std::fs::write(path, &**bytes).unwrap(),
            None => std::fs::create_dir(path).unwrap(),
        }
    }
}
