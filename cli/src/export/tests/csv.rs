use super::*;
use std::collections::HashMap;
use umo_core::ARKIT_NAMES;

fn rows(clip: &Clip) -> Vec<HashMap<String, String>> {
    let bytes = bytes_of(|clip, out| super::super::csv::write(clip, out), clip);
    let mut reader = ::csv::Reader::from_reader(bytes.as_slice());
    reader.deserialize().map(|row| row.unwrap()).collect()
}

fn header(clip: &Clip) -> Vec<String> {
    let bytes = bytes_of(|clip, out| super::super::csv::write(clip, out), clip);
    let text = String::from_utf8(bytes).unwrap();
    let line = text.lines().next().unwrap();
    line.split(',').map(str::to_owned).collect()
}

fn about(axis: usize, angle: f32) -> [f32; 4] {
    let mut q = [0.0, 0.0, 0.0, (angle / 2.0).cos()];
    q[axis] = (angle / 2.0).sin();
    q
}

#[test]
fn csv_has_the_columns_of_live_link_face() {
    let header = header(&sample::clip(FaceKind::Arkit, 1, 1));
    assert_eq!(header.len(), 63);
    assert_eq!(header[..3], ["Timecode", "BlendShapeCount", "EyeBlinkLeft"]);
    assert_eq!(header[16..20], ["JawForward", "JawRight", "JawLeft", "JawOpen"]);
    assert_eq!(header[53..55], ["TongueOut", "HeadYaw"]);
    assert_eq!(header[62], "RightEyeRoll");
}

#[test]
fn csv_puts_each_blendshape_under_its_name() {
    let mut clip = sample::clip(FaceKind::Arkit, 2, 1);
    // Another channel order, as a model's file may have.
    clip.face.names.reverse();
    for (i, value) in clip.face_values.iter_mut().enumerate() {
        *value = i as f32 / 1000.0;
    }
    let rows = rows(&clip);
    assert_eq!(rows.len(), 2);
    for (frame, row) in rows.iter().enumerate() {
        assert_eq!(row["BlendShapeCount"], "61");
        for (i, name) in clip.face.names.iter().enumerate() {
            let column = format!("{}{}", name[..1].to_uppercase(), &name[1..]);
            let value: f32 = row[&column].parse().unwrap();
            assert_eq!(value, clip.face_values[frame * ARKIT_NAMES.len() + i], "{column}");
        }
    }
}

#[test]
fn csv_gives_head_and_eye_angles_in_radians() {
    let mut clip = sample::clip(FaceKind::Arkit, 3, 0);
    for (axis, [neck, head]) in [(1, [0.3, 0.2]), (0, [0.1, 0.25]), (2, [-0.2, 0.05])] {
        let frame = &mut clip.rotations[axis];
        frame[12] = about(axis, neck);
        frame[15] = about(axis, head);
        frame[23] = about(axis, 0.125);
        frame[24] = about(axis, -0.125);
    }
    let rows = rows(&clip);
    let pitch_yaw_roll = ["Pitch", "Yaw", "Roll"];
    for (axis, head) in [(1, 0.5), (0, 0.35), (2, -0.15)] {
        for (i, name) in pitch_yaw_roll.iter().enumerate() {
            let angle = |part: &str| rows[axis][&format!("{part}{name}")].parse::<f64>().unwrap();
            let want = |x: f64| if i == axis { x } else { 0.0 };
            assert!((angle("Head") - want(head)).abs() < 2e-6);
            assert!((angle("LeftEye") - want(0.125)).abs() < 2e-6);
            assert!((angle("RightEye") - want(-0.125)).abs() < 2e-6);
        }
    }
}

#[test]
fn csv_counts_frames_within_the_second() {
    let rows = rows(&sample::clip(FaceKind::Arkit, 2000, 1));
    let code = |frame: usize| rows[frame]["Timecode"].as_str();
    assert_eq!(code(0), "00:00:00:00.000");
    assert_eq!(code(29), "00:00:00:29.000");
    assert_eq!(code(30), "00:00:01:00.000");
    assert_eq!(code(1811), "00:01:00:11.000");
    let mut long = sample::clip(FaceKind::Arkit, 3, 1);
    // f32 represents this rate exactly, so frames fall on whole seconds.
    long.frame_rate = 1.0 / 2048.0;
    assert_eq!(self::rows(&long)[2]["Timecode"], "01:08:16:00.000");
}

#[test]
fn csv_refuses_a_face_that_is_not_arkit() {
    let smplx = sample::clip(FaceKind::SmplxExpression, 1, 1).face;
    let message = Format::Csv.check_face(&smplx).unwrap_err().to_string();
    assert!(message.starts_with("Live Link Face needs an ARKit face"), "{message}");
    let mut short = sample::clip(FaceKind::Arkit, 1, 1).face;
    short.names.retain(|name| name != "jawOpen");
    let message = Format::Csv.check_face(&short).unwrap_err().to_string();
    assert!(message.contains("`JawOpen`"), "{message}");
}

#[test]
fn csv_with_few_keys_has_the_rows_that_hold_the_others_and_markers() {
    let clip = sample::clip(FaceKind::Arkit, 90, 1);
    let keying = super::keying(2.0);
    let whole = rows(&clip);
    let bytes = bytes_of(|clip, out| super::super::csv::write_keyed(clip, Some(&keying), out), &clip);
    let mut reader = ::csv::Reader::from_reader(bytes.as_slice());
    let columns: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    assert_eq!(columns[..63], header(&clip));
    assert_eq!(columns[63..], ["Stroke", "Word"]);
    let few: Vec<HashMap<String, String>> = reader.deserialize().map(|row| row.unwrap()).collect();
    assert!(3 * few.len() < 2 * whole.len(), "{} rows", few.len());
    let frame = |row: &HashMap<_, _>| whole.iter().position(|it| it["Timecode"] == row["Timecode"]).unwrap();
    for pair in few.windows(2) {
        let [from, to] = [frame(&pair[0]), frame(&pair[1])];
        for (at, whole) in whole.iter().enumerate().take(to + 1).skip(from) {
            for column in &columns[2..63] {
                let [a, b, want] = [&pair[0], &pair[1], whole].map(|row| row[column].parse::<f64>().unwrap());
                let read = a + (b - a) * (at - from) as f64 / (to - from) as f64;
                let is_angle = ["Yaw", "Pitch", "Roll"].iter().any(|name| column.ends_with(name));
                let most = if is_angle { 2_f64.to_radians() } else { 0.02 };
                assert!((read - want).abs() < most + 1e-5, "{column} in frame {at}");
            }
        }
    }
    assert_eq!([frame(&few[0]), frame(few.last().unwrap())], [0, 89]);
    let marked: Vec<_> = few.iter().filter(|row| !(row["Stroke"].is_empty() && row["Word"].is_empty())).collect();
    let marked: Vec<_> = marked.iter().map(|row| (frame(row), &*row["Stroke"], &*row["Word"])).collect();
    assert_eq!(marked, [(8, "left", ""), (17, "", "so far"), (89, "both", "")]);
}
