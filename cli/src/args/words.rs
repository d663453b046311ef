//! Words and their rules.

use std::path::PathBuf;

use clap::Args as ClapArgs;
use umo_core::WordRules;

use super::TUNING;
use crate::failure::Failure;

/// Rules of words.
#[derive(Clone, Debug, ClapArgs)]
pub struct RuleArgs {
    /// Language of the words: en or de
    #[arg(long, value_name = "CODE", default_value = WordRules::LANGUAGES[0], value_parser = language)]
    pub language: String,
    /// Rules to add, TOML; may be repeated
    #[arg(long, value_name = "FILE.toml", help_heading = TUNING, hide_short_help = true)]
    pub rules: Vec<PathBuf>,
}

/// Words of a recording.
#[derive(Clone, Debug, ClapArgs)]
pub struct WordArgs {
    /// Words of the recording, for gestures that say the same
    ///
    /// With times: SubRip (.srt), WebVTT (.vtt), Whisper's JSON (.json), a Praat TextGrid (.TextGrid), CTM (.ctm).
    /// Without: plain text (.txt), which is spread over the voice.
    #[arg(long, value_name = "FILE")]
    pub words: Option<PathBuf>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub rules: RuleArgs,
}

impl WordArgs {
    /// Refuses words beside what has no place for them.
    pub(crate) fn refuse_with(&self, other: &str) -> Result<(), Failure> {
        match self.words {
            Some(_) => Err(Failure::input(format!("--words does not go with {other}"))),
            None => Ok(()),
        }
    }
}

/// Print the gestures that a text would get, and why.
#[derive(Debug, ClapArgs)]
pub struct Words {
    /// The text, as somebody would say it at five syllables per second
    pub text: String,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub rules: RuleArgs,
    /// Random seed: another one takes other gestures of the same classes
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
}

fn language(code: &str) -> Result<String, String> {
    let known = || format!("rules exist for {}", WordRules::LANGUAGES.join(" and "));
    WordRules::of(code).map(|_| code.to_owned()).ok_or_else(known)
}
