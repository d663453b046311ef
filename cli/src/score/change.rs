//! From a changed score to an edit of its take.

use std::collections::BTreeMap;
use std::ops::Range;

use umo_core::{Edit, EditError, Event, GestureOptions, Gestures, Model, Take};

use super::hands::{code, keyframes, of_code, step};
use super::line::{Hands, Kind, Line, Phase};
use super::{FULL_SPEED, Score, is_shown, seconds};
use crate::failure::Failure;

/// Least time from one stroke of a hand to the next, seconds.
const BETWEEN_STROKES: f64 = 0.3;
/// Preparation and retraction of a stroke beside rest that has none, seconds.
const WAY: f64 = 0.3;
/// Seconds from a request to its time.
const AHEAD: f64 = 3.0;
/// Seconds before its time, and after its end, in which a request makes a difference.
const BEFORE: f64 = 2.0;
const AFTER_GESTURE: f64 = 3.0;
const AFTER_WORDS: f64 = 2.5;
const AFTER_LIPS: f64 = 0.2;
/// Seconds until a value that was set is reached.
const TO_VALUE: f64 = 2.0;

/// An edit that changes nothing.
pub(super) fn nothing(take: &Take, model: &Model) -> Edit<'static> {
    Edit { phases: take.phases(model).unwrap_or_default(), ..Edit::default() }
}

/// The edit of a take whose own lines are `own`.
pub(super) fn edit<'a>(
    take: &'a Take,
    model: &Model,
    own: &[Line],
    score: &'a Score,
    gestures: &Gestures,
) -> Result<Edit<'a>, Failure> {
    let mut edit = nothing(take, model);
    let end = seconds(take);
    for (number, line) in &score.lines {
        if line.at >= end || line.to.is_some_and(|to| to > end + step(take, model) / 2.0) && is_hands(line) {
            return Err(score.wrong(*number, format!("it is after the take's end at {end:.3} s")));
        }
    }
    // Lines that both have, each as often as it is there.
    let mut known: BTreeMap<String, usize> = BTreeMap::new();
    own.iter().for_each(|line| *known.entry(line.text()).or_default() += 1);
    let mut is_own = Vec::with_capacity(score.lines.len());
    for (_, line) in &score.lines {
        let count = known.get_mut(&line.text()).filter(|count| **count > 0);
        is_own.push(count.is_some());
        if let Some(count) = count {
            *count -= 1;
        }
    }
    let gone: Vec<&Line> = own
        .iter()
        .filter(|line| {
            let count = known.get_mut(&line.text()).filter(|count| **count > 0);
            count.map(|count| *count -= 1).is_some()
        })
        .collect();
    let new: Vec<(usize, &Line)> =
        score.lines.iter().zip(&is_own).filter(|(_, own)| !**own).map(|((number, line), _)| (*number, line)).collect();
    if gone.iter().any(|line| is_hands(line)) || new.iter().any(|(_, line)| is_hands(line)) {
        if edit.phases.is_empty() {
            return Err(score.wrong(new.first().map_or(1, |(number, _)| *number), EditError::Phases));
        }
        hands(take, model, score, &new, &mut edit)?;
    }
    if gone.iter().any(|line| !is_hands(line)) || new.iter().any(|(_, line)| !is_hands(line)) {
        requests(take, score, &gone, &new, gestures, &mut edit)?;
    }
    Ok(edit)
}

fn is_hands(line: &Line) -> bool {
    matches!(line.kind, Kind::Hands(..))
}

/// Phases that are asked for, and speeds of strokes.
fn hands(take: &Take, model: &Model, score: &Score, new: &[(usize, &Line)], edit: &mut Edit) -> Result<(), Failure> {
    let count = edit.phases.len();
    let shown = keyframes(take, model, &(0.0..seconds(take))).end.min(count);
    let way = keyframes(take, model, &(0.0..WAY)).end;
    let is_new = |number: usize| new.iter().any(|(other, _)| *other == number);
    // The line of each hand at each keyframe.
    let mut lanes: [Vec<Option<(usize, Phase)>>; 2] = [vec![None; shown], vec![None; shown]];
    let mut strokes: Vec<(usize, Hands, Range<usize>, bool)> = Vec::new();
    for (number, line) in &score.lines {
        let (Kind::Hands(hands, phase, strength), Some(to)) = (&line.kind, line.to) else { continue };
        let span = keyframes(take, model, &(line.at..to));
        let span = span.start..span.end.min(shown);
        if span.is_empty() {
            let least = step(take, model);
            return Err(score.wrong(*number, format!("it is shorter than the {least} s that hands are known by")));
        }
        for (lane, hand) in lanes.iter_mut().zip([Hands::Left, Hands::Right]).filter(|(_, hand)| hand.meet(*hands)) {
            for place in &mut lane[span.clone()] {
                if let Some((other, before)) = place.replace((*number, *phase))
                    && before != *phase
                {
                    let problem = format!("the {} hand does something else then by line {other}", hand.name());
                    return Err(score.wrong(*number, problem));
                }
            }
        }
        if *phase == Phase::Stroke {
            if is_new(*number)
                && let Some(strength) = strength
            {
                edit.speeds.push((span.clone(), strength * FULL_SPEED));
            }
            // Part of the take's own stroke is not a new one.
            let (own, phase) = of_code(edit.phases[span.start]);
            let begins = is_new(*number) && !(phase == Phase::Stroke && own.meet(*hands));
            strokes.push((*number, *hands, span, begins));
        }
    }
    strokes.sort_by_key(|(_, _, span, _)| span.start);
    let seconds_of = |keyframe: usize| keyframe as f64 * step(take, model);
    for (at, (number, hands, span, is_new)) in strokes.iter().enumerate() {
        let before = strokes[..at].iter().rfind(|(_, other, ..)| other.meet(*hands));
        let Some((other, other_hands, earlier, was_new)) = before else { continue };
        let apart = seconds_of(span.start) - seconds_of(earlier.start);
        // One that goes on with another hand is the same.
        let goes_on = earlier.end >= span.start && other_hands != hands;
        if (*is_new || *was_new) && !goes_on && (earlier.end >= span.start || apart < BETWEEN_STROKES - 1e-6) {
            let line = if *is_new { number } else { other };
            return Err(score.wrong(
                *line,
                format!(
                    "strokes at {:.1} and {:.1} s of one hand: they need {BETWEEN_STROKES} s from one to the next, and \
                     something else between",
                    seconds_of(earlier.start),
                    seconds_of(span.start)
                ),
            ));
        }
    }
    for (keyframe, phase) in edit.phases.iter_mut().enumerate().take(shown) {
        *phase = together([0, 1].map(|hand| lanes[hand][keyframe].map_or(Phase::Rest, |(_, phase)| phase)));
    }
    // A new stroke beside rest gets its way there and back.
    for (number, hands, span, _) in strokes.iter().filter(|(.., is_new)| *is_new) {
        let before = span.start.saturating_sub(way)..span.start;
        let rests = |phases: &[u16], at: &usize| of_code(phases[*at]).1 == Phase::Rest;
        let free = before.clone().rev().take_while(|at| rests(&edit.phases, at)).count();
        if before.len() < way && free == before.len() {
            return Err(score.wrong(*number, format!("a stroke needs {WAY} s before it, to raise the hand")));
        }
        edit.phases[span.start - free..span.start].fill(code(*hands, Phase::Prepare));
        let after = span.end..(span.end + way).min(shown);
        let free = after.clone().take_while(|at| rests(&edit.phases, at)).count();
        edit.phases[span.end..span.end + free].fill(code(*hands, Phase::Retract));
    }
    Ok(())
}

/// The code of two hands in these phases: that of the first in stroke, prepare, hold, retract, rest (SPEC 2.12).
fn together([left, right]: [Phase; 2]) -> u16 {
    let order = [Phase::Stroke, Phase::Prepare, Phase::Hold, Phase::Retract, Phase::Rest];
    let phase = order.into_iter().find(|phase| left == *phase || right == *phase).unwrap_or(Phase::Rest);
    let hands = match (left == phase, right == phase) {
        (true, true) => Hands::Both,
        (true, false) => Hands::Left,
        (false, _) => Hands::Right,
    };
    code(hands, phase)
}

/// Requests that are asked for, and the frames in which they make a difference.
fn requests<'a>(
    take: &'a Take,
    score: &'a Score,
    gone: &[&Line],
    new: &[(usize, &'a Line)],
    gestures: &Gestures,
    edit: &mut Edit<'a>,
) -> Result<(), Failure> {
    let rate = f64::from(take.info().frame_rate);
    let mut gone: Vec<&Line> = gone.iter().copied().filter(|line| !is_hands(line)).collect();
    let differing: Vec<&Line> = gone.iter().copied().chain(new.iter().map(|(_, line)| *line)).collect();
    // Requests whose line is there still, and those that have none.
    let mut events: Vec<(u64, Event<'a>)> = Vec::new();
    for (frame, event) in take.events() {
        let line = Line::of(frame as f64 / rate, &event).filter(|_| is_shown(&event));
        let is_gone = line.and_then(|line| gone.iter().position(|other| other.text() == line.text()));
        match is_gone {
            Some(at) => drop(gone.swap_remove(at)),
            None => events.push((frame, event)),
        }
    }
    for &(number, line) in new.iter().filter(|(_, line)| !is_hands(line)) {
        let event = event(line);
        if let Event::Gesture { name, .. } = event
            && gestures.stroke(name).is_none()
        {
            return Err(score.wrong(number, format!("gesture `{name}`; known: {}", crate::gestures::list(gestures))));
        }
        let ahead = if line.to.is_some() || matches!(event, Event::Gesture { .. }) { AHEAD } else { 0.0 };
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, within the take")]
        let frame = ((line.at - ahead).max(0.0) * rate).round() as u64;
        let at = events.partition_point(|(other, _)| *other <= frame);
        events.insert(at, (frame, event));
    }
    let all: Vec<f64> = take
        .events()
        .filter_map(|(frame, event)| Line::of(frame as f64 / rate, &event))
        .chain(score.lines.iter().map(|(_, line)| line.clone()))
        .filter(|line| line.to.is_none() && !matches!(line.kind, Kind::Gesture(..)))
        .map(|line| line.at)
        .collect();
    for line in differing {
        edit.windows.push(window(line, gestures, &all, seconds(take), rate));
    }
    edit.events = Some(events);
    Ok(())
}

/// Frames in which a request makes a difference. `values` are the times at which values are set.
fn window(line: &Line, gestures: &Gestures, values: &[f64], end: f64, rate: f64) -> Range<u64> {
    let (before, last) = match &line.kind {
        Kind::Words(_) | Kind::Hands(..) => (BEFORE, line.to.unwrap_or(line.at) + AFTER_WORDS),
        Kind::Gesture(name, options) => {
            let way = gestures.stroke(name).unwrap_or(BEFORE) / f64::from(options.speed);
            (BEFORE.max(way), line.at + way + AFTER_GESTURE)
        }
        Kind::Lips(_) => (AFTER_LIPS, line.to.unwrap_or(line.at) + AFTER_LIPS),
        _ => {
            let next = values.iter().copied().filter(|at| *at > line.at + 1e-3).fold(f64::INFINITY, f64::min);
            (0.0, next + TO_VALUE)
        }
    };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the take")]
    let frame = |seconds: f64| (seconds.clamp(0.0, end) * rate).round() as u64;
    frame(line.at - before)..frame(last)
}

/// The request of a line.
fn event(line: &Line) -> Event<'_> {
    match &line.kind {
        Kind::Words(text) => Event::Words { text, start: line.at, end: line.to.unwrap_or(line.at) },
        Kind::Gesture(name, options) => {
            Event::Gesture { name, options: GestureOptions { at: Some(line.at), ..*options } }
        }
        Kind::Lips(shape) => {
            Event::Lips { shape: *shape, start: line.at, duration: line.to.unwrap_or(line.at) - line.at }
        }
        Kind::Look(point, strength) => Event::Look { point: *point, strength: *strength },
        Kind::Mood(mood, strength) => Event::Mood { mood: *mood, strength: *strength },
        Kind::Expression(expression) => Event::Expression(*expression),
        Kind::Attention(attention) => Event::Attention(*attention),
        Kind::Layer(layer, gain) => Event::Layer { layer: *layer, gain: *gain },
        Kind::Hands(..) => unreachable!("hands are codes, and no request"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_busier_hand_gives_the_code() {
        assert_eq!(together([Phase::Rest, Phase::Rest]), 0);
        assert_eq!(together([Phase::Stroke, Phase::Hold]), code(Hands::Left, Phase::Stroke));
        assert_eq!(together([Phase::Hold, Phase::Prepare]), code(Hands::Right, Phase::Prepare));
        assert_eq!(together([Phase::Retract, Phase::Retract]), code(Hands::Both, Phase::Retract));
    }
}
