//! Actions on a run over HTTP, and the token that allows them.

use glasshouse_line::ids::SceneId;

/// Minimum length of a token. Failed attempts are not limited, so a token must not be guessable.
pub const MIN_TOKEN_CHARACTERS: usize = 16;

/// A change of a run's state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Lets workers finish their open scenes and start no others.
    Pause,
    /// Lets workers take tasks and open scenes again.
    Resume,
    /// Cancels the rest of the run.
    Cancel,
    /// Takes a scene out of quarantine, so that workers try it again.
    Retry(SceneId),
}

/// The secret that allows actions. Only its digest is kept.
#[derive(Clone)]
pub(super) struct Token(blake3::Hash);

impl Token {
    /// Creates a token; returns `None` if the text is too short.
    pub(super) fn new(text: &str) -> Option<Self> {
        (text.chars().count() >= MIN_TOKEN_CHARACTERS).then(|| Self(blake3::hash(text.as_bytes())))
    }

    /// True if the value of an `Authorization` header contains this token. The comparison of digests takes constant
    /// time, so that the time reveals neither the token's length nor a correct prefix of a guess.
    pub(super) fn opens(&self, authorization: &[u8]) -> bool {
        let Some((scheme, given)) = authorization.split_at_checked(7) else {
            return false;
        };
        scheme.eq_ignore_ascii_case(b"bearer ") && blake3::hash(given.trim_ascii()) == self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_complete_token_is_accepted() {
        let token = Token::new("correct horse battery").unwrap();
        assert!(token.opens(b"Bearer correct horse battery"));
        assert!(token.opens(b"bearer  correct horse battery "));
        for wrong in [
            &b""[..],
            b"Bearer",
            b"Bearer ",
            b"Bearer correct horse batter",
            b"Bearer correct horse batteryy",
            b"Basic correct horse battery",
            b"correct horse battery",
        ] {
            assert!(!token.opens(wrong), "{wrong:?}");
        }
    }

    #[test]
    fn short_tokens_are_refused() {
        assert!(Token::new("").is_none());
        assert!(Token::new("123456789012345").is_none());
        assert!(Token::new("1234567890123456").is_some());
    }
}
