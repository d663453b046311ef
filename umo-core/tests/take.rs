//! Takes: players show the recorded bits, layers and requests included; damaged takes are refused.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use umo_core::{
    Animation, Attention, AvatarConfig, Compute, Edit, EditError, Engine, EngineConfig, Event, GestureOptions,
    Gestures, Isa, Layer, LayerGains, LipShape, Model, ModelFile, Mood, PacketConfig, Poll, Precision, Session,
    SessionConfig, SessionError, Take, TakeError, Team, Threads, Voice, WordRules,
};
use umo_core_stream::animation::Group;

const PEOPLE: &str = "../models/umo-people/model.safetensors";
const SMALL: [&str; 2] =
    ["../tests/golden/mel_k2_arkit/model.safetensors", "../tests/golden/frames_seven/model.safetensors"];

fn open(path: &str) -> Arc<Model> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    Arc::new(Model::load(&ModelFile::open(&path).unwrap(), Precision::Stored, Isa::detect()).unwrap())
}

/// Syllables of a tone, louder and softer, with pauses.
fn speech(rate: usize, seconds: usize) -> Vec<f32> {
    let syllable = |i: usize| {
        let phrase = if i / rate % 3 == 2 { 0.0 } else { 0.1 + 0.2 * ((i / 5000) % 3) as f32 };
        if i % 4000 < 2500 { (i as f32 * 0.06).sin() * phrase } else { 0.0 }
    };
    (0..seconds * rate).map(syllable).collect()
}

/// Bits of a frame.
type Bits = (Vec<u32>, [u32; 3], Vec<u32>);

fn bits(rotations: &[[f32; 4]], place: [f32; 3], face: &[f32]) -> Bits {
    let all = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect();
    (all(rotations.as_flattened()), place.map(f32::to_bits), all(face))
}

/// Settings unlike the defaults.
fn avatar(model: &Model) -> AvatarConfig {
    let mut avatar = SessionConfig::new(model.config()).avatar;
    avatar.sampler.seed = 11;
    avatar.sampler.expression = 0.9;
    avatar
}

/// Records four seconds, in which the host asks for all kinds of things; returns the take and the frames.
fn record(model: &Model, gains: LayerGains, history: bool) -> (Take, Vec<Bits>) {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let mut animation = Animation::with_layers(model, &avatar(model), gains, Gestures::new()).unwrap();
    if history {
        animation.avatar_mut().set_history(&vec![1; 2 * model.config().codes_per_keyframe()]).unwrap();
    }
    animation.record(model).unwrap();
    animation.push_audio(&speech(model.config().audio.sample_rate, 4)).unwrap();
    animation.finish(118);
    animation.play_gesture("wave", &GestureOptions::default().at(1.5).strength(0.8)).unwrap();
    animation.hint_words("No, never!", 0.2, 0.9).unwrap();
    let (mut frames, mut steps) = (Vec::new(), 0);
    while animation
        .step(model, cx, &mut |frame| frames.push(bits(&frame.pose.rotations, frame.pose.translation, frame.face)))
        .unwrap()
    {
        match steps {
            0 => animation.set_mood(Mood::Joy, 0.7).unwrap(),
            1 => animation.hint_lips(LipShape::Round, 2.013, 0.2).unwrap(),
            2 => animation.hint_words("you and I, one, two, three", 2.6, 3.8).unwrap(),
            3 => {
                let point = GestureOptions::default().target([0.5, 1.0, 2.0]).variant(3);
                animation.play_gesture("point", &point).unwrap();
            }
            _ => {}
        }
        steps += 1;
    }
    assert_eq!(frames.len(), 118);
    (animation.take().unwrap(), frames)
}

fn play(session: &Session) -> Vec<Bits> {
    let mut frames = Vec::new();
    while !session.is_done().unwrap() {
        session.push_take().unwrap();
        // A few at a time, and more packets than there is room for.
        session
            .pull_frames(7, |frame| frames.push(bits(&frame.pose.rotations, frame.pose.translation, frame.face)))
            .unwrap();
    }
    frames
}

#[test]
fn a_take_plays_the_bits_that_were_recorded() {
    for (path, gains, history) in [
        (SMALL[0], LayerGains::ON, false),
        (SMALL[1], LayerGains::ON, false),
        (SMALL[1], LayerGains::OFF, true),
        (PEOPLE, LayerGains::ON, false),
    ] {
        let model = open(path);
        let (take, frames) = record(&model, gains, history);
        let take = Take::new(take.bytes()).unwrap();
        let info = take.info();
        assert_eq!((info.frames, info.samples), (118, 4 * model.config().audio.sample_rate as u64), "{path}");
        assert_eq!(take.packets().count(), info.packets as usize);
        let (own, want) = (take.avatar(), avatar(&model));
        assert_eq!((info.model, own.sampler, &own.template), (model.fingerprint(), want.sampler, &want.template));
        assert_eq!((own.target, own.smoothing), (want.target, want.smoothing));
        let session = Session::of_take(&model, &take, &SessionConfig::new(model.config())).unwrap();
        assert!(play(&session) == frames, "{path}");
        // Anew, whatever the host has changed meanwhile.
        session.set_mood(Mood::Angry, 1.0).unwrap();
        session.reset().unwrap();
        assert!(play(&session) == frames, "{path}: again");
        assert_eq!(session.push_packet(&[0; 40]), Err(SessionError::Take));
        // The host of the take is not the only one that is heard.
        session.reset().unwrap();
        session.look_at([2.0, 1.0, 1.0], 1.0).unwrap();
        assert!(gains.is_off() || play(&session) != frames, "{path}: looks elsewhere");
    }
}

/// Recordings of a group that are longer and shorter, begin at other times and ask for other things.
#[test]
fn animations_of_a_group_record_the_bytes_that_each_has_alone() {
    let model = open(SMALL[1]);
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let animation = |number: u32| {
        let mut avatar = avatar(&model);
        avatar.sampler.seed = number.into();
        let mut animation = Animation::with_layers(&model, &avatar, LayerGains::ON, Gestures::new()).unwrap();
        animation.record(&model).unwrap();
        animation.play_gesture("nod", &GestureOptions::default().at(0.2 * f64::from(number))).unwrap();
        animation.push_audio(&speech(model.config().audio.sample_rate, 1 + number as usize)).unwrap();
        animation.finish(30 * (1 + number as usize) - 1);
        animation
    };
    let alone: Vec<Take> = (0..4)
        .map(|number| {
            let mut animation = animation(number);
            animation.hint_words("No, never!", 0.2, 0.9).unwrap();
            while animation.step(&model, cx, &mut |_| {}).unwrap() {}
            animation.take().unwrap()
        })
        .collect();
    let (mut group, mut inside, mut waiting) = (Group::new(&model, 2), Vec::new(), (0..4).rev().collect::<Vec<_>>());
    let mut unrecorded = Group::new(&model, 1);
    unrecorded.add(Animation::new(&model, &avatar(&model)).unwrap());
    assert!(unrecorded.take(0).is_none());
    while !group.is_empty() || !waiting.is_empty() {
        if !group.is_full()
            && let Some(number) = waiting.pop()
        {
            group.add(animation(number));
            inside.push(number as usize);
            group.hint_words(group.len() - 1, "No, never!", 0.2, 0.9).unwrap();
        }
        assert!(group.step(&model, cx, &mut |_, _| {}).unwrap().is_empty());
        for index in (0..group.len()).rev().filter(|&index| group.is_done(&model, index)).collect::<Vec<_>>() {
            let (take, alone) = (group.take(index).unwrap(), &alone[inside.swap_remove(index)]);
            assert!(take.bytes() == alone.bytes() && take.info().packets > 1);
            group.remove(index);
        }
    }
}

#[test]
fn a_take_has_what_its_host_asked_for_in_time() {
    let model = open(SMALL[1]);
    let (take, _) = record(&model, LayerGains::ON, false);
    let events: Vec<_> = take.events().collect();
    let chunk = (model.config().target * model.config().keyframe_stride) as u64;
    assert_eq!(events[1], (0, Event::Words { text: "No, never!", start: 0.2, end: 0.9 }));
    assert!(matches!(events[0], (0, Event::Gesture { name: "wave", options }) if options.at == Some(1.5)));
    assert!(
        matches!(events[2], (frame, Event::Mood { mood: Mood::Joy, strength: 0.7 }) if frame <= chunk && frame > 0)
    );
    assert_eq!(events.len(), 6);
}

/// Every version is read for ever: this file was written by the first.
#[test]
fn a_take_of_the_first_version_is_read() {
    let take = Take::new(include_bytes!("take/version-1.umo")).unwrap();
    let info = take.info();
    assert_eq!((info.version, info.frames, info.packets, info.samples), (1, 45, 5, 24_000));
    assert_eq!((info.frame_rate, take.packets().count()), (30, 5));
    let events: Vec<String> = take.events().map(|(frame, event)| format!("{frame}: {event}")).collect();
    assert_eq!(events, ["0: words `Hello, you and I, all of us.`", "0: gesture `wave`", "0: mood"]);
}

#[test]
fn damaged_takes_are_refused_and_say_why() {
    let model = open(SMALL[1]);
    let (take, _) = record(&model, LayerGains::ON, false);
    let good = take.bytes();
    for at in (0..good.len()).filter(|at| *at < 300 || at % 5 == 0) {
        let mut bytes = good.to_vec();
        bytes[at] ^= 1 << (at % 8);
        assert!(Take::new(&bytes).is_err(), "byte {at}");
        assert!(Take::new(&good[..at]).is_err(), "{at} bytes");
    }
    let refused = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.to_vec();
        change(&mut bytes);
        Take::new(&bytes).unwrap_err()
    };
    assert_eq!(refused(&|bytes| bytes[0] = b'x'), TakeError::Foreign);
    assert_eq!(refused(&|bytes| bytes[8] = 7), TakeError::Version(7));
    assert_eq!(refused(&|bytes| bytes[200] ^= 1), TakeError::Checksum);
    let (got, want) = (good.len() as u64 - 1, good.len() as u64);
    assert_eq!(refused(&|bytes| bytes.truncate(good.len() - 1)), TakeError::Length { got, want });
}

/// With its checksum made right, a take that lies is refused or plays something; nothing panics.
#[test]
fn takes_that_lie_do_no_harm() {
    let model = open(SMALL[1]);
    let (take, _) = record(&model, LayerGains::ON, false);
    lie(&model, &take, |at| at < 200 || at % 7 == 0);
    // Of one that was edited, its edits.
    let model = open(PEOPLE);
    let (take, _) = record(&model, LayerGains::ON, false);
    let events = take.events().filter(|(_, event)| !matches!(event, Event::Mood { .. })).collect();
    let edit = Edit { events: Some(events), windows: std::iter::once(40..90).collect(), ..rest(&model, &take, 12..14) };
    let edits = take.bytes().len();
    lie(&model, &edited(&model, &take, &edit), |at| at >= edits && at % 3 == 0);
}

fn lie(model: &Arc<Model>, take: &Take, lies: impl Fn(usize) -> bool) {
    let (good, config) = (take.bytes(), SessionConfig::new(model.config()));
    let (mut refused, mut played) = (0, 0);
    for at in (24..good.len()).filter(|&at| lies(at)) {
        let mut bytes = good.to_vec();
        bytes[at] = bytes[at].wrapping_add(1 + u8::try_from(at % 251).unwrap());
        let sum = crc32fast::hash(&bytes[16..]);
        bytes[12..16].copy_from_slice(&sum.to_le_bytes());
        let session = Take::new(&bytes).map(|take| Session::of_take(model, &take, &config));
        match session {
            Ok(Ok(session)) if at % 8 == 0 => {
                play(&session);
                played += 1;
            }
            Ok(Ok(_)) => {}
            Ok(Err(_)) | Err(_) => refused += 1,
        }
    }
    assert!(refused > 20 && played > 3, "{refused} {played}");
}

#[test]
fn a_take_of_another_model_is_refused() {
    let (model, other) = (open(SMALL[1]), open(SMALL[0]));
    let (take, _) = record(&model, LayerGains::ON, false);
    assert_eq!(take.check(&other, &Gestures::new(), &WordRules::english()), Err(TakeError::Model));
    let error = Session::of_take(&other, &take, &SessionConfig::new(other.config())).unwrap_err();
    assert!(error.to_string().contains("another model"), "{error}");
}

#[test]
fn a_take_and_retiming_exclude_each_other() {
    let model = open(PEOPLE);
    let mut animation = Animation::new(&model, &avatar(&model)).unwrap();
    assert!(animation.take().is_none());
    animation.retime(&model).unwrap();
    animation.record(&model).unwrap_err();
    let mut animation = Animation::new(&model, &avatar(&model)).unwrap();
    animation.record(&model).unwrap();
    animation.retime(&model).unwrap_err();
}

/// A running session, spoken to in pieces, whose host asks for something before every fifth frame.
fn run(engine: &Engine, session: &Session, rate: usize) -> Vec<Bits> {
    let mut frames: Vec<Bits> = Vec::new();
    let samples = speech(rate, 5);
    for (piece, samples) in samples.chunks(rate / 6).enumerate() {
        session.push_audio(samples).unwrap();
        session.push_other_audio(&vec![if piece % 5 < 2 { 0.1 } else { 0.0 }; rate / 6]).unwrap();
        match piece {
            1 => session.hint_words("we all know", 0.6, 1.4).unwrap(),
            2 => session.play_gesture("wave", &GestureOptions::default().at(2.0)).unwrap(),
            4 => session.set_mood(Mood::Sad, 0.5).unwrap(),
            6 => session.look_at([1.0, 1.5, 1.0], 0.8).unwrap(),
            8 => session.hint_lips(LipShape::Closed, 2.71, 0.1).unwrap(),
            9 => session.set_attention(Attention::Thinking).unwrap(),
            11 => session.set_layer(Layer::Idle, 0.4).unwrap(),
            12 => session.set_expression(0.1).unwrap(),
            13 => session.set_activity(0.9).unwrap(),
            _ => {}
        }
        while engine.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
        session
            .pull_frames(5, |frame| frames.push(bits(&frame.pose.rotations, frame.pose.translation, frame.face)))
            .unwrap();
    }
    session.finish().unwrap();
    while !session.is_done().unwrap() {
        while engine.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
        session
            .pull_frames(5, |frame| frames.push(bits(&frame.pose.rotations, frame.pose.translation, frame.face)))
            .unwrap();
    }
    frames
}

fn taken(session: &Session) -> Take {
    let mut bytes = vec![0; session.take_size().unwrap()];
    assert_eq!(session.take(&mut bytes[1..]), Err(SessionError::Short { needed: bytes.len() }));
    assert_eq!(session.take(&mut bytes), Ok(bytes.len()));
    Take::new(&bytes).unwrap()
}

fn engine(model: &Arc<Model>) -> Engine {
    let config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
    Engine::new(Arc::clone(model), &config).unwrap()
}

#[test]
fn a_session_records_what_it_shows_while_it_runs() {
    for path in SMALL {
        let model = open(path);
        let (engine, rate) = (engine(&model), 24_000);
        let config = SessionConfig {
            avatar: avatar(&model),
            sample_rate: rate,
            take_bytes: 1 << 16,
            ..SessionConfig::new(model.config())
        };
        let session = engine.session(&config).unwrap();
        assert_eq!(taken(&session).info().frames, 0);
        for time in ["first", "after a reset"] {
            let frames = run(&engine, &session, rate);
            let take = taken(&session);
            assert_eq!(take.info().frames as usize, frames.len(), "{path}, {time}");
            let player = Session::of_take(&model, &take, &SessionConfig::new(model.config())).unwrap();
            assert!(play(&player) == frames, "{path}, {time}");
            // Settings from before a reset are in force after it.
            session.reset().unwrap();
        }
        // An interrupt ends the take: later frames ease from it.
        run(&engine, &session, rate);
        let before = taken(&session);
        session.interrupt(Duration::from_millis(300)).unwrap();
        run(&engine, &session, rate);
        assert!(before.bytes() == taken(&session).bytes(), "{path}");
    }
}

#[test]
fn a_take_ends_where_its_memory_ends() {
    let model = open(SMALL[1]);
    let (engine, rate) = (engine(&model), model.config().audio.sample_rate);
    let config = SessionConfig { take_bytes: 900, ..SessionConfig::new(model.config()) };
    let session = engine.session(&config).unwrap();
    let frames = run(&engine, &session, rate);
    let take = taken(&session);
    let count = take.info().frames as usize;
    assert!(count > 10 && count < frames.len(), "{count}");
    let player = Session::of_take(&model, &take, &SessionConfig::new(model.config())).unwrap();
    assert!(play(&player) == frames[..count]);
}

#[test]
fn what_a_take_cannot_say_is_not_recorded() {
    let model = open(PEOPLE);
    let engine = engine(&model);
    let config = SessionConfig { take_bytes: 1000, ..SessionConfig::new(model.config()) };
    let alone = PacketConfig { with_frames: false, ..PacketConfig::new(5) };
    for config in [
        SessionConfig { voice: Voice::Live, ..config.clone() },
        SessionConfig { packets: Some(alone), ..config.clone() },
    ] {
        let error = engine.session(&config).unwrap_err();
        assert!(error.to_string().contains("take_bytes"), "{error}");
    }
    assert!(Session::decoder(&model, &config).unwrap_err().to_string().contains("take_bytes"));
    // Idle motion moves the layers on, outside of the stream's time.
    let idle = engine.session(&SessionConfig { take_bytes: 1 << 16, ..config }).unwrap();
    idle.sample_pose(0.0, |_| ()).unwrap();
    run(&engine, &idle, 16_000);
    assert_eq!(taken(&idle).info().frames, 0);
    let session = engine.session(&SessionConfig::new(model.config())).unwrap();
    assert_eq!((session.take_size(), session.push_take()), (Err(SessionError::NoTake), Err(SessionError::NotDecoder)));
    let decoder = Session::decoder(&model, &SessionConfig::new(model.config())).unwrap();
    assert_eq!(decoder.push_take(), Err(SessionError::Take));
}

/// An edit that lets hands rest in these keyframes.
fn rest(model: &Model, take: &Take, keyframes: std::ops::Range<usize>) -> Edit<'static> {
    let mut phases = take.phases(model).unwrap();
    phases[keyframes].fill(0);
    Edit { phases, ..Edit::default() }
}

fn edited(model: &Model, take: &Take, edit: &Edit) -> Take {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let rate = model.config().audio.sample_rate;
    let take =
        take.edited(model, cx, &speech(rate, usize::try_from(take.info().samples).unwrap() / rate), edit).unwrap();
    Take::new(take.bytes()).unwrap()
}

/// Eight seconds in which the host asks for a gesture and words.
fn long(model: &Model, gains: LayerGains) -> Take {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let mut animation = Animation::with_layers(model, &avatar(model), gains, Gestures::new()).unwrap();
    animation.record(model).unwrap();
    animation.push_audio(&speech(model.config().audio.sample_rate, 8)).unwrap();
    animation.finish(240);
    animation.play_gesture("wave", &GestureOptions::default().at(2.5)).unwrap();
    animation.hint_words("you and I, one, two, three", 4.6, 5.8).unwrap();
    while animation.step(model, cx, &mut |_| ()).unwrap() {}
    animation.take().unwrap()
}

/// Frames that differ from those of the take before, of a take that is played twice.
fn differing(model: &Arc<Model>, before: &Take, after: &Take) -> Vec<usize> {
    let session = |take| Session::of_take(model, take, &SessionConfig::new(model.config())).unwrap();
    let (want, session) = (play(&session(before)), session(after));
    let got = play(&session);
    session.reset().unwrap();
    assert!(play(&session) == got, "once more");
    (0..want.len()).filter(|&at| want[at] != got[at]).collect()
}

#[test]
fn an_edit_changes_its_frames_and_no_other() {
    let model = open(PEOPLE);
    for gains in [LayerGains::ON, LayerGains::OFF] {
        let take = long(&model, gains);
        let phases = take.phases(&model).unwrap();
        // Keyframes of hands that do something.
        let busy = phases.windows(6).position(|run| run.iter().all(|&phase| phase != 0)).unwrap();
        let edit = Edit { anew: std::iter::once(busy..busy + 10).collect(), ..rest(&model, &take, busy..busy + 10) };
        let new = edited(&model, &take, &edit);
        assert!(new.is_edited() && new.phases(&model).unwrap() == edit.phases, "{:?}", new.changed());
        assert!(new.unedited().bytes() == take.bytes() && take.unedited().bytes() == take.bytes());
        let changed = new.changed()[0].clone();
        let (first, last) = (3 * busy as u64, 3 * (busy as u64 + 10));
        assert!(new.changed().len() == 1 && first < changed.end && changed.start < last, "{changed:?}");
        assert!(changed.end - changed.start < 110, "{changed:?}");
        let other = differing(&model, &take, &new);
        // The layers' way back is after them; a gesture remembers the arms of the frames before it.
        let back = 6;
        let inside = |at: &usize| (changed.start..changed.end + back).contains(&(*at as u64));
        assert!(other.len() > 15 && other.iter().all(inside), "{other:?} {changed:?}");
        // Hands rest: they are low at the end.
        let team = Team::new(1).unwrap();
        let cx = Compute { isa: model.isa(), team: &team };
        let height = |take: &Take| take.wrists(&model, cx).unwrap()[3 * (busy + 8)].map(|place| place[1]);
        let (low, high) = (height(&new), height(&take));
        assert!(low[0].max(low[1]) < high[0].max(high[1]) && low[0].max(low[1]) < 1.02, "{low:?} {high:?}");
        // Another draw is another motion; the first one is the same again.
        let anew = |variant| Edit {
            anew: std::iter::once(busy..busy + 6).collect(),
            variant,
            phases: phases.clone(),
            ..Edit::default()
        };
        let [a, b, c] = [1, 2, 1].map(|variant| edited(&model, &take, &anew(variant)));
        assert!(a.bytes() != b.bytes() && a.bytes() == c.bytes());
        // Back again, and nothing at all.
        let back = Edit { phases: phases.clone(), ..Edit::default() };
        assert!(edited(&model, &new, &back).bytes() == take.bytes());
        assert!(edited(&model, &take, &back).bytes() == take.bytes());
    }
}

#[test]
fn requests_are_changed_where_they_are_made() {
    let model = open(PEOPLE);
    let take = long(&model, LayerGains::ON);
    let events: Vec<_> = take.events().filter(|(_, event)| !matches!(event, Event::Gesture { .. })).collect();
    let edit =
        Edit { events: Some(events.clone()), windows: std::iter::once(15..135).collect(), ..rest(&model, &take, 0..0) };
    let new = edited(&model, &take, &edit);
    assert!(new.events().eq(events) && new.changed().iter().eq([&(15..135)]));
    let other = differing(&model, &take, &new);
    assert!(other.len() > 20 && other.iter().all(|at| (30..141).contains(at)), "{other:?}");
    // The take's own requests again.
    let own = Edit { events: Some(take.events().collect()), ..rest(&model, &take, 0..0) };
    assert!(edited(&model, &new, &own).bytes() == take.bytes());
    // Where the present host asks for something, its request goes on beyond the changed frames.
    let session = Session::of_take(&model, &new, &SessionConfig::new(model.config())).unwrap();
    session.set_mood(Mood::Angry, 1.0).unwrap();
    let angry = play(&session);
    let plain = Session::of_take(&model, &take, &SessionConfig::new(model.config())).unwrap();
    assert!(angry[200] != play(&plain)[200]);
}

#[test]
fn an_edit_that_does_not_fit_is_refused() {
    let (model, small) = (open(PEOPLE), open(SMALL[0]));
    let take = long(&model, LayerGains::OFF);
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let edit = rest(&model, &take, 20..30);
    let rate = model.config().audio.sample_rate;
    let refused = |samples: &[f32], edit: &Edit| take.edited(&model, cx, samples, edit).unwrap_err();
    assert!(matches!(refused(&speech(rate, 7), &edit), EditError::Audio));
    let mut other = speech(rate, 8);
    other[5000] += 0.1;
    assert!(matches!(refused(&other, &edit), EditError::Audio));
    let short = Edit { phases: vec![0; 3], ..Edit::default() };
    let want = edit.phases.len();
    assert!(matches!(refused(&speech(rate, 8), &short), EditError::Keyframes { got: 3, want: all } if all == want));
    let (plain, _) = record(&small, LayerGains::OFF, false);
    let edit = Edit { anew: std::iter::once(2..4).collect(), ..Edit::default() };
    let cx = Compute { isa: small.isa(), team: &team };
    let error = plain.edited(&small, cx, &speech(rate, 4), &edit).unwrap_err();
    assert!(matches!(error, EditError::Phases) && error.to_string().contains("intent"), "{error}");
}
