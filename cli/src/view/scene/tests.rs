use hound::{SampleFormat, WavSpec, WavWriter};
use umo_core_pose::clip::Clip;

use super::*;

/// Returns a scene with only a clip.
pub(crate) fn scene(clip: Clip) -> Scene {
    Scene::new(Path::new("clip.glb"), clip, Figure::default()).unwrap()
}

#[test]
fn audio_is_mixed_to_16_bits_within_range() {
    let audio = Audio::of(16_000, &[1.5, -2.0, 0.25]);
    assert_eq!((audio.sample_rate, audio.samples), (16_000, vec![32767, -32768, 8192]));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fast.wav");
    let spec = WavSpec { channels: 2, sample_rate: 96_000, bits_per_sample: 16, sample_format: SampleFormat::Int };
    let mut writer = WavWriter::create(&path, spec).unwrap();
    (0..19_200).for_each(|_| writer.write_sample(8192_i16).unwrap());
    writer.finalize().unwrap();
    let audio = Audio::new(&Speech::open(&path, false).unwrap()).unwrap();
    assert_eq!((audio.sample_rate, audio.samples.len()), (48_000, 4800));
    assert!((audio.samples[2400] - 8192).abs() < 50, "{}", audio.samples[2400]);
}

#[test]
fn codes_beyond_the_end_are_left_out() {
    for (every, left) in [(1, 17), (6, 3), (8, 3), (16, 2), (17, 1)] {
        let codes = vec![vec![7; 20]; 3];
        let mut record = Record { chunks: vec![(0, 7), (7, 12), (19, 12)], codes, every, ..Record::default() };
        record.cut(17);
        assert_eq!(record.chunks, [(0, 7), (7, 10), (19, 0)]);
        assert!(record.codes.iter().all(|codes| codes.len() == left), "every {every}");
    }
}

#[test]
fn too_long_a_motion_is_refused() {
    assert!(check_length(Path::new("a.wav"), MAX_SECONDS).is_ok());
    let refused = check_length(Path::new("a.wav"), MAX_SECONDS + 1.0).unwrap_err().to_string();
    assert!(refused.contains("a.wav: 1801 s"), "{refused}");
}
