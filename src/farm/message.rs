//! The messages between processes of a run: a version byte, then bincode.

use super::queue::{Answer, Message};
use crate::run::Task;
use bincode::config::{Configuration, Fixint, LittleEndian};
use bincode::{Decode, Encode};

/// Version of the encoding. A worker removes messages of other versions; the coordinator publishes their scenes again.
const VERSION: u8 = 1;

/// Largest number of times that a task is passed on. A farm passes a task on a few times; a larger number is forged.
const MOST_HOPS: u32 = 1 << 24;

const CONFIG: Configuration<LittleEndian, Fixint> =
    bincode::config::standard().with_fixed_int_encoding();

#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
struct TaskMessage {
    /// First eight bytes of the BLAKE3 digest of the run's spec, to refuse messages of another run.
    run: [u8; 8],
    /// Index of the scene in the manifest.
    scene: u32,
    start: u32,
    /// One past the last shard.
    end: u32,
    hops: u32,
}

/// Encodes a request of an idle worker: its time to load a scene, in microseconds, or 0 if it has loaded none.
pub(super) fn write_request(load_s: Option<f64>) -> Vec<u8> {
    encode(&micros(load_s))
}

pub(super) fn read_request(bytes: &[u8]) -> Result<Option<f64>, MessageError> {
    Ok(seconds(decode(bytes)?))
}

/// Encodes a donor's answer: the number of tasks that it published, and its load time as in a request.
pub(super) fn write_answer(answer: Answer) -> Vec<u8> {
    encode(&(answer.tasks, micros(answer.load_s)))
}

pub(super) fn read_answer(bytes: &[u8]) -> Result<Answer, MessageError> {
    let (tasks, load_us) = decode(bytes)?;
    Ok(Answer { tasks, load_s: seconds(load_us) })
}

fn micros(seconds: Option<f64>) -> u32 {
    seconds.map_or(0, |s| (s * 1e6).max(1.0) as u32)
}

fn seconds(micros: u32) -> Option<f64> {
    (micros > 0).then(|| f64::from(micros) / 1e6)
}

#[derive(Debug, thiserror::Error)]
#[error(
    "cannot decode a message of {length} bytes ({reason}); are there workers of another version in this run?"
)]
pub struct MessageError {
    length: usize,
    reason: String,
}

pub fn write_message(run: [u8; 8], message: &Message) -> Vec<u8> {
    encode(&TaskMessage {
        run,
        scene: message.task.scene,
        start: message.task.shards.start,
        end: message.task.shards.end,
        hops: message.hops,
    })
}

/// Decodes a message from an untrusted sender. `shards` has the number of shards of each scene. Returns `None` if the
/// message belongs to another run, names a scene or shards that the run does not have, no shards, or too many hops.
pub fn read_message(
    bytes: &[u8],
    run: [u8; 8],
    shards: &[u32],
) -> Result<Option<Message>, MessageError> {
    let m: TaskMessage = decode(bytes)?;
    let message = Message { task: Task { scene: m.scene, shards: m.start..m.end }, hops: m.hops };
    Ok((m.run == run && is_valid(&message, shards)).then_some(message))
}

/// True if the run has the message's shards; `shards` has the number of shards of each scene.
pub(super) fn is_valid(message: &Message, shards: &[u32]) -> bool {
    let Task { scene, shards: own } = &message.task;
    let count = shards.get(*scene as usize).copied().unwrap_or(0);
    own.start < own.end && own.end <= count && message.hops <= MOST_HOPS
}

/// Returns the end of a message's subject, which names its task and its hops.
pub(super) fn write_subject(message: &Message) -> String {
    let Message { task, hops } = message;
    format!("span.{}.{}-{}.{hops}", task.scene, task.shards.start, task.shards.end)
}

/// Reads the end of a subject as [`write_subject`] writes it; `None` for all other texts and for shards that the run
/// does not have.
pub(super) fn read_subject(text: &str, shards: &[u32]) -> Option<Message> {
    let mut parts = text.strip_prefix("span.")?.split('.');
    let (scene, range, hops) = (parts.next()?, parts.next()?, parts.next()?);
    let (start, end) = range.split_once('-')?;
    let task = Task { scene: scene.parse().ok()?, shards: start.parse().ok()?..end.parse().ok()? };
    let message = Message { task, hops: hops.parse().ok()? };
    (is_valid(&message, shards) && write_subject(&message) == text).then_some(message)
}

/// Reads a delivered message: the task that its bytes and its subject name alike, or the reason why it must be removed.
pub(super) fn read_delivered(
    subject: &str,
    bytes: &[u8],
    run: [u8; 8],
    shards: &[u32],
) -> Result<Message, String> {
    match read_message(bytes, run, shards) {
        Ok(Some(message)) if read_subject(subject, shards).as_ref() == Some(&message) => {
            Ok(message)
        }
        Ok(Some(_)) => Err(format!("a message does not belong to its subject {subject:?}")),
        Ok(None) => Err(format!("the message {subject:?} names no shards of this run")),
        Err(error) => Err(format!("{error} (its subject is {subject:?})")),
    }
}

fn encode(message: &impl Encode) -> Vec<u8> {
    let mut bytes = vec![VERSION];
    let body = bincode::encode_to_vec(message, CONFIG).expect("numbers can be encoded");
    bytes.extend(body);
    bytes
}

fn decode<M: Decode<()>>(bytes: &[u8]) -> Result<M, MessageError> {
    let error = |reason: String| MessageError { length: bytes.len(), reason };
    let (&version, body) = bytes.split_first().ok_or_else(|| error("it is empty".to_owned()))?;
    if version != VERSION {
        return Err(error(format!("version {version}, not {VERSION}")));
    }
    let (message, used) =
        bincode::decode_from_slice(body, CONFIG).map_err(|e| error(e.to_string()))?;
    if used != body.len() {
        return Err(error(format!("{} bytes too many", body.len() - used)));
    }
    Ok(message)
}

#[cfg(test)]
mod tests {
    use super::*;

    const MESSAGE: TaskMessage =
        TaskMessage { run: *b"8 bytes!", scene: 7, start: 16, end: 32, hops: 1 };

    /// Other versions of the program read these bytes.
    #[test]
    fn the_encoding_of_messages_is_fixed() {
        let bytes = encode(&MESSAGE);
        let mut expected = vec![1];
        expected.extend(b"8 bytes!");
        expected.extend([7, 0, 0, 0, 16, 0, 0, 0, 32, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(bytes, expected);
        assert_eq!(decode::<TaskMessage>(&bytes).unwrap(), MESSAGE);
        let answer = Answer { tasks: 3, load_s: Some(0.2) };
        let bytes = write_answer(answer);
        assert_eq!(bytes, [1, 3, 0, 0, 0, 0x40, 0x0d, 3, 0]);
        assert_eq!(read_answer(&bytes).unwrap(), answer);
        let bytes = write_request(Some(0.2));
        assert_eq!(bytes, [1, 0x40, 0x0d, 3, 0]);
        assert_eq!(read_request(&bytes).unwrap(), Some(0.2));
        assert_eq!(read_request(&write_request(None)).unwrap(), None);
    }

    #[test]
    fn damaged_messages_are_refused() {
        let bytes = encode(&MESSAGE);
        for length in 0..bytes.len() {
            assert!(decode::<TaskMessage>(&bytes[..length]).is_err());
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert!(decode::<TaskMessage>(&longer).is_err());
        let mut newer = bytes;
        newer[0] = 2;
        let error = decode::<TaskMessage>(&newer).unwrap_err().to_string();
        assert!(error.contains("version 2, not 1"), "{error}");
    }

    #[test]
    fn messages_with_another_run_or_shards_that_it_does_not_have_are_refused() {
        let read = |message: &TaskMessage, run, shards: &[u32]| {
            read_message(&encode(message), run, shards).unwrap().map(|message| message.task)
        };
        let run = *b"8 bytes!";
        assert_eq!(read(&MESSAGE, run, &[32; 8]), Some(Task { scene: 7, shards: 16..32 }));
        assert_eq!(read(&MESSAGE, *b"another!", &[32; 8]), None);
        assert_eq!(read(&MESSAGE, run, &[32; 7]), None);
        // The scene has fewer shards: the message is not cut to an empty task.
        assert_eq!(read(&MESSAGE, run, &[31; 8]), None);
        assert_eq!(read(&MESSAGE, run, &[16; 8]), None);
        assert_eq!(read(&TaskMessage { end: 16, ..MESSAGE }, run, &[32; 8]), None);
        assert_eq!(read(&TaskMessage { hops: u32::MAX, ..MESSAGE }, run, &[32; 8]), None);
    }

    #[test]
    fn only_the_subject_of_its_own_message_is_read() {
        let task = Task { scene: 7, shards: 16..32 };
        let message = Message { task, hops: 1 };
        let text = write_subject(&message);
        assert_eq!(text, "span.7.16-32.1");
        assert_eq!(read_subject(&text, &[32; 8]), Some(message.clone()));
        let odd = [
            "span.7.16-32",
            "span.07.16-32.1",
            "span.7.16-33.1",
            "span.8.16-32.1",
            "span.7.32-32.1",
        ];
        for text in
            odd.iter().chain(&["span.7.16-32.1.9", "span.x.y.z", "", "give", "span.7.+16-32.1"])
        {
            assert_eq!(read_subject(text, &[32; 8]), None, "{text}");
        }
        let (run, bytes) = (*b"8 bytes!", write_message(*b"8 bytes!", &message));
        assert_eq!(read_delivered(&text, &bytes, run, &[32; 8]), Ok(message));
        let wrong =
            |subject, bytes: &[u8]| read_delivered(subject, bytes, run, &[32; 8]).unwrap_err();
        assert!(wrong("span.6.16-32.1", &bytes).contains("does not belong to its subject"));
        assert!(wrong(&text, b"8 bytes.").contains("version 56, not 1"));
        assert!(
            wrong(&text, &write_message(*b"another!", &read_subject(&text, &[32; 8]).unwrap()))
                .contains("no shards of this run")
        );
    }
}
