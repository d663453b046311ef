//! Bearer tokens: admission of clients, and the names by which they are counted.

use sha2::{Digest, Sha256};
use subtle::{Choice, ConditionallySelectable, ConstantTimeEq};

/// Minimum length of a token in bytes, against guessing.
pub const LEAST: usize = 16;

/// Name of a client and the SHA-256 of its token, which itself is not kept.
#[derive(Clone)]
struct Entry {
    name: String,
    digest: [u8; 32],
}

/// Accepted tokens.
#[derive(Clone, Default)]
pub struct Tokens {
    entries: Vec<Entry>,
}

impl std::fmt::Debug for Tokens {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<_> = self.entries.iter().map(|entry| &entry.name).collect();
        f.debug_struct("Tokens").field("names", &names).finish()
    }
}

impl Tokens {
    /// Parses lines of `NAME TOKEN`; empty lines and lines that begin with `#` are ignored.
    ///
    /// # Errors
    /// A message with the line number, never with the token.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut entries: Vec<Entry> = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let wrong = |problem: &str| format!("line {}: {problem}", number + 1);
            let line = line.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let mut words = line.split_whitespace();
            let (Some(name), Some(token), None) = (words.next(), words.next(), words.next()) else {
                return Err(wrong("expected a name and a token"));
            };
            if token.len() < LEAST {
                return Err(wrong(&format!("a token needs {LEAST} characters or more")));
            }
            let digest = digest(token);
            if entries.iter().any(|entry| entry.digest == digest) {
                return Err(wrong("this token is already in a line above"));
            }
            entries.push(Entry { name: name.to_owned(), digest });
        }
        if entries.is_empty() {
            return Err("no token in it".to_owned());
        }
        Ok(Self { entries })
    }

    /// Whether no tokens are configured, so that every client is accepted.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Returns the name of the client that owns this token. The time does not depend on the token: all digests
    /// are compared, in constant time.
    pub fn name(&self, token: &str) -> Option<&str> {
        let given = digest(token);
        let (mut found, mut is_known) = (0, Choice::from(0));
        for (place, entry) in (0_u64..).zip(&self.entries) {
            let same = entry.digest.ct_eq(&given);
            found.conditional_assign(&place, same);
            is_known |= same;
        }
        let entry = self.entries.get(usize::try_from(found).ok()?)?;
        bool::from(is_known).then_some(entry.name.as_str())
    }
}

fn digest(token: &str) -> [u8; 32] {
    Sha256::digest(token.as_bytes()).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_names_its_client_and_nothing_else_does() {
        let tokens = Tokens::parse("# two\n\nstudio 0123456789abcdef\n game  fedcba9876543210 \n").unwrap();
        assert_eq!(tokens.name("0123456789abcdef"), Some("studio"));
        assert_eq!(tokens.name("fedcba9876543210"), Some("game"));
        for wrong in ["", "0123456789abcde", "0123456789abcdef0", "studio"] {
            assert_eq!(tokens.name(wrong), None, "{wrong}");
        }
        assert!(!format!("{tokens:?}").contains("0123456789"));
        assert_eq!(Tokens::default().name(""), None);
    }

    #[test]
    fn lines_that_are_no_tokens_are_refused_without_saying_them() {
        let wrong = [("a short", "line 1"), ("alone", "name and a token"), ("# nothing", "no token")];
        for (text, part) in wrong {
            assert!(Tokens::parse(text).unwrap_err().contains(part), "{text}");
        }
        let twice = Tokens::parse("a 0123456789abcdef\nb 0123456789abcdef").unwrap_err();
        assert!(twice.contains("line 2") && !twice.contains("0123456789"), "{twice}");
    }
}
