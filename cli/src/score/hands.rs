//! Phases of hands: codes of keyframes to spans and back.

use std::ops::Range;

use umo_core::{Compute, EditError, Model, Take};

use super::FULL_SPEED;
use super::line::{Hands, Kind, Line, Phase};

/// Code of a phase of hands in `intent` (SPEC 2.12).
pub(super) fn code(hands: Hands, phase: Phase) -> u16 {
    match phase {
        Phase::Rest => 0,
        phase => 1 + 3 * (phase as u16 - 1) + hands as u16,
    }
}

/// Hands and phase of a code; every unknown one is rest.
pub(super) fn of_code(code: u16) -> (Hands, Phase) {
    let Some(code) = code.checked_sub(1) else { return (Hands::Both, Phase::Rest) };
    let phase = Phase::ALL.get(usize::from(code / 3) + 1).copied().unwrap_or(Phase::Rest);
    (Hands::ALL[usize::from(code % 3)], phase)
}

/// Seconds of a keyframe.
pub(super) fn step(take: &Take, model: &Model) -> f64 {
    model.config().keyframe_stride as f64 / f64::from(take.info().frame_rate)
}

/// The keyframes of a span in seconds.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, and cut at the take's end")]
pub(super) fn keyframes(take: &Take, model: &Model, span: &Range<f64>) -> Range<usize> {
    let step = step(take, model);
    let end = super::seconds(take).max(0.0);
    let at = |seconds: f64| (seconds.clamp(0.0, end) / step).round() as usize;
    at(span.start)..at(span.end)
}

/// Runs of keyframes with the same code.
pub(super) fn runs(phases: &[u16]) -> Vec<(Range<usize>, u16)> {
    let mut at = 0;
    let run = |run: &[u16]| {
        at += run.len();
        (at - run.len()..at, run[0])
    };
    phases.chunk_by(|a, b| a == b).map(run).collect()
}

/// The lines of a take's hands.
pub(super) fn lines(take: &Take, model: &Model, cx: Compute) -> Result<Vec<Line>, EditError> {
    let Some(phases) = take.phases(model) else { return Ok(Vec::new()) };
    let wrists = take.wrists(model, cx)?;
    let step = step(take, model);
    let shown = keyframes(take, model, &(0.0..super::seconds(take))).end.min(phases.len());
    let mut lines = Vec::new();
    for (run, code) in runs(&phases[..shown]) {
        let (hands, phase) = of_code(code);
        let strength = (phase == Phase::Stroke).then(|| {
            let peak = take.peak_speed(model, &wrists, &run, code);
            (100.0 * (peak / FULL_SPEED).clamp(0.0, 1.0)).round() / 100.0
        });
        lines.push(Line::span(run.start as f64 * step, run.end as f64 * step, Kind::Hands(hands, phase, strength)));
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_a_phase_of_hands_and_back() {
        for number in 0..13 {
            let (hands, phase) = of_code(number);
            assert_eq!(code(hands, phase), number);
        }
        assert_eq!(of_code(5), (Hands::Right, Phase::Stroke));
        assert_eq!(of_code(99).1, Phase::Rest);
        assert_eq!(runs(&[0, 0, 5, 5, 4]), [(0..2, 0), (2..4, 5), (4..5, 4)]);
    }
}
