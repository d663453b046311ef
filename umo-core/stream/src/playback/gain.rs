//! Gains of the parts, as set by the host: applied to the frames that are handed out, and to no
//! stored frame.

use std::sync::atomic::{AtomicU32, Ordering};

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::part::{Part, PerPart};
use umo_core_pose::rotation::scaled;
use umo_core_pose::skeleton::{JAW, joints_of};

use super::{Frame, Start};

/// Largest gain of a part.
pub const MAX_GAIN: f32 = 2.0;

/// Rate at which a gain follows its setting, per second.
const SPEED: f64 = 8.0;

/// The gains in force, and the frame that they are applied to.
#[derive(Debug)]
pub(crate) struct Gained {
    now: PerPart<f32>,
    /// Time of the last frame that they were applied to, seconds.
    time: f64,
    /// Whether any frame was handed out; the first takes its gains at once.
    started: bool,
    frame: OwnedFrame,
    is_arkit: bool,
}

impl Gained {
    pub(crate) fn new(frame: OwnedFrame, is_arkit: bool) -> Self {
        Self {
            now: PerPart { face: 1.0, hands: 1.0, upper: 1.0, lower: 1.0 },
            time: 0.0,
            started: false,
            frame,
            is_arkit,
        }
    }

    /// Describes the gains in force.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        for part in Part::ALL {
            let bits = gain_bits(pass, self.now[part].to_bits())?;
            if pass.loads() {
                self.now[part] = f32::from_bits(bits);
            }
        }
        pass.float(&mut self.time)?;
        pass.switch("gains", &mut self.started)?;
        Ok(())
    }

    pub(crate) fn reset(&mut self, start: &Start) {
        self.started &= !start.is_reset;
    }

    /// Scales the deviation of `frame`, shown at `time`, from `rest` by the gains, which follow the
    /// `wanted` ones, bits of floats; returns `frame` itself if all are 1.
    pub(crate) fn apply<'a>(
        &'a mut self,
        wanted: &PerPart<AtomicU32>,
        time: f64,
        frame: &'a OwnedFrame,
        rest: &OwnedFrame,
    ) -> Frame<'a> {
        self.follow(wanted, time);
        if Part::ALL.iter().all(|&part| self.now[part] == 1.0) {
            return frame.into();
        }
        self.frame.copy(frame);
        for part in Part::ALL.into_iter().filter(|&part| self.now[part] != 1.0) {
            let gain = self.now[part];
            // The eyes are in no part's channels: they follow the face's gain.
            let eyes = if part == Part::Face { JAW + 1..JAW + 3 } else { 0..0 };
            for joint in joints_of(part).chain(eyes) {
                self.frame.pose.rotations[joint] =
                    scaled(rest.pose.rotations[joint], frame.pose.rotations[joint], gain);
            }
        }
        self.scale_face(rest);
        if self.now.lower != 1.0 {
            for (value, rest) in self.frame.pose.translation.iter_mut().zip(rest.pose.translation) {
                *value = rest + (*value - rest) * self.now.lower;
            }
        }
        (&self.frame).into()
    }

    fn scale_face(&mut self, rest: &OwnedFrame) {
        if self.now.face == 1.0 {
            return;
        }
        for (value, rest) in self.frame.face.iter_mut().zip(&rest.face) {
            *value = rest + (*value - rest) * self.now.face;
            if self.is_arkit {
                *value = value.clamp(0.0, 1.0);
            }
        }
    }

    /// Moves the gains towards their settings.
    #[expect(clippy::cast_possible_truncation, reason = "a gain's precision is enough")]
    fn follow(&mut self, wanted: &PerPart<AtomicU32>, time: f64) {
        let step = (SPEED * (time - self.time).max(0.0)) as f32;
        let at_once = !std::mem::replace(&mut self.started, true);
        self.time = time;
        for part in Part::ALL {
            let wanted = f32::from_bits(wanted[part].load(Ordering::Relaxed));
            let now = self.now[part];
            self.now[part] = if at_once { wanted } else { now + (wanted - now).clamp(-step, step) };
        }
    }
}

/// Describes a gain as the bits of a float.
pub(crate) fn gain_bits(pass: &mut StatePass, present: u32) -> Result<u32, StateError> {
    let bits = u32::try_from(pass.limited("gain", present.into(), u32::MAX.into())?).unwrap_or_default();
    pass.must((0.0..=MAX_GAIN).contains(&f32::from_bits(bits)), "gain")?;
    Ok(bits)
}
