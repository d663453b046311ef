//! Word rules of an engine's new sessions.

use std::ffi::c_char;
use std::sync::{Mutex, MutexGuard, PoisonError};

use umo_core::WordRules;
use umo_core_base::memory;

use super::{UmoEngine, get};
use crate::ffi::{self, guard};
use crate::status::{Failure, UmoStatus};

/// Word rules for an engine's new sessions.
pub(crate) struct Words(Mutex<WordRules>);

impl Words {
    pub(super) fn new() -> Self {
        Self(Mutex::new(WordRules::english()))
    }

    /// Clones the rules, which share their data.
    pub(crate) fn rules(&self) -> WordRules {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, WordRules> {
        // A panic while it was locked left the rules unchanged.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Sets the rules by which words become gestures (docs/words.md), for sessions created later: those of
/// `language` (`"en"`, which is the default, or `"de"`; NULL keeps the present ones), and to them those of `toml`,
/// the text of a file of rules (NULL for none). Gestures that the rules name must be known when a session is
/// created.
///
/// Threads: any but the audio thread. Allocates.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (a language without rules; not rules:
/// `umo_last_error` says where and why), `OUT_OF_MEMORY`.
///
/// # Safety
/// `language` and `toml` are NULL or end with a zero byte.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_set_word_rules(
    engine: *mut UmoEngine,
    language: *const c_char,
    toml: *const c_char,
) -> UmoStatus {
    guard(|| {
        let engine = get(engine)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let language = unsafe { optional(language, "language") }?;
        // SAFETY: as above.
        let toml = unsafe { optional(toml, "toml") }?;
        let changed = memory::watch(|| {
            let unknown = |code| {
                let known = WordRules::LANGUAGES.join(", ");
                Failure::argument(format_args!("language `{code}`: there are rules for {known}"))
            };
            let rules = match language {
                None => engine.words.rules(),
                Some(code) => WordRules::of(code).ok_or_else(|| unknown(code))?,
            };
            toml.map_or_else(|| Ok(rules.clone()), |toml| rules.with(toml)).map_err(Failure::argument)
        })??;
        *engine.words.lock() = changed;
        Ok(())
    })
}

/// A text that may be absent.
///
/// # Safety
/// `text` is NULL or ends with a zero byte, for as long as the result lives.
unsafe fn optional<'a>(text: *const c_char, what: &str) -> Result<Option<&'a str>, Failure> {
    match text.is_null() {
        true => Ok(None),
        // SAFETY: guaranteed by the caller (see # Safety).
        false => unsafe { ffi::string(text, what) }.map(Some),
    }
}
