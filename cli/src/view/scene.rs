//! The contents of a page.

use std::path::Path;

use serde::Serialize;
use umo_core::{Animation, AvatarConfig, Config, Face, FaceKind, Part, Place, Pose};
use umo_core_model::config::PartSpec;
use umo_core_model::lm::tally::kind_names;
use umo_core_pose::clip::Clip;
use umo_core_rig::glb::Glb;

use super::stream::StreamPage;
use super::take::Takes;
use crate::animate::Generator;
use crate::args::{Page, Shown};
use crate::converse::{Member, Voice};
use crate::failure::Failure;
use crate::retarget::{Wearer, Worn, is_character};
use crate::speech::Speech;
use crate::words::Script;
use crate::{import, model};
use umo_figure::{Figure, Mesh};

/// Upper bound on the motion of a page, which browsers open without trouble at a few MB a minute.
const MAX_SECONDS: f64 = 1800.0;
/// Upper bound on the sample rate of a page's audio; higher rates are inaudible.
pub(super) const MAX_RATE: usize = 48_000;

/// The contents of a page.
pub(super) struct Scene {
    pub(super) title: String,
    pub(super) notice: String,
    /// Short description of how it was made.
    pub(super) about: String,
    pub(super) clip: Clip,
    pub(super) mesh: Mesh,
    /// Character that wears the motion in place of the mesh.
    pub(super) character: Option<Worn>,
    pub(super) audio: Option<Audio>,
    pub(super) model: Option<ModelInfo>,
    pub(super) record: Option<Record>,
    pub(super) live: Option<LiveInfo>,
    /// Pieces of motion to judge, if this is that page.
    pub(super) judge: Option<JudgeInfo>,
    /// The members of a conversation, in place of `clip` and `audio`.
    pub(super) room: Vec<RoomMember>,
    /// Persons of a conversation, who are heard.
    pub(super) people: Vec<Person>,
    /// Figures of members beside `mesh`.
    pub(super) other_meshes: Vec<Mesh>,
    /// Takes, if this is their page.
    pub(super) takes: Option<Takes>,
}

/// A member of a conversation who has an avatar.
pub(super) struct RoomMember {
    pub(super) name: String,
    pub(super) place: Place,
    /// Its figure: 0 is the scene's mesh, others follow.
    pub(super) figure: usize,
    pub(super) clip: Clip,
    pub(super) audio: Audio,
}

/// Somebody without an avatar.
pub(super) struct Person {
    pub(super) name: String,
    pub(super) place: Place,
    pub(super) audio: Audio,
}

/// Equally long pieces of several takes: `clip` and `audio` hold them one after the other.
#[derive(Clone, Debug, Serialize)]
pub(super) struct JudgeInfo {
    /// Length of a piece of sound.
    pub(super) seconds: usize,
    /// Number of frames of a piece of motion.
    pub(super) frames: usize,
    pub(super) takes: Vec<JudgeTake>,
}

/// A take of a page to judge.
#[derive(Clone, Debug, Serialize)]
pub(super) struct JudgeTake {
    pub(super) name: String,
    pub(super) pieces: usize,
}

/// Speech in a format that browsers play.
#[derive(Clone)]
pub(super) struct Audio {
    pub(super) sample_rate: u32,
    /// Mono, full scale 32768.
    pub(super) samples: Vec<i16>,
}

/// The model that made the motion.
pub(super) struct ModelInfo {
    pub(super) name: String,
    /// Frames from one keyframe to the next.
    pub(super) stride: usize,
}

/// A record of how every frame was made.
#[derive(Default)]
pub(super) struct Record {
    /// Parts of the codes, in order.
    pub(super) parts: Vec<CodedPart>,
    /// Names of the kinds of tokens.
    pub(super) kinds: &'static [&'static str],
    /// Frames from one frame with codes to the next.
    pub(super) every: usize,
    pub(super) experts: usize,
    pub(super) encoder_layers: usize,
    pub(super) decoder_layers: usize,
    /// First frame of each chunk, and the number of frames that it completed.
    pub(super) chunks: Vec<(usize, usize)>,
    /// One list per code of a keyframe, levels ascending within a part; each holds all frames with codes.
    pub(super) codes: Vec<Vec<u16>>,
    /// `[chunks, layers, kinds, experts]`.
    pub(super) routed: Vec<u32>,
}

/// A part that has codes.
pub(super) struct CodedPart {
    pub(super) name: String,
    pub(super) levels: usize,
    /// Number of codes in each level.
    pub(super) codes: usize,
}

/// Properties of a live page that are known before its stream begins.
#[derive(Clone)]
pub(super) struct LiveInfo {
    /// Upper bound on the future audio that a frame needs.
    pub(super) algorithmic_seconds: f64,
    /// Pose shown before the first frame.
    pub(super) rest: Pose,
    pub(super) rest_face: Vec<f32>,
    /// Whether a mouth can move with the sound.
    pub(super) has_mouth: bool,
    /// Requested timing of the mouth, if any.
    pub(super) voice: Option<&'static str>,
    /// Engine in the page itself; `None` if a program serves the streams.
    pub(super) engine: Option<PageEngine>,
}

/// An engine in the browser; its addresses are relative to the page.
#[derive(Clone, Debug, Serialize)]
pub(super) struct PageEngine {
    /// Module of the package `umo-web`.
    pub(super) package: &'static str,
    pub(super) model: &'static str,
    pub(super) precision: &'static str,
    /// Options for the package's sessions.
    pub(super) session: serde_json::Value,
    /// Ids of `umo_parameter`, with values.
    pub(super) parameters: Vec<(u32, f32)>,
}

impl Scene {
    /// Animates a recording.
    pub(super) fn of_speech(path: &Path, args: &Page) -> Result<Self, Failure> {
        let speech = Speech::open(path, args.repair)?;
        check_length(path, speech.seconds())?;
        let wearer = wearer(&args.shown)?;
        let generator = Generator::new(&args.generate, &args.compute, model::open(args.compute.model.as_deref())?)?;
        let config = generator.model.config();
        let mut animation = generator.animation("audio_to_motion", None)?;
        animation.keep_record(config);
        let frames = generator.hear(&mut animation, &speech)?;
        let script = Script::begin(&args.words, &speech, &mut animation)?;
        let mut record = Record::new(config);
        let clip = generator.clip(&mut animation, frames, script, |animation| record.keep(animation))?;
        record.cut(frames);
        let mut scene = Self::worn_by(path, clip, wearer, args.shown.figure.unwrap_or_default())?;
        scene.audio = Some(Audio::new(&speech)?);
        scene.record = Some(record);
        scene.set_model(config, &generator.avatar());
        Ok(scene)
    }

    /// Reads a finished animation.
    pub(super) fn of_animation(path: &Path, args: &Page) -> Result<Self, Failure> {
        // A file not written by umo may be a character with an animation, with umo's joint names or others.
        let is_own = || umo_core_rig::glb::read(path).is_ok_and(|bytes| is_written_here(&bytes));
        let mut scene = match import::members(path) {
            Err(_) if args.shown.onto.is_none() && is_character(path) => Self::of_character(path, args)?,
            Ok(_) if args.shown.onto.is_none() && is_character(path) && !is_own() => Self::of_character(path, args)?,
            Ok(members) if members.len() > 1 => return Self::of_members(path, members, args),
            Ok(mut members) => {
                let clip = members.swap_remove(0).clip;
                check_length(path, clip.len() as f64 / f64::from(clip.frame_rate))?;
                Self::worn_by(path, clip, wearer(&args.shown)?, args.shown.figure.unwrap_or_default())?
            }
            Err(problem) => return Err(problem),
        };
        match &args.audio[..] {
            [] => Ok(scene),
            [speech] => {
                scene.audio = Some(Audio::new(&Speech::open(speech, args.repair)?)?);
                Ok(scene)
            }
            several => {
                Err(Failure::input(format!("{}: one motion, but --audio {} times", path.display(), several.len())))
            }
        }
    }

    /// Returns the members of a conversation that was read.
    fn of_members(path: &Path, members: Vec<import::Member>, args: &Page) -> Result<Self, Failure> {
        if args.shown.onto.is_some() {
            let problem = "the members of a conversation wear figures: `umo retarget` writes a character for each";
            return Err(Failure::input(format!("{}: {problem}", path.display())));
        }
        let mut figures: Vec<Figure> = Vec::new();
        let mut room = Vec::with_capacity(members.len());
        let sounds = sounds(path, members.len(), args)?;
        for (member, audio) in members.into_iter().zip(sounds) {
            let figure = args.shown.figure.or(member.figure).unwrap_or_default();
            let known = figures.iter().position(|own| *own == figure);
            let figure = known.unwrap_or_else(|| {
                figures.push(figure);
                figures.len() - 1
            });
            let place = Place { position: member.position, facing: member.facing, ..Place::default() };
            room.push(RoomMember { name: member.name, place, figure, audio, clip: member.clip });
        }
        Self::of_room(path, room, &figures)
    }

    /// Returns a page whose frames come later, from a stream.
    pub(super) fn of_stream(page: &StreamPage, character: Option<Worn>) -> Result<Self, Failure> {
        let config = page.model.config();
        let (path, clip) = (Path::new(&page.title), config.clip());
        let mut scene = match character {
            Some(worn) => Self { character: Some(worn), ..Self::plain(path, clip) },
            None => Self::new(path, clip, page.figure)?,
        };
        scene.live = Some(page.live.clone());
        scene.set_model(config, &page.session.avatar);
        Ok(scene)
    }

    /// Returns the members of a conversation with their clips.
    pub(super) fn of_conversation(
        members: &[Member],
        names: &[String],
        clips: Vec<Clip>,
        figures: &[Figure],
    ) -> Result<Self, Failure> {
        let figures = &figures[..figures.len().min(clips.len())];
        let (mut room, mut people, mut clips) = (Vec::new(), Vec::new(), clips.into_iter());
        for (member, name) in members.iter().zip(names.iter().cloned()) {
            let (place, audio) = (member.place, Audio::of_voice(&member.voice)?);
            match if member.is_person { None } else { clips.next() } {
                None => people.push(Person { name, place, audio }),
                Some(clip) => {
                    room.push(RoomMember { name, place, figure: room.len() % figures.len(), clip, audio });
                }
            }
        }
        Ok(Self { people, ..Self::of_room(Path::new(&names.join(", ")), room, figures)? })
    }

    /// Returns a room with these figures.
    pub(super) fn of_room(path: &Path, room: Vec<RoomMember>, figures: &[Figure]) -> Result<Self, Failure> {
        let first = &room[0].clip;
        check_length(path, first.len() as f64 / f64::from(first.frame_rate))?;
        let no_frames = Clip::new(first.frame_rate, first.skeleton.clone(), first.face.clone());
        let mut scene = Self::new(path, no_frames, figures[0])?;
        scene.other_meshes = figures[1..].iter().map(|&figure| mesh(figure, first)).collect::<Result<_, _>>()?;
        Ok(Self { room, ..scene })
    }

    /// Reads a character's file with its animation.
    fn of_character(path: &Path, args: &Page) -> Result<Self, Failure> {
        let worn = Wearer::read(path, args.shown.mapping.as_deref())?.own_motion()?;
        check_length(path, worn.seconds)?;
        let mut scene = Self::plain(path, still());
        scene.character = Some(worn);
        Ok(scene)
    }

    /// Returns a motion on a character, or on the figure.
    pub(super) fn worn_by(path: &Path, clip: Clip, wearer: Option<Wearer>, figure: Figure) -> Result<Self, Failure> {
        match wearer {
            Some(wearer) => Ok(Self { character: Some(wearer.wear(&clip)?), ..Self::plain(path, clip) }),
            None => Self::new(path, clip, figure),
        }
    }

    pub(super) fn new(path: &Path, clip: Clip, figure: Figure) -> Result<Self, Failure> {
        Ok(Self { mesh: mesh(figure, &clip)?, ..Self::plain(path, clip) })
    }

    /// Returns a scene with neither figure nor character.
    fn plain(path: &Path, clip: Clip) -> Self {
        Self {
            title: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
            notice: String::new(),
            about: concat!("umo ", env!("CARGO_PKG_VERSION")).to_owned(),
            mesh: Mesh::default(),
            character: None,
            clip,
            audio: None,
            model: None,
            record: None,
            live: None,
            judge: None,
            room: Vec::new(),
            people: Vec::new(),
            other_meshes: Vec::new(),
            takes: None,
        }
    }

    /// Returns the number of frames that the page shows.
    pub(super) fn frames(&self) -> usize {
        let rate = f64::from(self.clip.frame_rate);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a length that was checked")]
        let worn = |worn: &Worn| (worn.seconds * rate).round() as usize + 1;
        match self.room.first() {
            Some(member) => member.clip.len(),
            None if self.clip.is_empty() => self.character.as_ref().map_or(0, worn),
            None => self.clip.len(),
        }
    }

    pub(super) fn set_model(&mut self, config: &Config, avatar: &AvatarConfig) {
        let sampler = &avatar.sampler;
        let is_greedy = sampler.sampling.temperature == 0.0;
        let draw = if is_greedy { "greedy".to_owned() } else { format!("seed {}", sampler.seed) };
        self.about += &format!(
            " · model {} · {} keyframes a chunk, one every {} frames · {} frames held back · {draw}",
            config.name, avatar.target, config.keyframe_stride, avatar.lookahead
        );
        self.notice = config.notice.clone().unwrap_or_default();
        self.model = Some(ModelInfo { name: config.name.clone(), stride: config.keyframe_stride });
    }
}

/// Returns the figure's mesh for clips like this.
fn mesh(figure: Figure, clip: &Clip) -> Result<Mesh, Failure> {
    let mesh = figure.mesh(&clip.skeleton)?;
    Ok(if clip.face.kind == FaceKind::Arkit { mesh } else { mesh.on_the_jaw() })
}

/// Returns the character that is to wear the motion, if requested.
pub(super) fn wearer(args: &Shown) -> Result<Option<Wearer>, Failure> {
    args.onto.as_deref().map(|onto| Wearer::read(onto, args.mapping.as_deref())).transpose()
}

/// Whether a `.glb` file was generated by umo, as opposed to a character with an added animation; also true if
/// the file has no meshes.
fn is_written_here(bytes: &[u8]) -> bool {
    #[derive(Default, serde::Deserialize)]
    #[serde(default)]
    struct Made {
        asset: Asset,
        meshes: Vec<serde::de::IgnoredAny>,
    }
    #[derive(Default, serde::Deserialize)]
    #[serde(default)]
    struct Asset {
        generator: String,
    }
    let made = Glb::split(bytes).ok().and_then(|file| serde_json::from_str::<Made>(file.json).ok());
    made.is_some_and(|made| made.asset.generator.starts_with("umo ") || made.meshes.is_empty())
}

/// Returns a clip without frames, for a character whose motion is in its own file.
fn still() -> Clip {
    Clip {
        frame_rate: 30.0,
        skeleton: umo_figure::sample::skeleton(),
        face: Face { kind: FaceKind::Arkit, names: Vec::new() },
        rotations: Vec::new(),
        translation: Vec::new(),
        face_values: Vec::new(),
    }
}

pub(super) fn check_length(path: &Path, seconds: f64) -> Result<(), Failure> {
    if seconds <= MAX_SECONDS {
        return Ok(());
    }
    let problem = format!("{seconds:.0} s are too long for a page: at most {MAX_SECONDS:.0}; cut it");
    Err(Failure::input(format!("{}: {problem}", path.display())))
}

/// Returns the sound of each member of a conversation: silence, a recording for each, or a channel for each of one.
fn sounds(path: &Path, members: usize, args: &Page) -> Result<Vec<Audio>, Failure> {
    let sounds: Vec<Audio> = match &args.audio[..] {
        [] => return Ok(vec![Audio { sample_rate: 8000, samples: Vec::new() }; members]),
        [one] => Voice::channels(one, args.repair)?.iter().map(Audio::of_voice).collect::<Result<_, _>>()?,
        several => {
            let open = |speech| Audio::new(&Speech::open(speech, args.repair)?);
            several.iter().map(|speech| open(speech)).collect::<Result<_, _>>()?
        }
    };
    match sounds.len() == members {
        true => Ok(sounds),
        false => {
            let problem = "expected --audio for each, or one with a channel for each";
            let (count, path) = (sounds.len(), path.display());
            Err(Failure::input(format!("{path}: {members} members, but {count} voices: {problem}")))
        }
    }
}

impl Audio {
    /// Converts the voice of a member.
    fn of_voice(voice: &Voice) -> Result<Self, Failure> {
        let rate = voice.sample_rate().min(MAX_RATE);
        Ok(Self::of(rate, &voice.mono(rate)?))
    }

    /// Mixes a recording's channels to mono, in 16 bits.
    pub(super) fn new(speech: &Speech) -> Result<Self, Failure> {
        let sample_rate = speech.sample_rate().min(MAX_RATE);
        Ok(Self::of(sample_rate, &speech.mono(sample_rate)?))
    }

    /// Converts mono samples to 16 bits.
    #[expect(clippy::cast_possible_truncation, reason = "clamped to the range of 16 bits; a rate is at most 48,000")]
    pub(super) fn of(sample_rate: usize, samples: &[f32]) -> Self {
        let whole = |&sample: &f32| (sample * 32768.0).round().clamp(-32768.0, 32767.0) as i16;
        Self { sample_rate: sample_rate as u32, samples: samples.iter().map(whole).collect() }
    }
}

impl Record {
    fn new(config: &Config) -> Self {
        let part = |part: PartSpec| CodedPart { name: part.name, levels: part.levels, codes: part.codes };
        Self {
            parts: config.part_list().into_iter().map(part).collect(),
            kinds: kind_names(config),
            // In layout `frames`, only keyframes have codes.
            every: if config.is_frames() { config.keyframe_stride } else { 1 },
            codes: vec![Vec::new(); config.codes_per_keyframe()],
            experts: config.lm.experts,
            encoder_layers: config.lm.num_layers,
            decoder_layers: config.lm.num_decoder_layers,
            ..Self::default()
        }
    }

    fn keep(&mut self, animation: &Animation) {
        let Some(chunk) = animation.chunk() else { return };
        self.chunks.push((chunk.first_frame, chunk.frames));
        let places = self.codes.len();
        for (place, codes) in self.codes.iter_mut().enumerate() {
            codes.extend(chunk.keyframes.iter().skip(place).step_by(places));
        }
        // Empty in layout `frames`.
        for (codes, part) in self.codes.iter_mut().zip(Part::ALL) {
            codes.extend_from_slice(chunk.codes[part]);
        }
        self.routed.extend_from_slice(chunk.tally.counts());
    }

    /// Drops the codes after the end.
    fn cut(&mut self, frames: usize) {
        for codes in &mut self.codes {
            codes.truncate(frames.div_ceil(self.every));
        }
        for (first, count) in &mut self.chunks {
            *count = (*count).min(frames.saturating_sub(*first));
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
