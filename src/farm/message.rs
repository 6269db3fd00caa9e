//! Everything that goes over the wire between processes of a run, in one place: a version byte, then bincode.

use super::queue::{Answer, Message};
use crate::run::Task;
use bincode::config::{Configuration, Fixint, LittleEndian};
use bincode::{Decode, Encode};

/// Version of the messages. A message of another version is left for a worker that knows it.
const VERSION: u8 = 1;

const CONFIG: Configuration<LittleEndian, Fixint> =
    bincode::config::standard().with_fixed_int_encoding();

/// A message of the queue: work that waits.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
struct SpanMessage {
    /// First eight bytes of the BLAKE3 of the run's spec: a message of another run is refused.
    run: [u8; 8],
    /// Place of the scene in the manifest.
    scene: u32,
    start: u32,
    /// One past the last.
    end: u32,
    /// How often it went from worker to worker, whole or in part.
    hops: u32,
}

/// Question of a worker that has nothing to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub(super) struct DonationRequest {
    /// Microseconds in which it loads a scene; 0 if it has loaded none.
    load_us: u32,
}

impl DonationRequest {
    pub(super) fn new(load_s: Option<f64>) -> Self {
        Self { load_us: micros(load_s) }
    }

    pub(super) fn load_s(self) -> Option<f64> {
        seconds(self.load_us)
    }
}

fn micros(seconds: Option<f64>) -> u32 {
    seconds.map_or(0, |s| (s * 1e6).max(1.0) as u32)
}

fn seconds(micros: u32) -> Option<f64> {
    (micros > 0).then(|| f64::from(micros) / 1e6)
}

/// Answer of a worker that was asked for work.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub(super) struct DonationReply {
    /// Tasks that it published.
    tasks: u32,
    /// Microseconds in which it loads a scene; 0 if it has loaded none.
    load_us: u32,
}

impl DonationReply {
    pub(super) fn new(answer: Answer) -> Self {
        Self { tasks: answer.tasks, load_us: micros(answer.load_s) }
    }

    pub(super) fn answer(self) -> Answer {
        Answer { tasks: self.tasks, load_s: seconds(self.load_us) }
    }
}

/// Why a message is not understood.
#[derive(Debug, thiserror::Error)]
#[error(
    "a message of {length} bytes is not understood ({reason}); are there workers of another version in this run?"
)]
pub struct MessageError {
    length: usize,
    reason: String,
}

/// The bytes that tell workers of `run` of work that waits.
pub fn write_message(run: [u8; 8], message: &Message) -> Vec<u8> {
    encode(&SpanMessage {
        run,
        scene: message.task.scene,
        start: message.task.shards.start,
        end: message.task.shards.end,
        hops: message.hops,
    })
}

/// Work that waits, from bytes that may come from anybody. None if it is of another run than `run`, which has so many
/// `scenes`, or of no shard. A scene may have fewer shards than it says.
pub fn read_message(
    bytes: &[u8],
    run: [u8; 8],
    scenes: usize,
) -> Result<Option<Message>, MessageError> {
    let message: SpanMessage = decode(bytes)?;
    let hops = message.hops;
    let task = message.task(run, scenes);
    Ok(task.map(|task| Message { task, hops }))
}

impl SpanMessage {
    /// The task, if it belongs to this run and its scene is one of `scenes`.
    fn task(&self, run: [u8; 8], scenes: usize) -> Option<Task> {
        let valid = self.run == run && (self.scene as usize) < scenes && self.start < self.end;
        valid.then_some(Task { scene: self.scene, shards: self.start..self.end })
    }
}

/// Bytes of a message.
pub(super) fn encode(message: &impl Encode) -> Vec<u8> {
    let mut bytes = vec![VERSION];
    let body = bincode::encode_to_vec(message, CONFIG).expect("numbers can be encoded");
    bytes.extend(body);
    bytes
}

/// A message from bytes that may come from anybody.
pub(super) fn decode<M: Decode<()>>(bytes: &[u8]) -> Result<M, MessageError> {
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

    const MESSAGE: SpanMessage =
        SpanMessage { run: *b"8 bytes!", scene: 7, start: 16, end: 32, hops: 1 };

    /// The bytes are a format: other versions of the program read them.
    #[test]
    fn bytes_on_the_wire() {
        let bytes = encode(&MESSAGE);
        let mut expected = vec![1];
        expected.extend(b"8 bytes!");
        expected.extend([7, 0, 0, 0, 16, 0, 0, 0, 32, 0, 0, 0, 1, 0, 0, 0]);
        assert_eq!(bytes, expected);
        assert_eq!(decode::<SpanMessage>(&bytes).unwrap(), MESSAGE);
        let answer = Answer { tasks: 3, load_s: Some(0.2) };
        let reply = DonationReply::new(answer);
        assert_eq!(encode(&reply), [1, 3, 0, 0, 0, 0x40, 0x0d, 3, 0]);
        assert_eq!(reply.answer(), answer);
        let request = DonationRequest::new(Some(0.2));
        assert_eq!(encode(&request), [1, 0x40, 0x0d, 3, 0]);
        assert_eq!(request.load_s(), Some(0.2));
        assert_eq!(DonationRequest::new(None).load_s(), None);
    }

    #[test]
    fn what_is_not_understood_is_refused() {
        let bytes = encode(&MESSAGE);
        for length in 0..bytes.len() {
            assert!(decode::<SpanMessage>(&bytes[..length]).is_err());
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert!(decode::<SpanMessage>(&longer).is_err());
        let mut newer = bytes;
        newer[0] = 2;
        let error = decode::<SpanMessage>(&newer).unwrap_err().to_string();
        assert!(error.contains("version 2, not 1"), "{error}");
    }

    #[test]
    fn a_span_of_another_run_or_no_scene_is_none() {
        let run = *b"8 bytes!";
        let task = MESSAGE.task(run, 8).unwrap();
        assert_eq!((task.scene, task.shards), (7, 16..32));
        assert_eq!(MESSAGE.task(*b"another!", 8), None);
        assert_eq!(MESSAGE.task(run, 7), None);
        let empty = SpanMessage { end: 16, ..MESSAGE };
        assert_eq!(empty.task(run, 8), None);
    }
}
