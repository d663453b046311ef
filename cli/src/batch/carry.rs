//! Edits of a score on a motion that was made anew: they move with the words.
//!
//! ```text
//! own score of the old take ─┬─ edits ─► moved by the words' times ─► own score of the new take, edited
//! score as it was edited ────┘
//! ```

use std::fmt;

/// Times that count as the same, seconds.
const SAME: f64 = 5e-4;
/// How far an entry may be from the time at which it is looked for, seconds.
const NEAR: f64 = 0.25;
/// Longest pause between the two forms of a changed entry, seconds.
const CHANGED: f64 = 1.0;
/// Motions without common words have the same times if their lengths differ by less than this share.
const SAME_LENGTH: f64 = 0.05;

/// A line of a score.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    /// Start and end, seconds; of a moment both are the same.
    pub(super) time: [f64; 2],
    /// What it is, as reports name it: entries of one kind can stand for each other.
    pub(super) kind: String,
    /// Everything else that it says.
    pub(super) rest: String,
    /// Words that are said, if it is about them.
    pub(super) words: Option<String>,
}

impl Entry {
    fn is(&self, other: &Self) -> bool {
        let is_same_time = (0..2).all(|end| is_same(self.time[end], other.time[end]));
        self.kind == other.kind && self.rest == other.rest && self.words == other.words && is_same_time
    }

    /// Seconds between this entry and a time; 0 where they overlap.
    fn distance(&self, [at, to]: [f64; 2]) -> f64 {
        (at - self.time[1]).max(self.time[0] - to).max(0.0)
    }

    /// Place, among the entries, of the one of the same kind that is nearest to a time.
    fn nearest<'a>(
        &self,
        entries: impl Iterator<Item = (usize, &'a Self)>,
        time: [f64; 2],
        most: f64,
    ) -> Option<usize> {
        let away = |entry: &Self| (entry.time[0] - time[0]).abs() + (entry.time[1] - time[1]).abs();
        entries
            .filter(|(_, entry)| entry.kind == self.kind && entry.distance(time) < most)
            .min_by(|(_, a), (_, b)| away(a).total_cmp(&away(b)))
            .map(|(place, _)| place)
    }
}

fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() < SAME
}

/// A motion's own score, and its length in seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Score<'a> {
    pub(super) entries: &'a [Entry],
    pub(super) seconds: f64,
}

/// Returns the new score with the edits that `edited` has of the old one, and what happened to each edit.
pub(super) fn carry(old: Score, edited: &[Entry], new: Score) -> (Vec<Entry>, Vec<String>) {
    let times = Times::new(old, new);
    let mut entries: Vec<(Entry, bool)> = new.entries.iter().map(|entry| (entry.clone(), false)).collect();
    let told = |edit: Edit| match apply(&edit, &times, &mut entries) {
        Ok(at) if is_same(at, edit.at()) => format!("{edit}: kept at {at:.2} s"),
        Ok(at) => format!("{edit}: kept at {at:.2} s (was {:.2} s)", edit.at()),
        Err(why) => format!("{edit}: dropped (was at {:.2} s): {why}", edit.at()),
    };
    let report = edits(old.entries, edited).into_iter().map(told).collect();
    let mut entries: Vec<Entry> = entries.into_iter().map(|(entry, _)| entry).collect();
    entries.sort_by(|a, b| a.time[0].total_cmp(&b.time[0]));
    (entries, report)
}

/// A difference between a motion's own score and the edited one.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Edit<'a> {
    Added(&'a Entry),
    Removed(&'a Entry),
    Changed(&'a Entry, &'a Entry),
}

impl fmt::Display for Edit<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Added(entry) => write!(f, "added {}", entry.kind),
            Self::Removed(entry) => write!(f, "removed {}", entry.kind),
            Self::Changed(_, entry) => write!(f, "changed {}", entry.kind),
        }
    }
}

impl Edit<'_> {
    fn at(&self) -> f64 {
        let (Self::Added(entry) | Self::Removed(entry) | Self::Changed(_, entry)) = self;
        entry.time[0]
    }
}

/// The differences, by time.
fn edits<'a>(own: &'a [Entry], edited: &'a [Entry]) -> Vec<Edit<'a>> {
    let mut there: Vec<&Entry> = edited.iter().collect();
    let mut gone: Vec<&Entry> = Vec::new();
    for entry in own {
        match there.iter().position(|other| other.is(entry)) {
            Some(place) => drop(there.remove(place)),
            None => gone.push(entry),
        }
    }
    let mut edits = Vec::new();
    for entry in gone {
        let others = there.iter().copied().enumerate();
        edits.push(match entry.nearest(others, entry.time, CHANGED) {
            Some(place) => Edit::Changed(entry, there.remove(place)),
            None => Edit::Removed(entry),
        });
    }
    edits.extend(there.into_iter().map(Edit::Added));
    edits.sort_by(|a, b| a.at().total_cmp(&b.at()));
    edits
}

/// Makes an edit among the new motion's entries, of which the marked ones were edited. Returns its time, or why it
/// cannot be made.
fn apply(edit: &Edit, times: &Times, entries: &mut Vec<(Entry, bool)>) -> Result<f64, String> {
    let find = |entry: &Entry, entries: &[(Entry, bool)]| -> Result<usize, String> {
        let time = times.of(entry.time)?;
        let own = entries.iter().enumerate().filter(|(_, (_, is_edited))| !is_edited);
        let found = entry.nearest(own.map(|(place, (entry, _))| (place, entry)), time, NEAR);
        found.ok_or_else(|| format!("the motion has nothing of this kind at {:.2} s", time[0]))
    };
    match *edit {
        Edit::Added(entry) => {
            let time = times.of(entry.time)?;
            entries.push((Entry { time, ..entry.clone() }, true));
            Ok(time[0])
        }
        Edit::Removed(entry) => {
            let place = find(entry, entries)?;
            Ok(entries.remove(place).0.time[0])
        }
        Edit::Changed(from, to) => {
            let place = find(from, entries)?;
            let moved = times.of(to.time)?;
            let (entry, is_edited) = &mut entries[place];
            // What was not edited stays the new motion's.
            let mut time = entry.time;
            for end in (0..2).filter(|&end| !is_same(from.time[end], to.time[end])) {
                time[end] = moved[end];
            }
            entry.time = if time[0] <= time[1] { time } else { moved };
            if from.rest != to.rest {
                entry.rest.clone_from(&to.rest);
            }
            if from.words != to.words {
                entry.words.clone_from(&to.words);
            }
            *is_edited = true;
            Ok(entry.time[0])
        }
    }
}

/// A word and its time.
#[derive(Clone, Debug, PartialEq)]
struct Word {
    text: String,
    time: [f64; 2],
}

/// The words of a score, in order. A line of several is divided by their letters.
fn words(entries: &[Entry]) -> Vec<Word> {
    let mut words = Vec::new();
    for Entry { words: text, time: [start, end], .. } in entries {
        let Some(text) = text else { continue };
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
    fn new(old: Score, new: Score) -> Self {
        let (before, after) = (words(old.entries), words(new.entries));
        let common = common(&before, &after);
        let is_long = (old.seconds - new.seconds).abs() >= SAME_LENGTH * old.seconds;
        let unknown = if before.is_empty() || after.is_empty() {
            let lengths = format!("its length was {:.1} s and is {:.1} s", old.seconds, new.seconds);
            is_long.then(|| format!("without words its time is not known, as {lengths}"))
        } else {
            common.is_empty().then(|| "none of the words is said any more".to_owned())
        };
        let mut pairs: Vec<[f64; 2]> = Vec::new();
        for (from, to) in common.iter().flat_map(|&(i, j)| before[i].time.into_iter().zip(after[j].time)) {
            if pairs.last().is_none_or(|&[old, new]| old < from && new <= to) {
                pairs.push([from, to]);
            }
        }
        // Without words of the new motion nothing is lost.
        let is_said = |place| after.is_empty() || common.iter().any(|&(old, _)| old == place);
        let words = before.into_iter().enumerate().map(|(place, word)| (word, is_said(place))).collect();
        Self { pairs, words, seconds: new.seconds, unknown }
    }

    /// The new time of something; or why there is none.
    fn of(&self, time: [f64; 2]) -> Result<[f64; 2], String> {
        if let Some(why) = &self.unknown {
            return Err(why.clone());
        }
        let [from, to] = time;
        let mut around =
            self.words.iter().filter(|(word, _)| word.time[0] < to.max(from + SAME) && from < word.time[1]);
        if let Some((Word { text, .. }, false)) = around.clone().next()
            && around.all(|(_, is_said)| !is_said)
        {
            return Err(format!("`{text}` is not said any more"));
        }
        let [at, end] = time.map(|time| self.moved(time));
        if at >= self.seconds || end < 0.0 {
            return Err(format!("the motion ends at {:.2} s", self.seconds));
        }
        Ok([at.max(0.0), end.min(self.seconds)])
    }

    fn moved(&self, time: f64) -> f64 {
        let after = self.pairs.partition_point(|&[old, _]| old <= time);
        match (after.checked_sub(1).map(|before| self.pairs[before]), self.pairs.get(after)) {
            (Some([a, x]), Some([b, y])) => x + (y - x) * (time - a) / (b - a),
            (Some([old, new]), None) | (None, Some(&[old, new])) => time + new - old,
            (None, None) => time,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(at: f64, to: f64, kind: &str, rest: &str) -> Entry {
        Entry { time: [at, to], kind: kind.to_owned(), rest: rest.to_owned(), words: None }
    }

    fn said(at: f64, to: f64, text: &str) -> Entry {
        Entry { words: Some(text.to_owned()), ..entry(at, to, "words", "") }
    }

    fn score(entries: &[Entry], seconds: f64) -> Score<'_> {
        Score { entries, seconds }
    }

    fn close(a: [f64; 2], b: [f64; 2]) -> bool {
        (0..2).all(|end| (a[end] - b[end]).abs() < 1e-9)
    }

    #[test]
    fn times_move_with_the_words_around_them() {
        let old = [said(1.0, 2.0, "one two"), said(3.0, 4.0, "Three,"), said(5.0, 6.0, "five")];
        let new = [said(0.5, 1.5, "One"), said(1.5, 2.0, "two!"), said(2.5, 3.0, "and"), said(4.0, 6.0, "three")];
        let times = Times::new(score(&old, 8.0), score(&new, 7.0));
        // Before the first word, within words, between them, after the last that is said.
        for (from, to) in [(0.75, 0.25), (1.25, 1.0), (1.5, 1.5), (2.5, 3.0), (3.5, 5.0), (4.5, 6.5)] {
            assert!((times.moved(from) - to).abs() < 1e-9, "{from}: {}", times.moved(from));
        }
        assert!(close(times.of([0.0, 0.6]).unwrap(), [0.0, 0.1]));
        assert!(close(times.of([3.5, 5.2]).unwrap(), [5.0, 7.0]));
        assert_eq!(times.of([5.2, 5.4]).unwrap_err(), "`five` is not said any more");
        assert!(times.of([6.5, 6.5]).unwrap_err().contains("ends at 7.00 s"));
    }

    #[test]
    fn repeated_words_are_matched_in_order() {
        let old = [said(0.0, 1.0, "no"), said(1.0, 2.0, "no"), said(2.0, 3.0, "yes"), said(3.0, 4.0, "no")];
        let new = [said(0.0, 1.0, "no"), said(1.0, 2.0, "yes"), said(2.0, 3.0, "no")];
        let pairs = common(&words(&old), &words(&new));
        assert_eq!(pairs.len(), 3);
        assert!(pairs.windows(2).all(|two| two[0].0 < two[1].0 && two[0].1 < two[1].1));
        assert_eq!(pairs[1..], [(2, 1), (3, 2)]);
    }

    #[test]
    fn without_words_times_stay_if_the_lengths_agree() {
        let gesture = [entry(2.0, 2.0, "gesture", "nod")];
        let (kept, report) = carry(score(&[], 10.0), &gesture, score(&[], 10.4));
        assert_eq!((&kept[..], &*report[0]), (&gesture[..], "added gesture: kept at 2.00 s"));
        let (kept, report) = carry(score(&[], 10.0), &gesture, score(&[], 10.6));
        assert!(kept.is_empty() && report[0].contains("dropped") && report[0].contains("10.6 s"), "{report:?}");
        // The same where one of them has words; but words that have nothing in common say nothing.
        let old = [said(0.0, 3.0, "hello")];
        let edited = [&old[..], &gesture].concat();
        assert_eq!(carry(score(&old, 10.0), &edited, score(&[], 10.4)).0, gesture);
        let new = [said(0.0, 3.0, "goodbye")];
        let (kept, report) = carry(score(&old, 10.0), &edited, score(&new, 10.0));
        assert!(kept == new && report[0].contains("none of the words"), "{report:?}");
    }

    #[test]
    fn edits_are_made_on_the_new_motion() {
        let stroke = |at, to, strength| entry(at, to, "right stroke", strength);
        let old = [
            said(1.0, 2.0, "hello"),
            stroke(1.0, 1.4, "0.6"),
            stroke(4.0, 4.4, "0.3"),
            entry(5.0, 6.0, "both rest", ""),
            stroke(7.0, 7.5, "0.5"),
        ];
        // A strength, an end, a line gone, a line more, and a stroke of which the new motion has none.
        let edited = [
            said(1.0, 2.0, "hello"),
            stroke(1.0, 1.4, "1.0"),
            stroke(4.0, 4.8, "0.3"),
            entry(3.0, 3.0, "gesture", "nod"),
            stroke(7.0, 7.5, "0.9"),
        ];
        let new = [
            said(2.0, 3.0, "Hello."),
            stroke(2.1, 2.3, "0.7"),
            stroke(5.1, 5.3, "0.4"),
            entry(6.0, 7.0, "both rest", ""),
            stroke(8.9, 9.2, "0.5"),
        ];
        let (kept, report) = carry(score(&old, 10.0), &edited, score(&new, 11.0));
        let want = [
            said(2.0, 3.0, "Hello."),
            stroke(2.1, 2.3, "1.0"),
            entry(4.0, 4.0, "gesture", "nod"),
            stroke(5.1, 5.8, "0.4"),
            stroke(8.9, 9.2, "0.5"),
        ];
        assert!(kept.len() == want.len() && kept.iter().zip(&want).all(|(a, b)| a.is(b)), "{kept:?}");
        let lines: Vec<&str> = report.iter().map(String::as_str).collect();
        assert_eq!(
            lines,
            [
                "changed right stroke: kept at 2.10 s (was 1.00 s)",
                "added gesture: kept at 4.00 s (was 3.00 s)",
                "changed right stroke: kept at 5.10 s (was 4.00 s)",
                "removed both rest: kept at 6.00 s (was 5.00 s)",
                "changed right stroke: dropped (was at 7.00 s): the motion has nothing of this kind at 8.00 s",
            ]
        );
    }

    #[test]
    fn a_score_without_edits_is_the_new_motions_own() {
        let old = [said(0.0, 1.0, "a"), entry(1.0, 2.0, "both rest", "")];
        let new = [said(0.5, 1.0, "b"), entry(1.5, 2.0, "left stroke", "0.5")];
        assert_eq!(carry(score(&old, 3.0), &old, score(&new, 9.0)), (new.to_vec(), Vec::new()));
    }
}
