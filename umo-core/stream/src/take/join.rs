//! From changed frames back to a take's own: the frames that were drawn anew, and the layers' state after them (SPEC
//! 2.25).

use std::ops::Range;

use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::rotation::{axis_angle_to_quat, inverse, product, quat_to_axis_angle};
use umo_core_pose::skeleton::JOINTS;

use crate::playback::LayersState;

/// Frames of the way back from the layers' state in changed frames.
const LAYERS_BACK: u32 = 6;

/// Changed frames of a take, and what comes after them.
#[derive(Debug)]
pub(crate) struct Patch {
    pub(crate) frames: Range<u64>,
    /// The decoders' frames, if chunks were drawn anew; empty if only requests differ.
    pub(crate) drawn: Box<[OwnedFrame]>,
    /// `None` if the take ends in them.
    pub(crate) join: Option<Join>,
}

/// The layers after the last of some frames that differ, as if none did.
#[derive(Debug)]
pub(crate) struct Join {
    pub(crate) layers: LayersState,
    /// The last of these frames, as it was shown.
    pub(crate) shown: OwnedFrame,
}

/// A difference of poses that fades.
#[derive(Debug)]
pub(crate) struct Offset {
    /// Axis times angle, and its change a frame.
    turns: [[[f32; 3]; 2]; JOINTS],
    place: [[f32; 3]; 2],
    face: Box<[[f32; 2]]>,
    done: u32,
    frames: u32,
}

impl Offset {
    pub(crate) fn new(face: usize) -> Self {
        let face = vec![[0.0; 2]; face].into();
        Self { turns: [[[0.0; 3]; 2]; JOINTS], place: [[0.0; 3]; 2], face, done: 0, frames: 0 }
    }

    /// Stops.
    pub(crate) fn reset(&mut self) {
        (self.done, self.frames) = (0, 0);
    }

    /// Begins to fade a layer state's difference.
    pub(crate) fn begin(&mut self, shown: &OwnedFrame, own: &OwnedFrame) {
        self.begin_over([shown, shown], [own, own], LAYERS_BACK);
    }

    /// Begins to fade the difference of two motions over `frames` frames: of the frame before the first of these, and of
    /// the one before that.
    pub(crate) fn begin_over(&mut self, from: [&OwnedFrame; 2], to: [&OwnedFrame; 2], frames: u32) {
        let turn = |at: usize, joint: usize| {
            let (a, b) = (from[at].pose.rotations[joint], to[at].pose.rotations[joint]);
            quat_to_axis_angle(product(a, inverse(b)))
        };
        for (joint, fading) in self.turns.iter_mut().enumerate() {
            *fading = with_change(turn(0, joint), turn(1, joint));
        }
        let away = |at: usize| {
            let (a, b) = (from[at].pose.translation, to[at].pose.translation);
            std::array::from_fn(|axis| a[axis] - b[axis])
        };
        self.place = with_change(away(0), away(1));
        for (value, fading) in self.face.iter_mut().enumerate() {
            let [now, before] = [0, 1].map(|at| from[at].face[value] - to[at].face[value]);
            *fading = [now, now - before];
        }
        (self.done, self.frames) = (0, frames);
    }

    /// Adds what is left to the next frame; after the last, nothing.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame) {
        self.done += u32::from(self.done < self.frames);
        if self.done == self.frames {
            return;
        }
        let fade = Fade::new(self.done as f32 / self.frames as f32, self.frames as f32);
        for (q, turn) in frame.pose.rotations.iter_mut().zip(&self.turns) {
            *q = product(axis_angle_to_quat(fade.of3(turn)), *q);
        }
        let place = fade.of3(&self.place);
        frame.pose.translation.iter_mut().zip(place).for_each(|(to, more)| *to += more);
        frame.face.iter_mut().zip(&self.face).for_each(|(to, &more)| *to += fade.of(more));
    }
}

fn with_change(now: [f32; 3], before: [f32; 3]) -> [[f32; 3]; 2] {
    [now, std::array::from_fn(|axis| now[axis] - before[axis])]
}

/// Factors of a value and of its change a frame, on the way to 0 without a jump of speed or acceleration.
#[derive(Clone, Copy, Debug)]
struct Fade(f32, f32);

impl Fade {
    /// `s` is the share of the way, of `frames` frames.
    fn new(s: f32, frames: f32) -> Self {
        let (s3, s4, s5) = (s * s * s, s * s * s * s, s * s * s * s * s);
        Self(1.0 - 10.0 * s3 + 15.0 * s4 - 6.0 * s5, frames * (s - 6.0 * s3 + 8.0 * s4 - 3.0 * s5))
    }

    fn of(self, [value, change]: [f32; 2]) -> f32 {
        self.0 * value + self.1 * change
    }

    fn of3(self, [value, change]: &[[f32; 3]; 2]) -> [f32; 3] {
        std::array::from_fn(|axis| self.of([value[axis], change[axis]]))
    }
}
