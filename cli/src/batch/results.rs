//! Results of a batch: a JSON lines file that grows as lines finish, so that an interrupted run
//! resumes where it stopped.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::hash::file_hash;
use super::manifest::Line;
use crate::animate::is_take;
use crate::atomic_file;
use crate::failure::Failure;

/// A finished or failed line.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Done {
    /// The recording.
    pub(super) file: String,
    /// Index in the manifest, from 1.
    line: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    speaker: Option<String>,
    /// Hash of the recording's contents and of everything else that determines its motion.
    key: String,
    pub(super) frames: usize,
    /// Length of the motion, seconds.
    seconds: f64,
    /// Seconds from the line's first chunk to its last, computed along with other lines.
    took: f64,
    outputs: Vec<Written>,
    /// Hash of the score that the files follow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    score: Option<String>,
    /// Outcome of each change of the score.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) edits: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) error: Option<String>,
    /// Whether an earlier run made the files.
    #[serde(skip)]
    pub(super) is_kept: bool,
}

/// A written file.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Written {
    file: PathBuf,
    sha256: String,
}

impl Done {
    fn of(line: &Line, key: &str) -> Self {
        Self {
            file: line.file.display().to_string(),
            line: line.number + 1,
            speaker: line.speaker.clone(),
            key: key.to_owned(),
            frames: 0,
            seconds: 0.0,
            took: 0.0,
            outputs: Vec::new(),
            score: None,
            edits: Vec::new(),
            error: None,
            is_kept: false,
        }
    }

    /// Returns a line whose files were written.
    pub(super) fn made(
        line: &Line,
        key: &str,
        (frames, rate): (usize, usize),
        took: Duration,
        edits: Vec<String>,
    ) -> Result<Self, Failure> {
        let hashed = |path: &PathBuf| Ok(Written { file: path.clone(), sha256: file_hash(path)? });
        let outputs = line.outputs.iter().map(hashed).collect::<Result<_, Failure>>()?;
        let (seconds, took) = (frames as f64 / rate as f64, took.as_secs_f64());
        let score = line.score().as_deref().map(file_hash).transpose()?;
        Ok(Self { frames, seconds, took, outputs, score, edits, ..Self::of(line, key) })
    }

    /// Returns a line that failed.
    pub(super) fn failed(line: &Line, key: &str, failure: &Failure) -> Self {
        Self { error: Some(failure.to_string()), ..Self::of(line, key) }
    }

    /// Whether every file of the line still exists with its recorded contents, and its score is the same.
    pub(super) fn is_there(&self, line: &Line) -> bool {
        let is_same = |(path, written): (&PathBuf, &Written)| {
            *path == written.file && file_hash(path).is_ok_and(|hash| hash == written.sha256)
        };
        let score = line.score().map(|path| file_hash(&path).unwrap_or_default());
        self.error.is_none()
            && self.score == score
            && self.outputs.len() == line.outputs.len()
            && line.outputs.iter().zip(&self.outputs).all(is_same)
    }

    /// Notes about its score.
    pub(super) fn notes(&self) -> impl Iterator<Item = String> {
        let take = self.outputs.iter().map(|output| &output.file).find(|path| is_take(path));
        let score = take.map(|take| take.with_extension("toml")).unwrap_or_default();
        self.edits.iter().map(move |edit| format!("{}: {edit}", score.display()))
    }

    /// Returns this result as kept, with the names and number that the line has in this run.
    pub(super) fn kept(&self, line: &Line) -> Self {
        let own = Self::of(line, &self.key);
        Self { file: own.file, line: own.line, speaker: own.speaker, is_kept: true, edits: Vec::new(), ..self.clone() }
    }
}

/// The results file.
pub(super) struct Results {
    path: PathBuf,
    file: File,
    before: Vec<Done>,
    done: Vec<Done>,
}

impl Results {
    /// Opens the results of earlier runs for appending. Skips anything that is not a result, such as a line
    /// that an interrupted run left incomplete.
    pub(super) fn open(path: PathBuf) -> Result<Self, Failure> {
        let wrong = |cause: std::io::Error| Failure::input(format!("cannot write `{}`: {cause}", path.display()));
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(wrong)?;
        }
        let mut before = Vec::new();
        let mut is_cut = false;
        if let Ok(file) = File::open(&path) {
            for line in BufReader::new(file).split(b'\n') {
                let line = line.map_err(wrong)?;
                let done = serde_json::from_slice(&line);
                is_cut = done.is_err();
                before.extend(done);
            }
        }
        let mut file = OpenOptions::new().append(true).create(true).open(&path).map_err(wrong)?;
        if is_cut {
            writeln!(file).map_err(wrong)?;
        }
        Ok(Self { path, file, before, done: Vec::new() })
    }

    /// Returns the successful results of earlier runs by key.
    pub(super) fn known(&self) -> HashMap<String, Done> {
        self.before.iter().filter(|done| done.error.is_none()).map(|done| (done.key.clone(), done.clone())).collect()
    }

    /// Appends a line immediately.
    pub(super) fn add(&mut self, done: Done) -> Result<(), Failure> {
        if !done.is_kept {
            let mut text = serde_json::to_string(&done).map_err(Failure::environment)?;
            text.push('\n');
            let wrong = |cause| Failure::environment(format!("cannot write `{}`: {cause}", self.path.display()));
            self.file.write_all(text.as_bytes()).map_err(wrong)?;
        }
        self.done.push(done);
        Ok(())
    }

    /// Replaces the file with this run's lines in manifest order.
    pub(super) fn finish(self, lines: &[Line]) -> Result<(), Failure> {
        let Self { path, file, mut done, .. } = self;
        // On Windows an open file cannot be replaced.
        drop(file);
        debug_assert_eq!(done.len(), lines.len(), "every line is done or failed");
        done.sort_by_key(|done| done.line);
        let whole = atomic_file::create(&path)?;
        atomic_file::commit(whole, |out| {
            for done in &done {
                serde_json::to_writer(&mut *out, done)?;
                writeln!(out)?;
            }
            Ok(())
        })
    }
}
