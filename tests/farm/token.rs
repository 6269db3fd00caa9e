//! With the token, the requests of the status page's buttons have the effects of the commands.

use crate::processes::{end, slow_place, start};
use crate::serve_run::{get, request, view_address};
use crate::support::nats::Nats;
use crate::support::program::{Ended, Program, command, run, text};
use serde_json::Value;
use std::io::Read;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt;

const TOKEN: &str = "0123456789abcdef-test";

fn view(address: SocketAddr) -> Value {
    serde_json::from_slice(&get(address, "/api/view").expect(200).body).unwrap()
}

#[test]
fn the_pages_buttons_need_the_token() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let file = place.folder.path().join("token");
    std::fs::write(&file, format!("{TOKEN}\n")).unwrap();
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
    std::fs::create_dir(place.run.join("quarantine")).unwrap();
    let record = r#"{"schema":"glasshouse.quarantine/1","scene":"train-sample-000001","reason":"it rained"}"#;
    std::fs::write(place.run.join("quarantine/train-sample-000001.json"), record).unwrap();
    let more = ["--listen", "127.0.0.1:0", "--token-file", text(&file)];
    let mut coordinator = start("coordinate", &place, &server, &more);
    let (address, mut stderr) = view_address(&mut coordinator);

    let post = |path: &str, token: &str| {
        let header = format!("Authorization: Bearer {token}\r\n");
        request(address, "POST", path, &header)
    };
    post("/api/pause", "0123456789abcdef-tesu").expect(403);
    assert!(!place.run.join("control.json").exists());
    post("/api/pause", TOKEN).expect(200);
    assert_eq!(view(address)["state"], "paused");
    let status = run(&["status", text(&place.run), "--json"]).json();
    assert_eq!(status["state"], "paused");
    assert!(get(address, "/").expect(200).text().contains("/api/resume"));
    post("/api/resume", TOKEN).expect(200);
    assert_eq!(view(address)["state"], "running");
    assert!(!place.run.join("control.json").exists());
    let refused = post("/api/retry/train-sample-000000", TOKEN).expect(409);
    assert!(refused.text().contains("not in quarantine"), "{}", refused.text());
    post("/api/retry/train-sample-000001", TOKEN).expect(200);
    assert!(!place.run.join("quarantine/train-sample-000001.json").exists());
    post("/api/cancel", TOKEN).expect(200);
    let mut said = String::new();
    stderr.read_to_string(&mut said).unwrap();
    end(coordinator).expect(3);
    assert!(said.contains("cancelled") && !said.contains(TOKEN), "{said}");
}

#[test]
fn weak_tokens_and_tokens_on_the_command_line_are_refused() {
    let place = slow_place();
    let folder = text(&place.run);
    let coordinate = |more: &[&str]| {
        let all =
            ["coordinate", folder, "--queue", "nats://127.0.0.1:1", "--listen", "127.0.0.1:0"];
        command(&[&all[..], more].concat())
    };
    let ended = |mut command: Program| Ended::from(command.output().unwrap());
    ended(coordinate(&["--token", TOKEN])).expect(2);
    ended(coordinate(&["--token-file", "/nonexistent"])).expect(2).says(&["/nonexistent"]);
    let mut weak = coordinate(&[]);
    weak.env("GLASSHOUSE_TOKEN", "guess me");
    let weak = ended(weak).expect(2).says(&["16 characters"]);
    assert!(!weak.stderr.contains("guess me"));
}
