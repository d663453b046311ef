//! `umo converse`: recordings of one conversation to avatars that see and hear each other.
//!
//! | module | part |
//! |---|---|
//! | `voice` | what a member says: a recording, or a channel of one |
//! | `crosstalk` | other members' voices in a channel |
//! | `place` | where the members stand |

mod crosstalk;
pub(crate) mod place;
mod voice;

use std::collections::HashSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use umo_core::{
    Config, Engine, EngineConfig, MAX_BATCH, MAX_MEMBERS, Model, Mood, Place, Poll, Scene, SceneError, Session,
    SessionConfig, Threads, WordRules,
};
use umo_core_base::file::AtomicFile;
use umo_core_pose::clip::Clip;
use umo_gltf::glb::{self, BuiltFigure};

use crate::args::{Converse, GenerateArgs};
use crate::export::{self, Format};
use crate::failure::Failure;
use crate::speech::Speech;
use crate::words::Script;
use crate::{animate, atomic_file, model, progress, view, words};
use place::eye_height;
use voice::Feed;
pub(crate) use voice::Voice;

/// Stands for the words of an avatar that has none.
const NO_WORDS: &str = "-";
/// Fewest members of a conversation.
const LEAST: usize = 2;

/// A member of a conversation.
pub(crate) struct Member {
    pub(crate) voice: Voice,
    pub(crate) place: Place,
    pub(crate) seed: u64,
    pub(crate) prompt: Option<String>,
    pub(crate) mood: Option<(Mood, f32)>,
    /// Words, and their rules.
    pub(crate) words: Option<(Script, WordRules)>,
    /// Whether it is a person, who has no avatar.
    pub(crate) is_person: bool,
}

impl Member {
    pub(crate) fn new(voice: Voice, place: Place, seed: u64) -> Self {
        Self { voice, place, seed, prompt: None, mood: None, words: None, is_person: false }
    }
}

/// Animates a conversation and writes every output.
pub(crate) fn run(args: &Converse) -> Result<(), Failure> {
    let start = Instant::now();
    refuse_alone(&args.generate)?;
    if args.channels.is_none() {
        check_count(args.speech.len() + args.person.len())?;
    }
    let voices = voices(args)?;
    check_count(voices.len())?;
    let persons = persons(args, voices.len())?;
    let avatars = persons.iter().filter(|is_person| !**is_person).count();
    let places = place::places(args.places.as_deref(), voices.len())?;
    let names = names(args, voices.len());
    let outputs = Outputs::new(&args.output, avatars)?;
    check_turns(args, avatars)?;
    let mut members: Vec<Member> = Vec::with_capacity(voices.len());
    for (index, ((voice, place), is_person)) in voices.into_iter().zip(places).zip(persons).enumerate() {
        let member = Member::new(voice, place, args.generate.seed.wrapping_add(index as u64));
        members.push(Member { is_person, ..member });
    }
    give_words(args, members.iter_mut().filter(|member| !member.is_person))?;
    let model = model::load(&args.compute)?;
    outputs.check(&model)?;
    let frames = frames(&members, model.config().frame_rate)?;
    let bar = progress::frames(frames);
    let threads = model::threads(&args.compute)?;
    let clips = perform(&model, threads, &args.generate, &mut members, |done| bar.set_position(done as u64))?;
    bar.finish_and_clear();
    outputs.write(args, &members, &names, clips)?;
    let written: Vec<_> = args.output.iter().map(|path| path.display().to_string()).collect();
    let (seconds, took) = (frames as f64 / model.config().frame_rate as f64, start.elapsed().as_secs_f64());
    println!("{}: {} members, {frames} frames, {seconds:.2} s, made in {took:.2} s", written.join(", "), names.len());
    Ok(())
}

/// Refuses settings of a single avatar's motion.
pub(crate) fn refuse_alone(args: &GenerateArgs) -> Result<(), Failure> {
    let set = [
        ("--start-pose", args.start_pose.is_some()),
        ("--gesture", !args.gesture.is_empty()),
        ("--gesture-clip", !args.gesture_clip.is_empty()),
    ];
    match set.iter().find(|(_, is_set)| *is_set) {
        Some((option, _)) => Err(Failure::Input(format!("{option} does not go with a conversation"))),
        None => Ok(()),
    }
}

/// Refuses too few or too many members.
pub(crate) fn check_count(members: usize) -> Result<(), Failure> {
    match (LEAST..=MAX_MEMBERS).contains(&members) {
        true => Ok(()),
        false => {
            let problem = format!("a conversation has {LEAST} to {MAX_MEMBERS} members, this one {members}");
            Err(Failure::Input(problem))
        }
    }
}

fn voices(args: &Converse) -> Result<Vec<Voice>, Failure> {
    match &args.channels {
        Some(path) => Voice::channels(path, args.repair),
        None => recordings(args).map(|path| Ok(Voice::Recording(Box::new(Speech::open(path, args.repair)?)))).collect(),
    }
}

/// The recordings, in the order of the members.
fn recordings(args: &Converse) -> impl Iterator<Item = &PathBuf> {
    args.speech.iter().chain(&args.person)
}

/// Which of the members are persons.
fn persons(args: &Converse, members: usize) -> Result<Vec<bool>, Failure> {
    let mut persons = vec![false; members];
    match args.channels {
        None => persons[args.speech.len()..].fill(true),
        Some(_) => {
            for given in &args.person {
                let number = given.to_str().and_then(|text| text.parse::<usize>().ok()?.checked_sub(1));
                let person = number.and_then(|number| persons.get_mut(number)).ok_or_else(|| {
                    Failure::Input(format!("--person {}: expected a channel, 1 to {members}", given.display()))
                })?;
                *person = true;
            }
        }
    }
    match persons.contains(&false) {
        true => Ok(persons),
        false => Err(Failure::input("all members are persons: a conversation needs an avatar")),
    }
}

/// Refuses prompts and words that do not go with the number of avatars.
fn check_turns(args: &Converse, avatars: usize) -> Result<(), Failure> {
    if !args.words.is_empty() && args.words.len() != avatars {
        let problem = "expected --words for each, - for one without";
        return Err(Failure::Input(format!("{} --words for {avatars} avatars: {problem}", args.words.len())));
    }
    match args.prompt.len() {
        0 | 1 => Ok(()),
        count if count == avatars => Ok(()),
        count => {
            Err(Failure::Input(format!("{count} --prompt for {avatars} avatars: expected one of all, or of each")))
        }
    }
}

/// Gives each avatar its prompt and its words.
fn give_words<'a>(args: &Converse, avatars: impl Iterator<Item = &'a mut Member>) -> Result<(), Failure> {
    let rules = words::rules(&args.rules)?;
    for (avatar, member) in avatars.enumerate() {
        member.prompt = args.prompt.get(avatar).or(args.prompt.first()).cloned();
        let words = args.words.get(avatar).filter(|path| path.as_os_str() != NO_WORDS);
        let script = words.map(|path| member.voice.script(path, &rules)).transpose()?;
        member.words = script.map(|script| (script, rules.clone()));
    }
    Ok(())
}

/// Different names of the members: those of their files, or the numbers of their channels.
fn names(args: &Converse, members: usize) -> Vec<String> {
    let mut taken = HashSet::new();
    let name = |member: usize| {
        let recording = if args.channels.is_none() { recordings(args).nth(member) } else { None };
        let stem = recording.and_then(|path| path.file_stem());
        let own = stem.map_or_else(|| format!("channel-{}", member + 1), |stem| stem.to_string_lossy().into_owned());
        let numbered = (2..).map(|number| format!("{own}-{number}"));
        let mut candidates = std::iter::once(own.clone()).chain(numbered);
        candidates.find(|name| taken.insert(name.clone())).unwrap_or(own)
    };
    (0..members).map(name).collect()
}

/// Length of a conversation in frames.
fn frames(members: &[Member], rate: usize) -> Result<usize, Failure> {
    let longest = members.iter().map(|member| member.voice.frames(rate)).max();
    longest.filter(|&frames| frames > 0).ok_or_else(|| Failure::input("a conversation needs a frame of audio"))
}

/// Animates the members together, to the end of the longest recording; returns a clip of each that has an avatar, all of
/// one length. Calls `look` with the number of finished frames.
///
/// Every frame, the scene hears what each member has just said, and the members' next frames follow from it. So the
/// result depends on neither threads nor time.
pub(crate) fn perform(
    model: &Arc<Model>,
    threads: usize,
    args: &GenerateArgs,
    members: &mut [Member],
    mut look: impl FnMut(usize),
) -> Result<Vec<Clip>, Failure> {
    let config = model.config();
    let frames = frames(members, config.frame_rate)?;
    let avatars = members.iter().filter(|member| !member.is_person).count();
    let engine = EngineConfig {
        threads: Threads::Host(threads - 1),
        max_sessions: avatars,
        max_batch: avatars.clamp(1, MAX_BATCH),
        ..EngineConfig::default()
    };
    let engine = Engine::new(Arc::clone(model), &engine).map_err(Failure::input)?;
    let with_avatar = members.iter().filter(|member| !member.is_person);
    let sessions: Vec<Session> = with_avatar.map(|member| session(&engine, args, member)).collect::<Result<_, _>>()?;
    let scene = Scene::new(members.first().map_or(0, |member| member.seed)).map_err(Failure::environment)?;
    let eye_height = eye_height(&config.skeleton);
    let rate = config.audio.sample_rate;
    let (mut feeds, mut people, mut bodies) = (Vec::with_capacity(avatars), Vec::new(), sessions.iter());
    for member in &mut *members {
        let script = member.words.take().map_or_else(Script::default, |(script, _)| script);
        let body = if member.is_person { None } else { bodies.next() };
        let id = scene.add(body, Place { eye_height, ..member.place })?;
        let feed = member.voice.feed(rate)?;
        if member.is_person { people.push((id, feed)) } else { feeds.push((feed, script)) }
    }
    let mut room = Performance { scene, sessions: &sessions, people, clips: vec![config.clip(); avatars] };
    let mut pushed = 0;
    for frame in 1..=frames {
        let until = (frame * rate).div_ceil(config.frame_rate);
        for (session, (feed, script)) in sessions.iter().zip(&mut feeds) {
            script.give(|text, start, end| session.hint_words(text, start, end))?;
            let taken = session.push_audio(feed.take(until - pushed)?).map_err(Failure::environment)?.taken;
            if taken < until - pushed {
                return Err(Failure::environment("internal: a session's audio is full"));
            }
            if frame == frames {
                session.finish().map_err(Failure::environment)?;
            }
        }
        pushed = until;
        room.go_on(&engine)?;
        look(room.clips[0].len());
    }
    match room.clips.iter().all(|clip| clip.len() == frames) {
        true => Ok(room.clips),
        false => Err(Failure::environment("internal: the conversation ended early")),
    }
}

/// A conversation as it goes on.
struct Performance<'a> {
    scene: Scene<&'a Session>,
    sessions: &'a [Session],
    /// Number and voice of each person.
    people: Vec<(u32, Feed<'a>)>,
    /// The sessions' frames so far.
    clips: Vec<Clip>,
}

impl Performance<'_> {
    /// Computes what is due, and pulls a frame of each session after the other while all have one.
    fn go_on(&mut self, engine: &Engine) -> Result<(), Failure> {
        loop {
            while engine.poll(Duration::MAX).map_err(Failure::environment)? != Poll::Idle {}
            let ready = self.sessions.iter().map(Session::ready_frames).collect::<Result<Vec<_>, _>>();
            let ready = ready.map_err(Failure::environment)?.into_iter().min().unwrap_or(0);
            if ready == 0 {
                return Ok(());
            }
            (0..ready).try_for_each(|_| self.pull(engine.model().config()))?;
        }
    }

    fn pull(&mut self, config: &Config) -> Result<(), Failure> {
        self.scene.update(1.0 / config.frame_rate as f64)?;
        let shown = self.clips[0].len();
        for (session, clip) in self.sessions.iter().zip(&mut self.clips) {
            session.pull_frames(1, |frame| clip.push(frame.pose, frame.face)).map_err(Failure::environment)?;
        }
        // As of the sessions, the next update hears the frame that was shown.
        let until = |frame: usize| (frame * config.audio.sample_rate).div_ceil(config.frame_rate);
        for (id, voice) in &mut self.people {
            self.scene.push_audio(*id, voice.take(until(shown + 1) - until(shown))?)?;
        }
        Ok(())
    }
}

/// Returns a member's session.
fn session(engine: &Engine, args: &GenerateArgs, member: &Member) -> Result<Session, Failure> {
    let config = engine.model().config();
    // The whole recording is available, so a longer horizon costs nothing.
    let mut avatar = animate::avatar(args, config, config.audio.ahead);
    if !args.greedy {
        avatar.sampler.seed = member.seed;
    }
    let words = member.words.as_ref().map(|(_, rules)| rules.clone()).unwrap_or_default();
    let set = SessionConfig { avatar, layers: animate::layers(args), words, ..SessionConfig::new(config) };
    let session = engine.session(&set).map_err(Failure::input)?;
    if let Some(text) = &member.prompt {
        session.set_prompt(&animate::prompt(engine.model(), text)?).map_err(Failure::input)?;
    }
    if let Some((mood, strength)) = member.mood {
        session.set_mood(mood, strength).map_err(Failure::input)?;
    }
    Ok(session)
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::Session(_) | SceneError::Busy => Self::environment(error),
            error => Self::input(error),
        }
    }
}

/// Files to write.
struct Outputs {
    /// .glb files of all members.
    rooms: Vec<AtomicFile>,
    /// Pages of all members.
    pages: Vec<AtomicFile>,
    /// A file of each avatar, or none.
    each: Vec<(Format, export::Output)>,
}

impl Outputs {
    /// Opens the outputs.
    fn new(paths: &[PathBuf], avatars: usize) -> Result<Self, Failure> {
        let is = |path: &Path, known: &str| path.extension().is_some_and(|own| own.eq_ignore_ascii_case(known));
        let (pages, files): (Vec<&PathBuf>, Vec<_>) = paths.iter().partition(|path| is(path, "html"));
        let is_room = matches!(&files[..], [one] if is(one, "glb"));
        let (rooms, each) = if is_room { (files, Vec::new()) } else { (Vec::new(), files) };
        if !each.is_empty() && each.len() != avatars {
            let problem = format!("{} outputs for {avatars} avatars: expected one for each", each.len());
            return Err(Failure::Input(format!("{problem}, or a single .glb or .html of all")));
        }
        let open = |path: &&PathBuf| {
            let format = Format::from_extension(path)?;
            Ok((format, export::Output::create(path, format)?))
        };
        Ok(Self {
            rooms: rooms.into_iter().map(|path| atomic_file::create(path)).collect::<Result<_, _>>()?,
            pages: pages.into_iter().map(|path| atomic_file::create(path)).collect::<Result<_, _>>()?,
            each: each.iter().map(open).collect::<Result<_, Failure>>()?,
        })
    }

    /// Refuses formats that the model's face does not fit.
    fn check(&self, model: &Model) -> Result<(), Failure> {
        self.each.iter().try_for_each(|(format, _)| Ok(format.check_face(&model.config().face)?))
    }

    fn write(self, args: &Converse, members: &[Member], names: &[String], clips: Vec<Clip>) -> Result<(), Failure> {
        let with_avatar: Vec<(&Member, &String)> =
            members.iter().zip(names).filter(|(member, _)| !member.is_person).collect();
        let figure = |member: usize| args.figure[member % args.figure.len()];
        for (member, ((_, output), clip)) in self.each.into_iter().zip(&clips).enumerate() {
            output.write(clip, figure(member)).map_err(Failure::environment)?;
        }
        if !self.rooms.is_empty() {
            let built = args.figure.iter().take(clips.len());
            let built = built.map(|figure| BuiltFigure::new(*figure, &clips[0])).collect::<Result<Vec<_>, _>>();
            let built = built.map_err(Failure::environment)?;
            let member = |at: usize| {
                let (member, name) = with_avatar[at];
                let Place { position, facing, .. } = member.place;
                let figure = Some(&built[at % built.len()]);
                glb::Member { name: name.as_str(), clip: &clips[at], figure, position, facing }
            };
            let room: Vec<glb::Member> = (0..clips.len()).map(member).collect();
            for output in self.rooms {
                atomic_file::commit(output, |out| glb::write_room(&room, out))?;
            }
        }
        if !self.pages.is_empty() {
            let html = view::conversation(members, names, clips, &args.figure)?;
            for output in self.pages {
                atomic_file::commit(output, |out| out.write_all(html.as_bytes()))?;
            }
        }
        Ok(())
    }
}
