//! The page of a stream: its contents before the stream begins.

use std::path::Path;
use std::sync::Arc;

use umo_core::{AvatarConfig, Config, Engine, EngineConfig, Model, SessionConfig, Threads};
use umo_core_rig::glb::Follower;
use umo_figure::Figure;

use super::scene::{Audio, LiveInfo, Scene};
use crate::animate;
use crate::args::{GenerateArgs, VoiceArg};
use crate::failure::Failure;
use crate::live::session_rate;
use crate::retarget::Wearer;
use crate::speech::Speech;

/// Default keyframes per chunk of a live stream: the lowest latency at which the model's own lookahead
/// keeps the seams smooth.
const LIVE_TARGET: usize = 1;

/// Refuses `--voice live` for a model without a mouth network.
pub(crate) fn check_voice(voice: Option<VoiceArg>, model: &Model) -> Result<(), Failure> {
    match voice {
        Some(VoiceArg::Live) if model.mouth().is_none() => {
            Err(Failure::input("--voice live needs a model with a mouth network: `umo model inspect` tells"))
        }
        _ => Ok(()),
    }
}

/// Returns the avatar configuration of a live stream.
pub(crate) fn avatar(generate: &GenerateArgs, config: &Config) -> AvatarConfig {
    AvatarConfig { target: generate.target.unwrap_or(LIVE_TARGET), ..animate::avatar(generate, config, 0) }
}

/// Returns the session configuration of a live stream.
pub(crate) fn session(generate: &GenerateArgs, config: &Config) -> SessionConfig {
    let layers = animate::layers(generate);
    SessionConfig { avatar: avatar(generate, config), layers, ..SessionConfig::new(config) }
}

/// A page of a stream, but for its character.
#[derive(Clone)]
pub(super) struct StreamPage {
    pub(super) title: String,
    pub(super) model: Arc<Model>,
    pub(super) session: SessionConfig,
    pub(super) figure: Figure,
    pub(super) live: LiveInfo,
    /// Recording that the page speaks.
    pub(super) audio: Option<Audio>,
}

impl StreamPage {
    /// Reads the recording, if there is one, and computes the pose that the page shows at first.
    pub(super) fn new(
        input: Option<(&Path, bool)>,
        model: Arc<Model>,
        session: SessionConfig,
        (voice, figure): (Option<VoiceArg>, Figure),
    ) -> Result<Self, Failure> {
        check_voice(voice, &model)?;
        let audio = input.map(|(path, repair)| recording(path, repair)).transpose()?;
        let title = input.map_or_else(|| "microphone".to_owned(), |(path, _)| path.display().to_string());
        let live = live_info(&model, &session, voice)?;
        Ok(Self { title, model, session, figure, live, audio })
    }

    /// Returns the page's contents, and what moves its character.
    pub(super) fn scene(&self, wearer: Option<Wearer>) -> Result<(Scene, Option<Follower>), Failure> {
        let config = self.model.config();
        let mut still = config.clip();
        still.push(&self.live.rest, &self.live.rest_face);
        let (character, follower) = wearer.map(|wearer| wearer.follow(&still)).transpose()?.unzip();
        let mut scene = Scene::of_stream(self, character)?;
        scene.audio.clone_from(&self.audio);
        Ok((scene, follower))
    }
}

/// Reads a recording at a rate that sessions accept.
fn recording(path: &Path, repair: bool) -> Result<Audio, Failure> {
    let speech = Speech::open(path, repair)?;
    let rate = session_rate(speech.sample_rate()).min(super::scene::MAX_RATE);
    Ok(Audio::of(rate, &speech.mono(rate)?))
}

/// Returns the properties of a live stream that are known before it begins.
fn live_info(model: &Arc<Model>, config: &SessionConfig, voice: Option<VoiceArg>) -> Result<LiveInfo, Failure> {
    let engine = EngineConfig { threads: Threads::Own(1), max_sessions: 1, max_batch: 1, ..EngineConfig::default() };
    let engine = Engine::new(Arc::clone(model), &engine).map_err(Failure::input)?;
    let session = engine.session(config).map_err(Failure::input)?;
    let algorithmic = session.latency().algorithmic_samples as f64 / config.sample_rate as f64;
    let mut rest = None;
    session.sample_pose(0.0, |frame| rest = Some((*frame.pose, frame.face.to_vec()))).map_err(Failure::environment)?;
    let (rest, rest_face) = rest.ok_or_else(|| Failure::environment("internal: a session without a pose"))?;
    let voice = voice.map(|voice| match voice {
        VoiceArg::Live => "live",
        VoiceArg::Delayed => "delayed",
    });
    let has_mouth = model.mouth().is_some();
    Ok(LiveInfo { algorithmic_seconds: algorithmic, rest, rest_face, has_mouth, voice, engine: None })
}
