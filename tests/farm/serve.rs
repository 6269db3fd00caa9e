//! Tests the coordinator's web server with HTTP requests over a socket.

use crate::serve_run::{HOSTILE, TOKEN, get, id, png, request, run, send, start, worker};
use crate::support::markup::strictly;
use glasshouse::run::RunState;
use glasshouse::serve::{Action, FarmSource, QuarantinedScene, WorkerState, serve};
use glasshouse_line::layer::Layer;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;

#[test]
fn every_route_answers() {
    let run = run();
    let server = start(&run, None);
    let at = server.address();
    let page = get(at, "/").expect(200);
    assert_eq!(page.headers["content-type"], "text/html; charset=utf-8");
    for word in [
        "paper",
        "0123abcd",
        "running",
        "1,234",
        "of 5,000 scenes",
        "24.6 %",
        "30.0",
        "scenes a minute",
        "2 h 05 min",
        "20,000",
        "1 lost",
        "3,700",
        "66 held",
        "train-5",
        "no finite depth",
        "last words",
        "train-1",
        "25.00 % missed",
        "6 min 52 s ago",
        "/thumbnails/train-1/clean_reflection.png",
    ] {
        assert!(page.text().contains(word), "no {word:?}");
    }
    strictly(page.text());
    // The page fetches nothing from other hosts, and runs only scripts with the nonce of this response.
    for elsewhere in ["http://", "https://", "\"//", "url(", "@import"] {
        assert!(!page.text().contains(elsewhere), "{elsewhere}");
    }
    let policy = &page.headers["content-security-policy"];
    let (_, nonce) = policy.split_once("script-src 'nonce-").unwrap();
    let nonce = nonce.split('\'').next().unwrap();
    assert!(policy.starts_with("default-src 'none'"));
    assert_eq!(page.text().matches("<script").count(), 1);
    assert!(page.text().contains(&format!("<script nonce=\"{nonce}\">")));
    assert!(!get(at, "/").text().contains(nonce), "a nonce is used once");

    let view = get(at, "/api/view").expect(200);
    assert_eq!(view.headers["content-type"], "application/json");
    let json: serde_json::Value = serde_json::from_slice(&view.body).unwrap();
    assert_eq!(json, serde_json::to_value(run.view()).unwrap());
    assert_eq!(json["schema"], "glasshouse.farm/1");
    assert_eq!(json["workers"][1]["state"], "lost");

    assert_eq!(get(at, "/healthz").expect(200).text(), "ok\n");
    assert!(request(at, "HEAD", "/", "").expect(200).body.is_empty());
    let live = get(at, "/live").expect(200);
    let (_, part) = live.text().split_once("</title>").unwrap();
    assert!(page.text().contains(part), "/live and / have the same content");
    let mut answers = vec![page, live, view, get(at, "/metrics").expect(200)];
    answers.push(get(at, "/nothing").expect(404));
    answers.push(get(at, "/thumbnails/train-1/input.png").expect(200));
    answers.push(request(at, "PUT", "/api/view", "").expect(405));
    answers.push(request(at, "POST", "/", "").expect(405));
    answers.push(request(at, "GET", "/api/pause", "").expect(405));
    for answer in answers {
        assert_eq!(answer.headers["x-content-type-options"], "nosniff");
        assert_eq!(answer.headers["referrer-policy"], "no-referrer");
        assert_eq!(answer.headers["cross-origin-resource-policy"], "same-origin");
        let policy = &answer.headers["content-security-policy"];
        assert!(policy.contains("default-src 'none'") && policy.contains("frame-ancestors 'none'"));
    }
}

#[test]
fn only_named_pictures_are_served() {
    let run = run();
    let server = start(&run, None);
    let at = server.address();
    for layer in Layer::NAMES {
        let path = format!("/thumbnails/train-1/{layer}.png?run=0123abcd");
        let picture = get(at, &path).expect(200);
        assert_eq!(picture.headers["content-type"], "image/png");
        assert!(picture.headers["cache-control"].contains("max-age="));
        assert_eq!(picture.body, png(layer));
        let known = format!("If-None-Match: {}\r\n", picture.headers["etag"]);
        assert!(request(at, "GET", &path, &known).expect(304).body.is_empty());
        request(at, "GET", &path, "If-None-Match: \"other\"\r\n").expect(200);
    }
    get(at, "/thumbnails/train-2/input.png").expect(404);
    let asked = run.pictures_asked();
    let long = format!("/thumbnails/{}/input.png", "x".repeat(129));
    for path in [
        "/thumbnails/..%2f..%2fetc/passwd",
        "/thumbnails/..%2f/input.png",
        "/thumbnails/../input.png",
        "/thumbnails/%2e%2e/input.png",
        "/thumbnails/train-1%00/input.png",
        "/thumbnails/train-1%ff/input.png",
        "/thumbnails/a%2fb/input.png",
        "/thumbnails/train-1/..%2finput.png",
        "/thumbnails/train-1/tuple.json",
        "/thumbnails/train-1/input",
        "/thumbnails/train-1/Input.png",
        "/thumbnails/train-1/input.png.png",
        "/thumbnails/train-1/input.png/x",
        "/thumbnails//input.png",
        "/../../etc/passwd",
        long.as_str(),
    ] {
        let status = get(at, path).status;
        assert!(status == 404 || status == 400, "{path}: {status}");
    }
    assert_eq!(run.pictures_asked(), asked);
}

#[test]
fn without_a_token_the_page_is_read_only() {
    let run = run();
    let server = start(&run, None);
    let at = server.address();
    let given = format!("Authorization: Bearer {TOKEN}\r\n");
    for path in ["/api/pause", "/api/resume", "/api/cancel", "/api/retry/train-5"] {
        for headers in ["", &given, "Authorization: Bearer \r\n"] {
            let refused = request(at, "POST", path, headers).expect(403);
            assert!(refused.text().contains("start the coordinator with a token"));
        }
    }
    assert!(run.acted.lock().unwrap().is_empty());
    assert!(!get(at, "/").text().contains("<button"));
}

#[test]
fn only_the_token_allows_actions() {
    let run = run();
    let server = start(&run, Some(TOKEN));
    let at = server.address();
    let page = get(at, "/");
    for target in ["/api/pause", "/api/cancel", "/api/retry/train-5"] {
        assert!(page.text().contains(&format!("data-post=\"{target}\"")));
    }
    assert!(!page.text().contains(TOKEN));
    let (shorter, longer) = (&TOKEN[..TOKEN.len() - 1], format!("{TOKEN}x"));
    for headers in [
        String::new(),
        format!("Authorization: Bearer {shorter}\r\n"),
        format!("Authorization: Bearer {longer}\r\n"),
        format!("Authorization: Basic {TOKEN}\r\n"),
        format!("Cookie: token={TOKEN}\r\n"),
        "Authorization: Bearer\r\n".to_owned(),
        "Authorization: \u{ff}\u{fe}\r\n".to_owned(),
    ] {
        let path = format!("/api/pause?token={}", TOKEN.replace(' ', "%20"));
        let refused = request(at, "POST", &path, &headers).expect(403);
        assert!(refused.text().contains("Authorization: Bearer TOKEN"));
        request(at, "POST", "/api/retry/..%2f", &headers).expect(403);
    }
    assert!(run.acted.lock().unwrap().is_empty());
    let given = format!("Authorization: Bearer {TOKEN}\r\n");
    for path in ["/api/pause", "/api/resume", "/api/retry/train-5", "/api/cancel"] {
        request(at, "POST", path, &given).expect(200);
    }
    for bad in ["..%2f", "a.b", "%00", "a%2fb", "x%20y"] {
        request(at, "POST", &format!("/api/retry/{bad}"), &given).expect(404);
    }
    let acted = std::mem::take(&mut *run.acted.lock().unwrap());
    let retry = Action::Retry(id("train-5"));
    assert_eq!(acted, [Action::Pause, Action::Resume, retry, Action::Cancel]);
    run.refuses.store(true, Ordering::Relaxed);
    let refused = request(at, "POST", "/api/pause", &given).expect(409);
    assert_eq!(refused.text(), "the run is finished\n");
    let large = format!("{given}Content-Length: 5000\r\n");
    request(at, "POST", "/api/pause", &large).expect(413);
    let long = format!("X-Long: {}\r\n", "x".repeat(20_000));
    request(at, "GET", "/", &long).expect(431);
}

#[test]
fn requests_with_a_foreign_host_name_are_refused() {
    let run = run();
    let server = start(&run, None);
    let at = server.address();
    let port = at.port();
    let ask = |first: &str, hosts: &str| {
        send(at, &format!("GET {first} HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n"))
    };
    for host in [
        format!("localhost:{port}"),
        format!("127.0.0.1:{port}"),
        format!("[::1]:{port}"),
        "LOCALHOST".to_owned(),
        "127.0.0.1".to_owned(),
        // A tunnel may have another port.
        "localhost:9999".to_owned(),
    ] {
        ask("/", &format!("Host: {host}\r\n")).expect(200);
    }
    for host in [
        "evil.example",
        "localhost.evil.example",
        "127.0.0.1.evil.example",
        "evil.example:80",
        "localhost@evil.example",
        "evil@localhost",
        "192.0.2.7",
        "[::2]",
        "",
        "a b",
    ] {
        for path in ["/", "/api/view", "/metrics", "/healthz", "/nothing"] {
            let refused = ask(path, &format!("Host: {host}\r\n"));
            assert!(matches!(refused.status, 400 | 403), "{host}: {}", refused.status);
            assert!(!refused.text().contains("paper"));
        }
    }
    let sentence = ask("/", "Host: evil.example\r\n").expect(403);
    assert!(sentence.text().contains("localhost"), "{sentence:?}");
    ask("/", "").expect(403);
    ask("/", "Host: localhost\r\nHost: evil.example\r\n").expect(403);
    ask("http://evil.example/", "Host: localhost\r\n").expect(403);

    // A server that listens for other machines accepts all host names, since it cannot determine its own.
    let source: Arc<dyn FarmSource> = run;
    let open = serve(SocketAddr::from(([0, 0, 0, 0], 0)), source, None).unwrap();
    let at = SocketAddr::from(([127, 0, 0, 1], open.address().port()));
    let request = "GET / HTTP/1.1\r\nHost: farm.example\r\nConnection: close\r\n\r\n";
    send(at, request).expect(200);
}

#[test]
fn hostile_text_stays_text() {
    let run = run();
    {
        let mut view = run.view.lock().unwrap();
        view.name = HOSTILE.to_owned();
        view.run = HOSTILE.to_owned();
        view.version = HOSTILE.to_owned();
        view.queue.connected = false;
        view.queue.reason = Some(HOSTILE.to_owned());
        view.quarantine[0].reason = HOSTILE.repeat(100);
        view.quarantine[0].log_tail = Some(format!("\x1b[31m</pre>{HOSTILE}"));
        view.recent[0].worker = Some(HOSTILE.to_owned());
        view.recent[0].layers.push(HOSTILE.to_owned());
        view.workers[0].name = HOSTILE.to_owned();
        view.workers[0].host = HOSTILE.to_owned();
        view.workers[0].version = HOSTILE.to_owned();
    }
    let server = start(&run, Some(TOKEN));
    for path in ["/", "/live"] {
        let page = get(server.address(), path).expect(200);
        assert!(!page.text().contains("<img src=x"));
        assert!(!page.text().contains("onerror=\""));
        assert!(!page.text().contains('\x1b'));
        assert!(page.text().contains("&lt;img src=x onerror=&quot;document"));
    }
    strictly(get(server.address(), "/").expect(200).text());
    let view = get(server.address(), "/api/view").expect(200);
    let json: serde_json::Value = serde_json::from_slice(&view.body).unwrap();
    assert_eq!(json["name"], HOSTILE);
}

#[test]
fn a_large_farm_has_a_small_page_with_the_worst_first() {
    let run = run();
    {
        let mut view = run.view.lock().unwrap();
        view.workers = (0..500)
            .map(|n| {
                let state = if n % 250 == 77 { WorkerState::Lost } else { WorkerState::Working };
                worker(&format!("w{n:03}"), state, f64::from(n))
            })
            .collect();
        view.quarantine = (0..400)
            .map(|n| QuarantinedScene {
                scene: id(&format!("bad-{n:03}")),
                reason: "long ".repeat(10_000),
                log_tail: Some(format!("{}the end", "long ".repeat(10_000))),
            })
            .collect();
        view.quarantined = 450;
    }
    let server = start(&run, None);
    let page = get(server.address(), "/").expect(200);
    let page = page.text();
    let place = |name: &str| page.find(&format!("data-key=\"{name}\""));
    assert!(place("w327").unwrap() < place("w077").unwrap());
    assert!(place("w077").unwrap() < place("w499").unwrap());
    assert!(place("w402").is_some() && place("w401").is_none());
    assert!(page.contains("and 400 more workers"));
    assert!(place("bad-049").is_some() && place("bad-050").is_none());
    assert!(page.contains("and 400 more scenes"));
    assert!(page.contains("the end</pre>"));
    assert!(page.len() < 500_000, "{} bytes", page.len());
}

#[test]
fn the_page_reports_an_absent_queue_and_absent_workers() {
    let run = run();
    let server = start(&run, Some(TOKEN));
    let page = || get(server.address(), "/").expect(200).text().to_owned();
    assert!(!page().contains("No queue:"));
    {
        let mut view = run.view.lock().unwrap();
        view.queue.connected = false;
        view.queue.reason = Some("connection refused".to_owned());
        view.workers.clear();
    }
    assert!(page().contains("No queue:</b> connection refused. Workers"));
    assert!(page().contains("No worker."));
    run.view.lock().unwrap().state = RunState::Paused;
    assert!(page().contains("/api/resume") && !page().contains("/api/pause"));
    assert!(!page().contains("No worker."), "a paused run needs no worker");
    run.view.lock().unwrap().state = RunState::Finished;
    assert!(!page().contains("/api/resume") && !page().contains("/api/cancel"));
}
