//! Sockets: how many connections, for how long, and how the server ends.

use super::action::{Action, MIN_TOKEN_CHARACTERS, Token};
use super::routes::router;
use super::view::FarmView;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use render::ids::SceneId;
use std::net::{SocketAddr, TcpListener};
use std::pin::pin;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{Semaphore, oneshot};
use tokio::time::{sleep, timeout};

/// Concurrent connections; more wait until one ends.
const MAX_CONNECTIONS: usize = 256;
/// Time limit of a request's head; also how long an idle connection is kept.
const HEAD_LIMIT: Duration = Duration::from_secs(10);
/// Bytes of a request's head.
const HEAD_BYTES: usize = 16 << 10;
/// Lines of a request's head.
const HEAD_LINES: usize = 64;
/// A connection takes no request after this time, so that a client that reads slowly, or never, does not keep it.
const CONNECTION_LIMIT: Duration = Duration::from_mins(1);
/// Time limit of its last answer.
const LAST_ANSWER_LIMIT: Duration = Duration::from_secs(10);

/// Where a server gets views and passes actions. Called from several threads at once; may block for a while (the caller
/// waits for 20 s at most), but a hung call occupies one of few places.
pub trait FarmSource: Send + Sync {
    /// The run as it is now. Called every two seconds for each open page: it must be cheap.
    fn view(&self) -> FarmView;
    /// A PNG of a layer of a merged scene's tuple, made small enough for a page (256 px wide, say); `None` if there is
    /// none. `layer` is one of [`render::layer::Layer::NAMES`]; the scene may not exist.
    fn thumbnail(&self, scene: &SceneId, layer: &str) -> Option<Vec<u8>>;
    /// Does something, or says in a sentence why not. Called only if a token is set and was given.
    fn act(&self, action: Action) -> Result<(), String>;
}

/// The server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address is taken, foreign or forbidden.
    #[error(
        "cannot listen on {address}: {source}; choose another address (port 0 picks a free one)"
    )]
    Listen { address: SocketAddr, source: std::io::Error },
    /// No thread, or no file descriptors.
    #[error("cannot start the web server: {0}")]
    Start(std::io::Error),
    /// A token that can be guessed.
    #[error(
        "the token for the web server has fewer than {MIN_TOKEN_CHARACTERS} characters; make one with `openssl rand -hex 16`"
    )]
    WeakToken,
}

/// A running server; dropping it closes the port and all connections.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// The address it listens on, with the port that the system chose for port 0.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(stop) = self.stop.take() {
            let _ = stop.send(());
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Listens on `listen` and answers requests from `source` on a thread of its own. Without a `token` it only shows.
pub fn serve(
    listen: SocketAddr,
    source: Arc<dyn FarmSource>,
    token: Option<String>,
) -> Result<Server, ServeError> {
    let token = match token {
        Some(text) => Some(Token::new(&text).ok_or(ServeError::WeakToken)?),
        None => None,
    };
    let cannot_listen = |e| ServeError::Listen { address: listen, source: e };
    let listener = TcpListener::bind(listen).map_err(cannot_listen)?;
    listener.set_nonblocking(true).map_err(cannot_listen)?;
    let address = listener.local_addr().map_err(cannot_listen)?;
    let runtime = Builder::new_current_thread()
        .enable_io()
        .enable_time()
        .build()
        .map_err(ServeError::Start)?;
    let routes = router(source, token, address.ip());
    let (stop, stopped) = oneshot::channel();
    let thread = std::thread::Builder::new()
        .name("serve".to_owned())
        .spawn(move || run(runtime, listener, routes, stopped))
        .map_err(ServeError::Start)?;
    Ok(Server { address, stop: Some(stop), thread: Some(thread) })
}

fn run(
    runtime: Runtime,
    listener: TcpListener,
    routes: axum::Router,
    stopped: oneshot::Receiver<()>,
) {
    runtime.block_on(async {
        // It can fail only without a runtime.
        if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
            tokio::spawn(accept(listener, routes));
            let _ = stopped.await;
        }
    });
    // A hung call of the source must not keep the coordinator from ending.
    runtime.shutdown_timeout(Duration::from_millis(500));
}

async fn accept(listener: tokio::net::TcpListener, routes: axum::Router) {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let Ok(place) = Arc::clone(&places).acquire_owned().await else {
            return;
        };
        match listener.accept().await {
            Ok((stream, _)) => {
                let routes = routes.clone();
                tokio::spawn(async move {
                    converse(stream, routes).await;
                    drop(place);
                });
            }
            // No descriptors left, or the client is gone already: the next one may fare better.
            Err(_) => sleep(Duration::from_millis(100)).await,
        }
    }
}

/// Answers the requests of one connection. Its errors are the client's.
async fn converse(stream: TcpStream, routes: axum::Router) {
    let _ = stream.set_nodelay(true);
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_LIMIT)
        .max_buf_size(HEAD_BYTES)
        .max_headers(HEAD_LINES)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(routes));
    let mut connection = pin!(connection);
    if timeout(CONNECTION_LIMIT, connection.as_mut()).await.is_err() {
        connection.as_mut().graceful_shutdown();
        let _ = timeout(LAST_ANSWER_LIMIT, connection).await;
    }
}
