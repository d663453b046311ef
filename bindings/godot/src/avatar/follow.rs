//! From a player's sound to the motion shown: the current line, its playback position, and its end.

use godot::classes::{AudioServer, MeshInstance3D, Node, Skeleton3D};
use godot::prelude::*;

use super::{IDLE_REST, Line, UmoAvatar3D, VOICE_AUTO, VOICE_LIVE};
use crate::rig::{Face, Rig};
use crate::source::Source;
use crate::umo::{Hint, Session, Shown};

/// A jump of the player's position by more than this many seconds counts as a seek.
const JUMP: f64 = 0.5;
/// A player that stops more than this many seconds before its end was stopped from outside.
const EARLY: f64 = 0.3;
/// Milliseconds in which the avatar then eases to rest.
const STOP_EASE_MS: u32 = 300;
/// Upper bound of the seconds between two mixes while the output runs.
const STALLED: f64 = 0.1;
/// Lead of the clock over the newest frame in seconds, so that umo knows that more motion is needed.
const AHEAD: f64 = 0.1;

impl Line {
    /// Whether this line continues with the stream at `position`, at most `most` seconds after its last known position.
    fn goes_on(&self, stream: &Variant, position: f64, most: f64) -> bool {
        let moved = position - self.position;
        let jumped = moved < -JUMP / 2.0 || moved > JUMP + most;
        self.stream == *stream && (!jumped || matches!(self.source, Source::Capture(_)))
    }
}

impl UmoAvatar3D {
    /// Feeds the player's sound to the session and sets the clock to the motion time of the sound heard now.
    pub(super) fn follow(&mut self, player: Option<Gd<Node>>, delta: f64) -> Result<(), String> {
        let Some(player) = player else {
            self.end_line(true)?;
            self.run_on(delta);
            return Ok(());
        };
        if is(&player, "stream_paused") {
            return Ok(());
        }
        if !call(&player, "is_playing").try_to::<bool>().unwrap_or(false) {
            self.end_line(false)?;
            self.run_on(delta);
            return Ok(());
        }
        let position = number(&call(&player, "get_playback_position"));
        let pitch = number(&player.get("pitch_scale"));
        let server = AudioServer::singleton();
        // Mixed sound is heard after the output's latency; a stalled output does not advance.
        let since = server.get_time_since_last_mix().min(STALLED) - server.get_output_latency();
        if self.session.as_ref().is_some_and(|session| session.is_take) {
            self.time = self.time.max(position + since * pitch);
            return Ok(());
        }
        let stream = player.get("stream");
        let goes_on = self.line.as_ref().is_some_and(|line| line.goes_on(&stream, position, delta * pitch));
        if !goes_on {
            self.line = None;
            self.start_line(&player, stream, position)?;
        }
        let (Some(line), Some(session)) = (&mut self.line, &self.session) else { return Ok(()) };
        line.position = position;
        line.source.feed(session)?;
        match &line.source {
            Source::Wav(_) => self.time = self.time.max(line.base + position - line.start + since * pitch),
            Source::Capture(capture) => {
                let latency = session.latency()?;
                let seconds = |samples: u64| samples as f64 / f64::from(session.sample_rate);
                let behind = if session.is_live {
                    seconds(latency.mouth_samples)
                } else {
                    seconds(latency.algorithmic_samples) + latency.compute_p99
                };
                self.time = self.time.max(line.base + capture.seconds() + since - behind);
            }
            Source::Dropped => self.run_on(delta),
        }
        Ok(())
    }

    pub(super) fn start_line(&mut self, player: &Gd<Node>, stream: Variant, position: f64) -> Result<(), String> {
        let (source, start) = Source::of(player, position)?;
        let Some(session) = &self.session else { return Ok(()) };
        let is_live = match self.voice {
            VOICE_AUTO => matches!(source, Source::Capture(_)),
            voice => voice == VOICE_LIVE,
        };
        let has_other_voice = session.is_live != (is_live && session.model.has_mouth());
        let has_other_format = source.format().is_some_and(|format| format != (session.sample_rate, session.channels));
        if has_other_voice || has_other_format {
            self.open_session(source.format(), is_live)?;
        }
        let base = self.next_base()?;
        self.heard = true;
        let first = self.session.as_ref().and_then(Session::pushed_seconds);
        self.line = Some(Line { stream, position, start, base, first, source });
        for hint in std::mem::take(&mut self.hints) {
            self.hint_line(hint);
        }
        Ok(())
    }

    /// Whether the line is what the player plays now: a script may have started another one since the last frame.
    pub(super) fn is_heard(&self) -> bool {
        let player = self.base().get_node_or_null(&self.audio_player);
        let (Some(player), Some(line)) = (player, &self.line) else { return false };
        let position = number(&call(&player, "get_playback_position"));
        call(&player, "is_playing").try_to::<bool>().unwrap_or(false)
            && line.goes_on(&player.get("stream"), position, JUMP)
    }

    /// Passes a hint for the line, in seconds of it, to the session. False if 64 of its kind are waiting.
    pub(super) fn hint_line(&self, hint: Hint) -> bool {
        let Some(line) = &self.line else { return false };
        let Some(first) = line.first else {
            self.complain("hints: after restore_state it is not known when audio was heard; call reset() first");
            return false;
        };
        let hint = hint.after(first - line.start);
        // A hint before the place where the player began is dropped.
        hint.start < 0.0 || self.tell(|session| session.hint(&hint)).unwrap_or(false)
    }

    /// Starts a new stream, after all times shown so far if the session has received audio. Returns the time of its
    /// first frame.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "about a second at most")]
    pub(super) fn next_base(&mut self) -> Result<f64, String> {
        let Some(session) = &self.session else { return Ok(0.0) };
        if !self.heard {
            return Ok(0.0);
        }
        let rate = f64::from(session.model.info.frame_rate);
        let last = self.shown.index as f64 / rate;
        // The frames of the ease come before the stream's: one for each frame that the clock ran past the last one.
        let ease_ms = ((self.time - last).clamp(0.0, 10.0) * 1000.0).ceil();
        session.interrupt(ease_ms as u32)?;
        Ok((self.shown.index as f64 + 1.0 + (ease_ms * rate / 1000.0).ceil()) / rate)
    }

    /// Handles a player that stopped, at its end or earlier, or that is gone.
    pub(super) fn end_line(&mut self, is_gone: bool) -> Result<(), String> {
        let (Some(line), Some(session)) = (self.line.take(), &self.session) else { return Ok(()) };
        match line.source {
            Source::Wav(wav) if is_gone || line.position < wav.seconds() - EARLY => session.interrupt(STOP_EASE_MS),
            Source::Wav(_) | Source::Dropped => Ok(()),
            Source::Capture(_) => session.finish(),
        }
    }

    /// Advances the clock while nothing plays: through the remaining motion, and until the rest pose is reached.
    pub(super) fn run_on(&mut self, delta: f64) {
        let Some(session) = &self.session else { return };
        let rest = if self.idle == IDLE_REST { session.rest_seconds } else { 0.0 };
        let most = self.shown.newest + self.output_delay + AHEAD + rest;
        self.time = self.time.max((self.time + delta).min(most));
    }

    pub(super) fn saw(&mut self, seconds: f64, shown: Shown) {
        self.time = self.time.max(seconds);
        self.shown = shown;
    }

    /// Shows the pose at the clock's time.
    pub(super) fn show(&mut self) -> Result<(), String> {
        self.gaze()?;
        let Some(session) = &self.session else { return Ok(()) };
        let shown = session.sample(self.time, &mut self.frame)?;
        // After the session has failed, sampling keeps returning the last pose.
        session.is_done()?;
        self.saw(self.time, shown);
        self.apply();
        Ok(())
    }

    /// Looks at the target, if there is one.
    pub(super) fn gaze(&mut self) -> Result<(), String> {
        let Some(session) = &self.session else { return Ok(()) };
        let target = if self.gaze_target.is_empty() { None } else { self.base().get_node_or_null(&self.gaze_target) };
        match target.and_then(|node| node.try_cast::<Node3D>().ok()) {
            Some(target) => {
                session.look_at(self.to_avatar(target.get_global_position()), 1.0)?;
                self.gazes = true;
            }
            None if self.gazes => {
                session.look_at([0.0; 3], 0.0)?;
                self.gazes = false;
            }
            None => {}
        }
        Ok(())
    }

    /// Applies the frame to the skeleton and meshes that exist.
    pub(super) fn apply(&mut self) {
        let Some(model) = self.shared.clone() else { return };
        let node = |path: &NodePath| if path.is_empty() { None } else { self.base().get_node_or_null(path) };
        #[expect(clippy::cast_possible_truncation, reason = "it is short")]
        let seconds = self.base().get_process_delta_time() as f32;
        let skeleton = node(&self.skeleton).and_then(|node| node.try_cast::<Skeleton3D>().ok());
        let meshes: Vec<_> = self.meshes.iter_shared().map(|path| node(&path)).collect();
        if let Some(mut skeleton) = skeleton {
            if !self.rig.as_ref().is_some_and(|rig| rig.is_of(&skeleton, self.volume)) {
                let rig = Rig::new(&skeleton, &model, self.volume);
                let problem = rig.problem().filter(|_| skeleton.get_bone_count() > 0).map(|problem| {
                    let name = skeleton.get_name();
                    format!(
                        "the skeleton `{name}`: {problem}. Rename its bones, or let the importer's Retarget do it \
                         (Skeleton3D, Bone Map)"
                    )
                });
                self.rig = Some(rig);
                // Each problem is reported once.
                if problem.is_some() && problem != self.told_of_bones {
                    self.complain(problem.as_deref().unwrap_or_default());
                }
                self.told_of_bones = problem;
            }
            if let Some(rig) = &mut self.rig {
                rig.pose(&mut skeleton, seconds, &self.frame, self.move_root);
            }
        }
        self.faces.resize_with(meshes.len(), || None);
        for (face, node) in self.faces.iter_mut().zip(meshes) {
            let instance = node.and_then(|node| node.try_cast::<MeshInstance3D>().ok());
            let Some(mut instance) = instance else { continue };
            let Some(mesh) = instance.get_mesh() else { continue };
            if !face.as_ref().is_some_and(|face| face.is_of(&instance, &mesh)) {
                *face = Some(Face::new(&instance, &mesh, &model));
            }
            if let Some(face) = face {
                face.pose(&mut instance, &self.frame);
            }
        }
    }
}

/// Calls a method of a player: the three kinds of players have the same methods but no common class.
fn call(player: &Gd<Node>, method: &str) -> Variant {
    if player.has_method(method) { player.clone().call(method, &[]) } else { Variant::nil() }
}

fn is(player: &Gd<Node>, property: &str) -> bool {
    player.get(property).try_to::<bool>().unwrap_or(false)
}

fn number(value: &Variant) -> f64 {
    value.try_to::<f64>().unwrap_or(0.0)
}
