//! Compares the available memory of the machine and its container with the needs of the threads.

use super::finding::{Finding, Level, bytes_text};
use std::fs::read_to_string;
use std::path::{Path, PathBuf};

/// Memory of a tracing process without its threads, bytes.
const BASE_BYTES: u64 = 50_000_000;
/// Memory of each compute thread, bytes, with photographs of 1024 x 768 px and a film of 256 x 256 px: a loaded scene,
/// shards, and encoded results. Measured: 138 MB with one thread, 236 MB with two.
const THREAD_BYTES: u64 = 120_000_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Memory {
    /// Available memory of the machine, bytes.
    available: Option<u64>,
    /// Available memory of the container, bytes.
    left_in_group: Option<u64>,
    /// Limit of the container, bytes.
    group_limit: Option<u64>,
}

/// Checks the memory for `threads` compute threads.
pub fn check_memory(threads: usize) -> Finding {
    judge(look(Path::new("/")), threads)
}

fn judge(memory: Memory, threads: usize) -> Finding {
    let need = BASE_BYTES + THREAD_BYTES * threads as u64;
    let there = [memory.available, memory.left_in_group].into_iter().flatten().min();
    let Some(there) = there else {
        return Finding::warn(
            "memory",
            "unknown to the system",
            "provide at least 120 MB for each thread",
        );
    };
    let group = memory.group_limit.map_or_else(String::new, |limit| {
        format!(" (the container's limit is {})", bytes_text(limit as f64))
    });
    let most = there.saturating_sub(BASE_BYTES) / THREAD_BYTES;
    let text = format!(
        "{} free{group}; tracing with -j {threads} takes about {}",
        bytes_text(there as f64),
        bytes_text(need as f64)
    );
    Finding::ok("memory", text)
        .unless(
            most > 0,
            Level::Fail,
            "free memory, or raise the container's limit: the memory does not suffice for one thread",
        )
        .unless(
            there >= need,
            Level::Warn,
            format!("use fewer threads: -j {}; larger photographs need more memory", most.max(1)),
        )
        .with("free_bytes", there)
        .with("group_limit_bytes", memory.group_limit)
        .with("needed_bytes", need)
}

/// Reads the memory figures from the system's files below `root` (`/` except in tests).
fn look(root: &Path) -> Memory {
    let available = read_to_string(root.join("proc/meminfo")).ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("MemAvailable:"))?.to_owned();
        let kib: u64 = line.split_ascii_whitespace().nth(1)?.parse().ok()?;
        Some(kib * 1024)
    });
    let mut memory = Memory { available, ..Memory::default() };
    for (limit, used) in groups(root) {
        let number = |path: &Path| read_to_string(path).ok()?.trim().parse::<u64>().ok();
        // `max`, or a number near the maximum of an integer, means no limit.
        let Some(limit) = number(&limit).filter(|limit| *limit < 1 << 60) else {
            continue;
        };
        let left = limit.saturating_sub(number(&used).unwrap_or(0));
        if memory.left_in_group.is_none_or(|least| left < least) {
            (memory.left_in_group, memory.group_limit) = (Some(left), Some(limit));
        }
    }
    memory
}

/// Lists the files with limit and usage of this process's control groups and their ancestors, in versions 2 and 1.
fn groups(root: &Path) -> Vec<(PathBuf, PathBuf)> {
    let mut files = Vec::new();
    let text = read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    for line in text.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next())
        else {
            continue;
        };
        let (mount, names) = match controllers {
            "" => ("sys/fs/cgroup", ["memory.max", "memory.current"]),
            "memory" => {
                ("sys/fs/cgroup/memory", ["memory.limit_in_bytes", "memory.usage_in_bytes"])
            }
            _ => continue,
        };
        // Inside a container, the group of the process is often mounted at the top.
        let mount = root.join(mount);
        let own = mount.join(path.trim_start_matches('/'));
        for folder in own.ancestors().take_while(|folder| folder.starts_with(&mount)) {
            files.push((folder.join(names[0]), folder.join(names[1])));
        }
    }
    files
}

#[cfg(test)]
mod tests {
    use super::*;
    use render::atomic_file::{create_dir, write};

    #[test]
    fn the_tightest_group_counts() {
        let root = tempfile::tempdir().unwrap();
        let put = |path: &str, text: &str| {
            let path = root.path().join(path);
            create_dir(path.parent().unwrap()).unwrap();
            write(&path, text.as_bytes()).unwrap();
        };
        assert_eq!(look(root.path()), Memory::default());
        put("proc/meminfo", "MemTotal: 9 kB\nMemAvailable:   4000000 kB\n");
        put("proc/self/cgroup", "4:memory:/a/b\n0::/c\n");
        put("sys/fs/cgroup/c/memory.max", "max\n");
        put("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
        assert_eq!(look(root.path()).left_in_group, None);
        put("sys/fs/cgroup/memory/a/memory.limit_in_bytes", "1000000000\n");
        put("sys/fs/cgroup/memory/a/memory.usage_in_bytes", "400000000\n");
        let memory = look(root.path());
        assert_eq!(memory.left_in_group, Some(600_000_000));
        let found = judge(memory, 8);
        assert_eq!(found.level, Level::Warn);
        assert!(found.to_do.unwrap().contains("-j 4"), "{:?}", found.value);
        assert_eq!(judge(memory, 1).level, Level::Ok);
        put("sys/fs/cgroup/c/memory.max", "90000000\n");
        assert_eq!(judge(look(root.path()), 1).level, Level::Fail);
    }
}
