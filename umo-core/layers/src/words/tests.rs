use umo_core_pose::rotation::rotate;

use super::super::gesture::{GestureOptions, Request as HostRequest};
use super::super::trial::Trial;
use super::super::{Gestures, RequestError};
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
        trial.stack.apply(&mut frame, &trial.controls, 0.0, Some(heard));
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
        for (text, at) in [("hello", 1.0), ("maybe", 3.4), ("stop", 6.0)] {
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
        trial.stack.apply(&mut frame, &trial.controls, 0.0, heard(at));
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
