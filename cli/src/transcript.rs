//! Words of a recording out of files: with times (SubRip, WebVTT, Whisper's JSON, Praat TextGrid, CTM), or plain text.

use std::path::Path;

use serde::Deserialize;
use umo_core::WordRules;
use umo_core_words::spoken;

use crate::failure::Failure;

/// A word, or words that share a time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Timed {
    pub(crate) text: String,
    /// Seconds of the recording.
    pub(crate) start: f64,
    pub(crate) end: f64,
}

/// Contents of a file.
#[derive(Debug, PartialEq)]
pub(crate) enum Transcript {
    Timed(Vec<Timed>),
    Plain(String),
}

/// Longest recording, seconds: a week.
const MAX_SECONDS: f64 = 604_800.0;
/// Most words of a cue that share its time in one call, and its longest duration, seconds.
const MAX_WORDS: usize = 32;
const MAX_CUE: f64 = 30.0;

/// Reads a file by its extension.
pub(crate) fn read(path: &Path) -> Result<Transcript, Failure> {
    let wrong = |problem: String| Failure::Input(format!("{}: {problem}", path.display()));
    let text = decoded(&std::fs::read(path).map_err(|error| wrong(error.to_string()))?).map_err(wrong)?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let words = match &*extension {
        "srt" | "vtt" => cues(&text),
        "json" => whisper(&text),
        "textgrid" => text_grid(&text),
        "ctm" => ctm(&text),
        "txt" => return Ok(Transcript::Plain(text)),
        _ => Err("expected .srt, .vtt, .json, .TextGrid, .ctm or .txt".to_owned()),
    };
    words.and_then(checked).map(Transcript::Timed).map_err(wrong)
}

/// UTF-8, or UTF-16 with a byte order mark, as Praat writes it.
fn decoded(bytes: &[u8]) -> Result<String, String> {
    let wide = |rest: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = rest.chunks_exact(2).map(|pair| unit([pair[0], pair[1]])).collect();
        String::from_utf16(&units).map_err(|_| "the text is not UTF-16, as its first bytes say".to_owned())
    };
    match bytes {
        [0xFF, 0xFE, rest @ ..] => wide(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => wide(rest, u16::from_be_bytes),
        [0xEF, 0xBB, 0xBF, rest @ ..] | rest => {
            let line = |at: usize| rest[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
            let wrong =
                |error: std::str::Utf8Error| format!("line {}: the text is not UTF-8", line(error.valid_up_to()));
            std::str::from_utf8(rest).map(str::to_owned).map_err(wrong)
        }
    }
}

/// Checks times, drops empty texts and cuts long ones.
fn checked(words: Vec<Timed>) -> Result<Vec<Timed>, String> {
    let mut all = Vec::with_capacity(words.len());
    for Timed { text, start, end } in words {
        if !(0.0..=MAX_SECONDS).contains(&start) || !(start..=MAX_SECONDS).contains(&end) {
            return Err(format!("`{text}`: expected a start from 0 on and an end after it, got {start} to {end} s"));
        }
        let parts: Vec<&str> = text.split_whitespace().collect();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a recording's seconds")]
        let cues = ((end - start) / MAX_CUE).ceil() as usize;
        let pieces = parts.len().div_ceil(MAX_WORDS).max(cues).min(parts.len());
        if pieces < 2 {
            // A subtitle that stays up is not spoken so slowly.
            let end = end.min(start + MAX_CUE);
            all.extend((!parts.is_empty()).then_some(Timed { text, start, end }));
            continue;
        }
        let at = |piece: usize| start + (end - start) * piece as f64 / pieces as f64;
        for (number, part) in parts.chunks(parts.len().div_ceil(pieces)).enumerate() {
            let first = at(number);
            all.push(Timed { text: part.join(" "), start: first, end: at(number + 1).min(first + MAX_CUE) });
        }
    }
    Ok(all)
}

/// SubRip and WebVTT.
fn cues(text: &str) -> Result<Vec<Timed>, String> {
    let mut words: Vec<Timed> = Vec::new();
    // Of the cue: its text, its times, and the line of these.
    let mut cue: Option<(String, f64, f64)> = None;
    let close = |cue: &mut Option<(String, f64, f64)>, words: &mut Vec<Timed>| {
        if let Some((text, start, end)) = cue.take() {
            words.extend(segments(&text, start, end));
        }
    };
    for (number, line) in text.lines().enumerate() {
        if let Some((from, to)) = line.split_once("-->") {
            close(&mut cue, &mut words);
            let time = |text: &str| {
                let text = text.split_whitespace().next().unwrap_or_default();
                clock(text).ok_or_else(|| format!("line {}: expected a time as 00:01:02.500, got `{text}`", number + 1))
            };
            cue = Some((String::new(), time(from)?, time(to)?));
        } else if line.trim().is_empty() {
            close(&mut cue, &mut words);
        } else if let Some((text, ..)) = &mut cue {
            *text += " ";
            *text += line;
        }
    }
    close(&mut cue, &mut words);
    if words.is_empty() {
        Err("no cue found: expected lines as 00:00:01.000 --> 00:00:02.000".to_owned())
    } else {
        Ok(words)
    }
}

/// `1:02:03.5`, `02:03,500`: seconds.
fn clock(text: &str) -> Option<f64> {
    let parts: Vec<&str> = text.split(':').collect();
    if !(2..=3).contains(&parts.len()) || !text.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let (last, first) = parts.split_last()?;
    let whole = first.iter().try_fold(0.0, |sum, part| Some(60.0 * sum + f64::from(part.parse::<u32>().ok()?)))?;
    let seconds: f64 = last.replace(',', ".").parse().ok()?;
    (0.0..60.0).contains(&seconds).then_some(60.0 * whole + seconds)
}

/// A cue's text without its tags; the times in it (`<00:00:01.500>`) part it.
fn segments(text: &str, start: f64, end: f64) -> Vec<Timed> {
    let (mut segments, mut said, mut since) = (Vec::new(), String::new(), start);
    let mut rest = text;
    while let Some((before, after)) = rest.split_once(['<', '{']) {
        said += before;
        let Some((tag, after)) = after.split_once(['>', '}']) else {
            // A tag that does not end.
            rest = "";
            break;
        };
        if let Some(time) = clock(tag).filter(|time| (since..=end).contains(time)) {
            segments.push(Timed { text: std::mem::take(&mut said), start: since, end: time });
            since = time;
        }
        rest = after;
    }
    said += rest;
    segments.push(Timed { text: said, start: since, end });
    segments.retain(|segment| !segment.text.trim().is_empty());
    segments
}

/// Whisper's JSON: words of segments, words beside segments, or segments alone; and whisper.cpp's.
fn whisper(text: &str) -> Result<Vec<Timed>, String> {
    #[derive(Deserialize)]
    struct File {
        #[serde(default)]
        words: Vec<Word>,
        #[serde(default)]
        segments: Vec<Segment>,
        #[serde(default)]
        transcription: Vec<Piece>,
    }
    #[derive(Deserialize)]
    struct Segment {
        start: Option<f64>,
        end: Option<f64>,
        #[serde(default)]
        text: String,
        #[serde(default)]
        words: Vec<Word>,
    }
    #[derive(Deserialize)]
    struct Word {
        #[serde(alias = "text")]
        word: String,
        // A word that could not be aligned has none.
        start: Option<f64>,
        end: Option<f64>,
    }
    #[derive(Deserialize)]
    struct Piece {
        text: String,
        offsets: Offsets,
    }
    /// Milliseconds.
    #[derive(Deserialize)]
    struct Offsets {
        from: f64,
        to: f64,
    }
    let File { words, segments, transcription } = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let timed = |text: String, start: Option<f64>, end: Option<f64>| Some(Timed { text, start: start?, end: end? });
    let mut all: Vec<Timed> = words.into_iter().filter_map(|it| timed(it.word, it.start, it.end)).collect();
    if all.is_empty() {
        for Segment { start, end, text, words } in segments {
            let before = all.len();
            all.extend(words.into_iter().filter_map(|it| timed(it.word, it.start, it.end)));
            if all.len() == before {
                all.extend(timed(text, start, end));
            }
        }
    }
    all.extend(
        transcription
            .into_iter()
            .filter_map(|it| timed(it.text, Some(it.offsets.from / 1000.0), Some(it.offsets.to / 1000.0))),
    );
    if all.is_empty() {
        return Err("no words found: expected `words` or `segments` with `start` and `end`".to_owned());
    }
    Ok(all)
}

/// Praat's TextGrid, in its long and short form.
fn text_grid(text: &str) -> Result<Vec<Timed>, String> {
    let mut tokens = grid_tokens(text)?.into_iter().peekable();
    let last = text.lines().count();
    let mut next = |what: &str| match tokens.next() {
        Some(token) => Ok(token),
        None => Err(format!("line {last}: the file ends where {what} should be")),
    };
    let string = |(line, token): (usize, GridToken), what: &str| match token {
        GridToken::Text(text) => Ok(text),
        GridToken::Number(number) => Err(format!("line {line}: expected {what} in quotes, got {number}")),
    };
    let number = |(line, token): (usize, GridToken), what: &str| match token {
        GridToken::Number(number) => Ok(number),
        GridToken::Text(text) => Err(format!("line {line}: expected {what}, got \"{text}\"")),
    };
    let (kind, class) = (next("ooTextFile")?, next("TextGrid")?);
    if string(kind, "ooTextFile")? != "ooTextFile" || string(class, "TextGrid")? != "TextGrid" {
        return Err("line 1: expected File type = \"ooTextFile\" and Object class = \"TextGrid\"".to_owned());
    }
    for what in ["xmin", "xmax"] {
        number(next(what)?, what)?;
    }
    let tiers = number(next("the number of tiers")?, "the number of tiers")?;
    let mut found: Vec<(String, Vec<Timed>)> = Vec::new();
    let mut names = Vec::new();
    let mut at = 0.0;
    while at < tiers {
        at += 1.0;
        let kind = string(next("a tier")?, "the class of a tier")?;
        let name = string(next("a tier's name")?, "the name of a tier")?;
        for what in ["xmin", "xmax"] {
            number(next(what)?, what)?;
        }
        let size = number(next("a tier's size")?, "the size of a tier")?;
        let is_intervals = kind == "IntervalTier";
        let (mut words, mut item) = (Vec::new(), 0.0);
        while item < size {
            item += 1.0;
            let start = number(next("a time")?, "a time")?;
            let end = if is_intervals { number(next("a time")?, "a time")? } else { start };
            let text = string(next("a text")?, "a text")?;
            words.push(Timed { text, start, end });
        }
        names.push(name.clone());
        if is_intervals {
            found.push((name, words));
        }
    }
    let is_words = |name: &str| matches!(&*name.to_lowercase(), "words" | "word" | "ort" | "orthography" | "wörter");
    let chosen = match found.iter().position(|(name, _)| is_words(name)) {
        Some(at) => at,
        None if found.len() == 1 => 0,
        None => return Err(format!("no tier is called `words`; there are {}", names.join(", "))),
    };
    let silent = ["sil", "sp", "<eps>", "<p:>", "spn"];
    let (_, mut words) = found.swap_remove(chosen);
    words.retain(|word| !silent.contains(&word.text.trim()));
    Ok(words)
}

enum GridToken {
    Text(String),
    Number(f64),
}

/// Strings and free numbers with their lines; everything else of a TextGrid repeats what their order says.
fn grid_tokens(text: &str) -> Result<Vec<(usize, GridToken)>, String> {
    let mut tokens = Vec::new();
    let (mut line, mut rest) = (1, text);
    while let Some(first) = rest.chars().next() {
        if first == '"' {
            let (begin, mut said) = (line, String::new());
            rest = &rest[1..];
            loop {
                let Some((part, after)) = rest.split_once('"') else {
                    return Err(format!("line {begin}: a quote that does not end"));
                };
                line += part.matches('\n').count();
                said += part;
                rest = after;
                // Two quotes are one.
                match rest.strip_prefix('"') {
                    Some(after) => (rest, said) = (after, said + "\""),
                    None => break,
                }
            }
            tokens.push((begin, GridToken::Text(said)));
        } else if first == '!' {
            rest = rest.find('\n').map_or("", |end| &rest[end..]);
        } else if first.is_whitespace() {
            line += usize::from(first == '\n');
            rest = &rest[first.len_utf8()..];
        } else {
            let end = rest.find(|c: char| c.is_whitespace() || c == '"').unwrap_or(rest.len());
            if let Some(number) = rest[..end].parse().ok().filter(|number: &f64| number.is_finite()) {
                tokens.push((line, GridToken::Number(number)));
            }
            rest = &rest[end..];
        }
    }
    Ok(tokens)
}

/// NIST's CTM: `recording channel start duration word [confidence]`.
fn ctm(text: &str) -> Result<Vec<Timed>, String> {
    let mut words = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with(";;") {
            continue;
        }
        let fields: Vec<&str> = line.split_whitespace().collect();
        let [_, _, start, duration, word, ..] = fields[..] else {
            return Err(format!("line {}: expected `recording channel start duration word`, got `{line}`", number + 1));
        };
        let seconds = |text: &str| {
            let wrong = || format!("line {}: `{text}` is not a number of seconds", number + 1);
            text.parse::<f64>().ok().filter(|value| (0.0..=MAX_SECONDS).contains(value)).ok_or_else(wrong)
        };
        let start = seconds(start)?;
        if !matches!(word, "<eps>" | "sil" | "sp" | "<unk>") {
            words.push(Timed { text: word.to_owned(), start, end: start + seconds(duration)? });
        }
    }
    if words.is_empty() { Err("no words found".to_owned()) } else { Ok(words) }
}

/// Rate at which the voice is looked for, per second.
pub(crate) const VOICE_RATE: usize = 16_000;
/// Samples of a level, 10 ms.
const LEVEL: usize = VOICE_RATE / 100;
/// Shortest pause between two stretches of voice, and shortest stretch, in levels.
const SHORTEST_PAUSE: usize = 18;
const SHORTEST_VOICE: usize = 10;

/// Stretches with voice, seconds: levels above a threshold between the recording's quiet and loud ones.
pub(crate) fn voiced(samples: &[f32]) -> Vec<(f64, f64)> {
    let power = |piece: &[f32]| piece.iter().map(|value| value * value).sum::<f32>() / piece.len() as f32;
    let powers: Vec<f32> = samples.chunks(LEVEL).map(power).collect();
    // Over 70 ms, so that neither a click nor a closure counts.
    let around = |at: usize| &powers[at.saturating_sub(3)..(at + 4).min(powers.len())];
    let mean = |piece: &[f32]| (piece.iter().sum::<f32>() / piece.len() as f32).sqrt();
    let levels: Vec<f32> = (0..powers.len()).map(|at| mean(around(at))).collect();
    let mut sorted = levels.clone();
    sorted.sort_by(f32::total_cmp);
    // One in twenty is quieter, one louder.
    let twentieth = sorted.len() / 20;
    let (quiet, loud) = (sorted.get(twentieth), sorted.get(19 * twentieth));
    let (quiet, loud) = (quiet.copied().unwrap_or(0.0), loud.copied().unwrap_or(0.0));
    let threshold = (0.14 * loud).max(2.0 * quiet).min(0.3 * loud);
    let mut stretches: Vec<(usize, usize)> = Vec::new();
    for (at, _) in levels.iter().enumerate().filter(|&(_, &level)| level > threshold) {
        match stretches.last_mut() {
            Some((_, end)) if at <= *end + SHORTEST_PAUSE => *end = at + 1,
            _ => stretches.push((at, at + 1)),
        }
    }
    stretches.retain(|(start, end)| end - start >= SHORTEST_VOICE);
    stretches.into_iter().map(|(start, end)| (start as f64 * 0.01, end as f64 * 0.01)).collect()
}

/// Time of a syllable and of a letter, relative to each other.
const SYLLABLE: f64 = 0.55;
const LETTER: f64 = 0.18;
/// Time by which the last word of a stretch is longer, on the same scale.
const LENGTHENED: f64 = 0.6;
/// Cost of a pause inside a clause, seconds of mismatch.
const PAUSE_IN_CLAUSE: f64 = 0.25;
/// Words of a stretch that are always tried, and the seconds and the share of its length beyond which more are not: so an
/// hour of text takes no longer than a stretch's words do, once for each pair of stretch and word.
const WORDS_TRIED: usize = 8;
const SECONDS_TRIED: f64 = 2.0;
const SHARE_TRIED: f64 = 4.0;

/// Spreads the words of a text over stretches with voice: so that each stretch has as many syllables as its length
/// lets expect, and pauses fall on punctuation; within a stretch by syllables, the last word longer.
pub(crate) fn spread(rules: &WordRules, text: &str, stretches: &[(f64, f64)], seconds: f64) -> Vec<Timed> {
    let words: Vec<_> = spoken(text).collect();
    // A word's time goes by its syllables, and by its sounds, of which letters tell.
    let weight = |word: &str| SYLLABLE * f64::from(rules.syllables(word)) + LETTER * word.chars().count() as f64;
    let weights: Vec<f64> = words.iter().map(|it| weight(it.text)).collect();
    let whole = [(0.0, seconds)];
    let stretches = if stretches.is_empty() { &whole[..] } else { stretches };
    let bounds = bounds(&words, &weights, stretches);
    let mut all = Vec::with_capacity(words.len());
    for (&(start, end), range) in stretches.iter().zip(bounds.windows(2)) {
        let range = range[0]..range[1];
        let last = range.end;
        let total: f64 = weights[range.clone()].iter().sum::<f64>() + LENGTHENED;
        let mut at = start;
        for index in range {
            let weight = weights[index] + if index + 1 == last { LENGTHENED } else { 0.0 };
            let length = (end - start) * weight / total;
            let text = format!("{}{}", words[index].text, if words[index].is_end { "," } else { "" });
            all.push(Timed { text, start: at, end: at + length });
            at += length;
        }
    }
    all
}

/// First word of each stretch, and the number of words: the least mismatch of lengths, by dynamic programming.
fn bounds(words: &[umo_core_words::Spoken], weights: &[f64], stretches: &[(f64, f64)]) -> Vec<usize> {
    let count = words.len();
    let mut sums = vec![0.0];
    sums.extend(weights.iter().scan(0.0, |sum, weight| {
        *sum += weight;
        Some(*sum)
    }));
    let voice: f64 = stretches.iter().map(|(start, end)| end - start).sum();
    let pace = voice / (sums[count] + LENGTHENED * stretches.len() as f64).max(1.0);
    let mut costs = vec![f64::INFINITY; count + 1];
    costs[0] = 0.0;
    let mut before = Vec::with_capacity(stretches.len());
    for (number, (start, end)) in stretches.iter().enumerate() {
        let (length, is_last) = (end - start, number + 1 == stretches.len());
        let (mut new, mut from) = (vec![f64::INFINITY; count + 1], vec![0_u32; count + 1]);
        for to in 0..=count {
            let is_pause = to > 0 && !is_last && !words[to - 1].is_end;
            let pause = if is_pause { PAUSE_IN_CLAUSE } else { 0.0 };
            for begin in (0..=to).rev() {
                let lengthened = if to > begin { LENGTHENED } else { 0.0 };
                let expected = pace * (sums[to] - sums[begin] + lengthened);
                if to - begin > WORDS_TRIED && expected > SHARE_TRIED * length + SECONDS_TRIED {
                    break;
                }
                let cost = costs[begin] + pause + (length - expected).powi(2) / (length + expected).max(1e-3);
                if cost < new[to] {
                    (new[to], from[to]) = (cost, u32::try_from(begin).unwrap_or(u32::MAX));
                }
            }
        }
        costs = new;
        before.push(from);
    }
    let mut bounds = vec![count];
    for from in before.iter().rev() {
        bounds.push(from[bounds[bounds.len() - 1]] as usize);
    }
    bounds.reverse();
    bounds
}

#[cfg(test)]
mod tests;
