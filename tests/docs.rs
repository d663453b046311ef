//! Checks the documentation: numbers that follow from the default model's settings against
//! the library's, and package names against the packages.

#[path = "docs/names.rs"]
mod names;

use std::sync::Arc;

use umo_core::{
    AvatarConfig, Config, Engine, EngineConfig, Model, ModelFile, Precision, SessionConfig, Threads, Voice,
};
use umo_kernels::Isa;
use umo_tests::pages::{Table, root, tables};

fn default_model() -> Config {
    ModelFile::open(&root().join("models/umo-people/model.safetensors")).unwrap().config().clone()
}

/// The number at the start of a cell.
fn number<T: std::str::FromStr>(cell: &str, place: &str) -> T {
    let digits = cell.split([' ', ',']).next().unwrap();
    digits.parse().ok().unwrap_or_else(|| panic!("{place}: \"{cell}\" does not begin with a number"))
}

/// Latency of a session at this rate, in seconds, in the documentation's format.
fn latency(config: &Config, target: usize, lookahead: usize, sample_rate: usize) -> String {
    let defaults = SessionConfig::new(config);
    let avatar = AvatarConfig { target, lookahead, ..defaults.avatar.clone() };
    let session = SessionConfig { avatar, sample_rate, ..defaults };
    let seconds = session.latency_samples(config).unwrap() as f64 / sample_rate as f64;
    format!("{seconds:.3} s")
}

#[test]
fn latencies_are_those_that_sessions_have() {
    let config = default_model();
    let mut rows = 0;
    for Table { place, rows: table } in tables(|header| header[0] == "`target`, `lookahead`") {
        let rates: Vec<usize> = table[0][1..]
            .iter()
            .map(|header| {
                let kilohertz = header.strip_prefix("audio of ").and_then(|header| header.strip_suffix(" kHz"));
                let kilohertz = kilohertz.unwrap_or_else(|| panic!("{place}: \"{header}\" names no rate"));
                1000 * number::<usize>(kilohertz, &place)
            })
            .collect();
        for row in &table[1..] {
            let (target, lookahead) = row[0].split_once(", ").unwrap_or_else(|| panic!("{place}: \"{}\"", row[0]));
            let (target, lookahead) = (number(target, &place), number(lookahead, &place));
            let default = (target, lookahead) == (config.target, config.lookahead);
            assert_eq!(row[0].contains("default"), default, "{place}: \"{}\"", row[0]);
            let seconds: Vec<_> = rates.iter().map(|&rate| latency(&config, target, lookahead, rate)).collect();
            assert_eq!(row[1..], seconds, "{place}: target {target}, lookahead {lookahead}");
            rows += 1;
        }
    }
    assert!(rows >= 3, "the documentation has no table of latencies");
}

#[test]
fn chunks_are_as_long_as_the_model_makes_them() {
    let config = default_model();
    let tables = tables(|header| header[0] == "`target`" && header[1] == "a chunk is");
    assert!(!tables.is_empty(), "the documentation has no table of chunks");
    for Table { place, rows } in tables {
        assert_eq!(rows[0][3], "chunks a second", "{place}");
        for row in &rows[1..] {
            let target = number::<usize>(&row[0], &place);
            assert_eq!(row[0].contains("default"), target == config.target, "{place}: \"{}\"", row[0]);
            let seconds = (target * config.keyframe_stride) as f64 / config.frame_rate as f64;
            assert_eq!((&row[1], &row[3]), (&format!("{seconds:.1} s"), &format!("{:.0}", 1.0 / seconds)), "{place}");
        }
    }
}

#[test]
fn the_default_model_has_the_size_that_is_said() {
    let size = std::fs::metadata(root().join("models/umo-people/model.safetensors")).unwrap().len();
    let megabytes = size as f64 / 1e6;
    for (page, said) in [
        ("bindings/godot/README.md", format!("model ({megabytes:.0} MB)")),
        ("cli/README.md", format!("is a file of {megabytes:.0} MB")),
        ("models/umo-people/README.md", format!("{megabytes:.1} MB")),
    ] {
        let text = std::fs::read_to_string(root().join(page)).unwrap();
        assert!(text.contains(&said), "{page} does not say \"{said}\"");
    }
}

/// The low-pass filter delays by as many frames as it looks ahead.
#[test]
fn smoothing_is_part_of_the_latency() {
    let config = default_model();
    let defaults = SessionConfig::new(&config);
    let frames = |smoothing, lookahead| {
        AvatarConfig { smoothing, lookahead, target: 1, ..defaults.avatar.clone() }.latency_frames(&config)
    };
    assert!(defaults.avatar.smoothing > 0.0, "a session that says nothing trembles");
    let without = config.latency_frames(1, 0);
    assert_eq!(frames(0.0, 0), without);
    assert_eq!([frames(0.5, 0), frames(1.0, 0), frames(1.5, 0)], [without + 1, without + 2, without + 3]);
    assert_eq!(frames(1.5, 9), without + 9);
    let avatar = AvatarConfig { smoothing: 1.6, ..defaults.avatar.clone() };
    let error = SessionConfig { avatar, ..defaults }.latency_samples(&config).unwrap_err().to_string();
    assert!(error.contains("smoothing"), "{error}");
}

/// A session at an unsupported rate, target or lookahead has no latency.
#[test]
fn latency_refuses_what_a_session_refuses() {
    let config = default_model();
    let with = |target, lookahead, sample_rate| {
        let avatar = AvatarConfig { target, lookahead, ..AvatarConfig::new(&config) };
        SessionConfig { avatar, sample_rate, ..SessionConfig::new(&config) }.latency_samples(&config)
    };
    assert!(with(5, 9, 16_000).is_ok());
    for (key, found) in [
        ("target", with(0, 0, 16_000)),
        ("target", with(usize::MAX, 0, 16_000)),
        ("lookahead", with(5, usize::MAX, 16_000)),
        ("sample_rate", with(5, 9, 0)),
    ] {
        let error = found.unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}

/// Delay of a live mouth behind its audio, at every rate that a page names.
#[test]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a sample rate")]
fn live_mouths_are_as_late_as_is_said() {
    let path = root().join("models/umo-people/model.safetensors");
    let model = Model::load(&ModelFile::open(&path).unwrap(), Precision::Stored, Isa::detect()).unwrap();
    let engine_config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
    let engine = Engine::new(Arc::new(model), &engine_config).unwrap();
    let mut rows = 0;
    for Table { place, rows: table } in tables(|header| header[0] == "sample rate, kHz") {
        for row in &table[1..] {
            for rate in row[0].split(", ") {
                let sample_rate = (1000.0 * rate.parse::<f64>().unwrap()).round() as usize;
                let config =
                    SessionConfig { sample_rate, voice: Voice::Live, ..SessionConfig::new(engine.model().config()) };
                let behind =
                    engine.session(&config).unwrap().latency().mouth_samples as f64 * 1000.0 / sample_rate as f64;
                assert_eq!(row[1], format!("{behind:.0}"), "{place}: {rate} kHz, {behind} ms");
                let frame = 1000.0 / 30.0;
                if let [most, mean] = &row[2..] {
                    assert_eq!(*most, format!("{:.0}", behind + frame), "{place}: {rate} kHz");
                    assert_eq!(*mean, format!("{:.0}", behind + frame / 2.0), "{place}: {rate} kHz");
                }
                assert!(sample_rate < 16_000 || behind + frame <= 100.0, "{place}: {rate} kHz");
                rows += 1;
            }
        }
    }
    assert!(rows >= 10, "the documentation has no table of live mouths");
}
