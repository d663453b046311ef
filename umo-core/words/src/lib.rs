//! Rules from words to gestures, and the plan of a speech's gestures from its words (SPEC 2.20).
//!
//! | module | contents |
//! |---|---|
//! | `text` | a text's words in lower case, their syllables and stressed vowel |
//! | `rules` | rules as data: TOML to classes of words and phrases |
//! | `plan` | words with times to gestures with times: longest match, gaps, choice of a gesture |
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
#![deny(unsafe_code)]

mod plan;
mod rules;
mod text;

pub use plan::{
    Decision, Hints, LATE_SECONDS, MAX_PENDING_WORDS, MAX_WORDS_SECONDS, Outcome, Plan, Planner, REACH_SECONDS, UNITS,
    WordError,
};
pub use rules::{Class, ClassGesture, Hand, MAX_CLASSES, RulesError, WordRules};
pub use text::{Spoken, spoken};
