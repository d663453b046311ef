//! An event of a score, and its line of text.

use std::cmp::Ordering;

use umo_core::{Attention, Event, GestureOptions, Layer, LipShape, Mood, Side};

/// Something that a take does, at a time of its motion, seconds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Line {
    pub(crate) at: f64,
    /// When it ends, of what has a duration.
    pub(crate) to: Option<f64>,
    pub(crate) kind: Kind,
}

/// Hands of a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Hands {
    Left,
    Right,
    Both,
}

impl Hands {
    pub(crate) const ALL: [Self; 3] = [Self::Left, Self::Right, Self::Both];

    pub(crate) const fn name(self) -> &'static str {
        ["left", "right", "both"][self as usize]
    }

    /// Whether they share a hand.
    pub(crate) fn meet(self, other: Self) -> bool {
        self == other || self == Self::Both || other == Self::Both
    }
}

/// Phase of a gesture (SPEC 2.12).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Phase {
    Rest,
    Prepare,
    Stroke,
    Hold,
    Retract,
}

impl Phase {
    pub(crate) const ALL: [Self; 5] = [Self::Rest, Self::Prepare, Self::Stroke, Self::Hold, Self::Retract];

    pub(crate) const fn name(self) -> &'static str {
        ["rest", "prepare", "stroke", "hold", "retract"][self as usize]
    }
}

/// Kind of an event.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Kind {
    Words(String),
    /// With the strength of a stroke, 0 to 1.
    Hands(Hands, Phase, Option<f32>),
    Gesture(String, GestureOptions),
    Lips(LipShape),
    Look([f32; 3], f32),
    Mood(Mood, f32),
    Expression(f32),
    Attention(Attention),
    Layer(Layer, f32),
}

/// Names of the kinds of attention, in numeric order.
pub(super) const ATTENTIONS: [&str; Attention::ALL.len()] = ["auto", "idle", "listening", "thinking", "speaking"];
/// Names of the sides of a gesture, in numeric order.
pub(super) const SIDES: [&str; Side::ALL.len()] = ["auto", "left", "right", "both"];

impl Kind {
    fn rank(&self) -> usize {
        match self {
            Self::Words(_) => 0,
            Self::Hands(hands, ..) => 1 + *hands as usize,
            Self::Gesture(..) => 4,
            Self::Lips(_) => 5,
            Self::Look(..) => 6,
            Self::Mood(..) => 7,
            Self::Expression(_) => 8,
            Self::Attention(_) => 9,
            Self::Layer(..) => 10,
        }
    }
}

impl Line {
    pub(crate) fn at(at: f64, kind: Kind) -> Self {
        Self { at, to: None, kind }
    }

    pub(crate) fn span(at: f64, to: f64, kind: Kind) -> Self {
        Self { at, to: Some(to), kind }
    }

    /// The line of a request that was made at `at`; `None` for what says how codes are drawn.
    pub(super) fn of(at: f64, event: &Event) -> Option<Self> {
        Some(match *event {
            Event::Words { text, start, end } => Self::span(start, end, Kind::Words(text.to_owned())),
            Event::Gesture { name, options } => {
                let untimed = GestureOptions { at: None, ..options };
                Self::at(options.at.unwrap_or(at), Kind::Gesture(name.to_owned(), untimed))
            }
            Event::Lips { shape, start, duration } => Self::span(start, start + duration, Kind::Lips(shape)),
            Event::Mood { mood, strength } => Self::at(at, Kind::Mood(mood, strength)),
            Event::Look { point, strength } => Self::at(at, Kind::Look(point, strength)),
            Event::Attention(attention) => Self::at(at, Kind::Attention(attention)),
            Event::Layer { layer, gain } => Self::at(at, Kind::Layer(layer, gain)),
            Event::Expression(expression) => Self::at(at, Kind::Expression(expression)),
            _ => return None,
        })
    }

    /// Order in a score: by time, kind, and text.
    pub(super) fn order(&self, other: &Self) -> Ordering {
        let milliseconds = |line: &Self| (line.at * 1000.0).round();
        let by_time = milliseconds(self).total_cmp(&milliseconds(other));
        by_time.then_with(|| self.kind.rank().cmp(&other.kind.rank())).then_with(|| self.text().cmp(&other.text()))
    }

    /// The line, as TOML's inline table.
    pub(crate) fn text(&self) -> String {
        let mut out = format!("{{ at = {}", number(self.at));
        if let Some(to) = self.to {
            out += &format!(", to = {}", number(to));
        }
        let mut field = |name: &str, value: &str| out += &format!(", {name} = {value}");
        match &self.kind {
            Kind::Words(text) => field("words", &quoted(text)),
            Kind::Hands(hands, phase, strength) => {
                field(hands.name(), &quoted(phase.name()));
                if let Some(strength) = strength {
                    field("strength", &number(f64::from(*strength)));
                }
            }
            Kind::Gesture(name, options) => {
                let GestureOptions { speed, strength, side, target, variant, .. } = *options;
                field("gesture", &quoted(name));
                if side != Side::Auto {
                    field("side", &quoted(SIDES[side as usize]));
                }
                for (name, value) in [("strength", strength), ("speed", speed)] {
                    if value.to_bits() != 1.0_f32.to_bits() {
                        field(name, &number(f64::from(value)));
                    }
                }
                if variant != 0 {
                    field("variant", &variant.to_string());
                }
                if let Some(target) = &target {
                    field("target", &place(target));
                }
            }
            Kind::Lips(shape) => field("lips", &quoted(shape.name())),
            Kind::Look(point, strength) => {
                field("look", &place(point));
                field("strength", &number(f64::from(*strength)));
            }
            Kind::Mood(mood, strength) => {
                field("mood", &quoted(mood.name()));
                field("strength", &number(f64::from(*strength)));
            }
            Kind::Expression(expression) => field("expression", &number(f64::from(*expression))),
            Kind::Attention(attention) => field("attention", &quoted(ATTENTIONS[*attention as usize])),
            Kind::Layer(layer, gain) => {
                field("layer", &quoted(layer.name()));
                field("gain", &number(f64::from(*gain)));
            }
        }
        out + " }"
    }
}

/// A score.
pub(crate) fn text(lines: &[Line], seconds: f64) -> String {
    let mut out = "# What a take does, in seconds: docs/scores.md\nversion = 1\n".to_owned();
    out += &format!("seconds = {}\nevents = [\n", number(seconds));
    for line in lines {
        out += &format!("    {},\n", line.text());
    }
    out + "]\n"
}

/// At most three decimals, without zeros at the end.
fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn place(place: &[f32; 3]) -> String {
    format!("[{}]", place.map(|value| number(f64::from(value))).join(", "))
}

/// A basic string of TOML.
fn quoted(text: &str) -> String {
    let mut out = String::from('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => out.extend(['\\', c]),
            '\n' => out += "\\n",
            '\t' => out += "\\t",
            '\r' => out += "\\r",
            c if c.is_control() => out += &format!("\\u{:04X}", c as u32),
            c => out.push(c),
        }
    }
    out + "\""
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_its_fields_in_order_and_short_numbers() {
        let options = GestureOptions::default().side(Side::Left).strength(0.8).target([0.5, 1.25, -2.0]).variant(3);
        let cases = [
            (
                Line::span(0.0, 0.6, Kind::Hands(Hands::Both, Phase::Rest, None)),
                "{ at = 0, to = 0.6, both = \"rest\" }",
            ),
            (
                Line::span(0.9, 1.3, Kind::Hands(Hands::Right, Phase::Stroke, Some(0.62))),
                "{ at = 0.9, to = 1.3, right = \"stroke\", strength = 0.62 }",
            ),
            (
                Line::span(1.1, 1.4501, Kind::Words("say \"hi\"\\\n".to_owned())),
                "{ at = 1.1, to = 1.45, words = \"say \\\"hi\\\"\\\\\\n\" }",
            ),
            (
                Line::at(7.2, Kind::Gesture("point".to_owned(), options)),
                "{ at = 7.2, gesture = \"point\", side = \"left\", strength = 0.8, variant = 3, target = [0.5, 1.25, -2] }",
            ),
            (Line::at(3.0, Kind::Look([0.0, 1.6, 2.0], 1.0)), "{ at = 3, look = [0, 1.6, 2], strength = 1 }"),
            (Line::at(0.0, Kind::Mood(Mood::Joy, 0.5)), "{ at = 0, mood = \"joy\", strength = 0.5 }"),
            (Line::at(-0.0001, Kind::Expression(0.5)), "{ at = 0, expression = 0.5 }"),
            (Line::at(0.0, Kind::Layer(Layer::Gaze, 0.25)), "{ at = 0, layer = \"gaze\", gain = 0.25 }"),
        ];
        for (line, want) in cases {
            assert_eq!(line.text(), want);
        }
    }
}
