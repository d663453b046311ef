//! A score out of TOML.

use std::path::Path;

use serde::Deserialize;
use toml::Spanned;
use umo_core::{Attention, GestureOptions, Layer, LipShape, Mood, Side};

use super::Score;
use super::line::{ATTENTIONS, Hands, Kind, Line, Phase, SIDES};
use crate::failure::Failure;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    version: Spanned<u32>,
    #[serde(rename = "seconds")]
    _seconds: Option<f64>,
    events: Vec<Spanned<Entry>>,
}

/// The fields of all kinds of events.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    at: f64,
    to: Option<f64>,
    left: Option<String>,
    right: Option<String>,
    both: Option<String>,
    strength: Option<f32>,
    words: Option<String>,
    gesture: Option<String>,
    side: Option<String>,
    speed: Option<f32>,
    variant: Option<u8>,
    target: Option<[f32; 3]>,
    look: Option<[f32; 3]>,
    mood: Option<String>,
    expression: Option<f32>,
    lips: Option<String>,
    attention: Option<String>,
    layer: Option<String>,
    gain: Option<f32>,
}

/// Reads a score's file.
pub(super) fn open(path: &Path) -> Result<Score, Failure> {
    let bytes =
        umo_core_base::file::read(path).map_err(|error| Failure::Input(format!("{}: {error}", path.display())))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| Failure::Input(format!("{}: not UTF-8: save it as UTF-8", path.display())))?;
    parse(path, &text)
}

/// Reads a score; `path` is for messages.
pub(super) fn parse(path: &Path, text: &str) -> Result<Score, Failure> {
    let line_of = |at: usize| 1 + text.as_bytes()[..at.min(text.len())].iter().filter(|&&byte| byte == b'\n').count();
    let wrong = |line: usize, problem: &str| Failure::Input(format!("{}:{line}: {problem}", path.display()));
    let file: File = toml::from_str(text)
        .map_err(|error| wrong(error.span().map_or(1, |span| line_of(span.start)), error.message()))?;
    if *file.version.get_ref() != 1 {
        let problem = format!("version {}; this program knows 1: use a later umo", file.version.get_ref());
        return Err(wrong(line_of(file.version.span().start), &problem));
    }
    let mut lines = Vec::with_capacity(file.events.len());
    for entry in file.events {
        let number = line_of(entry.span().start);
        lines.push((number, line(entry.into_inner()).map_err(|problem| wrong(number, &problem))?));
    }
    Ok(Score { path: path.to_owned(), lines })
}

/// The event of an entry, or what is wrong with it.
fn line(entry: Entry) -> Result<Line, String> {
    let Entry { at, to, left, right, both, strength, words, gesture, side, speed, variant, target, .. } = entry;
    let Entry { look, mood, expression, lips, attention, layer, gain, .. } = entry;
    let hands = [left, right, both];
    let given = [&words, &gesture, &mood, &lips, &attention, &layer].iter().filter(|it| it.is_some()).count()
        + hands.iter().filter(|it| it.is_some()).count()
        + usize::from(look.is_some())
        + usize::from(expression.is_some());
    if given != 1 {
        return Err("an event says one thing: words, left, right, both, gesture, lips, look, mood, expression, \
                    attention or layer"
            .to_owned());
    }
    if !(at.is_finite() && at >= 0.0) {
        return Err(format!("at = {at}: expected a time from 0 on"));
    }
    let is_span = words.is_some() || lips.is_some() || hands.iter().any(Option::is_some);
    match to {
        Some(to) if !is_span => return Err(format!("to = {to}: this event has a time, and no duration")),
        None if is_span => return Err("`to` is missing: when it ends".to_owned()),
        Some(to) if !(to.is_finite() && to > at) => {
            return Err(format!("to = {to}: it ends before it begins, at {at}"));
        }
        _ => {}
    }
    // Fields of other kinds of events are refused.
    let is_gesture = gesture.is_some();
    let others = side.is_some() || speed.is_some() || variant.is_some() || target.is_some();
    if others && !is_gesture {
        return Err("side, speed, variant and target are a gesture's".to_owned());
    }
    if gain.is_some() && layer.is_none() {
        return Err("gain is a layer's".to_owned());
    }
    let share = |name: &str, value: Option<f32>| match value {
        Some(value) if !(0.0..=1.0).contains(&value) => Err(format!("{name} = {value}: expected 0 to 1")),
        value => Ok(value),
    };
    let strength = share("strength", strength)?;
    let mut takes_strength = is_gesture || look.is_some() || mood.is_some();
    let kind = if let Some(text) = words {
        Kind::Words(text)
    } else if let Some((hands, phase)) = Hands::ALL.into_iter().zip(hands).find_map(|(it, phase)| Some((it, phase?))) {
        let phase = one("phase", &phase, &Phase::ALL, Phase::name)?;
        takes_strength = phase == Phase::Stroke;
        Kind::Hands(hands, phase, strength)
    } else if let Some(name) = gesture {
        let side = side.map(|side| one("side", &side, &Side::ALL, |side| SIDES[side as usize])).transpose()?;
        let options = GestureOptions {
            speed: speed.unwrap_or(1.0),
            strength: strength.unwrap_or(1.0),
            side: side.unwrap_or_default(),
            target,
            variant: variant.unwrap_or_default(),
            ..GestureOptions::default()
        };
        Kind::Gesture(name, options)
    } else if let Some(shape) = lips {
        Kind::Lips(one("lips", &shape, &LipShape::ALL, LipShape::name)?)
    } else if let Some(point) = look {
        Kind::Look(point, strength.unwrap_or(1.0))
    } else if let Some(mood) = mood {
        Kind::Mood(one("mood", &mood, &Mood::ALL, Mood::name)?, strength.unwrap_or(1.0))
    } else if let Some(expression) = share("expression", expression)? {
        Kind::Expression(expression)
    } else if let Some(name) = attention {
        Kind::Attention(one("attention", &name, &Attention::ALL, |it| ATTENTIONS[it as usize])?)
    } else {
        let layer = one("layer", &layer.unwrap_or_default(), &Layer::ALL, Layer::name)?;
        Kind::Layer(layer, share("gain", gain)?.unwrap_or(1.0))
    };
    match strength {
        Some(_) if !takes_strength => Err("strength is a stroke's, a gesture's, a look's or a mood's".to_owned()),
        _ => Ok(Line { at, to, kind }),
    }
}

/// One of `all` by its name.
fn one<T: Copy>(what: &str, name: &str, all: &[T], name_of: impl Fn(T) -> &'static str) -> Result<T, String> {
    let known = || all.iter().map(|&it| name_of(it)).collect::<Vec<_>>().join(", ");
    all.iter().copied().find(|&it| name_of(it) == name).ok_or_else(|| format!("{what} `{name}`; known: {}", known()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(events: &str) -> String {
        let text = format!("version = 1\nevents = [\n{events}\n]\n");
        parse("x.toml".as_ref(), &text).unwrap_err().to_string()
    }

    #[test]
    fn what_was_written_is_read() {
        let text = "# A comment\nversion = 1\nseconds = 20\nevents = [\n    { at = 0, to = 0.6, both = \"rest\" },\n\n    \
                    { at = 7.2, gesture = \"there\", side = \"right\" },\n]\n";
        let score = parse("x.toml".as_ref(), text).unwrap();
        let lines: Vec<_> = score.lines.iter().map(|(number, line)| (*number, line.text())).collect();
        assert_eq!(lines[0], (5, "{ at = 0, to = 0.6, both = \"rest\" }".to_owned()));
        assert_eq!(lines[1], (7, "{ at = 7.2, gesture = \"there\", side = \"right\" }".to_owned()));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        for (events, want) in [
            (
                "{ at = 0, to = 1, right = \"wave\" }",
                "x.toml:3: phase `wave`; known: rest, prepare, stroke, hold, retract",
            ),
            ("{ at = 0, to = 1 }", "x.toml:3: an event says one thing"),
            ("{ at = 0, to = 1, left = \"rest\", words = \"a\" }", "x.toml:3: an event says one thing"),
            ("\n{ at = 1, to = 1, left = \"rest\" }", "x.toml:4: to = 1: it ends before"),
            ("{ at = 1, left = \"rest\" }", "x.toml:3: `to` is missing"),
            ("{ at = 1, to = 2, gesture = \"wave\" }", "x.toml:3: to = 2: this event has a time"),
            ("{ at = -1, gesture = \"wave\" }", "x.toml:3: at = -1: expected"),
            ("{ at = nan, gesture = \"wave\" }", "x.toml:3: at = NaN: expected"),
            ("{ at = 0, mood = \"joy\", strength = 2 }", "x.toml:3: strength = 2: expected 0 to 1"),
            ("{ at = 0, to = 1, left = \"hold\", strength = 1 }", "x.toml:3: strength is a stroke's"),
            ("{ at = 0, expression = 1, strength = 1 }", "x.toml:3: strength is a stroke's"),
            ("{ at = 0, mood = \"joy\", side = \"left\" }", "x.toml:3: side, speed, variant and target are"),
            ("{ at = 0, mood = \"joy\", gain = 1 }", "x.toml:3: gain is a layer's"),
            ("{ at = 0, moood = \"joy\" }", "x.toml:3: unknown field `moood`"),
            ("{ at = 0, mood = \"joy\"", "x.toml:"),
        ] {
            let got = problem(events);
            assert!(got.starts_with(want), "{events}: {got}");
        }
        let later = parse("x.toml".as_ref(), "version = 2\nevents = []\n").unwrap_err().to_string();
        assert_eq!(later, "x.toml:1: version 2; this program knows 1: use a later umo");
    }
}
