//! Looks, blinks and small eye movements, counted as an observer would see them.

use umo_core_pose::skeleton::JOINTS;

use super::super::trial::{SECONDS, Trial, assert_sound, degrees, shape, turned, yawed};
use super::super::{Attention, Company, Layer, Role};
use super::*;

/// Ticks at which the left lid closes beyond `least`.
fn blinks(shown: &[OwnedFrame], least: f32) -> Vec<usize> {
    let lid = |tick: usize| shape(&shown[tick], "eyeBlinkLeft");
    (1..shown.len()).filter(|&tick| lid(tick - 1) < least && lid(tick) >= least).collect()
}

/// Speed of the left eye in the avatar's space, degrees a second, for each tick except the first.
fn speeds(trial: &Trial, shown: &[OwnedFrame]) -> Vec<f32> {
    let looks: Vec<[f32; 3]> = shown.iter().map(|frame| trial.looks(frame)[0]).collect();
    looks.windows(2).map(|pair| degrees(pair[0], pair[1]) / SECONDS).collect()
}

fn shifts(speeds: &[f32]) -> usize {
    speeds.windows(2).filter(|pair| pair[0] < 45.0 && pair[1] >= 45.0).count()
}

#[test]
fn blinks_come_12_to_22_times_a_minute_and_last_a_quarter_of_a_second() {
    for seed in 0..4 {
        let mut trial = Trial::new(&[Layer::Gaze], seed);
        for is_speech in [true, false] {
            let shown = if is_speech { trial.speak(18_000) } else { trial.ticks(18_000) };
            let full = blinks(&shown, 0.6).len();
            assert!((120..=220).contains(&full), "{seed} {is_speech} {full}");
            // Some are half blinks.
            assert!(blinks(&shown, 0.4).len() > full + 3);
            let closed = shown.iter().filter(|frame| shape(frame, "eyeBlinkLeft") > 0.5).count();
            assert!((2..=6).contains(&(closed / full)), "{closed} {full}");
            let apart = |frame: &OwnedFrame| shape(frame, "eyeBlinkLeft") - shape(frame, "eyeBlinkRight");
            assert!(shown.iter().all(|frame| apart(frame).abs() < 0.2));
            assert!(shown.iter().any(|frame| apart(frame) != 0.0));
        }
    }
}

#[test]
fn phrases_end_with_blinks_more_often_than_they_go_on_with_them() {
    let mut trial = Trial::new(&[Layer::Gaze], 1);
    let shown = trial.speak(18_000);
    let at_ends = blinks(&shown, 0.5).iter().filter(|&&tick| (64..78).contains(&(tick % 78))).count();
    // By chance 14 of 78 ticks would have 0.18 of the blinks.
    assert!(at_ends as f32 > 0.3 * blinks(&shown, 0.5).len() as f32, "{at_ends}");
}

#[test]
fn the_gaze_shifts_20_to_50_times_a_minute_and_is_fixed_between() {
    for (seed, attention) in [(1, Attention::Speaking), (2, Attention::Idle), (3, Attention::Listening)] {
        let mut trial = Trial::new(&[Layer::Gaze], seed);
        trial.controls.attention = attention;
        let shown = trial.speak(9000);
        let speeds = speeds(&trial, &shown);
        let a_minute = shifts(&speeds) / 5;
        assert!((18..=50).contains(&a_minute), "{attention:?} {a_minute}");
        // Between saccades the eyes rest: never faster than a few degrees a second.
        let rests = speeds.iter().filter(|&&speed| speed < 6.0).count();
        assert!(rests as f32 > 0.85 * speeds.len() as f32, "{attention:?} {rests}");
        shown.iter().for_each(assert_sound);
    }
}

#[test]
fn listeners_look_at_who_speaks_and_thinkers_look_away() {
    let contact = |attention, seed| {
        let mut trial = Trial::new(&[Layer::Gaze], seed);
        trial.controls.attention = attention;
        let eyes = trial.rig.eye_height;
        let shown = trial.ticks(9000);
        let on = shown.iter().filter(|frame| {
            let (from, _) = trial.rig.head(&frame.pose);
            let way = add([0.0, eyes, LISTENER_DISTANCE], from.map(|v| -v));
            trial.looks(frame).iter().all(|&look| degrees(look, way) < 4.5)
        });
        on.count() as f32 / shown.len() as f32
    };
    let share = |attention| (0..3).map(|seed| contact(attention, seed)).sum::<f32>() / 3.0;
    let (listening, speaking, thinking) =
        (share(Attention::Listening), share(Attention::Speaking), share(Attention::Thinking));
    assert!((0.68..0.88).contains(&listening), "{listening}");
    assert!((0.4..0.7).contains(&speaking), "{speaking}");
    assert!(thinking < 0.3, "{thinking}");
}

#[test]
fn eyes_stay_within_their_limits_and_joints_agree_with_shapes() {
    let mut trial = Trial::new(&[Layer::Gaze], 8);
    let rest = trial.frame.pose;
    for tick in 0..3000_u16 {
        let angle = 60.0 * (f32::from(tick) * 0.05).sin();
        trial.frame.pose.rotations[HEAD] = yawed(rest.rotations[HEAD], angle);
        let shown = trial.tick();
        assert_sound(&shown);
        for (joint, eye) in EYES.into_iter().zip([LEFT, RIGHT]) {
            let [yaw, pitch] = angles(turn_vector(shown.pose.rotations[joint], [0.0, 0.0, 1.0]));
            assert!(yaw.abs() <= MAX_EYE_ANGLE[0] + 1e-4 && pitch.abs() <= MAX_EYE_ANGLE[1] + 1e-4, "{yaw} {pitch}");
            let value = |shape: usize| shown.face[shape];
            let by_shapes = [
                eye.side * EYE_SHAPE_ANGLE[0] * (value(eye.outwards) - value(eye.inwards)),
                EYE_SHAPE_ANGLE[1] * (value(eye.down) - value(eye.up)),
            ];
            assert!((by_shapes[0] - yaw).abs() < 1e-4 && (by_shapes[1] - pitch).abs() < 1e-4);
        }
    }
}

#[test]
fn the_gaze_stays_where_it_was_while_the_head_turns() {
    let mut trial = Trial::new(&[Layer::Gaze], 8);
    let rest = trial.frame.pose;
    trial.ticks(60);
    let mut held = 0;
    for start in 0..40_u16 {
        // No new fixation during the turn.
        trial.stack.gaze.fixation.left = 10.0;
        trial.stack.gaze.fixation.offset = [0.0; 2];
        trial.ticks(10);
        let mut shown = trial.tick();
        let before = trial.looks(&shown)[0];
        let side = if start % 2 == 0 { 1.0 } else { -1.0 };
        for tick in 1..=8_u16 {
            trial.frame.pose.rotations[HEAD] = yawed(rest.rotations[HEAD], side * 1.5 * f32::from(tick));
            shown = trial.tick();
        }
        let head = turned(&trial, &shown, HEAD)[0];
        let moved = degrees(before, trial.looks(&shown)[0]);
        held += usize::from(moved < 1.5 && head.abs() > 8.0);
        trial.frame.pose = rest;
        trial.ticks(20);
    }
    assert!(held >= 38, "{held}");
}

#[test]
fn a_look_at_begins_with_the_eyes_arrives_and_comes_back() {
    for place in [[0.5, 1.6, 1.5], [-1.5, 1.2, 1.0], [1.4, 1.9, 0.5], [0.1, 1.3, 0.7], [-1.6, 1.5, 0.2]] {
        let mut trial = Trial::new(&[Layer::Gaze], 6);
        let before = trial.ticks(90).pop().unwrap();
        (trial.controls.look_at, trial.controls.look_at_strength) = (place, 1.0);
        let shown = trial.ticks(120);
        let off = |frame: &OwnedFrame| {
            let (places, _) = trial.rig.world(&frame.pose);
            let looks = trial.looks(frame);
            [0, 1]
                .map(|eye| degrees(looks[eye], add(place, places[EYES[eye]].map(|v| -v))))
                .into_iter()
                .fold(0.0, f32::max)
        };
        assert!(shown[75..].iter().all(|frame| off(frame) < 2.0), "{place:?} {}", off(&shown[75]));
        let (wanted, _) = direction(trial.rig.head(&trial.frame.pose).0, place);
        let yaw = |frame: &OwnedFrame, joint: usize| turned(&trial, frame, joint)[0];
        let started = yaw(&before, HEAD);
        let whole = yaw(&shown[119], HEAD) - started;
        // When the eyes have arrived, the head has turned little.
        if wanted[0].abs() > 15.0 * DEGREE {
            assert!(whole.signum() == wanted[0].signum());
            assert!((yaw(&shown[2], HEAD) - started).abs() < 0.6 * whole.abs());
            assert!((yaw(&shown[15], HEAD) - started).abs() > 0.8 * whole.abs());
        }
        // The trunk turns only for targets far to the side.
        let trunk = yaw(&shown[119], SPINE[2]).abs();
        assert!(if wanted[0].abs() > 35.0 * DEGREE { trunk > 3.0 } else { trunk < 1.0 }, "{place:?} {trunk}");
        let steps = shown.windows(2).map(|pair| (yaw(&pair[1], HEAD) - yaw(&pair[0], HEAD)).abs());
        assert!(steps.fold(0.0, f32::max) < 12.0);

        trial.controls.look_at_strength = 0.0;
        let back = trial.ticks(150).pop().unwrap();
        let [trunk, head] = [SPINE[2], HEAD].map(|joint| turned(&trial, &back, joint)[0].abs());
        assert!(trunk < 0.5 && head < 8.0, "{trunk} {head}");
    }
}

#[test]
fn points_that_are_no_places_are_not_looked_at() {
    for place in [[f32::NAN, 0.0, 1.0], [f32::INFINITY, 0.0, 0.0], [0.0, 1.0e30, 0.0], [0.0; 3]] {
        let mut trial = Trial::new(&[Layer::Gaze], 6);
        (trial.controls.look_at, trial.controls.look_at_strength) = (place, 1.0);
        trial.ticks(60).iter().for_each(assert_sound);
        // A later valid target is looked at.
        let place = [0.5, 1.6, 1.5];
        trial.controls.look_at = place;
        let shown = trial.ticks(120).pop().unwrap();
        let (from, _) = trial.rig.world(&shown.pose);
        let way = add(place, from[EYES[0]].map(|v| -v));
        assert!(degrees(trial.looks(&shown)[0], way) < 2.0);
    }
}

#[test]
fn a_face_of_another_kind_turns_its_eyes_alone() {
    let mut trial = Trial::of(
        &[Layer::Gaze],
        3,
        &super::super::trial::skeleton(),
        &super::super::trial::face(false),
        &super::super::trial::standing(),
    );
    let shown = trial.ticks(600);
    assert!(shown.iter().all(|frame| frame.face.iter().all(|&value| value == 0.0)));
    let speeds = speeds(&trial, &shown);
    assert!(shifts(&speeds) >= 4);
    let still: Vec<usize> =
        (0..JOINTS).filter(|joint| !EYES.contains(joint) && ![NECK, HEAD, 3, 6, 9].contains(joint)).collect();
    assert!(
        shown
            .iter()
            .all(|frame| still.iter().all(|&joint| frame.pose.rotations[joint] == trial.frame.pose.rotations[joint]))
    );
}

#[test]
fn lids_and_looks_of_a_gesture_stay() {
    let mut trial = Trial::new(&[Layer::Gaze], 3);
    for _ in 0..300 {
        let mut frame = trial.frame.clone();
        frame.face[LEFT.blink] = 0.9;
        trial.stack.gaze.read(&frame, &trial.rig);
        // A gesture raises the decoders' 0.9 and 0.
        frame.face[LEFT.blink] = 0.95;
        frame.face[LEFT.up] = 0.4;
        let controls = trial.controls;
        let tick = Tick {
            number: 0,
            seconds: SECONDS,
            seed: 3,
            cue: frame.cue,
            controls: &controls,
            weights: Default::default(),
            glance: None,
            rig: &trial.rig,
            lively: 0.0,
            shift: 0.0,
            stride: Default::default(),
            resting: [0.0; 2],
            gain: 1.0,
        };
        trial.stack.gaze.apply(&mut frame, &tick);
        assert!(shape(&frame, "eyeBlinkLeft") >= 0.5 - 1e-4 && shape(&frame, "eyeLookUpLeft") >= 0.4 - 1e-4);
    }
}

#[test]
fn the_models_own_blinks_go_with_the_gain() {
    let mut trial = Trial::new(&[Layer::Gaze], 3);
    trial.frame.face[arkit("eyeBlinkLeft")] = 1.0;
    let open = trial.ticks(300).iter().filter(|frame| shape(frame, "eyeBlinkLeft") < 0.3).count();
    assert!(open > 200, "{open}");
    trial.controls.layers = trial.controls.layers.with(Layer::Gaze, 0.25);
    trial.ticks(12);
    assert!(trial.ticks(300).iter().all(|frame| shape(frame, "eyeBlinkLeft") >= 0.75 - 1e-3));
}

/// Degrees from each eye's direction to a place, the larger one.
fn off(trial: &Trial, frame: &OwnedFrame, place: [f32; 3]) -> f32 {
    let ((places, _), looks) = (trial.rig.world(&frame.pose), trial.looks(frame));
    let away = |eye: usize| degrees(looks[eye], add(place, places[EYES[eye]].map(|v| -v)));
    away(0).max(away(1))
}

#[test]
fn the_others_of_a_scene_are_looked_at_and_past_without_a_jump() {
    let mut trial = Trial::new(&[Layer::Gaze], 6);
    trial.ticks(60);
    let eyes = trial.rig.eye_height;
    let mut before: Option<OwnedFrame> = None;
    let places = [[0.9, 0.0, 1.2], [-1.4, 0.1, 0.8], [0.2, -0.2, 1.5], [1.5, 0.0, -0.1], [-0.1, 0.0, 2.0]];
    for (turn, place) in places.into_iter().cycle().take(20).enumerate() {
        trial.controls.company = Company { role: Some(Role::ALL[turn % 3]), has_place: true, place, ..Company::ALONE };
        for is_contact in [true, false] {
            trial.controls.company.is_contact = is_contact;
            let shown = trial.ticks(90);
            shown.iter().for_each(assert_sound);
            let there = [place[0], eyes + place[1], place[2]];
            let on = shown[30..].iter().filter(|frame| off(&trial, frame, there) < 4.5).count();
            assert!(if is_contact { on > 55 } else { on < 12 }, "{place:?} {is_contact}: {on} of 60");
            let first = before.as_ref().unwrap_or(&shown[0]);
            let mut last = first;
            for frame in &shown {
                for joint in [HEAD, SPINE[2]] {
                    let speed = (turned(&trial, frame, joint)[0] - turned(&trial, last, joint)[0]).abs();
                    assert!(speed < 12.0, "{place:?}: {speed} degrees in a tick");
                }
                last = frame;
            }
            if is_contact && turn > 0 {
                // The eyes lead, the head follows.
                let yaw = |frame: &OwnedFrame| turned(&trial, frame, HEAD)[0];
                let whole = yaw(&shown[89]) - yaw(first);
                assert!((yaw(&shown[2]) - yaw(first)).abs() < 0.5 * whole.abs() + 3.0, "{place:?}");
            }
            before = Some(shown[89].clone());
        }
    }
    // Nobody is looked at behind the back, and a place that is none changes nothing.
    trial.controls.company.place = [0.1, 0.0, -1.5];
    let behind = trial.ticks(120).pop().unwrap();
    assert!(turned(&trial, &behind, HEAD)[0].abs() < 25.0);
    trial.controls.company.place = [f32::NAN; 3];
    trial.ticks(30).iter().for_each(assert_sound);
    // The host's target comes first.
    trial.controls.company.place = [-1.0, 0.0, 1.0];
    (trial.controls.look_at, trial.controls.look_at_strength) = ([0.8, eyes, 1.0], 1.0);
    let host = trial.ticks(90).pop().unwrap();
    assert!(off(&trial, &host, [0.8, eyes, 1.0]) < 2.0);
}
