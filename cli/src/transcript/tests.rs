use proptest::prelude::*;

use super::*;

fn words(timed: &[Timed]) -> Vec<(&str, f64, f64)> {
    timed.iter().map(|word| (word.text.trim(), word.start, word.end)).collect()
}

#[test]
fn subtitles_give_their_cues_and_the_times_within() {
    let srt =
        "1\r\n00:00:01,000 --> 00:00:02,500\r\n<i>Hello</i>\r\nthere.\r\n\r\n2\n00:01:00,5 --> 00:01:01,000\n- Yes\n";
    assert_eq!(words(&cues(srt).unwrap()), [("Hello there.", 1.0, 2.5), ("- Yes", 60.5, 61.0)]);
    let vtt = "WEBVTT\n\nNOTE none\n\nid\n00:01.000 --> 00:02.000 align:start\nNo<00:01.400><c> problem</c>\n";
    assert_eq!(words(&cues(vtt).unwrap()), [("No", 1.0, 1.4), ("problem", 1.4, 2.0)]);
    assert!(cues("1\n00:00:01 -> x").unwrap_err().contains("no cue"));
    assert!(cues("\n\n1:00:xx --> 00:01.0").unwrap_err().starts_with("line 3: "));
}

#[test]
fn whisper_in_both_forms() {
    let segments = r#"{"text": "a b", "segments": [{"start": 0, "end": 1, "text": "a b", "words": [
        {"word": " a", "start": 0.1, "end": 0.3}, {"word": "7"}, {"word": " b,", "start": 0.4, "end": 0.9}]},
        {"start": 2, "end": 3, "text": " c d"}]}"#;
    assert_eq!(words(&whisper(segments).unwrap()), [("a", 0.1, 0.3), ("b,", 0.4, 0.9), ("c d", 2.0, 3.0)]);
    let top =
        r#"{"words": [{"word": "a", "start": 0.1, "end": 0.3}], "segments": [{"start": 0, "end": 1, "text": "a"}]}"#;
    assert_eq!(words(&whisper(top).unwrap()), [("a", 0.1, 0.3)]);
    let cpp = r#"{"transcription": [{"offsets": {"from": 500, "to": 900}, "text": " a"}]}"#;
    assert_eq!(words(&whisper(cpp).unwrap()), [("a", 0.5, 0.9)]);
    assert!(whisper("{\n\"words\": 3}").unwrap_err().contains("line 2"));
    assert!(whisper("{}").unwrap_err().contains("no words"));
}

#[test]
fn text_grids_long_and_short() {
    let long = "File type = \"ooTextFile\"\nObject class = \"TextGrid\"\n\nxmin = 0 \nxmax = 2\ntiers? <exists> \nsize = 2\nitem []:\n
        item [1]:\n class = \"IntervalTier\"\n name = \"phones\"\n xmin = 0\n xmax = 2\n intervals: size = 1\n intervals [1]:\n
        xmin = 0\n xmax = 2\n text = \"x\"\n item [2]:\n class = \"IntervalTier\"\n name = \"Words\"\n xmin = 0\n xmax = 2\n
        intervals: size = 2\n intervals [1]:\n xmin = 0\n xmax = 0.5\n text = \"say \"\"no\"\"\" \n intervals [2]:\n xmin = 0.5\n xmax = 2\n text = \"sil\"\n";
    let expected = [("say \"no\"", 0.0, 0.5)];
    assert_eq!(words(&text_grid(long).unwrap()), expected);
    let short = "\"ooTextFile\"\n\"TextGrid\"\n0\n2\n<exists>\n1\n\"IntervalTier\"\n\"any\"\n0\n2\n1\n0\n0.5\n\"say \"\"no\"\"\"\n";
    assert_eq!(words(&text_grid(short).unwrap()), expected);
    assert!(text_grid(&short[..short.len() - 14]).unwrap_err().contains("the file ends"));
    assert!(text_grid("\"ooTextFile\"\n\"TextGrid\"\n\"x\"").unwrap_err().starts_with("line 3: expected xmin"));
    assert!(text_grid("\"a").unwrap_err().starts_with("line 1"));
    let wide: Vec<u8> = [0xFF, 0xFE].into_iter().chain(short.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    assert_eq!(decoded(&wide).unwrap(), short);
    assert!(decoded(b"a\n\xFF").unwrap_err().starts_with("line 2"));
}

#[test]
fn ctm_lines() {
    let text = ";; comment\nfile 1 0.5 0.25 No 0.9\nfile 1 0.8 0.2 <eps>\n\nfile 1 1 0.5 way\n";
    assert_eq!(words(&ctm(text).unwrap()), [("No", 0.5, 0.75), ("way", 1.0, 1.5)]);
    assert!(ctm("file 1 0.5").unwrap_err().starts_with("line 1: expected"));
    assert!(ctm("\nf 1 x 1 a").unwrap_err().starts_with("line 2: `x`"));
}

#[test]
fn long_cues_are_cut_and_wrong_times_refused() {
    let cue = |text: &str, start, end| Timed { text: text.to_owned(), start, end };
    let cut = checked(vec![cue(&"word ".repeat(100), 1.0, 41.0), cue(" ", 0.0, 1.0), cue("a", 0.0, 100.0)]).unwrap();
    assert_eq!(cut.len(), 5);
    assert_eq!((cut[3].end, cut[4].end), (41.0, 30.0));
    assert!(cut.iter().all(|cue| cue.text.split(' ').count() <= MAX_WORDS && cue.end - cue.start <= MAX_CUE));
    for (start, end) in [(-1.0, 0.0), (1.0, 0.5), (f64::NAN, 1.0), (0.0, f64::INFINITY)] {
        assert!(checked(vec![cue("a", start, end)]).is_err());
    }
}

#[test]
fn plain_text_follows_the_voice() {
    let tone = |at: usize| if (8000..24_000).contains(&at) || (40_000..56_000).contains(&at) { 0.3 } else { 0.0 };
    let samples: Vec<f32> = (0..64_000).map(|at| tone(at) * (at as f32 * 0.3).sin()).collect();
    let stretches = voiced(&samples);
    assert_eq!(stretches.len(), 2);
    let timed = spread(&WordRules::english(), "one two three four, five six seven eight", &stretches, 4.0);
    assert_eq!(timed.len(), 8);
    assert!((timed[0].start - 0.5).abs() < 0.05 && (timed[3].end - 1.5).abs() < 0.05, "{timed:?}");
    assert!((timed[4].start - 2.5).abs() < 0.05 && (timed[7].end - 3.5).abs() < 0.05, "{timed:?}");
    // Without a voice over the whole.
    assert_eq!(spread(&WordRules::english(), "one", &[], 4.0)[0].end, 4.0);
    assert!(spread(&WordRules::english(), "", &stretches, 4.0).is_empty() && voiced(&[]).is_empty());
}

/// Sentences of one talker with the corpus's times: the share of words whose middle is within 200 ms. `UMO_GRID` names a
/// folder of all of them (`words.json`, `audio`), of which the share is only printed.
#[test]
fn words_of_plain_text_are_near_their_place() {
    let ten = Path::new(env!("CARGO_MANIFEST_DIR")).join("../benches/lips/ten");
    let all = std::env::var_os("UMO_GRID").map(std::path::PathBuf::from);
    let (list, audio) = match &all {
        Some(grid) => (grid.join("words.json"), grid.join("audio")),
        None => (ten.join("mouths.json"), ten),
    };
    let sentences: serde_json::Value = serde_json::from_slice(&std::fs::read(list).unwrap()).unwrap();
    let mut off: Vec<f64> = Vec::new();
    for (name, sentence) in sentences.as_object().unwrap() {
        let words = sentence.get("words").unwrap_or(sentence).clone();
        let words: Vec<(f64, f64, String)> = serde_json::from_value(words).unwrap();
        let words: Vec<_> = words.into_iter().filter(|(.., word)| word != "sil").collect();
        let text: Vec<&str> = words.iter().map(|(.., word)| &**word).collect();
        let speech = crate::speech::Speech::open(&audio.join(format!("{name}.opus")), false).unwrap();
        let stretches = voiced(&speech.mono(VOICE_RATE).unwrap());
        let timed = spread(&WordRules::english(), &text.join(" "), &stretches, speech.seconds());
        assert_eq!(timed.len(), words.len(), "{name}");
        off.extend(timed.iter().zip(&words).map(|(at, (start, end, _))| (at.start + at.end - start - end).abs() / 2.0));
    }
    off.sort_by(f64::total_cmp);
    let near = off.iter().filter(|&&off| off <= 0.2).count();
    println!("{near} of {} words within 200 ms, median {:.0} ms", off.len(), 1000.0 * off[off.len() / 2]);
    assert!(all.is_some() || near as f64 >= 0.85 * off.len() as f64, "{near} of {}", off.len());
}

/// An hour of speech is spread in a moment, whatever its pauses.
#[test]
fn a_long_text_is_spread_too() {
    let text = "some more words of a long talk, ".repeat(1200);
    let stretches: Vec<(f64, f64)> = (0..1200).map(|at| (3.0 * f64::from(at), 3.0 * f64::from(at) + 2.5)).collect();
    let timed = spread(&WordRules::english(), &text, &stretches, 3600.0);
    assert_eq!(timed.len(), 1200 * 7);
    assert!((timed[7 * 600].start - 1800.0).abs() < 0.05, "{}", timed[7 * 600].start);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn no_text_panics(text in "(\"|[0-9:.,]|-->|<|>|\\{|\n|[a-zä ]|ooTextFile|TextGrid|IntervalTier|words|sil){0,60}") {
        for parse in [cues, whisper, text_grid, ctm] {
            let _ = parse(&text).and_then(checked);
        }
        let _ = decoded(text.as_bytes());
        spread(&WordRules::german(), &text, &[(0.0, 1.0), (1.5, 2.0)], 3.0);
    }
}
