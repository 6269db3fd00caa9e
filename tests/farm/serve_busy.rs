//! Tests the coordinator's web server: slow clients, a hanging store, failures, shutdown, and refused settings.

use crate::serve_run::{Run, get, run, start};
use crate::support::tools::wait_for;
use glasshouse::serve::{FarmSource, ServeError, serve};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

#[test]
fn slow_clients_do_not_block_others() {
    let run = run();
    let server = start(&run, None);
    let at = server.address();
    let half = |text: &str| {
        let mut stream = TcpStream::connect(at).unwrap();
        stream.write_all(text.as_bytes()).unwrap();
        stream
    };
    // Some clients send incomplete requests; others do not read the responses.
    let mut slow: Vec<TcpStream> = (0..40).map(|_| half("GET / HTTP/1.1\r\nHost: loc")).collect();
    let unread = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n".repeat(50);
    slow.extend((0..10).map(|_| half(&unread)));
    // The store hangs, and the test requests more pictures than the server fetches at a time.
    *run.store_hangs.0.lock().unwrap() = true;
    let picture = "GET /thumbnails/train-1/input.png HTTP/1.1\r\nHost: localhost\r\n\r\n";
    slow.extend((0..20).map(|_| half(picture)));
    let begun = Instant::now();
    wait_for("a call to the source", || run.pictures_asked() > 0);
    for path in ["/", "/api/view", "/metrics", "/healthz"] {
        get(at, path).expect(200);
    }
    assert!(begun.elapsed() < Duration::from_secs(8), "{:?}", begun.elapsed());
    // The server closes connections with incomplete requests.
    let limit = Some(Duration::from_secs(30));
    slow[0].set_read_timeout(limit).unwrap();
    let _ = slow[0].read_to_end(&mut Vec::new());
    let waited = begun.elapsed();
    assert!(waited < Duration::from_secs(25), "{waited:?}");
    *run.store_hangs.0.lock().unwrap() = false;
    run.store_hangs.1.notify_all();
    get(at, "/thumbnails/train-1/input.png").expect(200);
}

#[test]
fn a_source_that_fails_does_not_end_the_server() {
    let run = run();
    let server = start(&run, None);
    run.panics.store(true, Ordering::Relaxed);
    for _ in 0..20 {
        get(server.address(), "/").expect(500);
    }
    run.panics.store(false, Ordering::Relaxed);
    get(server.address(), "/").expect(200);
}

#[test]
fn dropping_the_server_closes_the_port_and_the_connections() {
    let run = run();
    let server = start(&run, None);
    let at = server.address();
    assert_ne!(at.port(), 0);
    let mut open = TcpStream::connect(at).unwrap();
    open.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let mut first = [0; 12];
    open.read_exact(&mut first).unwrap();
    assert_eq!(&first, b"HTTP/1.1 200");
    // The server also stops while a call to the source hangs.
    *run.store_hangs.0.lock().unwrap() = true;
    let mut hung = TcpStream::connect(at).unwrap();
    hung.write_all(b"GET /thumbnails/train-1/input.png HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .unwrap();
    wait_for("a call to the source", || run.pictures_asked() > 0);
    let begun = Instant::now();
    drop(server);
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    assert!(TcpStream::connect(at).is_err());
    open.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    // The server closes or resets the connection.
    let ended = open.read_to_end(&mut Vec::new());
    assert!(ended.is_ok() || ended.unwrap_err().kind() == std::io::ErrorKind::ConnectionReset);
    let again: Arc<dyn FarmSource> = Arc::<Run>::clone(&run);
    let again = serve(at, again, None).unwrap();
    get(again.address(), "/healthz").expect(200);
    *run.store_hangs.0.lock().unwrap() = false;
    run.store_hangs.1.notify_all();
}

#[test]
fn a_port_in_use_and_a_weak_token_are_refused() {
    let run = run();
    let server = start(&run, None);
    let source = || -> Arc<dyn FarmSource> { Arc::<Run>::clone(&run) };
    let taken = serve(server.address(), source(), None).unwrap_err();
    assert!(taken.to_string().contains(&server.address().to_string()));
    assert!(taken.to_string().contains("choose another address"));
    let any = SocketAddr::from(([127, 0, 0, 1], 0));
    for token in ["", "short"] {
        let weak = serve(any, source(), Some(token.to_owned()));
        assert!(matches!(weak, Err(ServeError::WeakToken)));
    }
}
