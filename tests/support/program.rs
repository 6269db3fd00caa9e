//! Runs the program, and checks its exit code and output.

use super::postconditions::Call;
use serde_json::Value;
use std::ffi::OsStr;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::ops::{Deref, DerefMut};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Path of the `glasshouse` binary under test.
pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_glasshouse");

/// A call of the program whose promises are checked at its end.
pub(crate) struct Program(Command);

/// Makes a call of the program with `arguments` and pipes its output. The program writes each partial at once, so that a
/// test can kill it in the middle of a short run.
pub(crate) fn command<S: AsRef<OsStr>>(arguments: &[S]) -> Program {
    let mut command = Command::new(PROGRAM);
    command
        .args(arguments)
        .env("GLASSHOUSE_CHECKPOINT_S", "0")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    Program(command)
}

impl Program {
    pub(crate) fn args(&mut self, arguments: impl IntoIterator<Item: AsRef<OsStr>>) -> &mut Self {
        self.0.args(arguments);
        self
    }

    pub(crate) fn env(&mut self, name: impl AsRef<OsStr>, value: impl AsRef<OsStr>) -> &mut Self {
        self.0.env(name, value);
        self
    }

    pub(crate) fn env_remove(&mut self, name: impl AsRef<OsStr>) -> &mut Self {
        self.0.env_remove(name);
        self
    }

    pub(crate) fn current_dir(&mut self, folder: impl AsRef<Path>) -> &mut Self {
        self.0.current_dir(folder);
        self
    }

    pub(crate) fn stdin(&mut self, stdin: impl Into<Stdio>) -> &mut Self {
        self.0.stdin(stdin);
        self
    }

    pub(crate) fn stdout(&mut self, stdout: impl Into<Stdio>) -> &mut Self {
        self.0.stdout(stdout);
        self
    }

    pub(crate) fn stderr(&mut self, stderr: impl Into<Stdio>) -> &mut Self {
        self.0.stderr(stderr);
        self
    }

    #[track_caller]
    pub(crate) fn output(&mut self) -> io::Result<Output> {
        self.spawn()?.wait_with_output()
    }

    pub(crate) fn spawn(&mut self) -> io::Result<Running> {
        let call = Call::new(&self.0);
        Ok(Running { child: Some(self.0.spawn()?), call })
    }
}

/// A running call of the program.
pub(crate) struct Running {
    /// `None` after [`Self::wait_with_output`].
    child: Option<Child>,
    call: Call,
}

impl Running {
    /// Waits for the end, and checks the call's promises.
    #[track_caller]
    pub(crate) fn wait_with_output(mut self) -> io::Result<Output> {
        let child = self.child.take().expect("the first call of this method");
        let has_stdout = child.stdout.is_some();
        let output = child.wait_with_output()?;
        self.call.check(output.status.code(), has_stdout.then_some(&*output.stdout));
        Ok(output)
    }
}

impl Deref for Running {
    type Target = Child;

    fn deref(&self) -> &Child {
        self.child.as_ref().expect("only wait_with_output takes the child")
    }
}

impl DerefMut for Running {
    fn deref_mut(&mut self) -> &mut Child {
        self.child.as_mut().expect("only wait_with_output takes the child")
    }
}

impl Drop for Running {
    /// Checks the promises of a call whose output no test reads.
    fn drop(&mut self) {
        let ended = self.child.as_mut().and_then(|child| child.try_wait().ok().flatten());
        if let Some(status) = ended.filter(|_| !std::thread::panicking()) {
            self.call.check(status.code(), None);
        }
    }
}

/// Exit code and output of a finished process.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl From<Output> for Ended {
    fn from(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

impl Ended {
    /// Asserts the exit code.
    #[track_caller]
    pub(crate) fn expect(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{self:#?}");
        self
    }

    /// Asserts that stderr contains all `words`.
    #[track_caller]
    pub(crate) fn says(self, words: &[&str]) -> Self {
        for word in words {
            assert!(self.stderr.contains(word), "no {word:?} in {self:#?}");
        }
        self
    }

    /// Asserts that stdout contains all `words`.
    #[track_caller]
    pub(crate) fn prints(self, words: &[&str]) -> Self {
        for word in words {
            assert!(self.stdout.contains(word), "no {word:?} in {self:#?}");
        }
        self
    }

    /// Parses the output of `--json`, and asserts that it is one JSON object with a schema.
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        let value: Value = serde_json::from_str(&self.stdout)
            .unwrap_or_else(|e| panic!("stdout is not one JSON value ({e}): {self:#?}"));
        assert!(value["schema"].is_string(), "no schema: {self:#?}");
        value
    }
}

/// Runs the program to its end.
pub(crate) fn run<S: AsRef<OsStr>>(arguments: &[S]) -> Ended {
    command(arguments).output().unwrap().into()
}

/// Runs the program with the arguments in `line`, separated by spaces.
pub(crate) fn run_line(line: &str) -> Ended {
    run(&line.split(' ').collect::<Vec<_>>())
}

/// Runs the program with a file size limit of one block, which simulates a full disk.
pub(crate) fn run_on_full_disk(arguments: &[&str]) -> Ended {
    let call = Call::new(&command(arguments).0);
    let mut limited = Command::new("sh");
    limited.args(["-c", "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\"", PROGRAM]);
    let output = limited.args(arguments).output().unwrap();
    call.check(output.status.code(), Some(&output.stdout));
    output.into()
}

/// Sends a signal, such as `TERM`, to a child.
pub(crate) fn send(child: &Child, signal: &str) {
    let status = Command::new("kill").args([format!("-{signal}"), child.id().to_string()]).status();
    assert!(status.unwrap().success());
}

/// Time limit of a wait, which only a stalled process exceeds, even on a busy machine.
pub(crate) const LONGEST: Duration = Duration::from_mins(5);

/// Waits until `is_so` returns true or the child ends. Returns false if the child ended.
pub(crate) fn wait_until(child: &mut Child, mut is_so: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if is_so() {
            return true;
        }
        assert!(start.elapsed() < LONGEST, "the child makes no progress");
        // Polls, because most conditions depend on files that the child writes.
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

/// Returns a random number below `n`. It differs between test runs, so tests log its effect.
pub(crate) fn random(n: usize) -> usize {
    (RandomState::new().hash_one(0) % n as u64) as usize
}

/// Converts a path to an argument.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Makes a tokio runtime for the servers and clients of a test.
pub(crate) fn runtime() -> tokio::runtime::Runtime {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    builder.worker_threads(2).enable_all().build().unwrap()
}
