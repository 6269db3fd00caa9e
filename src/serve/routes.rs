//! Routes of the server, which answer or refuse requests.

use super::action::{Action, Token};
use super::server::FarmSource;
use super::view::FarmView;
use super::{metrics, page};
use axum::Router;
use axum::extract::{Path, Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{StatusCode, uri::Authority};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::Layer;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::Semaphore;
use tokio::time::timeout;

/// Time limit for an answer of the source.
const SOURCE_LIMIT: Duration = Duration::from_secs(20);
/// Maximum number of concurrent calls to the source. Pictures have a limit of their own, so that a slow store does not
/// delay other requests.
const CALLS: usize = 8;
/// Maximum length of a request's body, bytes; no route needs a body.
const BODY_BYTES: u64 = 4096;

/// State that all requests share.
#[derive(Clone)]
struct App {
    source: Arc<dyn FarmSource>,
    token: Option<Token>,
    listens_on: IpAddr,
    calls: Arc<Semaphore>,
    picture_calls: Arc<Semaphore>,
}

/// Status and message of a refused request.
type Refusal = (StatusCode, String);

pub(super) fn router(
    source: Arc<dyn FarmSource>,
    token: Option<Token>,
    listens_on: IpAddr,
) -> Router {
    let app = App {
        source,
        token,
        listens_on: listens_on.to_canonical(),
        calls: Arc::new(Semaphore::new(CALLS)),
        picture_calls: Arc::new(Semaphore::new(CALLS)),
    };
    Router::new()
        .route("/", get(index))
        .route("/live", get(live))
        .route("/healthz", get(async || "ok\n"))
        .route("/metrics", get(scrape))
        .route("/thumbnails/{scene}/{file}", get(thumbnail))
        .route("/api/view", get(view))
        .route("/api/pause", post(pause))
        .route("/api/resume", post(resume))
        .route("/api/cancel", post(cancel))
        .route("/api/retry/{scene}", post(retry))
        .fallback(async || refuse(StatusCode::NOT_FOUND, "no such page; try /"))
        .layer(from_fn_with_state(app.clone(), guard))
        .with_state(app)
}

fn refuse(status: StatusCode, sentence: &str) -> Refusal {
    (status, format!("{sentence}\n"))
}

/// Refuses requests for a foreign host or with a long body. Forbids browsers to guess the type of an answer, to embed
/// it in another site and, by default, to cache it.
async fn guard(State(app): State<App>, request: Request, next: Next) -> Response {
    let mut response = match app.admit(&request) {
        Ok(()) => next.run(request).await,
        Err(refusal) => refusal.into_response(),
    };
    let headers = response.headers_mut();
    let mut mark = |name: HeaderName, value| {
        let value = HeaderValue::from_static(value);
        headers.entry(name).or_insert(value);
    };
    mark(header::X_CONTENT_TYPE_OPTIONS, "nosniff");
    mark(header::REFERRER_POLICY, "no-referrer");
    mark(header::X_FRAME_OPTIONS, "DENY");
    mark(HeaderName::from_static("cross-origin-resource-policy"), "same-origin");
    mark(header::CONTENT_SECURITY_POLICY, "default-src 'none'; frame-ancestors 'none'");
    mark(header::CACHE_CONTROL, "no-store");
    response
}

impl App {
    fn admit(&self, request: &Request) -> Result<(), Refusal> {
        let headers = request.headers();
        if !self.is_ours(request) {
            return Err(refuse(
                StatusCode::FORBIDDEN,
                "wrong host name: the server listens on this machine only; open it as localhost or 127.0.0.1",
            ));
        }
        let length = headers.get(header::CONTENT_LENGTH);
        let length = length.and_then(|l| l.to_str().ok()?.parse::<u64>().ok());
        if length.is_some_and(|bytes| bytes > BODY_BYTES) {
            return Err(refuse(StatusCode::PAYLOAD_TOO_LARGE, "no request needs a body"));
        }
        Ok(())
    }

    /// True if the server listens for other machines or the request names this machine. On a loopback address, any
    /// other name comes from a foreign page that points its own name to this address (DNS rebinding). The port is not
    /// compared, because a tunnel may use another port.
    fn is_ours(&self, request: &Request) -> bool {
        if !self.listens_on.is_loopback() {
            return true;
        }
        let mut hosts = request.headers().get_all(header::HOST).iter();
        let (Some(host), None) = (hosts.next(), hosts.next()) else {
            return false;
        };
        let Ok(authority) = Authority::try_from(host.as_bytes()) else {
            return false;
        };
        let target = request.uri().authority();
        target.is_none_or(|a| self.is_our_name(a)) && self.is_our_name(&authority)
    }

    fn is_our_name(&self, authority: &Authority) -> bool {
        let name = authority.host();
        let address = name.trim_start_matches('[').trim_end_matches(']');
        let is_our_address = |ip: IpAddr| {
            let ip = ip.to_canonical();
            ip.is_loopback() || ip == self.listens_on
        };
        let has_user = authority.as_str().contains('@');
        !has_user
            && (name.eq_ignore_ascii_case("localhost") || address.parse().is_ok_and(is_our_address))
    }

    /// Calls the source on a thread that may block.
    async fn ask<T: Send + 'static>(
        &self,
        places: &Arc<Semaphore>,
        question: impl FnOnce(&dyn FarmSource) -> T + Send + 'static,
    ) -> Result<T, Refusal> {
        let (source, places) = (Arc::clone(&self.source), Arc::clone(places));
        let answer = async {
            let place = places.acquire_owned().await.ok()?;
            let call = move || {
                let answer = question(&*source);
                drop(place);
                answer
            };
            tokio::task::spawn_blocking(call).await.ok()
        };
        match timeout(SOURCE_LIMIT, answer).await {
            Ok(Some(answer)) => Ok(answer),
            Ok(None) => Err(refuse(
                StatusCode::INTERNAL_SERVER_ERROR,
                "the coordinator failed; see its log",
            )),
            Err(_) => Err(refuse(
                StatusCode::GATEWAY_TIMEOUT,
                "the coordinator does not answer; try again, and see its log",
            )),
        }
    }

    async fn view(&self) -> Result<FarmView, Refusal> {
        self.ask(&self.calls, |source| source.view()).await
    }

    /// Fails if the request carries no valid token.
    fn authorize(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let Some(token) = &self.token else {
            return Err(refuse(
                StatusCode::FORBIDDEN,
                "this server is read-only: start the coordinator with a token to allow actions",
            ));
        };
        let sentence = match headers.get(header::AUTHORIZATION) {
            Some(value) if token.opens(value.as_bytes()) => return Ok(()),
            Some(_) => "wrong token: send the coordinator's token as `Authorization: Bearer TOKEN`",
            None => "no token: send the coordinator's token as `Authorization: Bearer TOKEN`",
        };
        Err(refuse(StatusCode::FORBIDDEN, sentence))
    }

    async fn act(&self, headers: &HeaderMap, action: Action) -> Result<String, Refusal> {
        self.authorize(headers)?;
        let done = self.ask(&self.calls, |source| source.act(action)).await?;
        match done {
            Ok(()) => Ok("done\n".to_owned()),
            Err(why) => Err(refuse(StatusCode::CONFLICT, &why)),
        }
    }
}

async fn index(State(app): State<App>) -> Result<Response, Refusal> {
    let view = app.view().await?;
    let mut random = [0; 16];
    if getrandom::fill(&mut random).is_err() {
        return Err(refuse(
            StatusCode::INTERNAL_SERVER_ERROR,
            "the system has no random numbers for the page; /api/view needs none",
        ));
    }
    let nonce = STANDARD.encode(random);
    let policy = format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src 'self' data:; \
         connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    );
    let html = page::page(&view, &nonce, app.token.is_some());
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8"),
        (header::CONTENT_SECURITY_POLICY, policy.as_str()),
    ];
    Ok((headers, html).into_response())
}

/// Serves the changing part of the page to its script.
async fn live(State(app): State<App>) -> Result<Response, Refusal> {
    let html = page::live(&app.view().await?, app.token.is_some());
    Ok(([(header::CONTENT_TYPE, "text/html; charset=utf-8")], html).into_response())
}

async fn view(State(app): State<App>) -> Result<Response, Refusal> {
    let view = app.view().await?;
    let mut json = serde_json::to_string(&view).expect("a view is plain data");
    json.push('\n');
    Ok(([(header::CONTENT_TYPE, "application/json")], json).into_response())
}

async fn scrape(State(app): State<App>) -> Result<Response, Refusal> {
    let text = metrics::metrics(&app.view().await?);
    Ok(([(header::CONTENT_TYPE, metrics::CONTENT_TYPE)], text).into_response())
}

async fn thumbnail(
    State(app): State<App>,
    Path((scene, file)): Path<(String, String)>,
    headers: HeaderMap,
) -> Result<Response, Refusal> {
    let none = || refuse(StatusCode::NOT_FOUND, "no such picture");
    let scene = SceneId::new(scene).map_err(|_| none())?;
    let layer = file.strip_suffix(".png").ok_or_else(none)?;
    let layer = Layer::NAMES.into_iter().find(|l| *l == layer).ok_or_else(none)?;
    let png =
        app.ask(&app.picture_calls, move |s| s.thumbnail(&scene, layer)).await?.ok_or_else(none)?;
    let tag = format!("\"{}\"", &blake3::hash(&png).to_hex()[..32]);
    let known = headers.get(header::IF_NONE_MATCH);
    let is_known = known.is_some_and(|k| k.as_bytes() == tag.as_bytes());
    let headers = [
        (header::CONTENT_TYPE, "image/png"),
        (header::CACHE_CONTROL, "private, max-age=3600"),
        (header::ETAG, tag.as_str()),
    ];
    Ok(if is_known {
        (StatusCode::NOT_MODIFIED, headers).into_response()
    } else {
        (headers, png).into_response()
    })
}

async fn pause(State(app): State<App>, headers: HeaderMap) -> Result<String, Refusal> {
    app.act(&headers, Action::Pause).await
}

async fn resume(State(app): State<App>, headers: HeaderMap) -> Result<String, Refusal> {
    app.act(&headers, Action::Resume).await
}

async fn cancel(State(app): State<App>, headers: HeaderMap) -> Result<String, Refusal> {
    app.act(&headers, Action::Cancel).await
}

async fn retry(
    State(app): State<App>,
    Path(scene): Path<String>,
    headers: HeaderMap,
) -> Result<String, Refusal> {
    app.authorize(&headers)?;
    let scene = SceneId::new(scene).map_err(|e| refuse(StatusCode::NOT_FOUND, &e.to_string()))?;
    app.act(&headers, Action::Retry(scene)).await
}
