//! Checks the disk of a run: space, speed, and the guarantees of creation, renames, links and locks.
//!
//! Most probes do not use [`render::atomic_file`], because they test the guarantees on which it relies.

use super::finding::{Finding, Level, bytes_text, seconds_text};
use render::atomic_file;
use render::disk::{NO_FOLDER_SYNC, NO_LINKS, NO_LOCKS, OTHER_DISK, sync_folder};
use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::time::Instant;

/// Length of the file that measures the writing speed, bytes.
const WRITTEN: usize = 32 << 20;
/// Number of files that are written durably, one by one.
const DURABLE_FILES: usize = 15;
/// Number of files that are created, listed and removed.
const SMALL_FILES: usize = 100;
/// Free space below which most runs do not fit, bytes.
const LITTLE_SPACE: u64 = 1_000_000_000;
const NO_SPACE: u64 = 50_000_000;
const SLOW_MB_PER_S: f64 = 20.0;
const SLOW_DURABLE_S: f64 = 0.05;
const SLOW_SMALL_S: f64 = 5.0;

/// Returns the free bytes on the disk of a folder that may not exist yet.
pub fn available_bytes(folder: &Path) -> Option<u64> {
    let folder = std::path::absolute(folder).ok()?;
    let there = folder.ancestors().find(|folder| folder.is_dir())?;
    let disk = rustix::fs::statvfs(there).ok()?;
    Some(disk.f_bavail * disk.f_frsize)
}

/// Checks the disk of `folder`. Creates a temporary folder inside it, and removes the temporary folder at the end.
pub fn check_disk(folder: &Path) -> Vec<Finding> {
    type Probe = fn(&Path) -> io::Result<Finding>;
    let probes: [(&str, Probe); 4] = [
        ("disk speed", speed),
        ("durable files", durable),
        ("small files", small_files),
        ("disk promises", promises),
    ];
    let mut findings = vec![space(available_bytes(folder))];
    match tempfile::Builder::new().prefix(".tmp-doctor-").tempdir_in(folder) {
        Err(error) => findings.push(cannot("disk", &error)),
        Ok(place) => findings.extend(probes.into_iter().map(|(check, probe)| {
            probe(place.path()).unwrap_or_else(|error| cannot(check, &error))
        })),
    }
    findings
}

fn cannot(check: &'static str, error: &io::Error) -> Finding {
    let to_do = match error.kind() {
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            "give this user permission to write, or use another folder (`plan --out`, `--store`)"
        }
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "free space, or use another disk",
        _ => "use another folder, or check this disk",
    };
    Finding::fail(check, format!("cannot write: {error}"), to_do)
}

fn space(bytes: Option<u64>) -> Finding {
    let Some(bytes) = bytes else {
        return Finding::warn("disk space", "unknown to the system", "check with `df`");
    };
    Finding::ok("disk space", format!("{} free", bytes_text(bytes as f64)))
        .unless(bytes >= NO_SPACE, Level::Fail, "free space, or use another disk")
        .unless(
            bytes >= LITTLE_SPACE,
            Level::Warn,
            "`glasshouse plan RECIPE -n` estimates the space that a run needs",
        )
        .with("free_bytes", bytes)
}

/// Measures the speed of writing and syncing a long file.
fn speed(place: &Path) -> io::Result<Finding> {
    // Consecutive blocks differ, to limit the effect of compression and deduplication on the measured speed.
    let mut block: Vec<u8> =
        (0..1u32 << 20).map(|i| (i.wrapping_mul(0x9e37_79b1) >> 24) as u8).collect();
    let start = Instant::now();
    let mut file = File::create_new(place.join("long"))?;
    for number in 0..WRITTEN >> 20 {
        for byte in block.iter_mut().step_by(64) {
            *byte ^= number as u8 + 1;
        }
        file.write_all(&block)?;
    }
    file.sync_all()?;
    let rate = WRITTEN as f64 / start.elapsed().as_secs_f64() / 1e6;
    drop(file);
    fs::remove_file(place.join("long"))?;
    let text = format!("{rate:.0} MB/s ({} written and synced)", bytes_text(WRITTEN as f64));
    Ok(Finding::ok("disk speed", text)
        .unless(
            rate >= SLOW_MB_PER_S,
            Level::Warn,
            "put the run on a local disk, or use fewer workers on this one",
        )
        .with("mb_per_s", rate))
}

/// Measures the time of a durable write, which the store needs for each partial and each file of a tuple.
fn durable(place: &Path) -> io::Result<Finding> {
    let mut seconds = Vec::new();
    for number in 0..DURABLE_FILES {
        let start = Instant::now();
        let written =
            atomic_file::write(&place.join(format!("durable-{number}")), &[number as u8; 4096]);
        written.map_err(|error| error.source)?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    let (median, worst) = (seconds[DURABLE_FILES / 2], seconds[DURABLE_FILES - 1]);
    let text = format!(
        "{} each, {} at most (written, synced, renamed)",
        seconds_text(median),
        seconds_text(worst)
    );
    let to_do = "results wait for this disk: use a local disk, or a bucket with --store";
    Ok(Finding::ok("durable files", text)
        .unless(median <= SLOW_DURABLE_S, Level::Warn, to_do)
        .with("median_s", median)
        .with("most_s", worst))
}

/// Measures the time to create, list and remove small files, which is long on some network disks.
fn small_files(place: &Path) -> io::Result<Finding> {
    let folder = place.join("small");
    let start = Instant::now();
    fs::create_dir(&folder)?;
    for number in 0..SMALL_FILES {
        File::create_new(folder.join(number.to_string()))?.write_all(b"small")?;
    }
    let listed = fs::read_dir(&folder)?.count();
    fs::remove_dir_all(&folder)?;
    let seconds = start.elapsed().as_secs_f64();
    let text = format!("{SMALL_FILES} created, listed and removed in {}", seconds_text(seconds));
    Ok(Finding::ok("small files", text)
        .unless(
            seconds <= SLOW_SMALL_S,
            Level::Warn,
            "creating files is slow on this disk: use a local disk, or a bucket with --store",
        )
        .unless(
            listed == SMALL_FILES,
            Level::Fail,
            "a new file is not listed: this disk cannot hold a run",
        )
        .with("seconds", seconds)
        .with("listed", listed))
}

/// Tests the guarantees that runs need: exclusive creation, hard links, renames that replace files, and locks.
fn promises(place: &Path) -> io::Result<Finding> {
    let path = |name: &str| place.join(name);
    let mut broken = Vec::new();
    File::create_new(path("one"))?.write_all(b"one")?;
    File::create_new(path("two"))?.write_all(b"two")?;
    let is_taken = |result: io::Result<()>| {
        result.is_err_and(|error| error.kind() == ErrorKind::AlreadyExists)
    };
    if !is_taken(File::create_new(path("one")).map(drop)) {
        broken.push("a file can be created twice (O_EXCL)");
    }
    match fs::hard_link(path("one"), path("link")) {
        // The store uses a hard link to put an object at most once.
        Ok(()) if !is_taken(fs::hard_link(path("two"), path("link"))) => {
            broken.push("a link replaces a file");
        }
        Ok(()) => {}
        Err(_) => broken.push(NO_LINKS),
    }
    fs::rename(path("two"), path("one"))?;
    if fs::read(path("one"))? != b"two" || path("two").exists() {
        broken.push("a rename does not replace the file");
    }
    let locks = |file: &File| match file.try_lock() {
        Ok(()) => Ok(true),
        Err(TryLockError::WouldBlock) => Ok(false),
        Err(TryLockError::Error(error)) => Err(error),
    };
    let open = || File::options().append(true).open(path("one"));
    let (first, second) = (open()?, open()?);
    if !matches!((locks(&first), locks(&second)), (Ok(true), Ok(false))) {
        broken.push(NO_LOCKS);
    }
    let syncs = sync_folder(place)?;
    Ok(if broken.is_empty() && !syncs {
        Finding::warn(
            "disk promises",
            NO_FOLDER_SYNC,
            "use another disk for results that must survive a power cut",
        )
    } else if broken.is_empty() {
        Finding::ok("disk promises", "exclusive creation, renames, links and locks work")
    } else {
        Finding::fail("disk promises", broken.join("; "), OTHER_DISK)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_good_disk_passes_and_no_file_remains() {
        let folder = tempfile::tempdir().unwrap();
        let found = check_disk(folder.path());
        assert_eq!(found.len(), 5);
        assert!(found.iter().all(|f| f.level < Level::Fail), "{found:?}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_folder_without_write_permission_fails() {
        let found = check_disk(Path::new("/proc"));
        let worst = found.iter().map(|f| f.level).max();
        assert_eq!(worst, Some(Level::Fail), "{found:?}");
        assert!(found.iter().filter(|f| f.level == Level::Fail).all(|f| f.to_do.is_some()));
    }

    #[test]
    fn a_missing_folder_has_the_space_of_its_parent() {
        let folder = tempfile::tempdir().unwrap();
        let there = available_bytes(folder.path()).unwrap();
        let to_be = available_bytes(&folder.path().join("a/b")).unwrap();
        assert!(there > 0 && to_be > 0);
        // Other processes may write between the two calls.
        assert!(there.abs_diff(to_be) < there / 2);
    }
}
