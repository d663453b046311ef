//! Procedural layers (`umo_core_layers`) over the frames, with the host's requests to them.

use std::sync::atomic::Ordering;

use umo_core_base::state::{StateError, StatePass};
use umo_core_layers::{Company, Controls, Heard, LayerGains, LayerStack, Role};
use umo_core_model::lm::sampler::Sampler;
use umo_core_pose::frame::OwnedFrame;

use super::Start;
use super::host::Host;
use crate::scene::Pair;
use crate::session::spin_lock;
use crate::take::{Event, Known, Passed};

/// The host's requests at the start, with these draws of codes and gains of the layers.
pub(crate) fn controls(sampler: &Sampler, gains: LayerGains) -> Controls {
    let Sampler { activity, expression, .. } = *sampler;
    Controls { activity, expression, ..Controls::new(gains) }
}

/// The layers between two frames, and the requests in force.
#[derive(Debug)]
pub(crate) struct LayersState {
    bytes: Box<[u8]>,
    controls: Controls,
}

/// The layers of one avatar, and the requests in force.
#[derive(Debug)]
pub(crate) struct Layers {
    pub(crate) stack: LayerStack,
    pub(crate) controls: Controls,
    /// The others of a scene, and the person at the session's own microphone, who counts without them.
    scene: Company,
    pair: Pair,
    /// Whether there were ticks outside of the stream since its start.
    idled: bool,
    /// Seconds of a frame.
    seconds: f32,
    /// Rates of the frames' samples and of frames, per second.
    rate: usize,
    frame_rate: usize,
}

impl Layers {
    pub(crate) fn new(stack: LayerStack, controls: Controls, (rate, frame_rate): (usize, usize)) -> Self {
        let (pair, seconds) = (Pair::new(stack.seed()), stack.seconds());
        Self { stack, controls, scene: Company::ALONE, pair, idled: false, seconds, rate, frame_rate }
    }

    pub(crate) fn reset(&mut self, start: &Start, host: &Host) {
        self.follow(host);
        if start.is_reset {
            self.idled = false;
            self.pair.reset();
            self.stack.reset(start.epoch.number, &self.controls);
        } else {
            self.stack.interrupt(start.epoch.number, start.ease, &self.controls);
        }
        self.publish(host);
    }

    /// Whether they leave a frame unchanged.
    pub(crate) fn is_off(&self) -> bool {
        self.stack.is_off(&self.controls)
    }

    /// Whether the layers' state depends on nothing but the stream's frames and the host's requests.
    pub(crate) fn is_of_stream(&self) -> bool {
        !self.scene.is_on() && !self.idled
    }

    /// Lets a frame pass while they are off.
    pub(crate) fn skip(&mut self) {
        self.stack.skip(&self.controls);
    }

    /// Completes the next frame of the stream with a tick of the layers.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame) {
        let heard = Heard { sample: frame.sample, rate: self.rate };
        self.stack.apply(frame, &self.controls, Some(heard));
    }

    /// Passes a take's request to the host's requests. A request without room is dropped.
    pub(crate) fn ask(&self, host: &Host, event: &Event, epoch: u32) {
        let (gestures, rules) = (&host.gestures, &host.words);
        let known = Known { gestures, rules, frame_rate: self.frame_rate, sample_rate: self.rate };
        if let Ok(mut controls) = spin_lock(&host.controls.value)
            && event.apply(&mut controls, &known, (epoch, self.passed())).is_ok()
        {
            host.controls.changed();
        }
    }

    /// Numbers of requests that have begun or passed.
    pub(crate) fn passed(&self) -> Passed {
        let Self { stack, .. } = self;
        Passed { gestures: stack.begun_gestures(), lips: stack.passed_hints(), words: stack.passed_words() }
    }

    /// [`Self::apply`] for a host; `other` is the level of the voice at the session's microphone, if one is heard.
    /// Publishes the number of the requests that have begun.
    pub(crate) fn apply_for(&mut self, host: &Host, frame: &mut OwnedFrame, other: Option<f32>) {
        self.meet(host, frame, other);
        self.apply(frame);
        self.publish(host);
    }

    /// Applies a tick of the layers to a frame without audio, outside of the stream.
    pub(super) fn apply_to_still(&mut self, host: &Host, frame: &mut OwnedFrame) {
        self.idled |= !self.is_off();
        self.meet(host, frame, host.other_level());
        self.stack.apply(frame, &self.controls, None);
        host.begun_gestures.store(self.stack.begun_gestures(), Ordering::Release);
    }

    /// Takes over the host's requests; if the host is writing them, the next frame does.
    pub(crate) fn follow(&mut self, host: &Host) {
        host.controls.take(|controls| self.controls = Controls { company: self.controls.company, ..*controls });
        host.company.take(|company| self.scene = *company);
    }

    /// Meets the others of the scene at a frame, or the person at the session's microphone.
    fn meet(&mut self, host: &Host, frame: &OwnedFrame, other: Option<f32>) {
        self.controls.company =
            if self.scene.is_on() { self.scene } else { self.pair.advance(frame.cue.level, other, self.seconds) };
        // Without layers a body that is held would be a statue.
        let listens = self.controls.company.role == Some(Role::Listening) && !self.is_off();
        host.listens.store(listens, Ordering::Relaxed);
    }

    /// Publishes the numbers of begun gestures, passed hints and passed words for the host's setters.
    fn publish(&self, host: &Host) {
        host.passed_hints.store(self.stack.passed_hints(), Ordering::Release);
        host.passed_words.store(self.stack.passed_words(), Ordering::Release);
        host.begun_gestures.store(self.stack.begun_gestures(), Ordering::Release);
    }

    /// What the host asks for; `None` while it is writing.
    pub(crate) fn asked(&self, host: &Host) -> Option<Controls> {
        spin_lock(&host.controls.value).ok().map(|controls| *controls)
    }

    /// Their present state.
    pub(crate) fn keep(&mut self) -> Result<LayersState, StateError> {
        let describe = |layers: &mut Self, pass: &mut StatePass| {
            layers.stack.state(pass)?;
            layers.pair.state(pass)
        };
        let mut pass = StatePass::size();
        describe(self, &mut pass)?;
        let mut bytes = vec![0; pass.end()?];
        let mut pass = StatePass::save(&mut bytes, 0, 0);
        describe(self, &mut pass)?;
        let length = pass.end()?;
        bytes.truncate(length);
        Ok(LayersState { bytes: bytes.into(), controls: self.controls })
    }

    /// Returns to a state of layers like these, in the present epoch; returns whether it did. Never allocates.
    pub(crate) fn return_to(&mut self, host: &Host, state: &LayersState, epoch: u32) -> bool {
        let Ok(mut controls) = spin_lock(&host.controls.value) else { return false };
        let mut pass = StatePass::load(&state.bytes, 0);
        if self.stack.state(&mut pass).and_then(|()| self.pair.state(&mut pass)).is_err() {
            return false;
        }
        self.controls = state.controls;
        self.stack.move_to(epoch);
        self.controls.move_to(epoch);
        *controls = self.controls;
        drop(controls);
        self.publish(host);
        true
    }

    /// Describes the layers; [`Self::controls_state`] follows later in a state.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.stack.state(pass)
    }

    /// Describes the requests in force.
    pub(crate) fn controls_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.controls.state(pass)?;
        self.scene.state(pass)?;
        self.pair.state(pass)
    }
}
