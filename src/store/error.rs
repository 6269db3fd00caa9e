//! Errors of a store, and the distinction between temporary and permanent ones.

use std::error::Error as _;
use std::io;

/// An invalid address, a failed call, or an object with other bytes. No message contains a credential.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The address is invalid.
    #[error("{address} is not a store: {reason}; use a folder or s3://BUCKET/PREFIX")]
    Address {
        /// The address without possible secrets.
        address: String,
        reason: String,
    },
    /// A call failed permanently, or in all repetitions.
    #[error(
        "cannot {what} {key} in {store}: {reason}; check its space, its permissions and the connection"
    )]
    Call {
        /// `read`, `write`, ...
        what: &'static str,
        key: String,
        store: String,
        reason: String,
        /// True if a later call may succeed: the store was unavailable or busy, and not full, forbidden or absent.
        passing: bool,
    },
    /// The folder is not the one that was opened.
    #[error(
        "the folder {store} was deleted, moved or replaced during the command: its results are incomplete; put the folder \
         back if it was moved, and run the command again"
    )]
    Gone { store: String },
    /// Another process put other bytes under this key.
    #[error(
        "{key} in {store} holds other bytes ({there}) than this process made ({here}): two machines computed different \
         results, or the object was damaged; find the wrong one with `glasshouse audit RUN --scene NAME` (the folder's name) and remove it"
    )]
    Differs {
        key: String,
        store: String,
        /// First 16 digits of the BLAKE3 digest of this process's bytes.
        here: String,
        /// First 16 digits of the BLAKE3 digest of the store's bytes.
        there: String,
    },
}

impl StoreError {
    /// True if the same call may succeed later, without an intervention.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Call { passing: true, .. })
    }
}

/// True if a call with this error may succeed later. A server's unknown errors count as temporary: a worker that waits
/// in vain ends with a message, but a worker that gives up at the first lost connection is useless.
pub(super) fn is_passing(error: &object_store::Error) -> bool {
    use object_store::Error as E;
    let E::Generic { store, .. } = error else {
        // For example, the object is absent, forbidden or unchanged.
        return false;
    };
    for cause in causes(error) {
        if let Some(error) = cause.downcast_ref::<io::Error>()
            && *store == "LocalFileSystem"
        {
            return may_pass(error);
        }
        if is_distrust(cause) {
            return false;
        }
    }
    let text = error.to_string();
    if text.contains(OTHER_REGION) {
        return false;
    }
    match status(&text) {
        Some(408 | 429) => true,
        // 301: the bucket is in another region; 501: the server does not support the call; 507: the server is full.
        Some(300..=499 | 501 | 507) => false,
        _ => *store != "LocalFileSystem",
    }
}

/// True if the client refused a TLS connection, for example because of an untrusted certificate.
fn is_distrust(error: &(dyn std::error::Error + 'static)) -> bool {
    // The error inside an io::Error is not its source.
    let inside = error.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
    error.is::<rustls::Error>() || inside.is_some_and(|error| is_distrust(error))
}

/// True if the object is absent. If an object is removed while its download is interrupted, the error differs from that
/// of an object that never existed.
pub(super) fn is_absent(error: &object_store::Error) -> bool {
    use object_store::Error as E;
    match error {
        E::NotFound { .. } => true,
        E::Generic { .. } => status(&error.to_string()) == Some(404),
        _ => false,
    }
}

/// True if another process removed the folder or the unfinished file of a put to a disk.
pub(super) fn is_cleared_away(error: &object_store::Error) -> bool {
    let is_gone = |cause: &(dyn std::error::Error + 'static)| {
        let error = cause.downcast_ref::<io::Error>();
        error.is_some_and(|error| error.kind() == io::ErrorKind::NotFound)
    };
    matches!(error, object_store::Error::Generic { store, .. } if *store == "LocalFileSystem")
        && causes(error).any(is_gone)
}

/// True for errors of a disk on a restarting file server. A full disk, a quota and a failing sector are permanent.
fn may_pass(error: &io::Error) -> bool {
    use io::ErrorKind as K;
    matches!(
        error.kind(),
        K::Interrupted
            | K::WouldBlock
            | K::TimedOut
            | K::StaleNetworkFileHandle
            | K::HostUnreachable
            | K::NetworkUnreachable
            | K::NetworkDown
            | K::NotConnected
            | K::ConnectionReset
            | K::ConnectionAborted
            | K::ResourceBusy
    )
}

fn causes(error: &object_store::Error) -> impl Iterator<Item = &(dyn std::error::Error + 'static)> {
    std::iter::successors(error.source(), |cause: &&(dyn std::error::Error + 'static)| {
        (*cause).source()
    })
}

/// Text of a redirection without an address, S3's answer for a bucket of another region.
const OTHER_REGION: &str = "incorrectly configured region";

/// Text before an HTTP status in object_store's errors; the type of these errors is private.
const STATUS: &str = "status code: ";

/// Text before the cause if the server gave no response.
const NO_ANSWER: &str = " - HTTP error: ";

/// Returns the HTTP status in an error's text.
fn status(text: &str) -> Option<u16> {
    let (_, rest) = text.split_once(STATUS)?;
    rest.get(..3)?.parse().ok()
}

/// Describes an error on one line. A server's response is cut to code and message; the rest repeats the request.
pub(super) fn describe(error: &object_store::Error) -> String {
    let text = error.to_string();
    if text.contains(OTHER_REGION) {
        return "the bucket is in another region: set AWS_REGION to the bucket's own".to_owned();
    }
    let retries = text
        .split_once("after ")
        .and_then(|(_, rest)| rest.split_once(" retries"))
        .map_or_else(String::new, |(n, _)| format!(" after {n} quick retries"));
    let Some((_, answer)) = text.split_once(STATUS) else {
        let short = text.split_once(NO_ANSWER);
        let text = short.map_or(text.as_str(), |(_, cause)| cause);
        // The innermost cause names the event: "Connection refused".
        let cause = causes(error).last().map(ToString::to_string);
        let cause = cause.filter(|cause| !text.contains(cause));
        let cause = cause.map_or_else(String::new, |cause| format!(": {cause}"));
        return format!("{text}{cause}{retries}");
    };
    let status = answer.split([':', '<']).next().unwrap_or_default().trim();
    let tag = |name: &str| {
        let (_, rest) = answer.split_once(&format!("<{name}>"))?;
        rest.split_once(&format!("</{name}>")).map(|(text, _)| text)
    };
    let detail = match (tag("Code"), tag("Message")) {
        (Some(code), Some(message)) => format!(" ({code}: {message})"),
        (Some(code), None) => format!(" ({code})"),
        _ => String::new(),
    };
    format!("the server answers {status}{detail}{retries}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn generic(
        store: &'static str,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> object_store::Error {
        let source = source.into();
        object_store::Error::Generic { store, source }
    }

    #[test]
    fn a_full_disk_is_permanent_and_a_restarting_server_is_not() {
        let local =
            |kind: io::ErrorKind| is_passing(&generic("LocalFileSystem", io::Error::from(kind)));
        assert!(local(io::ErrorKind::StaleNetworkFileHandle));
        assert!(local(io::ErrorKind::TimedOut));
        for kind in [
            io::ErrorKind::StorageFull,
            io::ErrorKind::QuotaExceeded,
            io::ErrorKind::ReadOnlyFilesystem,
            io::ErrorKind::PermissionDenied,
            io::ErrorKind::Other,
        ] {
            assert!(!local(kind), "{kind}");
        }
    }

    #[test]
    fn the_http_status_tells_whether_an_error_is_temporary() {
        for (status, passing) in [
            ("500 Internal Server Error", true),
            ("503 Service Unavailable", true),
            ("429 Too Many Requests", true),
            ("400 Bad Request", false),
            ("507 Insufficient Storage", false),
        ] {
            let text = format!(
                "Error performing PUT http://x/b/k in 1s, after 3 retries, max_retries: 3, retry_timeout: 8s  - Server returned non-2xx status code: {status}: <Error><Code>Why</Code><Message>Because.</Message><AWSAccessKeyId>AKIA</AWSAccessKeyId></Error>"
            );
            let error = generic("S3", text);
            assert_eq!(is_passing(&error), passing, "{status}");
            assert_eq!(
                describe(&error),
                format!("the server answers {status} (Why: Because.) after 3 quick retries")
            );
        }
        assert!(is_passing(&generic("S3", "connection closed")));
        assert!(is_absent(&generic("S3", "status code: 404 Not Found: x")));
        let absent =
            object_store::Error::NotFound { path: "k".to_owned(), source: "no such bucket".into() };
        assert!(!is_passing(&absent) && is_absent(&absent));
    }
}
