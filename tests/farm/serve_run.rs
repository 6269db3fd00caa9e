//! A run in memory for the web server, and a client that sends HTTP requests over a socket.

use crate::support::program::Running;
use glasshouse::run::RunState;
use glasshouse::serve::{
    Action, Count, FARM_SCHEMA, FarmSource, FarmView, QuarantinedScene, QueueView, RecentTuple,
    Server, WorkerState, WorkerView, serve,
};
use glasshouse_line::ids::SceneId;
use glasshouse_line::layer::Layer;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

pub(crate) const TOKEN: &str = "a token of the test";
/// Hostile content of a name or a reason.
pub(crate) const HOSTILE: &str =
    "<img src=x onerror=\"document.title='pwned'\">\\\"'}\n& {x=\"1\"} 1";

/// Reads the address of a coordinator's status page. Returns the rest of its standard error, too.
pub(crate) fn view_address(coordinator: &mut Running) -> (SocketAddr, impl Read + use<>) {
    let mut stderr = BufReader::new(coordinator.stderr.take().unwrap());
    let mut said = String::new();
    stderr.read_line(&mut said).unwrap();
    let address = said.split("http://").nth(1).unwrap().trim_end().trim_end_matches('/');
    (address.parse().unwrap(), stderr)
}

/// A run in memory, which counts requests for pictures and records actions.
pub(crate) struct Run {
    pub(crate) view: Mutex<FarmView>,
    /// True if each view has one more finished scene than the last.
    pub(crate) goes_on: AtomicBool,
    pub(crate) acted: Mutex<Vec<Action>>,
    pub(crate) refuses: AtomicBool,
    pub(crate) panics: AtomicBool,
    pub(crate) pictures_asked: AtomicUsize,
    /// True while requests for pictures wait.
    pub(crate) store_hangs: (Mutex<bool>, Condvar),
}

impl Run {
    pub(crate) fn pictures_asked(&self) -> usize {
        self.pictures_asked.load(Ordering::Relaxed)
    }
}

impl FarmSource for Run {
    fn view(&self) -> FarmView {
        assert!(!self.panics.load(Ordering::Relaxed), "the test requested a panic");
        let mut view = self.view.lock().unwrap();
        if self.goes_on.load(Ordering::Relaxed) {
            view.scenes.done += 1;
        }
        view.clone()
    }

    fn thumbnail(&self, scene: &SceneId, layer: &str) -> Option<Vec<u8>> {
        self.pictures_asked.fetch_add(1, Ordering::Relaxed);
        let mut hangs = self.store_hangs.0.lock().unwrap();
        while *hangs {
            hangs = self.store_hangs.1.wait(hangs).unwrap();
        }
        (scene.as_str() == "train-1").then(|| png(layer))
    }

    fn act(&self, action: Action) -> Result<(), String> {
        if self.refuses.load(Ordering::Relaxed) {
            return Err("the run is finished".to_owned());
        }
        self.acted.lock().unwrap().push(action);
        Ok(())
    }
}

/// Makes a picture of a colour that depends on the length of the layer's name.
pub(crate) fn png(layer: &str) -> Vec<u8> {
    let value = layer.len() as u8;
    let picture = image::RgbImage::from_pixel(4, 3, image::Rgb([value, 128, 255 - value]));
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

pub(crate) fn id(text: &str) -> SceneId {
    SceneId::new(text).unwrap()
}

pub(crate) fn worker(name: &str, state: WorkerState, last_progress_s: f64) -> WorkerView {
    WorkerView {
        name: name.to_owned(),
        host: "host".to_owned(),
        version: "0.1.0".to_owned(),
        state,
        last_progress_s,
        scene: Some(id("train-7")),
        shard: Some(3),
        shards_done: 12,
    }
}

/// Makes a run with two workers, a recent tuple and a scene in quarantine.
pub(crate) fn run() -> Arc<Run> {
    let recent = RecentTuple {
        scene: id("train-1"),
        age_s: 4.2,
        worker: Some("one".to_owned()),
        miss_share: Some(0.25),
        layers: Layer::NAMES.map(str::to_owned).to_vec(),
    };
    let bad = QuarantinedScene {
        scene: id("train-5"),
        reason: "no finite depth".to_owned(),
        log_tail: Some("last words".to_owned()),
    };
    let view = FarmView {
        schema: FARM_SCHEMA,
        name: "paper".to_owned(),
        run: "0123abcd".to_owned(),
        version: "0.1.0".to_owned(),
        state: RunState::Running,
        scenes: Count { done: 1234, total: 5000 },
        shards: Count { done: 20_000, total: 80_000 },
        quarantined: 1,
        rate_scenes_per_s: Some(0.5),
        eta_s: Some(7532.0),
        queue: QueueView {
            connected: true,
            reason: None,
            spans_waiting: Some(3700),
            spans_held: Some(66),
        },
        workers: vec![
            worker("one", WorkerState::Working, 0.5),
            worker("two", WorkerState::Lost, 412.0),
        ],
        quarantine: vec![bad],
        recent: vec![recent],
    };
    Arc::new(Run {
        view: Mutex::new(view),
        goes_on: AtomicBool::new(false),
        acted: Mutex::default(),
        refuses: AtomicBool::new(false),
        panics: AtomicBool::new(false),
        pictures_asked: AtomicUsize::new(0),
        store_hangs: (Mutex::new(false), Condvar::new()),
    })
}

pub(crate) fn start(run: &Arc<Run>, token: Option<&str>) -> Server {
    let source: Arc<dyn FarmSource> = Arc::<Run>::clone(run);
    let any_port = SocketAddr::from(([127, 0, 0, 1], 0));
    serve(any_port, source, token.map(str::to_owned)).unwrap()
}

/// A parsed response.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) headers: BTreeMap<String, String>,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn text(&self) -> &str {
        std::str::from_utf8(&self.body).unwrap()
    }

    #[track_caller]
    pub(crate) fn expect(self, status: u16) -> Self {
        assert_eq!(self.status, status, "{:?} {}", self.headers, self.text());
        self
    }
}

/// Sends a request, reads until the server closes the connection, and parses the response.
pub(crate) fn send(address: SocketAddr, request: &str) -> Answer {
    let mut stream = TcpStream::connect(address).unwrap();
    let limit = Some(Duration::from_secs(30));
    stream.set_read_timeout(limit).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut bytes = Vec::new();
    // A server that refuses a request without reading all of it resets the connection after its response.
    let _ = stream.read_to_end(&mut bytes);
    let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap();
    let head = std::str::from_utf8(&bytes[..end]).unwrap();
    let (first, lines) = head.split_once("\r\n").unwrap();
    let headers = lines.lines().map(|line| line.split_once(": ").unwrap());
    Answer {
        status: first.split(' ').nth(1).unwrap().parse().unwrap(),
        headers: headers.map(|(key, value)| (key.to_ascii_lowercase(), value.to_owned())).collect(),
        body: bytes[end + 4..].to_vec(),
    }
}

pub(crate) fn request(address: SocketAddr, method: &str, path: &str, more: &str) -> Answer {
    let head =
        format!("{method} {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{more}\r\n");
    send(address, &head)
}

pub(crate) fn get(address: SocketAddr, path: &str) -> Answer {
    request(address, "GET", path, "")
}
