use std::path::PathBuf;

use crate::wav::{self, Wav};

use super::*;

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("test-files").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(path(name)).unwrap()
}

fn speech() -> Wav {
    wav::read(&path("hello.wav")).unwrap()
}

/// The root mean square of the difference over that of the speech, where the speech starts `late`
/// samples late.
fn error(decoded: &[f32], speech: &[f32], late: usize) -> f64 {
    let square = |x: f32| f64::from(x) * f64::from(x);
    let difference: f64 = decoded[late..].iter().zip(speech).map(|(&a, &b)| square(a - b)).sum();
    (difference / speech.iter().map(|&x| square(x)).sum::<f64>()).sqrt()
}

#[test]
fn each_format_is_the_speech_that_it_was_made_from() {
    let speech = speech();
    for (name, bound) in [("hello.flac", 0.0), ("hello.mp3", 0.07), ("hello.ogg", 0.08), ("hello.m4a", 0.045)] {
        let read = wav::read(&path(name)).unwrap();
        assert_eq!((read.sample_rate, read.channels, read.frames()), (16_000, 1, 16_000), "{name}");
        assert_eq!(read.notes, [], "{name}");
        let error = error(&read.samples, &speech.samples, 0);
        assert!(error <= bound, "{name}: {error}");
    }
}

#[test]
fn plain_aac_starts_as_late_as_its_encoder_made_it() {
    let (read, speech) = (wav::read(&path("hello.aac")).unwrap(), speech());
    assert_eq!(read.sample_rate, 16_000);
    let error = error(&read.samples, &speech.samples, 1024);
    assert!(error <= 0.045, "{error}");
}

#[test]
fn opus_is_the_speech_at_48_khz() {
    let (read, speech) = (wav::read(&path("hello.opus")).unwrap(), speech());
    assert_eq!((read.sample_rate, read.channels, read.frames()), (48_000, 1, 48_000));
    assert_eq!(read.notes, []);
    // Of 16 kHz, so that every third sample is all of it.
    let thirds: Vec<f32> = read.samples.iter().copied().step_by(3).collect();
    let error = error(&thirds, &speech.samples, 0);
    assert!(error <= 0.12, "{error}");
}

#[test]
fn formats_that_are_not_read_are_named_with_how_to_convert_them() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("speech.caf");
    std::fs::write(&file, b"caff\0\x01\0\0desc and more").unwrap();
    let message = wav::read(&file).unwrap_err().to_string();
    assert!(message.contains("it is Core Audio") && message.contains("ffmpeg -i"), "{message}");
}

#[test]
fn what_a_cut_file_lacks_is_noted_or_refused() {
    for name in ["hello.flac", "hello.mp3"] {
        let whole = bytes(name);
        let read = parse(name_of(name), whole[..whole.len() / 2].to_vec()).unwrap();
        assert!((4_000..12_000).contains(&read.frames()), "{name}: {}", read.frames());
        let short = |note: &Note| matches!(note, Note::Short { claimed: 16_000.., .. });
        assert!(read.notes.iter().any(short), "{name}: {:?}", read.notes);
    }
    // Its index is at its end.
    let whole = bytes("hello.m4a");
    let error = parse("MPEG-4 audio", whole[..whole.len() / 2].to_vec()).unwrap_err();
    assert!(error.to_string().starts_with("not a whole MPEG-4 audio file: "), "{error}");
}

fn name_of(file: &str) -> &'static str {
    match file.rsplit_once('.').unwrap().1 {
        "flac" => "FLAC",
        "mp3" => "MP3",
        "ogg" => "Ogg",
        "opus" => OPUS,
        _ => "MPEG-4 audio",
    }
}

#[test]
fn damaged_files_give_errors_or_usable_samples() {
    umo_core::defect::keep_quiet(&[]);
    let mut random = 7_u64;
    let mut next = move || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(random >> 33).unwrap()
    };
    for name in ["hello.flac", "hello.mp3", "hello.ogg", "hello.opus", "hello.m4a", "hello.aac"] {
        let whole = bytes(name);
        for round in 0..150 {
            let mut damaged = whole.clone();
            // Headers, which are at both ends, in half of the rounds.
            for _ in 0..1 + round % 8 {
                let at = next() % if round % 2 == 0 { whole.len() } else { 400 };
                let end = if round % 4 == 1 { whole.len() - 1 - at } else { at };
                damaged[end] = next().to_le_bytes()[0];
            }
            damaged.truncate(whole.len() - if round % 3 == 0 { next() % whole.len() } else { 0 });
            if let Ok(read) = parse(name_of(name), damaged) {
                assert!(read.frames() > 0 && read.samples.iter().all(|x| x.is_finite()), "{name}, round {round}");
            }
        }
    }
}

#[test]
fn garbage_is_refused() {
    for start in [&b"fLaC"[..], b"OggS", b"ID3\x04", b"\xff\xfb\x90\x64", b"\0\0\0\x20ftypM4A "] {
        let garbage: Vec<u8> =
            start.iter().copied().chain((0..3000_u32).map(|x| (x * x % 251).to_le_bytes()[0])).collect();
        assert!(parse("MP3", garbage).is_err(), "{start:?}");
    }
}
