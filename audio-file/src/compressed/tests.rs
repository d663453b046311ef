use std::path::PathBuf;

use crate::{Note, Recording, parse, read};

fn path(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("test-files").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(path(name)).unwrap()
}

fn speech() -> Recording {
    read(&path("hello.wav")).unwrap()
}

/// RMS of the difference divided by that of the speech, which starts `late` samples into the decoded audio.
fn error(decoded: &[f32], speech: &[f32], late: usize) -> f64 {
    let square = |x: f32| f64::from(x) * f64::from(x);
    let difference: f64 = decoded[late..].iter().zip(speech).map(|(&a, &b)| square(a - b)).sum();
    (difference / speech.iter().map(|&x| square(x)).sum::<f64>()).sqrt()
}

#[test]
fn each_format_is_the_speech_that_it_was_made_from() {
    let speech = speech();
    for (name, bound) in [("hello.flac", 0.0), ("hello.mp3", 0.07), ("hello.ogg", 0.08), ("hello.m4a", 0.045)] {
        let read = read(&path(name)).unwrap();
        assert_eq!((read.sample_rate, read.channels, read.frames()), (16_000, 1, 16_000), "{name}");
        assert_eq!(read.notes, [], "{name}");
        let error = error(&read.samples, &speech.samples, 0);
        assert!(error <= bound, "{name}: {error}");
    }
}

#[test]
fn plain_aac_starts_as_late_as_its_encoder_made_it() {
    let (read, speech) = (read(&path("hello.aac")).unwrap(), speech());
    assert_eq!(read.sample_rate, 16_000);
    let error = error(&read.samples, &speech.samples, 1024);
    assert!(error <= 0.045, "{error}");
}

#[test]
fn opus_is_the_speech_at_48_khz() {
    let (read, speech) = (read(&path("hello.opus")).unwrap(), speech());
    assert_eq!((read.sample_rate, read.channels, read.frames()), (48_000, 1, 48_000));
    assert_eq!(read.notes, []);
    // The speech is at 16 kHz, so every third sample reproduces it.
    let thirds: Vec<f32> = read.samples.iter().copied().step_by(3).collect();
    let error = error(&thirds, &speech.samples, 0);
    assert!(error <= 0.12, "{error}");
}

#[test]
fn formats_that_are_not_read_are_named_with_how_to_convert_them() {
    let folder = tempfile::tempdir().unwrap();
    let page = |codec: &[u8]| [b"OggS\0\x02".to_vec(), vec![0; 20], vec![1, 80], codec.to_vec(), vec![0; 72]].concat();
    let transport = [vec![0x47; 1], vec![0; 187], vec![0x47; 1], vec![0; 187]].concat();
    for (name, bytes, said) in [
        ("speech.spx", page(b"Speex   "), "it is Speex"),
        ("speech.ts", transport, "it is MPEG-TS"),
        ("speech.wma", b"\x30\x26\xb2\x75\x8e\x66\xcf\x11".to_vec(), "it is Windows Media Audio"),
        ("speech.amr", b"#!AMR\n".to_vec(), "it is AMR"),
    ] {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).unwrap();
        let message = read(&file).unwrap_err().to_string();
        assert!(message.contains(said) && message.contains("ffmpeg -i"), "{message}");
    }
}

#[test]
fn containers_and_codecs_of_telephones_hold_the_same_speech() {
    let speech = read(&path("phone.wav")).unwrap();
    for (name, bound) in [
        ("phone.aiff", 0.0),
        ("phone.caf", 0.0),
        ("phone.w64", 0.0),
        ("phone-alac.caf", 0.0),
        ("phone-alac.m4a", 0.0),
        ("phone.aifc", 0.03),
        ("phone-pcm_mulaw.wav", 0.03),
        ("phone-pcm_alaw.wav", 0.03),
        ("phone-adpcm_ms.wav", 0.08),
        ("phone-adpcm_ima_wav.wav", 0.12),
    ] {
        let read = read(&path(name)).unwrap();
        assert_eq!((read.sample_rate, read.channels, &read.notes[..]), (8_000, 1, &[][..]), "{name}");
        // The last block of ADPCM is padded.
        let most = if name.contains("adpcm") { 4_100 } else { 4_000 };
        assert!((4_000..=most).contains(&read.frames()), "{name}: {}", read.frames());
        let error = error(&read.samples, &speech.samples, 0);
        assert!(error <= bound, "{name}: {error}");
    }
}

#[test]
fn what_browsers_record_is_the_speech() {
    let speech = speech();
    // AAC is delayed by its encoder.
    for (name, bound, late) in [("hello.mka", 0.08, 0), ("hello-aac.mka", 0.045, 1024)] {
        let read = read(&path(name)).unwrap();
        assert_eq!((read.sample_rate, read.channels, &read.notes[..]), (16_000, 1, &[][..]), "{name}");
        assert!((16_000..=17_408).contains(&read.frames()), "{name}: {}", read.frames());
        let error = error(&read.samples, &speech.samples, late);
        assert!(error <= bound, "{name}: {error}");
    }
    for name in ["hello.webm", "hello-opus.mp4"] {
        let read = read(&path(name)).unwrap();
        assert_eq!((read.sample_rate, read.channels, &read.notes[..]), (48_000, 1, &[][..]), "{name}");
        assert!((48_000..49_000).contains(&read.frames()), "{name}: {}", read.frames());
        let thirds: Vec<f32> = read.samples.iter().copied().step_by(3).collect();
        let error = error(&thirds, &speech.samples, 0);
        assert!(error <= 0.12, "{name}: {error}");
    }
}

#[test]
fn a_stream_without_its_length_is_read_to_its_end() {
    let read = read(&path("hello-pipe.mp3")).unwrap();
    assert_eq!((read.sample_rate, &read.notes[..]), (16_000, &[][..]));
    // The encoder's delay and padding are unknown, too.
    assert!((16_000..19_000).contains(&read.frames()), "{}", read.frames());
    let speech = speech();
    let late = (1_000..1_300).min_by(|&a, &b| {
        error(&read.samples[8_000..], &speech.samples[8_000..], a).total_cmp(&error(
            &read.samples[8_000..],
            &speech.samples[8_000..],
            b,
        ))
    });
    let error = error(&read.samples[8_000..], &speech.samples[8_000..], late.unwrap());
    assert!(error < 0.3, "{late:?}: {error}");
}

#[test]
fn files_that_are_joined_are_all_read() {
    let tag = [b"ID3\x04\0\0\0\0\x02\x01".to_vec(), vec![0xFF; 257]].concat();
    for name in ["hello.mp3", "hello.flac", "hello.ogg", "hello.aac"] {
        let one = parse(&bytes(name)).unwrap();
        for between in [&[][..], &tag] {
            if name == "hello.ogg" && !between.is_empty() {
                continue;
            }
            let both = parse(&[&bytes(name)[..], between, &bytes(name)].concat()).unwrap();
            assert_eq!(both.notes, [], "{name}");
            assert_eq!(both.samples.len(), 2 * one.samples.len(), "{name}");
            if name != "hello.aac" {
                assert_eq!(both.samples, [one.samples.clone(), one.samples.clone()].concat(), "{name}");
            }
        }
    }
    // A second MP3 file without an information frame.
    let whole = bytes("hello.mp3");
    let frame = whole.windows(2).rposition(|at| at == [0xFF, 0xF3]).unwrap();
    let last = &whole[frame..];
    let both = parse(&[&whole[..], &last.repeat(8)].concat()).unwrap();
    assert_eq!(both.samples.len(), 16_000 + 8 * 576, "{:?}", both.notes);
    // Tags at both ends.
    let tagged = parse(&[&tag[..], &tag, &whole, b"TAG", &[b' '; 125]].concat()).unwrap();
    assert_eq!((tagged.samples.len(), &tagged.notes[..]), (16_000, &[][..]));
}

#[test]
fn an_edit_list_s_pause_is_silence() {
    let (late, speech) = (read(&path("hello-late.m4a")).unwrap(), speech());
    // 416 ms, preceded by the encoder's delay.
    let pause = 480 * 16;
    assert!(late.samples[..pause - 1024].iter().all(|&x| x == 0.0));
    assert!((pause + 16_000..=pause + 16_400).contains(&late.frames()), "{}", late.frames());
    let error = error(&late.samples, &speech.samples, pause);
    assert!(error <= 0.045, "{error}");
}

#[test]
fn what_a_cut_file_lacks_is_noted_or_refused() {
    for name in ["hello.flac", "hello.mp3"] {
        let whole = bytes(name);
        let read = parse(&whole[..whole.len() / 2]).unwrap();
        assert!((4_000..12_000).contains(&read.frames()), "{name}: {}", read.frames());
        let short = |note: &Note| matches!(note, Note::Short { claimed: 16_000.., .. });
        assert!(read.notes.iter().any(short), "{name}: {:?}", read.notes);
    }
    for (name, frames) in [("hello.webm", 20_000..40_000), ("hello.mka", 1_000..14_000)] {
        let whole = bytes(name);
        let read = parse(&whole[..whole.len() * 6 / 10]).unwrap();
        assert!(frames.contains(&read.frames()), "{name}: {}", read.frames());
        assert!(read.notes.contains(&Note::Cut), "{name}: {:?}", read.notes);
    }
    // The index is at the end of the file.
    let whole = bytes("hello.m4a");
    let error = parse(&whole[..whole.len() / 2]).unwrap_err();
    assert!(error.to_string().starts_with("not a whole MPEG-4 audio file: "), "{error}");
}

#[test]
fn damaged_files_give_errors_or_usable_samples() {
    umo_core_base::defect::keep_quiet(&[]);
    let mut random = 7_u64;
    let mut next = move || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(random >> 33).unwrap()
    };
    for name in [
        "hello.flac",
        "hello.mp3",
        "hello.ogg",
        "hello.opus",
        "hello.m4a",
        "hello.aac",
        "hello.webm",
        "hello.mka",
        "hello-late.m4a",
        "phone.aiff",
        "phone-alac.caf",
        "phone.w64",
        "phone-adpcm_ms.wav",
    ] {
        let whole = bytes(name);
        for round in 0..150 {
            let mut damaged = whole.clone();
            // In half of the rounds, the damage is in the headers, which are at both ends.
            for _ in 0..1 + round % 8 {
                let at = next() % if round % 2 == 0 { whole.len() } else { 400 };
                let end = if round % 4 == 1 { whole.len() - 1 - at } else { at };
                damaged[end] = next().to_le_bytes()[0];
            }
            damaged.truncate(whole.len() - if round % 3 == 0 { next() % whole.len() } else { 0 });
            if let Ok(read) = parse(&damaged) {
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
        assert!(parse(&garbage).is_err(), "{start:?}");
    }
}
