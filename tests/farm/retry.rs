//! `retry` takes scenes out of quarantine, in a running and in a finished run.

use crate::processes::{all_done, alone, coordinator, end, results, slow_place, worker};
use crate::support::nats::Nats;
use crate::support::outputs::{assert_same, tuples};
use crate::support::program::{run, text};
use crate::support::scenes::{SCENES, photographs, scene, write_lines};
use crate::support::tools::wait_for;
use serde_json::json;

#[test]
fn a_repaired_scene_is_rendered() {
    let folder = tempfile::tempdir().unwrap();
    photographs(folder.path());
    let mut bad = scene("bad");
    bad["back"]["color"] = json!("late.png");
    let manifest = folder.path().join("scenes.jsonl");
    write_lines(&manifest, &[scene("good"), bad]);
    let out = folder.path().join("run");
    let out = text(&out);
    // The test removes the photograph after planning.
    let late = folder.path().join("late.png");
    std::fs::copy(folder.path().join("b.png"), &late).unwrap();
    run(&["plan", text(&manifest), "--out", out]).expect(0);
    std::fs::remove_file(&late).unwrap();
    run(&["run", text(&manifest), "--out", out]).expect(3).says(&["late.png"]);

    let refused = run(&["retry", out, "bad", "good", "ugly", "--json"]).expect(2);
    let error = refused.json()["error"].as_str().unwrap().to_owned();
    for part in
        ["good is not in quarantine: it is done", "ugly is not a scene", "nothing was changed"]
    {
        assert!(error.contains(part), "{error}");
    }
    let would = run(&["retry", out, "bad", "-n", "--json"]).expect(0).json();
    assert_eq!(would["retried"], json!(["bad"]));
    run(&["work", out]).expect(3);

    std::fs::copy(folder.path().join("b.png"), late).unwrap();
    let done = run(&["retry", out, "--all", "--json"]).expect(0).json();
    assert_eq!(done["retried"], json!(["bad"]));
    let ended = run(&["work", out, "--json"]).expect(0).json();
    assert_eq!(ended["merged"], 1);
    let nothing = run(&["retry", out, "--all", "--json"]).expect(0).json();
    assert_eq!(nothing["retried"], json!([]));
}

#[test]
fn a_coordinator_notices_a_retry_and_a_finished_farm_resumes() {
    let Some(server) = Nats::start() else { return };
    let place = slow_place();
    let quarantine = |scene: &str| {
        let record =
            json!({"schema": "glasshouse.quarantine/1", "scene": scene, "reason": "it rained"});
        let attempts = place.run.join("attempts").join(scene);
        std::fs::create_dir_all(place.run.join("quarantine")).unwrap();
        std::fs::create_dir_all(&attempts).unwrap();
        std::fs::write(place.run.join(format!("quarantine/{scene}.json")), record.to_string())
            .unwrap();
        std::fs::write(attempts.join("0-192.1.json"), b"{}").unwrap();
    };
    quarantine("train-sample-000000");
    quarantine("test-sample-000000");
    let retry = |scene: &str| run(&["retry", text(&place.run), scene, "--json"]).expect(0).json();
    let first = coordinator(&place, &server);
    let working = worker(&place, &server);
    wait_for("a result", || results(&place.run) > 0);
    let done = retry("train-sample-000000");
    assert_eq!(done["attempts_removed"], 1);
    assert_eq!(done["was_finished"], false);
    let ended = end(first).expect(3).json();
    assert_eq!((&ended["done"], &ended["quarantined"]), (&(SCENES - 1).into(), &1.into()));
    end(working).expect(0);

    // The run is finished, and starts again.
    let done = retry("test-sample-000000");
    assert_eq!(done["was_finished"], true);
    all_done(coordinator(&place, &server), [worker(&place, &server)]);
    assert_same(&tuples(&place.run), alone(&place));
}
