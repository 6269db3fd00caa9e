//! Runs other programs if they are installed, and kills servers at the end of their test.

use super::program::{LONGEST, text};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, ExitStatus, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// A server that is killed when dropped.
pub(crate) struct Daemon(Child);

impl Daemon {
    /// Starts a server without output; returns `None`, and prints a note, if it is not installed.
    pub(crate) fn start(command: &mut Command) -> Option<Self> {
        command.stdin(Stdio::null()).stdout(Stdio::null());
        installed(command.stderr(Stdio::null()).spawn(), command).map(Self)
    }

    /// Starts a server, and returns it with its stderr; returns `None`, and prints a note, if it is not installed.
    pub(crate) fn start_and_hear(command: &mut Command) -> Option<(Self, ChildStderr)> {
        command.stdin(Stdio::null()).stderr(Stdio::piped());
        let mut child = installed(command.spawn(), command)?;
        let said = child.stderr.take().unwrap();
        Some((Self(child), said))
    }

    /// Returns the exit status if the server has ended.
    pub(crate) fn ended(&mut self) -> Option<ExitStatus> {
        self.0.try_wait().unwrap()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn installed<T>(started: std::io::Result<T>, command: &Command) -> Option<T> {
    match started {
        Ok(started) => Some(started),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            let name = command.get_program().to_string_lossy();
            eprintln!("skipped: {name} is not installed");
            None
        }
        Err(error) => panic!("{command:?}: {error}"),
    }
}

/// Runs a tool; returns `None`, and prints a note, if it is not installed.
pub(crate) fn tool(command: &mut Command) -> Option<Output> {
    installed(command.stdin(Stdio::null()).output(), command)
}

/// Asserts that a tool succeeded; shows its output otherwise.
#[track_caller]
pub(crate) fn content(output: &Output) {
    assert!(
        output.status.success(),
        "{}\n{}\n{}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

/// Waits until `is_so` returns true; panics after [`LONGEST`] with `what`, the name of the event.
#[track_caller]
pub(crate) fn wait_for(what: &str, mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < LONGEST, "timed out waiting for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Returns a port that is free now; another process may take it.
pub(crate) fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

/// True if a server listens on `port`.
pub(crate) fn listens(port: u16) -> bool {
    TcpStream::connect(("127.0.0.1", port)).is_ok()
}

/// Makes all keys and a server certificate for `names` with the shipped script; returns `None` if a tool is missing.
pub(crate) fn make_keys(folder: &Path, names: &[&str]) -> Option<()> {
    tool(Command::new("base32").arg("--version"))?;
    tool(Command::new("openssl").arg("version"))?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("workers/nats/make-keys.sh");
    content(&tool(Command::new(script).arg(folder).args(names))?);
    Some(())
}

type Built = OnceLock<Option<(tempfile::TempDir, PathBuf)>>;

/// Builds the library that, when preloaded, makes reads of files with "stuck" in their paths wait for ever. Returns `None` if it cannot be used here.
pub(crate) fn stuck_reads() -> Option<&'static Path> {
    static BUILT: Built = OnceLock::new();
    library(&BUILT, "stuck_read.c")
}

/// Builds the library that, when preloaded, takes features from a disk: see its source.
pub(crate) fn poor_disk() -> Option<&'static Path> {
    static BUILT: Built = OnceLock::new();
    library(&BUILT, "poor_disk.c")
}

fn library(built: &'static Built, source: &str) -> Option<&'static Path> {
    let built = built.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let library = folder.path().join("preloaded.so");
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support").join(source);
        let built = Command::new("cc")
            .args(["-shared", "-fPIC", "-O1", "-o", text(&library), text(&source), "-ldl"])
            .status();
        let is_built = built.is_ok_and(|status| status.success()) && cfg!(target_os = "linux");
        is_built.then_some((folder, library))
    });
    if built.is_none() {
        eprintln!("skipped: cc cannot build the library of {source}");
    }
    built.as_ref().map(|(_, library)| library.as_path())
}
