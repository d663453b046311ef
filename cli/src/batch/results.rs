//! What a batch has done: a file of JSON lines that grows as lines are done, so that a run that was
//! ended goes on where it was.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::manifest::Line;
use crate::atomic_file;
use crate::failure::Failure;

/// A line that was done, or failed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Done {
    /// The recording.
    pub(super) file: String,
    /// Its place in the manifest, from 1.
    line: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    speaker: Option<String>,
    /// Hash of the recording's contents and of all that decides its motion.
    key: String,
    pub(super) frames: usize,
    /// Length of the motion.
    seconds: f64,
    /// From the line's first chunk to its last, beside other lines.
    took: f64,
    outputs: Vec<Written>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) error: Option<String>,
    /// Whether an earlier run had done it.
    #[serde(skip)]
    pub(super) is_kept: bool,
}

/// A file that was written.
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
            error: None,
            is_kept: false,
        }
    }

    /// A line whose files were written.
    pub(super) fn made(line: &Line, key: &str, frames: usize, rate: usize, took: Duration) -> Result<Self, Failure> {
        let hashed = |path: &PathBuf| Ok(Written { file: path.clone(), sha256: file_hash(path)? });
        let outputs = line.outputs.iter().map(hashed).collect::<Result<_, Failure>>()?;
        let (seconds, took) = (frames as f64 / rate as f64, took.as_secs_f64());
        Ok(Self { frames, seconds, took, outputs, ..Self::of(line, key) })
    }

    /// A line that could not be done.
    pub(super) fn failed(line: &Line, key: &str, failure: &Failure) -> Self {
        Self { error: Some(failure.to_string()), ..Self::of(line, key) }
    }

    /// Whether every file of the line is there as it was written.
    pub(super) fn is_there(&self, line: &Line) -> bool {
        let is_same = |(path, written): (&PathBuf, &Written)| {
            *path == written.file && file_hash(path).is_ok_and(|hash| hash == written.sha256)
        };
        self.error.is_none()
            && self.outputs.len() == line.outputs.len()
            && line.outputs.iter().zip(&self.outputs).all(is_same)
    }

    /// The same for a line of this run.
    pub(super) fn kept(&self, line: &Line) -> Self {
        let own = Self::of(line, &self.key);
        Self { file: own.file, line: own.line, speaker: own.speaker, is_kept: true, ..self.clone() }
    }
}

/// SHA-256 of a file's contents.
pub(super) fn file_hash(path: &Path) -> Result<String, Failure> {
    let wrong = |cause: std::io::Error| Failure::input(format!("{}: {cause}", path.display()));
    let mut file = File::open(path).map_err(wrong)?;
    let (mut hash, mut piece) = (Sha256::new(), vec![0; 1 << 16]);
    loop {
        let count = file.read(&mut piece).map_err(wrong)?;
        if count == 0 {
            return Ok(data_encoding::HEXLOWER.encode(&hash.finalize()));
        }
        hash.update(&piece[..count]);
    }
}

/// The file of results.
pub(super) struct Results {
    path: PathBuf,
    file: File,
    before: Vec<Done>,
    done: Vec<Done>,
}

impl Results {
    /// Opens the results of earlier runs, to be added to. What is no result, as the end of a line that
    /// a run could not finish, is passed over.
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

    /// What earlier runs have done, by its key.
    pub(super) fn known(&self) -> HashMap<String, Done> {
        self.before.iter().filter(|done| done.error.is_none()).map(|done| (done.key.clone(), done.clone())).collect()
    }

    /// Adds a line at once.
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

    /// Puts this run's lines in the manifest's order.
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
