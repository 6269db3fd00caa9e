//! Checks the server of the queue: answer time, JetStream, version.

#[cfg(feature = "nats")]
use super::clock::compare;
use super::finding::{Finding, Level, seconds_text};
#[cfg(feature = "nats")]
use crate::farm::queue::{NatsOptions, probe_nats};
use serde_json::json;

/// Oldest server version with all required functions.
const OLDEST: [u32; 3] = [2, 9, 10];
const RECOMMENDED: [u32; 3] = [2, 12, 0];
/// Answer time above which a server is too slow, s. Workers query the server for every task.
const SLOW_S: f64 = 0.5;

/// Connects and queries the limits; if the server answers, also creates and removes a small stream in memory.
#[cfg(feature = "nats")]
pub fn check_queue(options: &NatsOptions) -> Vec<Finding> {
    let facts = match probe_nats(options) {
        Ok(facts) => facts,
        Err(error) => {
            let to_do =
                "check the address, that the server runs, and that this machine can reach its port";
            return vec![Finding::fail("queue", error.to_string(), to_do)];
        }
    };
    let mut findings = vec![judge_queue(&facts.version, facts.answer.as_secs_f64())];
    findings.push(match (&facts.account, facts.has_jetstream) {
        (Ok(account), _) => {
            let limit = |most: Option<i64>| most.map_or("no limit".to_owned(), |n| format!("{n} allowed"));
            let text = format!(
                "enabled; {} streams ({}), {} bytes on its disk ({})",
                account.streams,
                limit(account.max_streams),
                account.storage_bytes,
                limit(account.max_storage_bytes)
            );
            let is_full = account.max_streams.is_some_and(|most| most >= 0 && account.streams as i64 >= most);
            Finding::ok("JetStream", text)
                .unless(!is_full, Level::Fail, "no stream can be added: remove old ones (`nats stream ls`), or raise the limit")
                .with("streams", account.streams)
                .with("max_streams", json!(account.max_streams))
                .with("max_storage_bytes", json!(account.max_storage_bytes))
        }
        (Err(None), true) => Finding::ok(
            "JetStream",
            "enabled; this user may not read its limits, but a worker does not need them",
        ),
        (Err(Some(reason)), true) => Finding::ok("JetStream", format!("enabled; its limits cannot be read ({reason})")),
        (Err(reason), false) => Finding::fail(
            "JetStream",
            format!("does not answer: {}", reason.as_deref().unwrap_or("no answer in time")),
            "start the server with JetStream (`nats-server -js`), and enable it for this account",
        ),
    });
    match facts.made {
        Some(Ok((there, between))) => findings.push(compare("queue clock", there, between, 0.0)),
        Some(Err(reason)) => findings.push(Finding::warn(
            "streams",
            format!("this user cannot create a stream: {reason}"),
            "right for the key of a worker; the key of a coordinator needs this permission",
        )),
        None => {}
    }
    findings
}

/// Judges a server by its version and its answer time in seconds.
pub fn judge_queue(version: &str, answer_s: f64) -> Finding {
    let numbers = numbers(version);
    let text = format!("nats-server {version} answers in {}", seconds_text(answer_s));
    let old = format!(
        "use {} or newer; {}.{} is recommended",
        OLDEST.map(|n| n.to_string()).join("."),
        RECOMMENDED[0],
        RECOMMENDED[1]
    );
    Finding::ok("queue", text)
        .unless(numbers.is_none_or(|n| n >= OLDEST), Level::Fail, old.clone())
        .unless(numbers.is_none_or(|n| n >= RECOMMENDED), Level::Warn, old)
        .unless(answer_s < SLOW_S, Level::Warn, "use a server nearer to the workers")
        .with("version", version)
        .with("answer_s", answer_s)
}

/// Parses the three numbers of a version such as `2.10.22-beta`; ignores its suffix.
fn numbers(version: &str) -> Option<[u32; 3]> {
    let plain = version.split(['-', '+']).next()?;
    let mut parts = plain.split('.').map(|part| part.parse().ok());
    Some([parts.next()??, parts.next()??, parts.next()??])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_servers_are_reported() {
        let level = |version| judge_queue(version, 0.01).level;
        assert_eq!(level("2.9.9"), Level::Fail);
        assert_eq!((level("2.9.10"), level("2.11.3")), (Level::Warn, Level::Warn));
        assert_eq!(
            (level("2.12.0-RC.1"), level("3.0.0"), level("odd")),
            (Level::Ok, Level::Ok, Level::Ok)
        );
        assert_eq!(judge_queue("2.12.0", 2.0).level, Level::Warn);
    }
}
