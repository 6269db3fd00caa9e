//! Starts and stops the server, and limits its connections.

use super::action::{Action, MIN_TOKEN_CHARACTERS, Token};
use super::routes::router;
use super::view::FarmView;
use glasshouse_line::ids::SceneId;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::net::{SocketAddr, TcpListener};
use std::pin::pin;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{Semaphore, oneshot};
use tokio::time::{sleep, timeout};

/// Maximum number of concurrent connections; further connections wait.
const MAX_CONNECTIONS: usize = 256;
/// Time limit for a request's head and for an idle connection.
const HEAD_LIMIT: Duration = Duration::from_secs(10);
/// Maximum length of a request's head, bytes.
const HEAD_BYTES: usize = 16 << 10;
/// Maximum number of lines in a request's head.
const HEAD_LINES: usize = 64;
/// Age at which a connection accepts no more requests, so that a slow client cannot keep it.
const CONNECTION_LIMIT: Duration = Duration::from_mins(1);
/// Time limit for the last answer on a connection.
const LAST_ANSWER_LIMIT: Duration = Duration::from_secs(10);

/// The source of views and the receiver of actions. Several threads call it concurrently. Calls may block (the caller
/// waits for at most 20 s), but a hung call occupies one of few slots.
pub trait FarmSource: Send + Sync {
    /// Returns the current state of the run. Each open page causes a call every two seconds, so a call must be cheap.
    fn view(&self) -> FarmView;
    /// Returns a small PNG of a layer of a scene's tuple (at most 256 px a side), if the tuple has it. `layer` is one
    /// of [`glasshouse_line::layer::Layer::NAMES`]; the scene may not exist.
    fn thumbnail(&self, scene: &SceneId, layer: &str) -> Option<Vec<u8>>;
    /// Carries out an action; the server has already checked the request's token. The error is a message for the user.
    fn act(&self, action: Action) -> Result<(), String>;
}

/// The reason why the server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The address is in use, does not belong to this machine, or is forbidden.
    #[error(
        "cannot listen on {address}: {source}; choose another address (port 0 picks a free one)"
    )]
    Listen { address: SocketAddr, source: std::io::Error },
    /// The system is out of threads or file descriptors.
    #[error("cannot start the web server: {0}")]
    Start(std::io::Error),
    /// The token is too short.
    #[error(
        "the web server's token has fewer than {MIN_TOKEN_CHARACTERS} characters; `openssl rand -hex 16` makes a token"
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
    /// Returns the listening address, with the port that the system chose for port 0.
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

/// Starts a server on `listen` that runs on its own thread and answers requests with data from `source`. Without a
/// `token`, the server refuses actions.
pub fn serve(
    listen: SocketAddr,
    source: Arc<dyn FarmSource>,
    token: Option<String>,
) -> Result<Server, ServeError> {
    let token = token.map(|text| Token::new(&text).ok_or(ServeError::WeakToken)).transpose()?;
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
        // This fails only if the runtime cannot register the socket.
        if let Ok(listener) = tokio::net::TcpListener::from_std(listener) {
            tokio::spawn(accept(listener, routes));
            let _ = stopped.await;
        }
    });
    // A hung call to the source must not keep the coordinator from exiting.
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
            // The system is out of descriptors, or the client has closed the connection.
            Err(_) => sleep(Duration::from_millis(100)).await,
        }
    }
}

/// Answers the requests of one connection. Ignores errors, because the client causes them.
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
