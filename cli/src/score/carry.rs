//! Changes of a score on a motion that was made anew: they move with the words.
//!
//! ```text
//! lines of the old take ──────┬─ changes ─► moved by the words' times ─► lines of the new take, changed
//! lines as they were changed ─┘
//! ```

use std::fmt;

use super::line::{Hands, Kind, Line, Phase};

/// Times that count as the same, seconds: a score's text has milliseconds.
const SAME: f64 = 6e-4;
/// Largest distance of a line from the time at which it is looked for, seconds.
const NEAR: f64 = 0.25;
/// Longest pause between the two forms of a changed line, seconds.
const CHANGED: f64 = 1.0;
/// Motions without common words have the same times if their lengths differ by less than this share.
const SAME_LENGTH: f64 = 0.05;

/// A motion's own lines, and its length in seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Own<'a> {
    pub(crate) lines: &'a [Line],
    pub(crate) seconds: f64,
}

/// Returns the new lines with the changes that `changed` has of the old ones, and what became of each change. Hands change
/// at multiples of `step` seconds. Of changes that `check` refuses, the report says why.
pub(crate) fn carry(
    old: Own,
    changed: &[Line],
    (new, step): (Own, f64),
    mut check: impl FnMut(&[Line]) -> Result<(), String>,
) -> (Vec<Line>, Vec<String>) {
    let times = Times::new(old, new);
    let mut made = Made { step, lines: new.lines.to_vec(), is_changed: vec![false; new.lines.len()] };
    let mut report = Vec::new();
    for change in changes(old.lines, changed) {
        let (mut with, was) = (made.clone(), change.at());
        let applied = with.apply(&change, &times).and_then(|at| {
            with.lines_in_order();
            check(&with.lines).map(|()| at)
        });
        report.push(match applied {
            Ok(at) => {
                made = with;
                let before = if is_same(at, was) { String::new() } else { format!(" (was {was:.1} s)") };
                format!("{change}: kept at {at:.1} s{before}")
            }
            Err(why) => format!("{change}: dropped (was at {was:.1} s): {why}"),
        });
    }
    (made.lines, report)
}

fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() < SAME
}

fn span(line: &Line) -> [f64; 2] {
    [line.at, line.to.unwrap_or(line.at)]
}

/// Whether one line can stand for the other.
fn is_alike(a: &Kind, b: &Kind) -> bool {
    match (a, b) {
        (Kind::Gesture(a, _), Kind::Gesture(b, _)) => a == b,
        (Kind::Lips(a), Kind::Lips(b)) => a == b,
        (Kind::Layer(a, _), Kind::Layer(b, _)) => a == b,
        (Kind::Hands(a, Phase::Stroke, _), Kind::Hands(b, Phase::Stroke, _)) => a == b,
        (Kind::Hands(..), _) | (_, Kind::Hands(..)) => false,
        _ => std::mem::discriminant(a) == std::mem::discriminant(b),
    }
}

/// Place of the line that is like `kind` and nearest to a time.
fn nearest<'a>(
    lines: impl Iterator<Item = (usize, &'a Line)>,
    kind: &Kind,
    [at, to]: [f64; 2],
    most: f64,
) -> Option<usize> {
    let away = |line: &Line| (span(line)[0] - at).abs() + (span(line)[1] - to).abs();
    let pause = |line: &Line| (at - span(line)[1]).max(span(line)[0] - to).max(0.0);
    lines
        .filter(|(_, line)| is_alike(&line.kind, kind) && pause(line) < most)
        .min_by(|(_, a), (_, b)| away(a).total_cmp(&away(b)))
        .map(|(place, _)| place)
}

/// A difference between a take's own lines and the changed ones.
#[derive(Clone, Debug, PartialEq)]
enum Change {
    Added(Line),
    Removed(Line),
    Changed(Line, Line),
    /// Other phases of hands, in a span.
    Hands(Hands, [f64; 2], Vec<Line>),
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (how, line) = match self {
            Self::Added(line) => ("added", line),
            Self::Removed(line) => ("removed", line),
            Self::Changed(_, line) => ("changed", line),
            Self::Hands(hands, _, lines) => {
                let phases: Vec<_> = lines.iter().map(|line| phase(line).0.name()).collect();
                return write!(f, "{} {}", hands.name(), phases.join(", "));
            }
        };
        match &line.kind {
            Kind::Words(text) => write!(f, "{how} words `{text}`"),
            Kind::Hands(hands, phase, _) => write!(f, "{how} {} {}", hands.name(), phase.name()),
            Kind::Gesture(name, _) => write!(f, "{how} gesture `{name}`"),
            Kind::Lips(shape) => write!(f, "{how} lips `{}`", shape.name()),
            Kind::Look(..) => write!(f, "{how} look"),
            Kind::Mood(mood, _) => write!(f, "{how} mood `{}`", mood.name()),
            Kind::Expression(_) => write!(f, "{how} expression"),
            Kind::Attention(_) => write!(f, "{how} attention"),
            Kind::Layer(layer, _) => write!(f, "{how} layer `{}`", layer.name()),
        }
    }
}

impl Change {
    fn at(&self) -> f64 {
        match self {
            Self::Added(line) | Self::Removed(line) | Self::Changed(_, line) => line.at,
            Self::Hands(_, [at, _], _) => *at,
        }
    }
}

/// The differences, by time.
fn changes(own: &[Line], changed: &[Line]) -> Vec<Change> {
    let mut changes = hand_changes(own, changed);
    let is_hands = |line: &&Line| matches!(line.kind, Kind::Hands(..));
    let mut there: Vec<&Line> = changed.iter().filter(|line| !is_hands(line)).collect();
    let mut gone: Vec<&Line> = Vec::new();
    for line in own.iter().filter(|line| !is_hands(line)) {
        match there.iter().position(|other| other.text() == line.text()) {
            Some(place) => drop(there.remove(place)),
            None => gone.push(line),
        }
    }
    for line in gone {
        let others = there.iter().copied().enumerate();
        changes.push(match nearest(others, &line.kind, span(line), CHANGED) {
            Some(place) => Change::Changed(line.clone(), there.remove(place).clone()),
            None => Change::Removed(line.clone()),
        });
    }
    changes.extend(there.into_iter().cloned().map(Change::Added));
    changes.sort_by(|a, b| a.at().total_cmp(&b.at()));
    changes
}

/// Phase and strength of a line of hands; rest of any other.
fn phase(line: &Line) -> (Phase, Option<f32>) {
    match line.kind {
        Kind::Hands(_, phase, strength) => (phase, strength),
        _ => (Phase::Rest, None),
    }
}

/// The lines of one hand. Between them it rests.
fn lane(lines: &[Line], hand: Hands) -> Vec<&Line> {
    let of_hand = |line: &&Line| matches!(line.kind, Kind::Hands(hands, ..) if hands.meet(hand));
    lines.iter().filter(of_hand).collect()
}

/// Where the hands do something else.
fn hand_changes(own: &[Line], changed: &[Line]) -> Vec<Change> {
    let of = |hand: Hands| -> Vec<Change> {
        let (before, after) = (lane(own, hand), lane(changed, hand));
        let mut times: Vec<f64> = before.iter().chain(&after).flat_map(|line| span(line)).collect();
        times.sort_by(f64::total_cmp);
        times.dedup_by(|a, b| is_same(*a, *b));
        let at = |lane: &[&Line], time: f64| lane.iter().rposition(|line| span(line)[0] < time && time < span(line)[1]);
        let does = |lane: &[&Line], place: Option<usize>| {
            let (phase, strength) = place.map_or((Phase::Rest, None), |place| phase(lane[place]));
            (phase, strength.map(|strength| (1000.0 * strength).round()))
        };
        // Spans that differ, each with the place of its changed line.
        let mut found: Vec<([f64; 2], Option<usize>)> = Vec::new();
        for pair in times.windows(2) {
            let middle = f64::midpoint(pair[0], pair[1]);
            let [old, new] = [at(&before, middle), at(&after, middle)];
            if does(&before, old) == does(&after, new) {
                continue;
            }
            match found.last_mut() {
                Some((span, last)) if is_same(span[1], pair[0]) && *last == new => span[1] = pair[1],
                _ => found.push(([pair[0], pair[1]], new)),
            }
        }
        let mut changes: Vec<Change> = Vec::new();
        for ([from, to], place) in found {
            let (phase, strength) = place.map_or((Phase::Rest, None), |place| phase(after[place]));
            let line = Line::span(from, to, Kind::Hands(hand, phase, strength));
            match changes.last_mut() {
                Some(Change::Hands(_, span, lines)) if is_same(span[1], from) => {
                    span[1] = to;
                    lines.push(line);
                }
                _ => changes.push(Change::Hands(hand, [from, to], vec![line])),
            }
        }
        changes
    };
    let (mut left, mut both) = (of(Hands::Left), Vec::new());
    for change in of(Hands::Right) {
        let joint = change.clone().of(Hands::Both);
        match left.iter().position(|other| other.clone().of(Hands::Both) == joint) {
            Some(place) => {
                left.remove(place);
                both.push(joint);
            }
            None => both.push(change),
        }
    }
    both.extend(left);
    both
}

impl Change {
    /// The same of other hands.
    fn of(self, hands: Hands) -> Self {
        let Self::Hands(_, span, lines) = self else { return self };
        let of = |line: Line| {
            let (phase, strength) = phase(&line);
            Line { kind: Kind::Hands(hands, phase, strength), ..line }
        };
        Self::Hands(hands, span, lines.into_iter().map(of).collect())
    }
}

/// Lines of the new motion, and which of them were changed.
#[derive(Clone, Debug)]
struct Made {
    /// Seconds of a keyframe.
    step: f64,
    lines: Vec<Line>,
    is_changed: Vec<bool>,
}

impl Made {
    /// Makes a change. Returns its time, or why it cannot be made.
    fn apply(&mut self, change: &Change, times: &Times) -> Result<f64, String> {
        match change {
            Change::Added(line) => {
                let moved = times.of(span(line))?;
                self.push(Line { at: moved[0], to: line.to.map(|_| moved[1]), ..line.clone() });
                Ok(moved[0])
            }
            Change::Removed(line) => {
                let place = self.find(line, times)?;
                self.is_changed.remove(place);
                Ok(self.lines.remove(place).at)
            }
            Change::Changed(from, to) => {
                let place = self.find(from, times)?;
                let (moved, own) = (times.of(span(to))?, span(&self.lines[place]));
                // An end that was not changed stays the new motion's.
                let [at, end] =
                    [0, 1].map(|end| if is_same(span(from)[end], span(to)[end]) { own[end] } else { moved[end] });
                let [at, end] = if at <= end { [at, end] } else { moved };
                let line = &mut self.lines[place];
                (line.at, line.to) = (at, to.to.map(|_| end));
                if from.kind != to.kind {
                    line.kind = to.kind.clone();
                }
                self.is_changed[place] = true;
                Ok(at)
            }
            Change::Hands(hands, at, lines) => self.overlay(*hands, *at, lines, times),
        }
    }

    /// Place of the unchanged line that stands for one of the old motion.
    fn find(&self, line: &Line, times: &Times) -> Result<usize, String> {
        let moved = times.of(span(line))?;
        let own = self.lines.iter().enumerate().filter(|(place, _)| !self.is_changed[*place]);
        nearest(own, &line.kind, moved, NEAR).ok_or_else(|| format!("there is nothing like it at {:.1} s", moved[0]))
    }

    /// Lets hands do something else in a span.
    fn overlay(&mut self, hands: Hands, at: [f64; 2], lines: &[Line], times: &Times) -> Result<f64, String> {
        let step = self.step;
        let on_step = |time: f64| (time / step).round() * step;
        let [from, to] = times.of(at)?.map(on_step);
        let to = to.max(from + step);
        if let [line] = lines
            && self.is_stroke_of(hands, line)
            && let Ok(place) = self.find(line, times)
        {
            // A stroke that is there, too: as strong as it was wanted.
            self.lines[place].kind = line.kind.clone();
            self.is_changed[place] = true;
            return Ok(self.lines[place].at);
        }
        let mut kept = Vec::with_capacity(self.lines.len() + lines.len());
        for (line, is_changed) in std::mem::take(&mut self.lines).into_iter().zip(std::mem::take(&mut self.is_changed))
        {
            let Kind::Hands(own, phase, strength) = line.kind else {
                kept.push((line, is_changed));
                continue;
            };
            let [start, end] = span(&line);
            if !own.meet(hands) || end <= from || to <= start {
                kept.push((line, is_changed));
                continue;
            }
            let mut part = |hands, start: f64, end: f64| {
                if end - start > SAME {
                    kept.push((Line::span(start, end, Kind::Hands(hands, phase, strength)), true));
                }
            };
            part(own, start, from);
            part(own, to, end);
            let other = match (own, hands) {
                (Hands::Both, Hands::Left) => Some(Hands::Right),
                (Hands::Both, Hands::Right) => Some(Hands::Left),
                _ => None,
            };
            if let Some(other) = other {
                part(other, start.max(from), end.min(to));
            }
        }
        (self.lines, self.is_changed) = kept.into_iter().unzip();
        for line in lines {
            let ends = span(line).map(|time| on_step(times.moved(time)).clamp(from, to));
            // Hands without a line rest.
            if phase(line).0 != Phase::Rest && ends[1] - ends[0] > SAME {
                self.push(Line::span(ends[0], ends[1], line.kind.clone()));
            }
        }
        self.join();
        Ok(from)
    }

    fn is_stroke_of(&self, hands: Hands, line: &Line) -> bool {
        matches!(line.kind, Kind::Hands(own, Phase::Stroke, _) if own == hands)
    }

    fn push(&mut self, line: Line) {
        self.lines.push(line);
        self.is_changed.push(true);
    }

    /// Joins lines of hands that go on with the same, of which one was changed. A stroke has the later strength.
    fn join(&mut self) {
        self.lines_in_order();
        let mut place = 0;
        while place < self.lines.len() {
            let next = (place + 1..self.lines.len()).find(|&next| {
                let (line, other) = (&self.lines[place], &self.lines[next]);
                let is_one = match (&line.kind, &other.kind) {
                    (Kind::Hands(a, phase, _), Kind::Hands(b, other, _)) => a == b && phase == other,
                    _ => false,
                };
                is_one && is_same(span(line)[1], other.at) && (self.is_changed[place] || self.is_changed[next])
            });
            match next {
                Some(next) => {
                    let other = self.lines.remove(next);
                    self.is_changed.remove(next);
                    (self.lines[place].to, self.lines[place].kind) = (other.to, other.kind);
                    self.is_changed[place] = true;
                }
                None => place += 1,
            }
        }
    }

    fn lines_in_order(&mut self) {
        let mut all: Vec<_> = self.lines.drain(..).zip(self.is_changed.drain(..)).collect();
        all.sort_by(|(a, _), (b, _)| a.order(b));
        (self.lines, self.is_changed) = all.into_iter().unzip();
    }
}

/// A word and its time.
#[derive(Clone, Debug, PartialEq)]
struct Word {
    text: String,
    time: [f64; 2],
}

/// The words of a score, in order. A line of several is divided by their letters.
fn words(lines: &[Line]) -> Vec<Word> {
    let mut words = Vec::new();
    for line in lines {
        let (Kind::Words(text), [start, end]) = (&line.kind, span(line)) else { continue };
        let letters = |word: &str| word.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect();
        let said: Vec<String> = text.split_whitespace().map(letters).filter(|word: &String| !word.is_empty()).collect();
        let all = said.iter().map(String::len).sum::<usize>() as f64;
        let mut before = 0;
        for text in said {
            let after = before + text.len();
            let time = [before, after].map(|count| start + (end - start) * count as f64 / all);
            words.push(Word { text, time });
            before = after;
        }
    }
    words.sort_by(|a, b| a.time[0].total_cmp(&b.time[0]));
    words
}

/// Pairs of places of a longest common subsequence.
fn common(old: &[Word], new: &[Word]) -> Vec<(usize, usize)> {
    // Lengths of the longest from each pair of places on.
    let mut longest = vec![vec![0_u32; new.len() + 1]; old.len() + 1];
    for (i, a) in old.iter().enumerate().rev() {
        for (j, b) in new.iter().enumerate().rev() {
            longest[i][j] = match a.text == b.text {
                true => longest[i + 1][j + 1] + 1,
                false => longest[i + 1][j].max(longest[i][j + 1]),
            };
        }
    }
    let (mut pairs, mut i, mut j) = (Vec::new(), 0, 0);
    while i < old.len() && j < new.len() {
        if old[i].text == new[j].text {
            pairs.push((i, j));
            (i, j) = (i + 1, j + 1);
        } else if longest[i + 1][j] >= longest[i][j + 1] {
            i += 1;
        } else {
            j += 1;
        }
    }
    pairs
}

/// Where the times of the old motion are in the new one.
#[derive(Debug)]
struct Times {
    /// Old and new times that belong together, both ascending. Lines lie between; outside is the shift of the nearest.
    pairs: Vec<[f64; 2]>,
    /// Old words, and whether each is said in the new motion.
    words: Vec<(Word, bool)>,
    /// Length of the new motion.
    seconds: f64,
    /// Why no time is known, if so.
    unknown: Option<String>,
}

impl Times {
    fn new(old: Own, new: Own) -> Self {
        let (before, after) = (words(old.lines), words(new.lines));
        let common = common(&before, &after);
        let is_other = (old.seconds - new.seconds).abs() >= SAME_LENGTH * old.seconds;
        let unknown = if before.is_empty() || after.is_empty() {
            let lengths = format!("the motion had {:.1} s and has {:.1} s", old.seconds, new.seconds);
            is_other.then(|| format!("without words its time is not known, as {lengths}"))
        } else {
            common.is_empty().then(|| "none of the words is said any more".to_owned())
        };
        let mut pairs: Vec<[f64; 2]> = Vec::new();
        for (from, to) in common.iter().flat_map(|&(i, j)| before[i].time.into_iter().zip(after[j].time)) {
            if pairs.last().is_none_or(|&[old, new]| old < from && new <= to) {
                pairs.push([from, to]);
            }
        }
        // Where the new motion has no words, none is lost.
        let is_said = |place| after.is_empty() || common.iter().any(|&(old, _)| old == place);
        let words = before.into_iter().enumerate().map(|(place, word)| (word, is_said(place))).collect();
        Self { pairs, words, seconds: new.seconds, unknown }
    }

    /// The new time of a span, or the reason why it has none.
    fn of(&self, [from, to]: [f64; 2]) -> Result<[f64; 2], String> {
        if let Some(why) = &self.unknown {
            return Err(why.clone());
        }
        let is_around = |word: &Word| word.time[0] < to.max(from + SAME) && from < word.time[1];
        let mut around = self.words.iter().filter(|(word, _)| is_around(word));
        if let Some((Word { text, .. }, _)) = around.clone().next()
            && around.all(|(_, is_said)| !is_said)
        {
            return Err(format!("`{text}` is not said any more"));
        }
        let [at, end] = [from, to].map(|time| self.moved(time));
        if at >= self.seconds || end < 0.0 {
            return Err(format!("the motion ends at {:.1} s", self.seconds));
        }
        Ok([at.max(0.0), end.min(self.seconds)])
    }

    /// The new time of an old one. The start stays.
    fn moved(&self, time: f64) -> f64 {
        let after = self.pairs.partition_point(|&[old, _]| old <= time);
        match (after.checked_sub(1).map(|before| self.pairs[before]), self.pairs.get(after)) {
            _ if time < SAME => 0.0,
            (Some([a, x]), Some([b, y])) => x + (y - x) * (time - a) / (b - a),
            (Some([old, new]), None) | (None, Some(&[old, new])) => time + new - old,
            (None, None) => time,
        }
    }
}

#[cfg(test)]
mod tests {
    use umo_core::{GestureOptions, Mood};

    use super::*;

    fn said(at: f64, to: f64, text: &str) -> Line {
        Line::span(at, to, Kind::Words(text.to_owned()))
    }

    fn hands(at: f64, to: f64, hands: Hands, phase: Phase) -> Line {
        Line::span(at, to, Kind::Hands(hands, phase, (phase == Phase::Stroke).then_some(0.5)))
    }

    fn stroke(at: f64, to: f64, strength: f32) -> Line {
        Line::span(at, to, Kind::Hands(Hands::Right, Phase::Stroke, Some(strength)))
    }

    fn gesture(at: f64, name: &str) -> Line {
        Line::at(at, Kind::Gesture(name.to_owned(), GestureOptions::default()))
    }

    const STEP: f64 = 0.2;

    fn own(lines: &[Line], seconds: f64) -> Own<'_> {
        Own { lines, seconds }
    }

    fn texts(lines: &[Line]) -> Vec<String> {
        lines.iter().map(Line::text).collect()
    }

    fn all(_: &[Line]) -> Result<(), String> {
        Ok(())
    }

    #[test]
    fn times_move_with_the_words_around_them() {
        let old = [said(1.0, 2.0, "one two"), said(3.0, 4.0, "Three,"), said(5.0, 6.0, "five")];
        let new = [said(0.5, 1.5, "One"), said(1.5, 2.0, "two!"), said(2.5, 3.0, "and"), said(4.0, 6.0, "three")];
        let times = Times::new(own(&old, 8.0), own(&new, 7.0));
        // Before the first word, within words, between them, after the last that is said.
        for (from, to) in [(0.75, 0.25), (1.25, 1.0), (1.5, 1.5), (2.5, 3.0), (3.5, 5.0), (4.5, 6.5), (0.0, 0.0)] {
            assert!((times.moved(from) - to).abs() < 1e-9, "{from}: {}", times.moved(from));
        }
        let [at, to] = times.of([3.5, 5.2]).unwrap();
        assert!((at - 5.0).abs() < 1e-9 && (to - 7.0).abs() < 1e-9);
        assert_eq!(times.of([5.2, 5.4]).unwrap_err(), "`five` is not said any more");
        assert!(times.of([6.5, 6.5]).unwrap_err().contains("ends at 7.0 s"));
    }

    #[test]
    fn repeated_words_are_matched_in_order() {
        let old = [said(0.0, 1.0, "no"), said(1.0, 2.0, "no"), said(2.0, 3.0, "yes"), said(3.0, 4.0, "no")];
        let new = [said(0.0, 1.0, "no"), said(1.0, 2.0, "yes"), said(2.0, 3.0, "no")];
        let pairs = common(&words(&old), &words(&new));
        assert!(pairs.len() == 3 && pairs.windows(2).all(|two| two[0].0 < two[1].0 && two[0].1 < two[1].1));
        assert_eq!(pairs[1..], [(2, 1), (3, 2)]);
    }

    #[test]
    fn without_words_times_stay_if_the_lengths_agree() {
        let nod = [gesture(2.0, "nod")];
        let (kept, report) = carry(own(&[], 10.0), &nod, (own(&[], 10.4), STEP), all);
        assert_eq!((&kept[..], &*report[0]), (&nod[..], "added gesture `nod`: kept at 2.0 s"));
        let (kept, report) = carry(own(&[], 10.0), &nod, (own(&[], 10.6), STEP), all);
        assert!(kept.is_empty() && report[0].contains("dropped") && report[0].contains("10.6 s"), "{report:?}");
        // The same where one of them has words; but words that have nothing in common say nothing.
        let old = [said(0.0, 3.0, "hello")];
        let edited = [&old[..], &nod].concat();
        assert_eq!(carry(own(&old, 10.0), &edited, (own(&[], 10.4), STEP), all).0, nod);
        let new = [said(0.0, 3.0, "goodbye")];
        let (kept, report) = carry(own(&old, 10.0), &edited, (own(&new, 10.0), STEP), all);
        assert!(kept == new && report[0].contains("none of the words"), "{report:?}");
    }

    #[test]
    fn requests_keep_what_was_changed_of_them() {
        let mood = |at, strength| Line::at(at, Kind::Mood(Mood::Joy, strength));
        let look = |at, strength| Line::at(at, Kind::Look([0.0, 1.6, 2.0], strength));
        let old = [said(1.0, 2.0, "hello"), mood(0.0, 0.5), gesture(1.2, "wave"), look(3.0, 1.0), gesture(7.0, "nod")];
        // A strength, a time, a line gone, a line more, and a change of what the new motion has not.
        let edited =
            [said(1.0, 2.0, "hello"), mood(0.0, 0.9), gesture(1.5, "wave"), gesture(4.0, "point"), gesture(7.5, "nod")];
        let new = [mood(0.0, 0.5), said(2.0, 3.0, "Hello."), gesture(2.3, "wave"), look(4.1, 1.0), gesture(9.0, "nod")];
        let (kept, report) = carry(own(&old, 10.0), &edited, (own(&new, 11.0), STEP), all);
        let want = [
            mood(0.0, 0.9),
            said(2.0, 3.0, "Hello."),
            gesture(2.5, "wave"),
            gesture(5.0, "point"),
            gesture(9.0, "nod"),
        ];
        assert_eq!(texts(&kept), texts(&want));
        let lines: Vec<&str> = report.iter().map(String::as_str).collect();
        let want = [
            "changed mood `joy`: kept at 0.0 s",
            "changed gesture `wave`: kept at 2.5 s (was 1.5 s)",
            "removed look: kept at 4.1 s (was 3.0 s)",
            "added gesture `point`: kept at 5.0 s (was 4.0 s)",
            "changed gesture `nod`: dropped (was at 7.5 s): there is nothing like it at 8.0 s",
        ];
        assert_eq!(lines, want);
    }

    /// Everything beside stays the new motion's.
    #[test]
    fn hands_do_what_was_wanted_of_them_where_it_was_wanted() {
        use {Hands::*, Phase::*};
        let old = [
            hands(0.0, 1.0, Both, Rest),
            hands(1.0, 1.4, Right, Prepare),
            stroke(1.4, 1.8, 0.5),
            hands(1.8, 2.2, Right, Retract),
            hands(2.2, 8.0, Both, Rest),
            said(1.2, 2.2, "hello there"),
        ];
        // The stroke is stronger, and there is another one.
        let edited = [
            hands(0.0, 1.0, Both, Rest),
            hands(1.0, 1.4, Right, Prepare),
            stroke(1.4, 1.8, 1.0),
            hands(1.8, 2.2, Right, Retract),
            hands(2.2, 4.0, Both, Rest),
            hands(4.0, 4.4, Left, Stroke),
            hands(4.4, 8.0, Both, Rest),
            said(1.2, 2.2, "hello there"),
        ];
        let new = [
            hands(0.0, 2.0, Both, Rest),
            hands(2.0, 2.4, Right, Prepare),
            stroke(2.4, 3.0, 0.5),
            hands(3.0, 4.8, Right, Retract),
            hands(4.8, 5.2, Both, Hold),
            hands(5.2, 9.0, Both, Rest),
            said(2.25, 3.25, "Hello there!"),
        ];
        let (kept, report) = carry(own(&old, 8.0), &edited, (own(&new, 9.0), STEP), all);
        let want = [
            hands(0.0, 2.0, Both, Rest),
            hands(2.0, 2.4, Right, Prepare),
            said(2.25, 3.25, "Hello there!"),
            stroke(2.4, 3.0, 1.0),
            hands(3.0, 4.8, Right, Retract),
            hands(4.8, 5.0, Both, Hold),
            hands(5.0, 5.4, Left, Stroke),
            hands(5.0, 5.2, Right, Hold),
            hands(5.2, 5.4, Right, Rest),
            hands(5.4, 9.0, Both, Rest),
        ];
        assert_eq!(texts(&kept), texts(&want));
        assert_eq!(report, ["right stroke: kept at 2.4 s (was 1.4 s)", "left stroke: kept at 5.0 s (was 4.0 s)"]);

        // Without the stroke, and its way there and back.
        let edited = [hands(0.0, 8.0, Both, Rest), said(1.2, 2.2, "hello there")];
        let (kept, report) = carry(own(&old, 8.0), &edited, (own(&new, 9.0), STEP), all);
        assert_eq!(report, ["right rest: kept at 2.0 s (was 1.0 s)"]);
        let strokes = kept.iter().filter(|line| phase(line).0 == Stroke).count();
        assert!(strokes == 0 && texts(&kept).contains(&hands(3.2, 4.8, Right, Retract).text()), "{:?}", texts(&kept));
    }

    #[test]
    fn what_is_refused_is_dropped_and_the_rest_is_kept() {
        let edited = [gesture(1.0, "nod"), gesture(2.0, "bob"), gesture(3.0, "wave")];
        let (kept, report) = carry(own(&[], 5.0), &edited, (own(&[], 5.0), STEP), |lines| {
            let is_known = |line: &Line| !line.text().contains("bob");
            if lines.iter().all(is_known) { Ok(()) } else { Err("unknown".to_owned()) }
        });
        assert_eq!(texts(&kept), texts(&[gesture(1.0, "nod"), gesture(3.0, "wave")]));
        assert_eq!(report[1], "added gesture `bob`: dropped (was at 2.0 s): unknown");
    }

    #[test]
    fn a_score_without_changes_is_the_new_motions_own() {
        let old = [said(0.0, 1.0, "a"), hands(1.0, 2.0, Hands::Both, Phase::Rest)];
        let new = [said(0.5, 1.0, "b"), hands(1.5, 2.0, Hands::Left, Phase::Hold)];
        assert_eq!(carry(own(&old, 3.0), &old, (own(&new, 9.0), STEP), all), (new.to_vec(), Vec::new()));
    }
}
