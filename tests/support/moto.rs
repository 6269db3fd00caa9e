//! Starts moto, an S3 server in Python. Unlike s3s-fs, it reports absent buckets and obeys `If-None-Match` of a get; it
//! also has TLS. Its conditional puts check a key and then write, so two simultaneous puts may both succeed.

use super::program::text;
use super::tools::{Daemon, free_port, listens, wait_for};
use glasshouse::store::{Store, StoreOptions};
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;

/// A moto_server, which is killed when dropped.
pub(crate) struct Moto {
    _server: Daemon,
    endpoint: String,
}

impl Moto {
    /// Starts a server with an empty bucket; returns `None`, and prints a note, if moto does not start.
    pub(crate) fn start() -> Option<Self> {
        let server = Self::spawn("http", &[])?;
        server.make_bucket();
        Some(server)
    }

    /// Starts a TLS server without a bucket, with the certificate in `keys`; returns `None` like [`Self::start`].
    pub(crate) fn start_tls(keys: &Path) -> Option<Self> {
        let (certificate, key) = (keys.join("cert.pem"), keys.join("key.pem"));
        Self::spawn("https", &["-s", "-c", text(&certificate), "-k", text(&key)])
    }

    fn spawn(scheme: &str, more: &[&str]) -> Option<Self> {
        let port = free_port();
        let mut command = Command::new("moto_server");
        command.args(["-H", "127.0.0.1", "-p", &port.to_string()]);
        let mut server = Daemon::start(command.args(more))?;
        wait_for("the start of moto", || server.ended().is_some() || listens(port));
        if server.ended().is_some() {
            eprintln!("skipped: moto_server does not start (pip install 'moto[server]')");
            return None;
        }
        Some(Self { _server: server, endpoint: format!("{scheme}://localhost:{port}") })
    }

    /// Makes the bucket with an unsigned request, which moto accepts.
    fn make_bucket(&self) {
        use std::io::{Read, Write};
        let address = self.endpoint.trim_start_matches("http://");
        let mut stream = TcpStream::connect(address).unwrap();
        let request = "PUT /bucket HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    }

    pub(crate) fn store(&self, prefix: &str) -> Store {
        self.store_at(&format!("s3://bucket/{prefix}"))
    }

    pub(crate) fn store_at(&self, address: &str) -> Store {
        Store::open(address, &self.options()).unwrap()
    }

    pub(crate) fn options(&self) -> StoreOptions {
        let settings = [
            ("AWS_ENDPOINT_URL", self.endpoint.as_str()),
            ("AWS_ACCESS_KEY_ID", "a"),
            ("AWS_SECRET_ACCESS_KEY", "b"),
        ];
        StoreOptions {
            settings: settings.map(|(k, v)| (k.to_owned(), v.to_owned())).into(),
            ..StoreOptions::default()
        }
    }
}
