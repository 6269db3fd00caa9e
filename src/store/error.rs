//! What can go wrong with a store, and whether it may pass by itself.

use std::error::Error as _;
use std::io;

/// A store that cannot be used, or that holds other bytes. No text holds a key, a token or a password.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The address means nothing.
    #[error("{address} is no store: {reason}; use a folder or s3://BUCKET/PREFIX")]
    Address {
        /// As given, without what may be secret.
        address: String,
        reason: String,
    },
    /// A call failed, also when tried again.
    #[error(
        "cannot {what} {key} in {store}: {reason}; check its space, its permissions and the way to it"
    )]
    Call {
        /// `read`, `write`, ...
        what: &'static str,
        key: String,
        store: String,
        reason: String,
        /// It may work later: the store was away or busy, and not full, closed or absent.
        passing: bool,
    },
    /// Another process put other bytes there.
    #[error(
        "{key} in {store} holds other bytes ({there}) than this process made ({here}): two machines computed different \
         results, or the object was damaged; `glasshouse audit RUN --scene NAME` (the folder's name) tells which, then remove the wrong one"
    )]
    Differs {
        key: String,
        store: String,
        /// BLAKE3 of what was made here.
        here: String,
        /// BLAKE3 of what is there.
        there: String,
    },
}

impl StoreError {
    /// The same call may work later, without anybody doing anything.
    pub fn is_passing(&self) -> bool {
        matches!(self, Self::Call { passing: true, .. })
    }
}

/// Whether a call that failed like this may work later. When in doubt it may: a worker that waits in vain ends with a
/// message, one that gives up at the first cut connection is of no use.
pub(super) fn is_passing(error: &object_store::Error) -> bool {
    use object_store::Error as E;
    let E::Generic { store, .. } = error else {
        // Absent, forbidden, not known to this server.
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
    match status(&error.to_string()) {
        Some(408 | 429) => true,
        // 501: the server does not know the call; 507: it is full.
        Some(400..=499 | 501 | 507) => false,
        _ => *store != "LocalFileSystem",
    }
}

/// A certificate that nobody trusts, or the like.
fn is_distrust(error: &(dyn std::error::Error + 'static)) -> bool {
    // What is inside of an io::Error is not its source.
    let inside = error.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
    error.is::<rustls::Error>() || inside.is_some_and(|error| is_distrust(error))
}

/// Whether the object is not there. One that is removed while its bytes are on their way, over a connection that is cut,
/// is told in another way than one that was never there.
pub(super) fn is_absent(error: &object_store::Error) -> bool {
    use object_store::Error as E;
    match error {
        E::NotFound { .. } => true,
        E::Generic { .. } => status(&error.to_string()) == Some(404),
        _ => false,
    }
}

/// Whether a put to a disk lost its folder, or its unfinished file, while it was being written: somebody cleared it away.
pub(super) fn is_cleared_away(error: &object_store::Error) -> bool {
    let is_gone = |cause: &(dyn std::error::Error + 'static)| {
        let error = cause.downcast_ref::<io::Error>();
        error.is_some_and(|error| error.kind() == io::ErrorKind::NotFound)
    };
    matches!(error, object_store::Error::Generic { store, .. } if *store == "LocalFileSystem")
        && causes(error).any(is_gone)
}

/// Of errors of a disk, those of a server behind it that restarts. A full disk, a quota and a failing sector stay.
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

/// What object_store writes before an HTTP status; its type is not public.
const STATUS: &str = "status code: ";

/// What it writes before the cause when there was no answer.
const NO_ANSWER: &str = " - HTTP error: ";

/// The HTTP status in an error's text.
fn status(text: &str) -> Option<u16> {
    let (_, rest) = text.split_once(STATUS)?;
    rest.get(..3)?.parse().ok()
}

/// An error in a line: of a server's answer the code and the message alone, for the rest of it repeats the request.
pub(super) fn describe(error: &object_store::Error) -> String {
    let text = error.to_string();
    let retries = text
        .split_once("after ")
        .and_then(|(_, rest)| rest.split_once(" retries"))
        .map_or_else(String::new, |(n, _)| format!(" after {n} quick retries"));
    let Some((_, answer)) = text.split_once(STATUS) else {
        let short = text.split_once(NO_ANSWER);
        let text = short.map_or(text.as_str(), |(_, cause)| cause);
        // The innermost cause is the one that says what happened: "Connection refused".
        let cause = causes(error).last().map(ToString::to_string);
        return match cause {
            Some(cause) if !text.contains(&cause) => format!("{text}: {cause}{retries}"),
            _ => format!("{text}{retries}"),
        };
    };
    let status = answer.split([':', '<']).next().unwrap_or_default().trim();
    let tag = |name: &str| {
        let (_, rest) = answer.split_once(&format!("<{name}>"))?;
        rest.split_once(&format!("</{name}>")).map(|(text, _)| text)
    };
    match (tag("Code"), tag("Message")) {
        (Some(code), Some(message)) => {
            format!("the server answers {status} ({code}: {message}){retries}")
        }
        (Some(code), None) => format!("the server answers {status} ({code}){retries}"),
        _ => format!("the server answers {status}{retries}"),
    }
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
    fn a_full_disk_stays_and_a_server_that_restarts_passes() {
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
    fn an_answer_tells_by_its_status() {
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
