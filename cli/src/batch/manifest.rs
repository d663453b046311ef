//! The lines of a batch.

use std::collections::HashSet;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};
use umo_core::{Mood, Place};

use super::hash::file_hash;
use crate::animate::{TAKE, is_take};
use crate::args::Batch;
use crate::atomic_file::refuse_inputs;
use crate::converse::{self, place};
use crate::export::Format;
use crate::failure::Failure;

/// A recording to animate.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Line {
    /// Index in the manifest, from 0.
    pub(super) number: usize,
    pub(super) file: PathBuf,
    pub(super) outputs: Vec<PathBuf>,
    pub(super) seed: Option<u64>,
    pub(super) prompt: Option<String>,
    pub(super) mood: Option<(Mood, f32)>,
    pub(super) start_pose: Option<PathBuf>,
    pub(super) speaker: Option<String>,
    pub(super) words: Option<PathBuf>,
    /// Name of the conversation that it belongs to.
    pub(super) scene: Option<String>,
    /// Its place there.
    pub(super) place: Option<Place>,
}

/// The lines of each conversation, in the order of their first lines.
pub(super) fn scenes(lines: &[Line]) -> Vec<Vec<&Line>> {
    let mut scenes: Vec<Vec<&Line>> = Vec::new();
    for line in lines.iter().filter(|line| line.scene.is_some()) {
        match scenes.iter_mut().find(|scene| scene[0].scene == line.scene) {
            Some(scene) => scene.push(line),
            None => scenes.push(vec![line]),
        }
    }
    scenes
}

impl Line {
    /// The take among the outputs.
    pub(super) fn take(&self) -> Option<&Path> {
        self.outputs.iter().map(PathBuf::as_path).find(|path| is_take(path))
    }

    /// The score beside the take, if there is one.
    pub(super) fn score(&self) -> Option<PathBuf> {
        self.take().map(|take| take.with_extension("toml")).filter(|score| score.exists())
    }

    /// Returns a hash of everything that the files depend on: contents, not names and dates.
    pub(super) fn key(&self, settings: &str) -> Result<String, Failure> {
        let mut hash = Sha256::new();
        let mut add = |field: &str| {
            hash.update((field.len() as u64).to_le_bytes());
            hash.update(field);
        };
        add(settings);
        add(&file_hash(&self.file)?);
        add(&self.start_pose.as_deref().map(file_hash).transpose()?.unwrap_or_default());
        add(&self.words.as_deref().map(file_hash).transpose()?.unwrap_or_default());
        add(&format!("{:?} {:?} {:?}", self.seed, self.prompt, self.mood));
        for output in &self.outputs {
            add(&output.to_string_lossy());
        }
        Ok(data_encoding::HEXLOWER.encode(&hash.finalize()))
    }
}

/// A line as the manifest spells it.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    file: String,
    #[serde(default)]
    output: Outputs,
    #[serde(default)]
    seed: Option<u64>,
    #[serde(default)]
    prompt: Option<String>,
    #[serde(default)]
    mood: Option<String>,
    #[serde(default)]
    start_pose: Option<String>,
    #[serde(default)]
    speaker: Option<String>,
    #[serde(default)]
    words: Option<String>,
    #[serde(default)]
    scene: Option<String>,
    #[serde(default)]
    place: Option<String>,
}

/// One file or several; CSV separates several with semicolons.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Outputs {
    One(String),
    Several(Vec<String>),
}

impl Default for Outputs {
    fn default() -> Self {
        Self::Several(Vec::new())
    }
}

/// Reads the lines of a folder or a manifest, with their outputs; checks them before any work.
pub(super) fn read(args: &Batch) -> Result<Vec<Line>, Failure> {
    let input = &args.input;
    args.format
        .iter()
        .filter(|name| !name.eq_ignore_ascii_case(TAKE))
        .try_for_each(|name| Format::parse(name).map(drop))?;
    let wrong = |cause: std::io::Error| Failure::input(format!("{}: {cause}", input.display()));
    let is_folder = std::fs::metadata(input).map_err(wrong)?.is_dir();
    let (base, rows) = if is_folder {
        let mut rows = Vec::new();
        folder(input, input, &mut rows).map_err(wrong)?;
        (input.as_path(), rows)
    } else {
        (input.parent().unwrap_or(Path::new("")), manifest(input)?)
    };
    if rows.is_empty() {
        return Err(Failure::input(format!("{}: no recording found", input.display())));
    }
    let mut lines = Vec::with_capacity(rows.len());
    let mut taken = HashSet::new();
    for (number, row) in rows.into_iter().enumerate() {
        let line = line(number, row, base, args)
            .map_err(|problem| Failure::input(format!("{}: line {}: {problem}", input.display(), number + 1)))?;
        for output in &line.outputs {
            if !taken.insert(output.clone()) {
                let problem = format!("`{}` is the output of two lines", output.display());
                return Err(Failure::input(format!("{}: line {}: {problem}", input.display(), number + 1)));
            }
        }
        lines.push(line);
    }
    let results = args.results_path();
    let mut outputs: Vec<&Path> = lines.iter().flat_map(|line| &line.outputs).map(PathBuf::as_path).collect();
    outputs.push(&results);
    let more = lines.iter().flat_map(|line| [&line.start_pose, &line.words]).flatten().map(PathBuf::as_path);
    let inputs: Vec<_> = lines.iter().map(|line| &*line.file).chain(more).chain([input.as_path()]).collect();
    refuse_inputs(&outputs, &inputs)?;
    check_scenes(args, &lines).map_err(|problem| Failure::input(format!("{}: {problem}", input.display())))?;
    Ok(lines)
}

/// Adds the recordings of a folder and its subfolders, sorted by name.
fn folder(root: &Path, folder_path: &Path, rows: &mut Vec<Row>) -> std::io::Result<()> {
    let mut entries = std::fs::read_dir(folder_path)?.collect::<Result<Vec<_>, _>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        if entry.file_type()?.is_dir() {
            folder(root, &path, rows)?;
        } else if umo_audio_file::has_extension(&path) {
            let name = path.strip_prefix(root).unwrap_or(&path);
            rows.push(Row { file: name.to_string_lossy().into_owned(), ..Row::default() });
        }
    }
    Ok(())
}

fn manifest(path: &Path) -> Result<Vec<Row>, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let file = File::open(path).map_err(|cause| wrong(cause.to_string()))?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    match extension.as_str() {
        "csv" => {
            let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file);
            reader.deserialize().map(|row| row.map_err(|error| wrong(error.to_string()))).collect()
        }
        "jsonl" | "ndjson" => {
            let mut rows = Vec::new();
            for (number, line) in BufReader::new(file).lines().enumerate() {
                let line = line.map_err(|cause| wrong(cause.to_string()))?;
                if !line.trim().is_empty() {
                    let row = serde_json::from_str(&line);
                    rows.push(row.map_err(|error| wrong(format!("line {}: {error}", number + 1)))?);
                }
            }
            Ok(rows)
        }
        _ => Err(wrong("expected a folder, or a manifest that ends in .csv or .jsonl".to_owned())),
    }
}

fn line(number: usize, row: Row, base: &Path, args: &Batch) -> Result<Line, String> {
    let some = |text: Option<String>| text.filter(|text| !text.is_empty());
    let out = args.output.as_deref().unwrap_or(base);
    let names: Vec<String> = match row.output {
        Outputs::One(text) => {
            text.split(';').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
        }
        Outputs::Several(names) => names,
    };
    if let Some(name) = names.iter().find(|name| leaves(Path::new(name))) {
        return Err(format!("output `{name}` is outside the outputs' folder, {}", out.display()));
    }
    let outputs: Vec<PathBuf> = if names.is_empty() {
        let own = Path::new(&row.file);
        // For a recording outside the base folder, only the file name is kept.
        let is_inside = own.is_relative() && !own.components().any(|part| part == Component::ParentDir);
        let own = if is_inside { own } else { Path::new(own.file_name().unwrap_or_default()) };
        args.format.iter().map(|name| out.join(own).with_extension(name.to_ascii_lowercase())).collect()
    } else {
        names.iter().map(|name| out.join(name)).collect()
    };
    let mut takes = outputs.iter().filter(|path| is_take(path));
    if takes.next().is_some() && (args.retime || row.scene.as_deref().is_some_and(|name| !name.is_empty())) {
        return Err("a take (.umo) cannot say a motion of --retime or of a conversation".to_owned());
    }
    if takes.next().is_some() {
        return Err("a line has one take (.umo)".to_owned());
    }
    for output in outputs.iter().filter(|path| !is_take(path)) {
        Format::from_extension(output).map_err(|error| error.to_string())?;
    }
    let speaker = some(row.speaker);
    let mood = some(row.mood).map(|text| mood(&text)).transpose()?;
    Ok(Line {
        number,
        file: base.join(&row.file),
        outputs,
        seed: row.seed.or_else(|| speaker.as_deref().map(seed_of)),
        prompt: some(row.prompt),
        mood,
        start_pose: some(row.start_pose).map(|path| base.join(path)),
        speaker,
        words: some(row.words).map(|path| base.join(path)),
        scene: some(row.scene),
        place: some(row.place).map(|text| place::parse(&text)).transpose().map_err(|failure| failure.to_string())?,
    })
}

/// Refuses conversations that cannot be made.
fn check_scenes(args: &Batch, lines: &[Line]) -> Result<(), String> {
    let say = |failure: Failure| failure.to_string();
    if let Some(line) = lines.iter().find(|line| line.place.is_some() && line.scene.is_none()) {
        return Err(format!("line {} has a place and no scene", line.number + 1));
    }
    for scene in scenes(lines) {
        let name = scene[0].scene.as_deref().unwrap_or_default();
        let wrong = |problem: String| format!("scene {name}: {problem}");
        converse::refuse_alone(&args.generate).map_err(say).map_err(wrong)?;
        converse::check_count(scene.len()).map_err(say).map_err(wrong)?;
        if args.retime || args.reduce.is_some() || scene.iter().any(|line| line.start_pose.is_some()) {
            return Err(wrong("--retime, --reduce and start_pose do not go with a conversation".to_owned()));
        }
        if scene.iter().any(|line| line.place.is_some() != scene[0].place.is_some()) {
            return Err(wrong("some of its lines have a place and others have none".to_owned()));
        }
    }
    Ok(())
}

/// Whether a path leaves the folder that it is relative to.
fn leaves(path: &Path) -> bool {
    let mut depth = 0_usize;
    path.components().any(|part| match part {
        Component::Normal(_) => {
            depth += 1;
            false
        }
        Component::CurDir => false,
        Component::ParentDir if depth > 0 => {
            depth -= 1;
            false
        }
        Component::ParentDir | Component::RootDir | Component::Prefix(_) => true,
    })
}

/// Returns the seed for a speaker's lines without one, so that the speaker keeps the same habits in all lines.
fn seed_of(speaker: &str) -> u64 {
    let hash = Sha256::digest(speaker);
    hash[..8].iter().fold(0, |seed, &byte| seed << 8 | u64::from(byte))
}

/// Parses `joy` or `joy=0.5`.
fn mood(text: &str) -> Result<(Mood, f32), String> {
    let (name, strength) = text.split_once('=').map_or((text, "1"), |(name, strength)| (name.trim(), strength.trim()));
    let found = Mood::ALL.into_iter().find(|mood| mood.name().eq_ignore_ascii_case(name));
    let known = || Mood::ALL.map(Mood::name).join(", ");
    let mood = found.ok_or_else(|| format!("unknown mood `{name}`; known: {}", known()))?;
    match strength.parse() {
        Ok(strength) if (0.0..=1.0).contains(&strength) => Ok((mood, strength)),
        _ => Err(format!("mood `{text}`: expected a strength of 0 to 1")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moods_have_names_and_strengths() {
        assert_eq!(mood("joy"), Ok((Mood::Joy, 1.0)));
        assert_eq!(mood("Sad = 0.25"), Ok((Mood::Sad, 0.25)));
        assert!(mood("happy").unwrap_err().contains("joy"));
        assert!(mood("joy=2").unwrap_err().contains("0 to 1"));
    }

    #[test]
    fn a_speaker_has_a_seed() {
        assert_eq!(seed_of("ada"), seed_of("ada"));
        assert_ne!(seed_of("ada"), seed_of("bob"));
    }
}
