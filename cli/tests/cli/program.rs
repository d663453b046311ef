//! Runs the program in a temporary folder.

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

/// Result of a run.
#[derive(Debug)]
pub(crate) struct Ended {
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Ended {
    /// Asserts success.
    pub(crate) fn success(self) -> Self {
        assert_eq!(self.code, 0, "{}", self.err);
        assert!(!self.err.contains("error:"), "{}", self.err);
        self
    }
}

/// Runs the program with these arguments.
pub(crate) fn umo(args: &[&str]) -> Ended {
    let output = Command::new(env!("CARGO_BIN_EXE_umo")).args(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Ended {
        code: output.status.code().expect("ended by itself, not by a signal"),
        out: text(output.stdout),
        err: text(output.stderr),
    }
}

/// Path of a golden model.
pub(crate) fn golden(name: &str) -> String {
    golden_file(name, "model.safetensors").to_str().unwrap().to_owned()
}

/// Path of a file in a golden model's folder.
pub(crate) fn golden_file(name: &str, file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name).join(file)
}

/// A folder that is removed at the end.
pub(crate) struct Folder(TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A path in the folder.
    pub(crate) fn at(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    /// Writes a file with these bytes.
    pub(crate) fn file(&self, name: &str, bytes: &[u8]) -> String {
        std::fs::write(self.at(name), bytes).unwrap();
        self.at(name)
    }

    /// The bytes of a file.
    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.at(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Names of all files, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// A model of the smallest size.
    pub(crate) fn tiny(&self, name: &str, more: &[&str]) -> String {
        let path = self.at(name);
        umo(&[&["model", "random", "--size", "tiny", "-o", &path], more].concat()).success();
        path
    }

    /// A recording of these samples at 16 kHz, as floats.
    pub(crate) fn wav(&self, name: &str, samples: &[f32]) -> String {
        let path = self.at(name);
        let (channels, sample_rate) = (1, 16_000);
        let spec =
            hound::WavSpec { channels, sample_rate, bits_per_sample: 32, sample_format: hound::SampleFormat::Float };
        let mut out = hound::WavWriter::create(&path, spec).unwrap();
        samples.iter().for_each(|&sample| out.write_sample(sample).unwrap());
        out.finalize().unwrap();
        path
    }

    /// A recording that resembles a voice.
    pub(crate) fn speech(&self) -> String {
        self.wav("speech.wav", &voice(9000))
    }

    /// Asserts that the program refuses these arguments with exit code 2 and one line of error, and
    /// does not change the folder. Returns the line.
    pub(crate) fn refused(&self, args: &[&str]) -> String {
        let before = self.names();
        let ended = umo(args);
        assert_eq!(ended.code, 2, "{args:?}: {}{}", ended.out, ended.err);
        let is_error = |line: &&str| line.starts_with("error:");
        let errors: Vec<_> = ended.err.lines().filter(is_error).collect();
        assert_eq!(errors.len(), 1, "{args:?}: {}", ended.err);
        let others = ended.err.lines().filter(|line| !is_error(line));
        for line in others {
            assert!(line.starts_with("note:") || line.starts_with("warning:"), "{args:?}: {}", ended.err);
        }
        assert_eq!(self.names(), before, "{args:?}");
        errors[0].to_owned()
    }
}

/// A tone that swells and fades.
#[expect(clippy::cast_precision_loss, reason = "a second has far fewer than 2^24 samples")]
pub(crate) fn voice(samples: usize) -> Vec<f32> {
    let sample = |i: usize| {
        let t = i as f32 / 16_000.0;
        0.4 * (1500.0 * t).sin() * (11.0 * t).cos()
    };
    (0..samples).map(sample).collect()
}
