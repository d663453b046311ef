//! The mouth follows the speech of unusual recordings.

use super::program::{Folder, umo};

/// Duration of speech, seconds.
const SECONDS: usize = 4;

/// `jawOpen` in each frame of a recording's motion, and standard error.
fn jaw(folder: &Folder, recording: &str) -> (Vec<f64>, String) {
    let model = format!("{}/../models/umo-people/model.safetensors", env!("CARGO_MANIFEST_DIR"));
    let out = folder.at("motion.jsonl");
    let ended = umo(&["animate", recording, "--model", &model, "-o", &out]).success();
    let text = String::from_utf8(folder.read("motion.jsonl")).unwrap();
    let mut lines = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let names = lines.next().unwrap()["face"]["names"].clone();
    let at = names.as_array().unwrap().iter().position(|name| name == "jawOpen").unwrap();
    (lines.map(|frame| frame["face"][at].as_f64().unwrap()).collect(), ended.err)
}

/// Pearson's correlation.
#[expect(clippy::cast_precision_loss, reason = "a few hundred frames")]
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (a_mean, b_mean) = (mean(a), mean(b));
    let product = |x: &[f64], x_mean: f64, y: &[f64], y_mean: f64| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - x_mean) * (y - y_mean)).sum()
    };
    product(a, a_mean, b, b_mean) / (product(a, a_mean, a, a_mean) * product(b, b_mean, b, b_mean)).sqrt()
}

/// A recording of floats at 16 kHz, interleaved.
fn floats(folder: &Folder, name: &str, channels: u16, samples: impl Iterator<Item = f32>) -> String {
    let (bits_per_sample, sample_format) = (32, hound::SampleFormat::Float);
    let spec = hound::WavSpec { channels, sample_rate: 16_000, bits_per_sample, sample_format };
    let mut out = hound::WavWriter::create(folder.at(name), spec).unwrap();
    samples.for_each(|sample| out.write_sample(sample).unwrap());
    out.finalize().unwrap();
    folder.at(name)
}

#[test]
fn the_mouth_follows_speech_of_any_level_and_in_any_channel() {
    let folder = Folder::new();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/hello.wav");
    let mut speech = hound::WavReader::open(path).unwrap();
    let speech: Vec<f32> =
        speech.samples::<i16>().take(16_000 * SECONDS).map(|x| f32::from(x.unwrap()) / 32768.0).collect();
    let all = || speech.iter().copied();
    let (plain, said) = jaw(&folder, &floats(&folder, "plain.wav", 1, all()));
    assert!(!said.contains("note:"), "{said}");
    for (name, recording, finding) in [
        ("antiphase", floats(&folder, "a.wav", 2, all().flat_map(|x| [x, -x])), "cancel each other"),
        ("integers as floats", floats(&folder, "b.wav", 1, all().map(|x| x * 32768.0)), "16-bit integers"),
        ("34 dB less", floats(&folder, "c.wav", 1, all().map(|x| x * 0.02)), "adjusted to -26 dB"),
        (
            "in the centre of 5.1",
            floats(
                &folder,
                "d.wav",
                6,
                all().zip(all().skip(900)).flat_map(|(x, y)| [y / 9.0, -y / 9.0, x, y, 0.0, 0.0]),
            ),
            "only its centre channel",
        ),
    ] {
        let (moved, said) = jaw(&folder, &recording);
        let count = moved.len().min(plain.len());
        let r = correlation(&moved[..count], &plain[..count]);
        assert!(r >= 0.85, "{name}: {r}");
        assert!(said.contains("note:") && said.contains(finding), "{name}: {said}");
    }
}

#[test]
fn other_formats_give_the_same_motion() {
    let folder = Folder::new();
    let file = |name: &str| format!("{}/../audio-file/test-files/{name}", env!("CARGO_MANIFEST_DIR"));
    let plain = jaw(&folder, &file("phone.wav")).0;
    assert_eq!(plain.len(), 15);
    for name in ["phone.aiff", "phone.caf", "phone.w64", "phone-alac.caf", "phone-alac.m4a"] {
        assert!(jaw(&folder, &file(name)).0 == plain, "{name}");
    }
    for name in ["phone.aifc", "phone-pcm_mulaw.wav", "phone-pcm_alaw.wav", "phone-adpcm_ms.wav"] {
        let r = correlation(&jaw(&folder, &file(name)).0, &plain);
        // In half a second one sampled code, which may differ between processors, takes a quarter of it; noise has 0.
        assert!(r >= 0.6, "{name}: {r}");
    }
    let plain = jaw(&folder, &file("hello.wav")).0;
    assert_eq!(plain.len(), 30);
    assert!(jaw(&folder, &file("hello.flac")).0 == plain, "lossless audio gives another motion");
    for name in ["hello.mp3", "hello.ogg", "hello.opus", "hello.m4a"] {
        let r = correlation(&jaw(&folder, &file(name)).0, &plain);
        assert!(r >= 0.9, "{name}: {r}");
    }
    // Delay in frames due to AAC's encoder.
    for (name, late, least) in
        [("hello.webm", 0, 0.9), ("hello.mka", 0, 0.9), ("hello-aac.mka", 2, 0.85), ("hello-opus.mp4", 0, 0.9)]
    {
        let moved = jaw(&folder, &file(name)).0;
        assert!((30..=32).contains(&moved.len()), "{name}: {} frames", moved.len());
        let r = correlation(&moved[late..late + 28], &plain[..28]);
        assert!(r >= least, "{name}: {r}");
    }
}
