use super::*;
use proptest::prelude::*;
use umo_core_pose::rotation::normalized;
use umo_figure::sample;

/// Writes a clip and reads it back.
fn back(clip: &Clip, format: Format) -> Clip {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("motion.{}", format.name()));
    crate::export::write(&path, None, clip).unwrap();
    read(&path).unwrap()
}

fn near(a: &[[f32; 3]], b: &[[f32; 3]]) -> bool {
    a.len() == b.len() && a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < 2e-5)
}

/// Returns the largest angle between corresponding rotations of two clips, radians.
fn largest_angle(a: &Clip, b: &Clip) -> f32 {
    let pairs = a.rotations.iter().flatten().zip(b.rotations.iter().flatten());
    let angle = pairs.map(|(&a, &b)| {
        let (a, b) = (normalized(a), normalized(b));
        let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        let apart: f32 = a.iter().zip(b).map(|(a, b)| (a - dot.signum() * b).powi(2)).sum();
        2.0 * apart.sqrt()
    });
    angle.fold(0.0, f32::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2))]
    #[test]
    fn what_was_written_is_read(frames in 1_usize..9, rate in prop::sample::select(vec![24.0_f32, 29.97, 30.0, 120.0])) {
        for kind in [FaceKind::Arkit, FaceKind::SmplxExpression] {
            let mut clip = sample::clip(kind, frames, 3);
            clip.frame_rate = rate;
            for format in [Format::Npz, Format::Glb, Format::Bvh, Format::Jsonl] {
                let read = back(&clip, format);
                prop_assert_eq!(read.len(), clip.len());
                prop_assert!((read.frame_rate - rate).abs() < 1e-3 || frames == 1, "{:?} {}", format, read.frame_rate);
                prop_assert!(largest_angle(&clip, &read) < 1e-5, "{:?}", format);
                if format != Format::Npz {
                    prop_assert_eq!(&read.skeleton.parents, &clip.skeleton.parents);
                    prop_assert!(near(&read.skeleton.offsets_m[1..], &clip.skeleton.offsets_m[1..]));
                }
                let root = |clip: &Clip| -> Vec<[f32; 3]> {
                    let offset = if format == Format::Npz { [0.0; 3] } else { clip.skeleton.offsets_m[0] };
                    clip.translation.iter().map(|t| std::array::from_fn(|i| t[i] + offset[i])).collect()
                };
                prop_assert!(near(&root(&read), &root(&clip)), "{:?}", format);
                if format != Format::Bvh {
                    prop_assert_eq!(&read.face, &clip.face);
                    prop_assert_eq!(&read.face_values, &clip.face_values);
                }
            }
        }
    }
}

/// Of keys that are frames apart in every track, too.
#[test]
fn glb_files_of_few_keys_are_read_within_their_bound() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("few.glb");
    for (rate, degrees, stride) in [(30.0, 0.5, 1), (30.0, 3.0, 1), (24.0, 2.0, 3), (29.97, 1.0, 1)] {
        let mut clip = sample::clip(FaceKind::Arkit, 90, 3);
        clip.frame_rate = rate;
        let channels = clip.face.names.len();
        for frame in 0..clip.len() {
            // A wave, in steps between which it goes straight.
            let (at, share) = ((frame / stride * stride) as f32, (frame % stride) as f32 / stride as f32);
            let wave = |speed: f32| {
                let value = |at: f32| (speed * at).sin() * 0.3;
                value(at) + share * (value(at + stride as f32) - value(at))
            };
            let (sin, cos) = (0.5 * wave(0.11)).sin_cos();
            clip.rotations[frame] = [[sin, 0.0, 0.0, cos]; JOINTS];
            clip.translation[frame] = [wave(0.05), 1.0, 0.0];
            clip.face_values[frame * channels..][..channels].fill(wave(0.03).abs());
        }
        let bound = umo_gltf::keys::Bound::new(degrees).unwrap();
        let keying = umo_gltf::keys::Keying { bound, markers: Vec::new() };
        let mut figure = crate::export::FigureCache::from(Figure::default());
        let output = crate::export::Output::create(&path, Format::Glb).unwrap();
        output.write_as(&clip, &mut figure, Some(&keying)).unwrap();
        let read = read(&path).unwrap();
        assert_eq!((read.len(), read.rotations.len()), (90, 90), "{rate}");
        assert!((read.frame_rate - rate).abs() < 1e-3, "{} of {rate}", read.frame_rate);
        let (angle, most) = (largest_angle(&clip, &read).to_degrees(), degrees * 1.01);
        assert!(angle < most && angle > 0.01 * degrees, "{rate}: {angle}° of {degrees}°");
        let far = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(far(clip.translation.as_flattened(), read.translation.as_flattened()) < 0.0101 * degrees);
        assert!(far(&clip.face_values, &read.face_values) < 0.0101 * degrees);
    }
}

#[test]
fn jsonl_is_read_bit_for_bit() {
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    assert_eq!(back(&clip, Format::Jsonl), clip);
    // With a byte order mark, which some editors write.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jsonl");
    crate::export::write(&path, None, &clip).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("\u{feff}{text}")).unwrap();
    assert_eq!(read(&path).unwrap(), clip);
}

/// Writes an `.npz` file with these arrays of doubles.
fn arrays(path: &Path, arrays: &[(&str, &[u64], &[f64])]) {
    use npyz::WriterBuilder;
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    for &(name, shape, values) in arrays {
        zip.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
        let array = npyz::WriteOptions::new().default_dtype().shape(shape).writer(&mut zip);
        let mut array = array.begin_nd().unwrap();
        array.extend(values.iter().copied()).unwrap();
        array.finish().unwrap();
    }
    zip.finish().unwrap();
}

#[test]
fn the_rate_of_an_npz_file_is_found_by_each_of_its_names_or_said_to_be_missing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let poses = vec![0.0; 4 * 165];
    for (name, rate) in [("mocap_frame_rate", 50.0), ("mocap_framerate", 120.0), ("fps", 24.0), ("", 30.0)] {
        arrays(&path, &[("poses", &[4, 165], &poses), (if name.is_empty() { "else" } else { name }, &[], &[rate])]);
        let (clip, notes) = npz::read(&path).unwrap();
        assert!((f64::from(clip.frame_rate) - rate).abs() < 1e-6, "{name}");
        assert_eq!(notes.iter().any(|note| note.contains("no frame rate")), name.is_empty(), "{name}: {notes:?}");
    }
    arrays(&path, &[("poses", &[4, 165], &poses), ("fps", &[], &[0.0])]);
    assert!(read(&path).unwrap_err().to_string().contains("`fps`"));
}

#[test]
fn a_motion_whose_z_is_up_is_turned_upright() {
    let files = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/characters/");
    let file = |name: &str| npz::read(Path::new(&(files.to_owned() + name))).unwrap();
    let ((plain, none), (turned, notes)) = (file("motion.npz"), file("z_up.npz"));
    assert!(none.is_empty(), "{none:?}");
    assert!(notes.len() == 1 && notes[0].contains("Z up"), "{notes:?}");
    assert!(near(&turned.translation, &plain.translation));
    assert!(largest_angle(&turned, &plain) < 1e-3);
}

#[test]
fn poses_of_52_joints_are_read_and_others_refused_with_a_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut poses = vec![0.0; 2 * 156];
    // The body's last joint and the left hand's first.
    (poses[63], poses[66]) = (0.25, 0.5);
    arrays(&path, &[("poses", &[2, 156], &poses), ("fps", &[], &[30.0])]);
    let (clip, notes) = npz::read(&path).unwrap();
    assert!(notes.len() == 1 && notes[0].contains("SMPL-H"), "{notes:?}");
    let angle = |joint: usize| 2.0 * clip.rotations[0][joint][0].asin();
    assert!((angle(21) - 0.25).abs() < 1e-6 && angle(22) == 0.0 && (angle(25) - 0.5).abs() < 1e-6);
    arrays(&path, &[("poses", &[2, 72], &poses[..144]), ("fps", &[], &[30.0])]);
    let refused = read(&path).unwrap_err().to_string();
    assert!(refused.contains("165") && refused.contains("SMPL-X"), "{refused}");
}

#[test]
fn corrupt_input_does_not_panic() {
    let folder = tempfile::tempdir().unwrap();
    let clip = sample::clip(FaceKind::Arkit, 2, 1);
    for format in [Format::Npz, Format::Glb, Format::Bvh, Format::Jsonl] {
        let path = folder.path().join(format!("motion.{}", format.name()));
        crate::export::write(&path, None, &clip).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for step in 0..60 {
            let at = whole.len() * step / 60;
            std::fs::write(&path, &whole[..at]).unwrap();
            // Text cut between two frames is a valid shorter motion.
            if let Err(failure) = read(&path) {
                assert!(failure.to_string().contains("motion."), "{failure}");
            } else {
                assert_eq!(format, Format::Jsonl);
            }
            let mut spoilt = whole.clone();
            spoilt[at] = spoilt[at].wrapping_add(0x55);
            std::fs::write(&path, &spoilt).unwrap();
            if let Ok(clip) = read(&path) {
                assert_eq!(clip.check(), Ok(()));
            }
        }
    }
}

#[test]
fn other_files_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains(name), "{message}");
        message
    };
    assert!(refused("a.csv", b"").contains("face only"));
    assert!(refused("a.npz", b"PK").contains("not an npz"));
    assert!(refused("a.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff").contains("cut short"));
    assert!(refused("a.glb", b"glTF\x01\0\0\0\x0c\0\0\0").contains("version 1"));
    let one = b"HIERARCHY ROOT a { OFFSET 0 0 0 CHANNELS 0 End Site { OFFSET 0 0 1 } } MOTION Frames: 0 Frame Time: 1";
    assert!(refused("a.bvh", one).contains("has no joint `pelvis`"));
}
