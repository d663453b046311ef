use umo_core::motion::clip::Clip;

use super::*;

/// A page of a clip and nothing else.
pub(crate) fn scene(clip: Clip) -> Scene {
    Scene::new(Path::new("clip.glb"), clip, Figure::default()).unwrap()
}

#[test]
fn audio_is_mixed_to_16_bits_within_range() {
    let wav =
        Wav { sample_rate: 16_000, channels: 2, samples: vec![1.5, 1.5, -2.0, -2.0, 0.5, 0.0], notes: Vec::new() };
    let audio = Audio::new(&wav).unwrap();
    assert_eq!((audio.sample_rate, audio.samples), (16_000, vec![32767, -32768, 8192]));
    let fast = Wav { sample_rate: 96_000, channels: 1, samples: vec![0.0; 9600], notes: Vec::new() };
    let audio = Audio::new(&fast).unwrap();
    assert_eq!((audio.sample_rate, audio.samples.len()), (48_000, 4800));
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
