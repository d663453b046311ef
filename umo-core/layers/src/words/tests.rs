use umo_core_pose::rotation::rotate;

use super::super::gesture::{GestureOptions, Request as HostRequest};
use super::super::trial::{Trial, shape};
use super::super::{Gestures, Layer, RequestError};
use super::*;

const RATE: usize = 16_000;
const HEAD: usize = 15;

fn say(trial: &mut Trial, text: &str, start: f64, end: f64) -> Result<(), RequestError> {
    let (rules, passed) = (trial.stack.word_rules().clone(), trial.stack.passed_words());
    Ok(trial.controls.words.push(&rules, text, (start, end), (0, passed))?)
}

/// Runs ticks from the start of the audio.
fn run(trial: &mut Trial, ticks: u64) -> Vec<OwnedFrame> {
    let tick = |at: u64| {
        let mut frame = trial.frame.clone();
        frame.index = at;
        let heard = Heard { sample: at * RATE as u64 / 30, rate: RATE };
        trial.stack.apply(&mut frame, &trial.controls, Some(heard));
        frame
    };
    (0..ticks).map(tick).collect()
}

/// Turn of the head to the left, degrees.
fn yaw(trial: &Trial, frame: &OwnedFrame) -> f32 {
    let (_, turned) = trial.rig.world(&frame.pose);
    let [x, _, z] = rotate(turned[HEAD], [0.0, 0.0, 1.0]);
    x.atan2(z).to_degrees()
}

fn is_same(a: &OwnedFrame, b: &OwnedFrame) -> bool {
    a.pose == b.pose && a.face[..] == b.face[..]
}

fn differs(trial: &Trial, frame: &OwnedFrame) -> bool {
    !is_same(frame, &trial.frame)
}

#[test]
fn no_shakes_the_head_at_its_time_and_a_table_moves_nothing() {
    let mut trial = Trial::new(&[], 3);
    say(&mut trial, "no", 2.0, 2.3).unwrap();
    let frames = run(&mut trial, 150);
    let yaws: Vec<f32> = frames.iter().map(|frame| yaw(&trial, frame)).collect();
    let most = |from: usize, to: usize| yaws[from..to].iter().fold(0.0_f32, |most, yaw| most.max(yaw.abs()));
    assert!(most(60, 75) > 4.0, "{:?}", &yaws[50..100]);
    assert!(frames[..45].iter().chain(&frames[130..]).all(|frame| !differs(&trial, frame)));
    assert_eq!(trial.stack.passed_words(), 1);
    for text in ["table", "no problem", "not bad"] {
        let mut trial = Trial::new(&[], 3);
        say(&mut trial, text, 2.0, 2.5).unwrap();
        assert!(run(&mut trial, 120).iter().all(|frame| !differs(&trial, frame)), "{text}");
    }
}

/// A run with a voice of this level, louder by a factor while the word is said.
fn spoken(text: &str, seed: u64, factor: f32) -> (Trial, Vec<OwnedFrame>) {
    let mut trial = Trial::new(&[], seed);
    say(&mut trial, text, 2.0, 2.3).unwrap();
    let frames = (0..150_u64).map(|at| {
        let mut frame = trial.frame.clone();
        frame.index = at;
        let is_pause = at % 20 >= 14 && !(55..70).contains(&at);
        frame.cue.level = match (55..70).contains(&at) {
            true => 0.1 * factor,
            false if is_pause => 0.0,
            false => 0.1,
        };
        trial.stack.apply(&mut frame, &trial.controls, Some(Heard { sample: at * RATE as u64 / 30, rate: RATE }));
        frame
    });
    let frames = frames.collect();
    (trial, frames)
}

#[test]
fn every_no_shakes_the_head_by_4_degrees_and_an_accented_one_by_more() {
    let most = |seed, factor| {
        let (trial, frames) = spoken("no", seed, factor);
        frames[58..75].iter().map(|frame| yaw(&trial, frame).abs()).fold(0.0, f32::max)
    };
    for seed in 0..30 {
        let (quiet, loud) = (most(seed, 0.35), most(seed, 2.0));
        assert!(quiet > 4.0 && loud > 1.1 * quiet && loud < 16.0, "{seed}: {quiet} {loud}");
    }
}

/// Directions of the left eye, degrees to the left and down, in a run with a word whose stroke is near frame 63.
fn looks(text: &str, seed: u64) -> (Vec<[f32; 2]>, Vec<OwnedFrame>) {
    let mut trial = Trial::new(&[Layer::Gaze], seed);
    say(&mut trial, text, 2.0, 2.3).unwrap();
    let frames = run(&mut trial, 110);
    let look = |frame: &OwnedFrame| {
        let [[x, y, z], _] = trial.looks(frame);
        [x.atan2(z).to_degrees(), -y.asin().to_degrees()]
    };
    (frames.iter().map(look).collect(), frames)
}

#[test]
fn eyes_go_where_a_word_points_and_come_back() {
    for seed in 0..6 {
        let (there, frames) = looks("there", seed);
        let moves = |joint: usize| frames[63].pose.rotations[joint] != frames[0].pose.rotations[joint];
        assert!(moves(16) != moves(17));
        let side = if moves(16) { 1.0 } else { -1.0 };
        assert!(there[62..70].iter().all(|look| side * look[0] > 15.0), "{seed}: {:?}", &there[55..85]);
        let [up, down] = ["up", "down"].map(|text| looks(text, seed).0);
        assert!(up[66][1] < -9.0 && down[66][1] > 12.0, "{seed}: {:?} {:?}", up[66], down[66]);
        // No fixation of an idle avatar is so far away.
        let near =
            |looks: &[[f32; 2]]| looks.iter().all(|look| look[0].abs() < 19.0 && (-8.0..12.0).contains(&look[1]));
        for looks in [there, up, down] {
            assert!(near(&looks[..55]) && near(&looks[86..]), "{seed}: {looks:?}");
        }
    }
}

#[test]
fn a_question_raises_the_brows() {
    let mut trial = Trial::new(&[], 2);
    say(&mut trial, "really?", 2.0, 2.4).unwrap();
    let frames = run(&mut trial, 120);
    let brows: Vec<f32> = frames.iter().map(|frame| shape(frame, "browInnerUp")).collect();
    assert!(brows[68..80].iter().all(|&brow| brow > 0.2) && brows[110] < 0.01, "{brows:?}");
}

/// Height of the higher wrist, metres, and frames in which it moves down fast: beats.
fn beats(words: &[(&str, f64)], seed: u64) -> (Vec<f32>, Vec<usize>) {
    let mut trial = Trial::new(&[], seed);
    words.iter().for_each(|&(text, at)| say(&mut trial, text, at, at + 0.3).unwrap());
    let frames = run(&mut trial, 240);
    let height = |frame: &OwnedFrame| {
        let (places, _) = trial.rig.world(&frame.pose);
        places[20][1].max(places[21][1])
    };
    let heights: Vec<f32> = frames.iter().map(height).collect();
    let is_low = |at: &usize| heights[*at] < heights[*at - 3] - 0.008 && heights[*at] <= heights[*at + 1] + 1e-4;
    let mut lows: Vec<usize> = (3..heights.len() - 1).filter(is_low).collect();
    lows.dedup_by(|b, a| *b < *a + 8);
    (heights, lows)
}

#[test]
fn a_list_waits_for_its_words() {
    let low = beats(&[], 1).0[0];
    for seed in 0..4 {
        let (alone, _) = beats(&[("firstly", 1.0)], seed);
        assert!(alone[33] > low + 0.2 && alone[75] < low + 0.02, "{seed}");
        let words = [("firstly", 1.0), ("secondly", 2.9), ("thirdly", 5.0)];
        let (all, lows) = beats(&words, seed);
        assert!(all[35..155].iter().all(|&height| height > low + 0.2), "{seed}: {all:?}");
        assert!(all[220] < low + 0.02, "{seed}");
        for (_, at) in words {
            let stroke = 30.0 * (at + 0.06);
            assert!(lows.iter().any(|&low| (low as f64 - stroke).abs() < 4.0), "{seed} {at}: {lows:?}");
        }
    }
}

#[test]
fn a_gesture_of_the_host_comes_first() {
    let of = |at: f64| {
        let mut trial = Trial::new(&[], 3);
        let options = GestureOptions::default().at(at);
        let request = HostRequest::new(&Gestures::new(), "nod", &options, 30, 0).unwrap();
        trial.controls.gestures.push(request, 0).unwrap();
        trial
    };
    // One that waits for a time within the word's gesture, and one that plays.
    for at in [1.7, 2.3] {
        let (mut alone, mut both) = (of(at), of(at));
        say(&mut both, "no", 2.0, 2.3).unwrap();
        let (alone, both) = (run(&mut alone, 120), run(&mut both, 120));
        assert!(alone.iter().zip(&both).all(|(a, b)| is_same(a, b)), "{at}");
    }
    let (mut far, mut alone) = (of(6.0), of(6.0));
    say(&mut far, "no", 2.0, 2.3).unwrap();
    let (far, alone) = (run(&mut far, 120), run(&mut alone, 120));
    assert!(far[60..75].iter().zip(&alone[60..75]).all(|(a, b)| a.pose != b.pose));
}

#[test]
fn a_late_word_hurries_and_a_very_late_one_moves_nothing() {
    let moved = |text: &str, start: f64, end: f64| {
        let mut trial = Trial::new(&[], 3);
        say(&mut trial, text, start, end).unwrap();
        let frames = run(&mut trial, 60);
        frames.iter().filter(|frame| differs(&trial, frame)).count()
    };
    // A stop needs 0.6 s, a wave 0.74 s; in a hurry two thirds of it.
    assert!(moved("stop", 0.3, 0.5) > 20);
    assert_eq!(moved("hello", 0.0, 0.0), 0);
}

#[test]
fn a_state_goes_on_with_its_words_and_an_interrupt_drops_them() {
    let make = || {
        let mut trial = Trial::new(&[], 7);
        for (text, at) in [("first", 1.0), ("second", 3.4), ("stop", 6.0)] {
            say(&mut trial, text, at, at + 0.4).unwrap();
        }
        trial
    };
    let expected = run(&mut make(), 240);
    assert!(expected.iter().filter(|frame| differs(&make(), frame)).count() > 100);
    let (mut first, mut second) = (make(), make());
    let heard = |at: u64| Some(Heard { sample: at * RATE as u64 / 30, rate: RATE });
    for at in 0..240 {
        let trial = if at < 95 { &mut first } else { &mut second };
        let mut frame = trial.frame.clone();
        frame.index = at;
        trial.stack.apply(&mut frame, &trial.controls, heard(at));
        let wanted = &expected[usize::try_from(at).unwrap()];
        assert!(is_same(&frame, wanted), "{at}");
        if at == 94 {
            second.load(&first.save());
        }
    }
    let mut trial = make();
    trial.stack.interrupt(1, 5, &trial.controls);
    assert_eq!(trial.stack.passed_words(), 3);
    assert!(run(&mut trial, 240).iter().all(|frame| !differs(&trial, frame)));
}
