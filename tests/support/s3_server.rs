//! Runs a real S3 server (s3s-fs) in the test's process and injects faults in front of it.
//!
//! Other processes send it requests over TCP. A seed determines the faults: responses 500 and 503, slow responses, and
//! connections that end before the server gets the request, after it handles the request (the put takes effect, but its
//! response is lost) or in the middle of a response. The server handles conditional puts one at a time, so that S3's
//! rule holds and one of two simultaneous puts fails; the check and the write of s3s-fs are not atomic.

use super::program::Program;
use super::program::runtime;
use axum::body::Body;
use futures_util::StreamExt;
use glasshouse::store::{Store, StoreOptions};
use hyper::{Request, Response, body::Incoming, service::Service, service::service_fn};
use s3s::service::{S3Service, S3ServiceBuilder};
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::time::Duration;
use tempfile::TempDir;

pub(crate) const BUCKET: &str = "bucket";
const KEY_ID: &str = "AKIATEST";
const SECRET: &str = "hushhushhush";

/// Faults in front of the server.
#[derive(Default)]
pub(crate) struct Faults {
    seed: u64,
    /// Expected number of faulty requests among 1,000.
    per_mille: AtomicU32,
    /// True while the connection of every request ends without a response.
    away: AtomicBool,
    requests: AtomicU64,
    /// A lock that a conditional request holds.
    creating: tokio::sync::Mutex<()>,
    /// Number of random faults of each kind, in the order of [`FAULTS`].
    pub(crate) happened: [AtomicU64; 6],
}

/// The fault of one request.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    Error500,
    SlowDown,
    CutBefore,
    CutAfter,
    CutAnswer,
    Slow,
}

const FAULTS: [Fault; 6] = [
    Fault::Error500,
    Fault::SlowDown,
    Fault::CutBefore,
    Fault::CutAfter,
    Fault::CutAnswer,
    Fault::Slow,
];

impl Faults {
    fn draw(&self) -> Option<Fault> {
        if self.away.load(Ordering::SeqCst) {
            return Some(Fault::CutBefore);
        }
        let number = self.requests.fetch_add(1, Ordering::SeqCst);
        let digest = blake3::hash(&[self.seed.to_le_bytes(), number.to_le_bytes()].concat());
        let word = |k: usize| {
            let bytes = digest.as_bytes()[4 * k..4 * k + 4].try_into().unwrap();
            u32::from_le_bytes(bytes)
        };
        if word(0) % 1000 >= self.per_mille.load(Ordering::SeqCst) {
            return None;
        }
        let kind = word(1) as usize % FAULTS.len();
        self.happened[kind].fetch_add(1, Ordering::SeqCst);
        Some(FAULTS[kind])
    }

    pub(crate) fn set(&self, per_mille: u32) {
        self.per_mille.store(per_mille, Ordering::SeqCst);
    }

    pub(crate) fn set_away(&self, away: bool) {
        self.away.store(away, Ordering::SeqCst);
    }
}

/// The server; it stops when dropped.
pub(crate) struct S3Server {
    port: u16,
    pub(crate) faults: Arc<Faults>,
    _folder: TempDir,
    _runtime: tokio::runtime::Runtime,
}

impl S3Server {
    pub(crate) fn start(seed: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join(BUCKET)).unwrap();
        let mut builder = S3ServiceBuilder::new(s3s_fs::FileSystem::new(folder.path()).unwrap());
        builder.set_auth(s3s::auth::SimpleAuth::from_single(KEY_ID, SECRET));
        let server = builder.build();
        let faults = Arc::new(Faults { seed, ..Faults::default() });
        let runtime = runtime();
        let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
        let port = listener.local_addr().unwrap().port();
        runtime.spawn(listen(listener, server, Arc::clone(&faults)));
        Self { port, faults, _folder: folder, _runtime: runtime }
    }

    fn environment(&self) -> [(String, String); 4] {
        let endpoint = format!("http://127.0.0.1:{}", self.port);
        [
            ("AWS_ENDPOINT_URL", endpoint.as_str()),
            ("AWS_ACCESS_KEY_ID", KEY_ID),
            ("AWS_SECRET_ACCESS_KEY", SECRET),
            ("AWS_REGION", "us-east-1"),
        ]
        .map(|(name, value)| (name.to_owned(), value.to_owned()))
    }

    /// Sets the server's address and keys in a command's environment.
    pub(crate) fn tell(&self, command: &mut Program) {
        for (name, value) in self.environment() {
            command.env(name, value);
        }
    }

    pub(crate) fn options(&self, patience: Duration) -> StoreOptions {
        StoreOptions { settings: self.environment().into(), patience }
    }

    /// Opens the store below `prefix`.
    pub(crate) fn store(&self, prefix: &str) -> Store {
        let address = format!("s3://{BUCKET}/{prefix}");
        Store::open(&address, &self.options(Duration::from_secs(45))).unwrap()
    }
}

async fn listen(listener: tokio::net::TcpListener, server: S3Service, faults: Arc<Faults>) {
    while let Ok((socket, _)) = listener.accept().await {
        let (server, faults) = (server.clone(), Arc::clone(&faults));
        tokio::spawn(async move {
            let answer =
                service_fn(move |request| answer(server.clone(), Arc::clone(&faults), request));
            let socket = hyper_util::rt::TokioIo::new(socket);
            // An error of `answer` cuts the connection.
            let _ =
                hyper::server::conn::http1::Builder::new().serve_connection(socket, answer).await;
        });
    }
}

fn refusal(status: u16, code: &str) -> Response<Body> {
    let text = format!(
        "<?xml version=\"1.0\"?><Error><Code>{code}</Code><Message>Not now.</Message></Error>"
    );
    let answer = Response::builder().status(status);
    let answer = answer.header("content-type", "application/xml");
    answer.body(Body::from(text)).unwrap()
}

async fn answer(
    server: S3Service,
    faults: Arc<Faults>,
    request: Request<Incoming>,
) -> io::Result<Response<Body>> {
    let fault = faults.draw();
    let cut = || io::Error::from(io::ErrorKind::ConnectionReset);
    match fault {
        Some(Fault::Error500) => return Ok(refusal(500, "InternalError")),
        Some(Fault::SlowDown) => return Ok(refusal(503, "SlowDown")),
        Some(Fault::CutBefore) => return Err(cut()),
        Some(Fault::Slow) => tokio::time::sleep(Duration::from_millis(400)).await,
        _ => {}
    }
    let creating = if request.headers().contains_key("if-none-match") {
        Some(faults.creating.lock().await)
    } else {
        None
    };
    let answer = Service::call(&server, request).await.map_err(io::Error::other)?;
    drop(creating);
    match fault {
        Some(Fault::CutAfter) => Err(cut()),
        Some(Fault::CutAnswer) => Ok(answer.map(|body| {
            let mut left = 2000;
            let body = Body::new(body).into_data_stream().map(move |part| {
                let mut part = part.map_err(io::Error::other)?;
                if left == 0 {
                    return Err(cut());
                }
                part.truncate((part.len() / 2).min(left));
                left = 0;
                Ok(part)
            });
            Body::from_stream(body)
        })),
        _ => Ok(answer.map(Body::new)),
    }
}
