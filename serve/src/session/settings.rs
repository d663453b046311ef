//! Session settings from a hello.

use umo_core::{
    AvatarConfig, Idle, Layer, LayerGains, MAX_RATE, MIN_RATE, Model, PacketConfig, SessionConfig, Voice, WordRules,
};
use umo_core_model::lm::layout::Template;

use crate::protocol::{Hello, Output, VoiceKind};

/// Message for a packet client that sends a mood, gesture or look-at.
pub(super) const NOT_IN_PACKETS: &str =
    "packets do not carry mood, gestures, words, look-at and looks in a room: set them on the viewers' decoders";

/// Returns the settings of a hello, with `defaults` for missing ones; or an error message for the client.
pub(super) fn of(hello: &Hello, defaults: Option<&SessionConfig>, model: &Model) -> Result<SessionConfig, String> {
    let config = model.config();
    if !(MIN_RATE..=MAX_RATE).contains(&hello.rate) {
        return Err(format!("rate {}: expected {MIN_RATE} to {MAX_RATE}", hello.rate));
    }
    if !(0.0..=1.0).contains(&hello.layers.unwrap_or(1.0)) || !(0.0..=1.0).contains(&hello.mood_strength) {
        return Err("layers and mood_strength: expected 0 to 1".to_owned());
    }
    let mut settings = defaults.cloned().unwrap_or_else(|| SessionConfig::new(config));
    settings.sample_rate = hello.rate;
    let avatar = &mut settings.avatar;
    avatar.target = hello.target.unwrap_or(avatar.target);
    avatar.horizon = hello.horizon.unwrap_or(avatar.horizon);
    avatar.sampler.seed = hello.seed.unwrap_or(avatar.sampler.seed);
    if let Some(gain) = hello.layers {
        settings.layers = Layer::ALL.into_iter().fold(LayerGains::ON, |gains, layer| gains.with(layer, gain));
    }
    if let Some(text) = &hello.prompt {
        with_prompt(&mut settings.avatar, text, model)?;
    }
    if let Some(code) = &hello.language {
        let unknown = || format!("language `{code}`: there are rules for {}", WordRules::LANGUAGES.join(", "));
        settings.words = WordRules::of(code).ok_or_else(unknown)?;
    }
    if hello.voice == VoiceKind::Live {
        if model.mouth().is_none() {
            return Err("voice live: this model has no mouth network".to_owned());
        }
        settings.voice = Voice::Live;
    }
    if hello.room.is_some() {
        // Who listens has a body too.
        settings.idle = Idle::Live;
    } else if hello.place.is_some() {
        return Err("place: only in a room".to_owned());
    }
    if hello.output == Output::Packets {
        if hello.mood.is_some() || hello.room.is_some() {
            return Err(NOT_IN_PACKETS.to_owned());
        }
        if hello.voice == VoiceKind::Live {
            return Err("voice live: not available with packets, which carry their chunk's mouth".to_owned());
        }
        settings.packets = Some(PacketConfig { history: settings.avatar.target, with_frames: false });
    }
    Ok(settings)
}

/// Sets the prompt's tokens, and the variant of the template that has room for them.
fn with_prompt(avatar: &mut AvatarConfig, text: &str, model: &Model) -> Result<(), String> {
    let none = || "prompt: this model takes no text".to_owned();
    avatar.text = model.text().ok_or_else(none)?.encode(text).map_err(|error| format!("prompt: {error}"))?;
    let names = [avatar.template.clone(), format!("{}_with_text", avatar.template)];
    let has_text = |name: &&String| Template::new(model.config(), name).is_ok_and(|template| template.has_text());
    avatar.template = names.iter().find(has_text).ok_or_else(none)?.clone();
    Ok(())
}
