use proptest::prelude::*;

use super::*;

const RULES: &str = r#"
    gap = 1.0
    silent_final_e = true
    [class.negation]
    head = true
    gap = 2.0
    words = ["no", "no ^way at all"]
    gestures = [{ name = "shake" }, { name = "shake", strength = 0.5 }]
    [class.self]
    gap = 3.0
    chance = 0.999
    words = ["me"]
    gestures = [{ name = "me", side = "either" }]
    [class.up]
    gap = 0.5
    words = ["up"]
    gestures = [{ name = "point" }]
    [class.nothing]
    words = ["no problem"]
"#;

fn rules() -> WordRules {
    WordRules::parse(RULES).unwrap()
}

/// Decisions of words that are all given first, with the ticks in which they are made.
fn decisions(words: &[(&str, f64)], seed: u64) -> Vec<Decision> {
    let (rules, mut hints, mut planner, mut all) = (rules(), Hints::NONE, Planner::new(), Vec::new());
    for &(word, at) in words {
        hints.push(&rules, word, (at, at + 0.3), (0, 0)).unwrap();
    }
    for tick in 0..900 {
        planner.plan(&rules, &hints, seed, tick * UNITS / 30, |decision| all.push(decision));
    }
    all
}

fn outcomes(words: &[(&str, f64)]) -> Vec<&'static str> {
    let name = |decision: &Decision| match decision.outcome {
        Outcome::Gesture(_) => "gesture",
        Outcome::NoClass => "no class",
        Outcome::NoGesture => "no gesture",
        Outcome::Late => "late",
        Outcome::ClassGap => "class gap",
        Outcome::Gap => "gap",
        Outcome::Yields => "yields",
        Outcome::Chance => "chance",
    };
    decisions(words, 1).iter().map(name).collect()
}

#[test]
fn words_are_decided_by_their_phrase_their_gaps_and_what_follows() {
    assert_eq!(outcomes(&[("no", 1.0), ("problem", 1.3), ("table", 1.6)]), ["no gesture", "no class"]);
    // In any order; a pause parts a phrase.
    assert_eq!(outcomes(&[("problem", 2.1), ("no", 1.0)]), ["gesture", "no class"]);
    assert_eq!(outcomes(&[("no,", 1.0), ("problem", 1.3)]), ["gesture", "no class"]);
    assert_eq!(outcomes(&[("no", 1.0), ("no", 2.5), ("no", 3.5)]), ["gesture", "class gap", "gesture"]);
    // The head has its own gap; of the hands the weak class yields.
    assert_eq!(outcomes(&[("up", 1.0), ("no", 1.3), ("me", 1.6)]), ["gesture", "gesture", "gap"]);
    assert_eq!(outcomes(&[("me", 1.0), ("up", 1.5)]), ["yields", "gesture"]);
    assert_eq!(outcomes(&[("me", 1.0), ("up", 2.5)]), ["gesture", "gesture"]);
}

#[test]
fn the_stroke_is_on_the_stressed_vowel_of_the_stressed_word() {
    let all = decisions(&[("no way at all", 2.0)], 1);
    let [Decision { start, words: 4, outcome: Outcome::Gesture(plan), .. }] = all[..] else { panic!("{all:?}") };
    // Four syllables of 75 ms; "way" is the second, and its vowel is in its middle.
    let stroke = plan.stroke as f64 / UNITS as f64;
    assert!(start == 2 * UNITS && (2.105..2.125).contains(&stroke), "{stroke}");
    assert!((0.3..=1.0).contains(&plan.strength) && (0.9..1.1).contains(&plan.speed));
}

#[test]
fn the_same_words_are_gestured_in_other_ways_and_the_same_seed_repeats_them() {
    let words: Vec<(&str, f64)> = (0..8).map(|at| (["no", "me"][at % 2], 1.0 + 3.0 * at as f64)).collect();
    let plans = |seed| -> Vec<Plan> {
        let all = decisions(&words, seed);
        all.iter().filter_map(|it| if let Outcome::Gesture(plan) = it.outcome { Some(plan) } else { None }).collect()
    };
    let all = plans(5);
    assert_eq!(all, plans(5));
    assert_ne!(all, plans(4));
    let of = |class: u16| all.iter().filter(move |plan| plan.class == class).collect::<Vec<_>>();
    let no = of(0);
    assert!(no.len() >= 3 && no.windows(2).all(|pair| pair[0].variant != pair[1].variant), "{no:?}");
    assert!(of(2).windows(2).all(|pair| pair[0].strength != pair[1].strength && pair[0].side != Hand::Either));
}

#[test]
fn words_are_bounded_and_late_ones_move_nothing() {
    let (rules, mut hints, mut planner) = (rules(), Hints::NONE, Planner::new());
    for at in 0..MAX_PENDING_WORDS {
        hints.push(&rules, "no", (10.0 + at as f64, 10.0 + at as f64), (0, 0)).unwrap();
    }
    let mut push = |text: &str, times, passed| hints.push(&rules, text, times, (0, passed));
    assert_eq!(push("no", (0.0, 0.1), 0), Err(WordError::Full));
    assert_eq!(push("no no", (0.0, 0.1), 1), Err(WordError::Full));
    assert_eq!(push(&"no ".repeat(65), (0.0, 0.1), 64), Err(WordError::TooMany));
    assert_eq!(push("… !", (0.0, 0.1), 0), Ok(()));
    for times in [(-1.0, 0.0), (f64::NAN, 1.0), (0.0, f64::NAN), (1.0, 0.9), (0.0, 30.1), (1e300, 1e300)] {
        assert_eq!(push("no", times, 64), Err(WordError::Time), "{times:?}");
    }
    let mut all = Vec::new();
    planner.plan(&rules, &hints, 1, 30 * UNITS, |decision| all.push(decision.outcome));
    assert!(all[..20].iter().all(|&outcome| outcome == Outcome::Late));
    assert!(all.len() == 22 && planner.passed() == 22 && !planner.is_empty(&hints));
    planner.interrupt(1, &hints);
    assert!(planner.is_empty(&hints) && planner.passed() == MAX_PENDING_WORDS as u64);
}

fn save(planner: &mut Planner, hints: &mut Hints) -> Vec<u8> {
    let mut size = StatePass::size();
    planner.state(&mut size).unwrap();
    hints.state(&mut size).unwrap();
    let mut bytes = vec![0; size.end().unwrap()];
    let mut pass = StatePass::save(&mut bytes, 0, 0);
    planner.state(&mut pass).unwrap();
    hints.state(&mut pass).unwrap();
    let length = pass.end().unwrap();
    bytes.truncate(length);
    bytes
}

fn load(bytes: &[u8]) -> (Planner, Hints) {
    let (mut planner, mut hints) = (Planner::new(), Hints::NONE);
    let mut pass = StatePass::check(bytes, 0).unwrap();
    planner.state(&mut pass).unwrap();
    hints.state(&mut pass).unwrap();
    pass.end().unwrap();
    let mut pass = StatePass::load(bytes, 0);
    planner.state(&mut pass).unwrap();
    hints.state(&mut pass).unwrap();
    pass.end().unwrap();
    (planner, hints)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn a_state_goes_on_with_the_same_decisions_and_order_does_not_matter(
        words in prop::collection::vec((0_usize..6, 0_u32..300), 0..40),
        cut in 0_u64..300,
        seed in any::<u64>(),
    ) {
        let rules = rules();
        let texts = ["no", "me", "up", "problem", "way", "at all?"];
        let mut times: Vec<(&str, f64)> = words.iter().map(|&(which, at)| (texts[which], f64::from(at) / 30.0)).collect();
        times.sort_by(|a, b| a.1.total_cmp(&b.1));
        times.dedup_by(|a, b| a.1 == b.1);
        let expected = decisions(&times, seed);
        let mut hints = Hints::NONE;
        for &(word, at) in times.iter().rev() {
            prop_assume!(hints.push(&rules, word, (at, at + 0.3), (0, 0)).is_ok());
        }
        let (mut planner, mut all) = (Planner::new(), Vec::new());
        for tick in 0..900 {
            if tick == cut {
                let bytes = save(&mut planner, &mut hints);
                (planner, hints) = load(&bytes);
            }
            planner.plan(&rules, &hints, seed, tick * UNITS / 30, |decision| all.push(decision));
        }
        prop_assert_eq!(all, expected);
    }
}
