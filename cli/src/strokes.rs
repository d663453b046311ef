//! The strokes of a take: what a model with the annotation `intent` says about its gestures (SPEC 2.12).

use umo_core::Config;
use umo_gltf::keys::{Marker, MarkerKind};

const INTENT: &str = "intent";
/// Number of the phase in a gesture, from 1.
const STROKE: usize = 2;
const HANDS: [&str; 3] = ["left", "right", "both"];

/// Collects the strokes of a take from its chunks.
#[derive(Debug)]
pub(crate) struct Strokes {
    /// Place of the annotation among the codes of a keyframe, and their number.
    place: usize,
    codes: usize,
    stride: usize,
    frame_rate: f64,
    /// The hands of the last keyframe, if it was of a stroke.
    last: Option<&'static str>,
    found: Vec<Marker>,
}

impl Strokes {
    /// `None` if the model does not say.
    pub(crate) fn new(config: &Config) -> Option<Self> {
        let parts = config.part_list();
        let at = parts.iter().position(|part| config.is_frames() && part.name == INTENT && part.is_annotation())?;
        Some(Self {
            place: parts[..at].iter().map(|part| part.levels).sum(),
            codes: config.codes_per_keyframe(),
            stride: config.keyframe_stride,
            frame_rate: config.frame_rate as f64,
            last: None,
            found: Vec::new(),
        })
    }

    /// The strokes of a take of which these are all codes of `intent`, one for each keyframe.
    pub(crate) fn of(config: &Config, phases: &[u16]) -> Vec<Marker> {
        let (stride, frame_rate) = (config.keyframe_stride, config.frame_rate as f64);
        let mut strokes = Self { place: 0, codes: 1, stride, frame_rate, last: None, found: Vec::new() };
        strokes.hear(0, phases);
        strokes.markers()
    }

    /// Takes the codes of a chunk's keyframes, of which the first is at or after this frame.
    pub(crate) fn hear(&mut self, first_frame: usize, keyframes: &[u16]) {
        let first = first_frame.next_multiple_of(self.stride);
        let codes = keyframes.iter().skip(self.place).step_by(self.codes);
        for (keyframe, &code) in codes.enumerate() {
            let hands = hands_of_stroke(usize::from(code));
            if let Some(name) = hands.filter(|_| self.last != hands) {
                let seconds = (first + keyframe * self.stride) as f64 / self.frame_rate;
                self.found.push(Marker { seconds, kind: MarkerKind::Stroke, name: name.to_owned() });
            }
            self.last = hands;
        }
    }

    /// The markers, in order.
    pub(crate) fn markers(self) -> Vec<Marker> {
        self.found
    }
}

/// The hands of a code of a stroke.
fn hands_of_stroke(code: usize) -> Option<&'static str> {
    let code = code.checked_sub(1)?;
    (code / HANDS.len() + 1 == STROKE).then(|| HANDS[code % HANDS.len()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_codes_of_strokes_have_hands() {
        let all: Vec<_> = (0..13).filter_map(|code| Some((code, hands_of_stroke(code)?))).collect();
        assert_eq!(all, [(4, "left"), (5, "right"), (6, "both")]);
    }

    #[test]
    fn a_stroke_is_marked_where_it_begins() {
        let (last, found) = (None, Vec::new());
        let mut strokes = Strokes { place: 1, codes: 2, stride: 4, frame_rate: 30.0, last, found };
        strokes.hear(0, &[9, 0, 9, 1, 9, 4]);
        // The same stroke goes on in the next chunk, whose first frame is behind the last keyframe.
        strokes.hear(9, &[5, 4, 5, 5, 5, 0, 5, 5]);
        let found: Vec<_> = strokes.markers().into_iter().map(|it| (it.seconds * 30.0, it.name)).collect();
        let want = [(8.0, "left"), (16.0, "right"), (24.0, "right")];
        assert_eq!(found, want.map(|(frame, hands)| (frame, hands.to_owned())));
        assert!(Strokes::new(&crate::random::tiny()).is_none());
    }
}
