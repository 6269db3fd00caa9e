//! Tests a bucket over TLS with a private certificate authority: the program chooses its TLS provider before the first
//! connection, and trusts the authority only if `SSL_CERT_FILE` names it.

use crate::support::moto::Moto;
use crate::support::program::{Ended, command, text};
use crate::support::scenes::{photographs, scene};
use crate::support::tools::make_keys;
use std::path::Path;
use std::time::{Duration, Instant};

#[test]
fn a_private_authority_is_trusted_when_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    if make_keys(&path("keys"), &["localhost", "127.0.0.1"]).is_none() {
        return;
    }
    let Some(server) = Moto::start_tls(&path("keys/server")) else {
        return;
    };
    photographs(folder.path());
    let mut line = scene("tls");
    line["front"]["color"] = "s3://bucket/a.png".into();
    std::fs::write(path("scene.json"), line.to_string()).unwrap();
    let (scene, out) = (path("scene.json"), path("out"));
    let render = |authority: Option<&Path>| -> (Ended, Duration) {
        let mut command = command(&["render", text(&scene), "--out", text(&out)]);
        for (name, value) in server.options().settings {
            command.env(name, value);
        }
        if let Some(file) = authority {
            command.env("SSL_CERT_FILE", file);
        }
        let start = Instant::now();
        (command.output().unwrap().into(), start.elapsed())
    };
    // A trusted server responds that the bucket is absent.
    let (ended, _) = render(Some(&path("keys/ca/ca.pem")));
    ended.expect(4).says(&["NoSuchBucket"]);
    // The program does not retry an untrusted server.
    let (ended, took) = render(None);
    ended.expect(4).says(&["certificate"]);
    assert!(took < Duration::from_secs(20), "{took:?}");
}
