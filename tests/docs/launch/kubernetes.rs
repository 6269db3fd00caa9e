//! Checks the Kubernetes and compose files: no process runs as root, and workers have time to requeue their tasks.

use super::launch;
use super::yaml::{argument, at, documents, strings};
use yaml_rust2::Yaml;

/// Returns every workload with its name.
fn workloads() -> Vec<(String, Yaml)> {
    let files = ["nats", "coordinator", "workers"];
    let all = files.iter().flat_map(|f| documents(&launch(&format!("kubernetes/{f}.yaml"))));
    let named = all.map(|d| (at(&d, "metadata.name").as_str().unwrap().to_owned(), d));
    let found: Vec<(String, Yaml)> =
        named.filter(|(_, d)| !d["spec"]["template"].is_badvalue()).collect();
    assert_eq!(found.len(), 3);
    found
}

fn workload(name: &str) -> Yaml {
    let mut all = workloads().into_iter();
    all.find(|(n, _)| n == name).unwrap().1
}

fn words(name: &str) -> Vec<String> {
    let args = workload(name);
    let args = strings(at(&args, "spec.template.spec.containers.0.args"));
    args.into_iter().map(str::to_owned).collect()
}

#[test]
fn pods_have_least_privileges() {
    for (name, workload) in workloads() {
        let pod = at(&workload, "spec.template.spec");
        assert_eq!(pod["automountServiceAccountToken"].as_bool(), Some(false));
        let security = &pod["securityContext"];
        assert_eq!(security["runAsNonRoot"].as_bool(), Some(true), "{name}");
        assert!(security["runAsUser"].as_i64().unwrap() > 0);
        let profile = at(security, "seccompProfile.type");
        assert_eq!(profile.as_str(), Some("RuntimeDefault"));
        let [container] = pod["containers"].as_vec().unwrap().as_slice() else {
            panic!("{name} must have one container");
        };
        let security = &container["securityContext"];
        for (key, value) in [("readOnlyRootFilesystem", true), ("allowPrivilegeEscalation", false)]
        {
            assert_eq!(security[key].as_bool(), Some(value), "{name}: {key}");
        }
        assert_eq!(strings(at(security, "capabilities.drop")), ["ALL"]);
        for key in ["requests.cpu", "requests.memory", "limits.memory"] {
            let value = at(&container["resources"], key);
            assert!(value.as_str().is_some(), "{name}: {key}");
        }
    }
}

#[test]
fn mounted_volumes_exist_and_secrets_are_read_only() {
    for (name, workload) in workloads() {
        let pod = at(&workload, "spec.template.spec");
        let claims = &workload["spec"]["volumeClaimTemplates"];
        for mount in at(pod, "containers.0.volumeMounts").as_vec().unwrap() {
            let volume = mount["name"].as_str().unwrap();
            let is_claim = claims
                .as_vec()
                .is_some_and(|c| c.iter().any(|c| at(c, "metadata.name").as_str() == Some(volume)));
            let volumes = pod["volumes"].as_vec().unwrap();
            let found = volumes.iter().find(|v| v["name"].as_str() == Some(volume));
            assert!(found.is_some() || is_claim, "{name} has no volume {volume}");
            if let Some(secret) = found.and_then(|v| at(v, "secret.secretName").as_str()) {
                assert_eq!(mount["readOnly"].as_bool(), Some(true), "{name}: {volume}");
                // make-keys.sh makes a folder with each of these names.
                let role = secret.strip_prefix("glasshouse-").unwrap();
                assert!(["server", "coordinator", "worker"].contains(&role));
            }
        }
    }
}

#[test]
fn jobs_restart_after_a_stop_and_fail_after_permanent_errors() {
    for (name, again) in
        [("glasshouse-coordinator", "FailJob"), ("glasshouse-workers", "FailIndex")]
    {
        let job = workload(name);
        // A pod failure policy requires `Never`.
        let restart = at(&job, "spec.template.spec.restartPolicy");
        assert_eq!(restart.as_str(), Some("Never"));
        let rules = at(&job, "spec.podFailurePolicy.rules").as_vec().unwrap();
        let codes = |action: &str| -> Vec<i64> {
            let of_action = rules.iter().filter(|r| r["action"].as_str() == Some(action));
            let lists = of_action.filter_map(|r| at(r, "onExitCodes.values").as_vec());
            lists.flatten().map(|c| c.as_i64().unwrap()).collect()
        };
        assert_eq!(codes("Ignore"), [75, 143], "{name}");
        assert_eq!(codes(again), [2, 3, 4, 5], "{name}");
        let disrupted = rules.iter().any(|r| {
            at(r, "onPodConditions.0.type").as_str() == Some("DisruptionTarget")
                && r["action"].as_str() == Some("Ignore")
        });
        assert!(disrupted, "{name}");
    }
}

#[test]
fn workers_are_an_indexed_job_with_time_to_requeue() {
    let job = workload("glasshouse-workers");
    let spec = &job["spec"];
    assert_eq!(spec["completionMode"].as_str(), Some("Indexed"));
    assert_eq!(spec["completions"], spec["parallelism"]);
    assert!(spec["backoffLimitPerIndex"].as_i64().is_some());
    let pod = at(spec, "template.spec");
    assert!(pod["terminationGracePeriodSeconds"].as_i64().unwrap() >= 60);
    // A pod has as many processors as threads.
    let words = words("glasshouse-workers");
    let threads = words.iter().find_map(|w| w.strip_prefix("-j")).unwrap();
    let cpu = at(pod, "containers.0.resources.limits.cpu").as_str();
    assert_eq!(cpu, Some(threads));
}

/// A worker refuses a queue with a lease duration other than its own.
#[test]
fn coordinator_and_workers_agree() {
    let (one, other) = (words("glasshouse-coordinator"), words("glasshouse-workers"));
    let one: Vec<&str> = one.iter().map(String::as_str).collect();
    let other: Vec<&str> = other.iter().map(String::as_str).collect();
    assert_eq!((one[0], other[0], one[1]), ("coordinate", "work", other[1]));
    for flag in ["--queue", "--lease-s", "--queue-ca", "--queue-nkey"] {
        let value = argument(&one, flag);
        assert!(value.is_some(), "{flag}");
        assert_eq!(value, argument(&other, flag), "{flag}");
    }
    let service = documents(&launch("kubernetes/nats.yaml")).remove(0);
    let name = at(&service, "metadata.name").as_str().unwrap();
    let port = at(&service, "spec.ports.0.port").as_i64().unwrap();
    let url = format!("tls://{name}:{port}");
    assert_eq!(argument(&one, "--queue"), Some(url.as_str()));
}

#[test]
fn compose_has_the_same_restrictions() {
    let compose = documents(&launch("compose/compose.yaml")).remove(0);
    let services = &compose["services"];
    let names = ["nats", "coordinator", "worker"];
    assert_eq!(services.as_hash().unwrap().len(), names.len());
    for name in names {
        let service = &services[name];
        assert_eq!(at(service, "read_only").as_bool(), Some(true), "{name}");
        assert_eq!(strings(at(service, "cap_drop")), ["ALL"], "{name}");
        let options = strings(at(service, "security_opt"));
        assert_eq!(options, ["no-new-privileges:true"], "{name}");
        let user = at(service, "user").as_str().unwrap();
        assert!(!user.starts_with('0') && !user.starts_with("root"));
        let grace = at(service, "stop_grace_period").as_str().unwrap();
        let grace_s: u32 = grace.strip_suffix('s').unwrap().parse().unwrap();
        assert!(grace_s >= if name == "worker" { 60 } else { 20 });
        for volume in strings(at(service, "volumes")) {
            let is_key = volume.contains("KEYS");
            assert_eq!(is_key, volume.ends_with(":ro"), "{name}: {volume}");
        }
    }
    let commands = ["coordinator", "worker"].map(|n| at(&services[n], "command").as_str().unwrap());
    let [one, other] = commands.map(|c| c.split_whitespace().collect::<Vec<_>>());
    for flag in ["--queue", "--lease-s", "--queue-ca", "--queue-nkey"] {
        assert!(argument(&one, flag).is_some(), "{flag}");
        assert_eq!(argument(&one, flag), argument(&other, flag), "{flag}");
    }
}
