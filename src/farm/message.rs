//! The messages between processes of a run: a version byte, then bincode.

use super::queue::{Answer, Message};
use crate::run::Task;
use bincode::config::{Configuration, Fixint, LittleEndian};
use bincode::{Decode, Encode};

/// Version of the encoding. A worker leaves messages of other versions to other workers.
const VERSION: u8 = 1;

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

/// Decodes a message from an untrusted sender. Returns `None` if the message belongs to another run, names a scene that
/// is not below `scenes`, or has no shards. The scene may have fewer shards than the message names.
pub fn read_message(
    bytes: &[u8],
    run: [u8; 8],
    scenes: usize,
) -> Result<Option<Message>, MessageError> {
    let m: TaskMessage = decode(bytes)?;
    let valid = m.run == run && (m.scene as usize) < scenes && m.start < m.end;
    let task = Task { scene: m.scene, shards: m.start..m.end };
    Ok(valid.then_some(Message { task, hops: m.hops }))
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
    fn messages_with_another_run_an_unknown_scene_or_no_shards_are_ignored() {
        let read = |message: &TaskMessage, run, scenes| {
            read_message(&encode(message), run, scenes).unwrap().map(|message| message.task)
        };
        let run = *b"8 bytes!";
        assert_eq!(read(&MESSAGE, run, 8), Some(Task { scene: 7, shards: 16..32 }));
        assert_eq!(read(&MESSAGE, *b"another!", 8), None);
        assert_eq!(read(&MESSAGE, run, 7), None);
        assert_eq!(read(&TaskMessage { end: 16, ..MESSAGE }, run, 8), None);
    }
}
