use super::*;
use npyz::{Deserialize, NpyFile, NpyHeader};
use std::io::{Cursor, Read};
use umo_core::ARKIT_NAMES;
use zip::ZipArchive;

struct Npz(ZipArchive<Cursor<Vec<u8>>>);

impl Npz {
    fn of(clip: &Clip) -> Self {
        let bytes = bytes_of(|clip, out| super::super::npz::write(clip, out), clip);
        Self(ZipArchive::new(Cursor::new(bytes)).unwrap())
    }

    fn raw(&mut self, name: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut file = self.0.by_name(&format!("{name}.npy")).unwrap();
        file.read_to_end(&mut bytes).unwrap();
        bytes
    }

    fn array<T: Deserialize>(&mut self, name: &str) -> (String, Vec<u64>, Vec<T>) {
        let raw = self.raw(name);
        let file = NpyFile::new(raw.as_slice()).unwrap();
        let (kind, shape) = (file.dtype().descr(), file.shape().to_vec());
        (kind, shape, file.into_vec().unwrap())
    }

    fn floats(&mut self, name: &str, shape: &[u64]) -> Vec<f32> {
        let (kind, found, values) = self.array(name);
        assert_eq!((kind.as_str(), found.as_slice()), ("'<f4'", shape), "{name}");
        values
    }

    fn strings(&mut self, name: &str) -> (Vec<u64>, Vec<String>) {
        let raw = self.raw(name);
        let mut rest = raw.as_slice();
        let header = NpyHeader::from_reader(&mut rest).unwrap();
        let kind = header.dtype().descr();
        let width: usize = kind.trim_matches('\'')[2..].parse().unwrap();
        let codes: Vec<char> =
            rest.as_chunks::<4>().0.iter().map(|&code| char::from_u32(u32::from_le_bytes(code)).unwrap()).collect();
        let text = |row: &[char]| row.iter().filter(|&&c| c != '\0').collect();
        (header.shape().to_vec(), codes.chunks(width).map(text).collect())
    }
}

#[test]
fn npz_has_the_arrays_of_beat2() {
    for kind in KINDS {
        let clip = sample::clip(kind, 5, 1);
        let mut npz = Npz::of(&clip);
        assert_eq!(npz.floats("betas", &[300]), [0.0; 300]);
        assert_eq!(npz.floats("trans", &[5, 3]), clip.translation.as_flattened());
        npz.floats("poses", &[5, 165]);
        assert_eq!(npz.strings("model"), (vec![], vec!["smplx2020".to_owned()]));
        assert_eq!(npz.strings("gender"), (vec![], vec!["neutral".to_owned()]));
        let rate = ("'<i8'".to_owned(), vec![], vec![30_i64]);
        assert_eq!(npz.array("mocap_frame_rate"), rate);
        let arkit = kind == FaceKind::Arkit;
        assert_eq!(npz.0.len(), if arkit { 9 } else { 7 });
        let expressions = npz.floats("expressions", &[5, 100]);
        if arkit {
            assert!(expressions.iter().all(|&x| x == 0.0));
            assert_eq!(npz.floats("arkit", &[5, 52]), clip.face_values);
            let names = ARKIT_NAMES.map(str::to_owned).to_vec();
            assert_eq!(npz.strings("arkit_names"), (vec![52], names));
        } else {
            assert_eq!(expressions, clip.face_values);
        }
    }
}

#[test]
fn npz_pads_and_cuts_expressions_to_100() {
    for count in [0_usize, 10, 130] {
        let mut clip = sample::clip(FaceKind::SmplxExpression, 2, 1);
        clip.face.names = (0..count).map(|i| format!("expression_{i}")).collect();
        clip.face_values = (0..2 * count).map(|i| i as f32).collect();
        let found = Npz::of(&clip).floats("expressions", &[2, 100]);
        for (i, &x) in found.iter().enumerate() {
            let (frame, column) = (i / 100, i % 100);
            let want = if column < count { frame * count + column } else { 0 };
            assert_eq!(x, want as f32);
        }
    }
}

#[test]
fn npz_keeps_a_fractional_frame_rate() {
    let mut clip = sample::clip(FaceKind::Arkit, 1, 1);
    clip.frame_rate = 29.97;
    let (kind, _, rate) = Npz::of(&clip).array::<f64>("mocap_frame_rate");
    assert_eq!((kind.as_str(), rate[0]), ("'<f8'", f64::from(29.97_f32)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn npz_poses_are_the_quaternions_rotations(clip in any_clip(FaceKind::Arkit, 2)) {
        let poses = Npz::of(&clip).floats("poses", &[2, 165]);
        let quaternions = clip.rotations.as_flattened().iter();
        for (pose, q) in poses.as_chunks::<3>().0.iter().zip(quaternions) {
            let pose = pose.map(f64::from);
            let angle = distance(pose, [0.0; 3]);
            let scale = if angle < 1e-9 { 0.5 } else { (angle / 2.0).sin() / angle };
            let [x, y, z] = pose.map(|x| x * scale);
            let q = q.map(f64::from);
            let dot = x * q[0] + y * q[1] + z * q[2] + (angle / 2.0).cos() * q[3];
            prop_assert!((dot.abs() - 1.0).abs() < 1e-6, "{:?} {:?}", pose, q);
        }
    }
}
