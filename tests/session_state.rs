//! Invariants of a session's saved state: restored in any session of the model, it continues with
//! the same bits; invalid bytes change nothing.

mod model_bytes;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use model_bytes::ModelBytes;
use proptest::prelude::*;
use umo_core::{
    Attention, Clock, Engine, EngineConfig, Frame, GestureOptions, Idle, Layer, LipShape, Model, ModelFile, Mood,
    PacketConfig, Part, Poll, Precision, Session, SessionConfig, SessionError, Side, StateError, Threads, Voice,
};
use umo_kernels::Isa;
use umo_tests::{Ends, Noise};

const NAMES: [&str; 6] =
    ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit", "frames_four", "frames_seven"];

/// The golden models.
static MODELS: LazyLock<Vec<Arc<Model>>> =
    LazyLock::new(|| NAMES.iter().map(|name| load(name, Precision::F32)).collect());

fn load(name: &str, precision: Precision) -> Arc<Model> {
    let file = ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap();
    Arc::new(Model::load(&file, precision, Isa::detect()).unwrap())
}

/// An engine whose clock the test advances.
struct Timed {
    engine: Engine,
    nanos: Arc<AtomicU64>,
}

fn timed(model: &Arc<Model>, more_threads: usize, max_batch: usize, start: u64) -> Timed {
    let nanos = Arc::new(AtomicU64::new(start));
    let (threads, clock) = (Threads::Host(more_threads), Clock::Manual(Arc::clone(&nanos)));
    let config = EngineConfig { threads, max_sessions: 8, max_batch, clock, ..EngineConfig::default() };
    Timed { engine: Engine::new(Arc::clone(model), &config).unwrap(), nanos }
}

/// Computes everything that is due.
fn settle(engine: &Engine) {
    while engine.poll(Duration::from_secs(1)).unwrap() == Poll::More {}
}

fn config(model: &Model, target: usize, lookahead: usize) -> SessionConfig {
    let mut session = SessionConfig::new(model.config());
    (session.avatar.target, session.avatar.lookahead, session.avatar.sampler.seed) = (target, lookahead, 7);
    session.avatar.horizon = lookahead.min(model.config().audio.ahead);
    if model.config().name.ends_with("frames_seven") {
        session.avatar.guidance = 2.0;
    }
    session
}

/// One call of a script.
#[derive(Clone, Debug)]
enum Call {
    Push(usize),
    Finish,
    Pull(usize),
    /// Seconds are frames after the last one shown.
    Sample(f64),
    Interrupt(u64),
    Reset,
    Prompt(Vec<u32>),
    Seed(u64),
    Temperature(f32),
    Gain(Part, f32),
    SetIdle(Idle),
    LookAt([f32; 3], f32),
    Attend(Attention),
    SetMood(Mood, f32),
    Express(f32),
    SetLayer(Layer, f32),
    /// Index of a gesture, delay in seconds after the last frame shown (`None`: no start time), and side.
    Gesture(usize, Option<f64>, Side),
    Lips(usize, f64, f64),
    /// Index of a word, delay in seconds after the last frame shown, and duration.
    Word(usize, f64, f64),
    /// Number of samples of the interlocutor, and their level.
    Other(usize, f32),
    Wait(u64),
    /// Advances the host's time, in milliseconds.
    Clock(u32),
    Settle,
}

/// Words of several classes and of none.
const WORDS: [&str; 8] = ["no", "hello!", "maybe", "me", "not bad", "first,", "second,", "over there"];

fn any_idle() -> impl Strategy<Value = Idle> + Clone {
    prop::sample::select(vec![Idle::Hold, Idle::Rest, Idle::Live])
}

fn any_call() -> impl Strategy<Value = Call> {
    prop_oneof![
        6 => (1_usize..9_000).prop_map(Call::Push),
        1 => Just(Call::Finish),
        4 => (0_usize..20).prop_map(Call::Pull),
        4 => (0.0..9.0).prop_map(Call::Sample),
        1 => (0_u64..400).prop_map(Call::Interrupt),
        1 => Just(Call::Reset),
        1 => prop::collection::vec(0_u32..90, 0..5).prop_map(Call::Prompt),
        1 => any::<u64>().prop_map(Call::Seed),
        1 => (0.0_f32..2.0).prop_map(Call::Temperature),
        2 => (prop::sample::select(Part::ALL.to_vec()), 0.0_f32..2.0).prop_map(|(part, gain)| Call::Gain(part, gain)),
        1 => any_idle().prop_map(Call::SetIdle),
        1 => ([-2.0_f32..2.0, 0.0_f32..2.0, 0.5_f32..3.0], 0.0_f32..=1.0).prop_map(|(at, much)| Call::LookAt(at, much)),
        1 => prop::sample::select(Attention::ALL.to_vec()).prop_map(Call::Attend),
        1 => (prop::sample::select(Mood::ALL.to_vec()), 0.0_f32..=1.0).prop_map(|(mood, much)| Call::SetMood(mood, much)),
        1 => (0.0_f32..=1.0).prop_map(Call::Express),
        1 => (prop::sample::select(Layer::ALL.to_vec()), 0.0_f32..=1.0).prop_map(|(layer, gain)| Call::SetLayer(layer, gain)),
        2 => (0_usize..40, prop::option::of(0.0..3.0), prop::sample::select(Side::ALL.to_vec()))
            .prop_map(|(which, at, side)| Call::Gesture(which, at, side)),
        2 => (0_usize..3, 0.0..2.0, 0.0..0.3_f64)
            .prop_map(|(which, after, duration)| Call::Lips(which, after, duration)),
        2 => (0_usize..WORDS.len(), 0.0..3.0, 0.0..0.5_f64)
            .prop_map(|(which, after, duration)| Call::Word(which, after, duration)),
        2 => (0_usize..9_000, 0.0_f32..0.5).prop_map(|(count, level)| Call::Other(count, level)),
        2 => (0_u64..700).prop_map(Call::Wait),
        2 => (0_u32..700).prop_map(Call::Clock),
        6 => Just(Call::Settle),
    ]
}

/// A session and its output so far.
struct Run<'a> {
    timed: &'a Timed,
    session: Session,
    channels: usize,
    /// Sample frames pushed, the time of the last pose, and the host's time, if it was set.
    pushed: u64,
    time: f64,
    clock: f64,
    /// Whether the engine has nothing to do.
    settled: bool,
    /// Results and outputs of all calls, as bits.
    seen: Vec<u64>,
}

fn show(frame: Frame, seen: &mut Vec<u64>) {
    seen.extend([frame.index, frame.sample]);
    let values = frame.pose.rotations.as_flattened().iter().chain(&frame.pose.translation).chain(frame.face);
    seen.extend(values.map(|value| u64::from(value.to_bits())));
}

impl<'a> Run<'a> {
    fn new(timed: &'a Timed, config: &SessionConfig) -> Self {
        let (session, channels) = (timed.engine.session(config).unwrap(), config.channels);
        Self { timed, session, channels, pushed: 0, time: 0.0, clock: 0.0, settled: false, seen: Vec::new() }
    }

    #[expect(clippy::cast_precision_loss, reason = "a short stream")]
    fn call(&mut self, call: &Call) {
        let Self { timed, session, channels, pushed, time, clock, settled, seen } = self;
        match call {
            Call::Push(frames) => {
                let mut noise = Noise::new(*pushed);
                // Syllables, whose arousal is heard.
                let first = usize::try_from(*pushed).unwrap();
                let loud = |i: usize| if (first + i / *channels) % 4000 < 2500 { 0.3 } else { 0.0 };
                let sound = |i: usize| loud(i) * (0.05 * i as f32).sin() + noise.float(0.02);
                let samples: Vec<f32> = (0..frames * *channels).map(sound).collect();
                match session.push_audio(&samples) {
                    Ok(taken) => {
                        *pushed += taken.taken as u64;
                        seen.push(taken.taken as u64);
                    }
                    Err(error) => assert_eq!(error, SessionError::Finished),
                }
            }
            Call::Finish => session.finish().unwrap(),
            Call::Pull(most) => {
                let shown = |frame: Frame| {
                    *time = time.max(frame.index as f64 / 30.0);
                    show(frame, seen);
                };
                let ready = session.ready_frames().unwrap();
                let pulled = session.pull_frames(*most, shown).unwrap();
                // A working engine may have added frames in the meantime.
                assert!(pulled >= ready.min(*most), "{pulled} frames of {most}, where {ready} were ready");
                assert!(!*settled || pulled == ready.min(*most), "{pulled} frames of {most}, {ready} were ready");
                let (arousal, trend) = session.arousal().unwrap();
                seen.extend([arousal, trend].map(|value| u64::from(value.to_bits())));
            }
            Call::Sample(frames) => {
                *time += frames / 30.0;
                let sampled = session.sample_pose(*time, |frame| show(frame, seen)).unwrap();
                seen.extend([sampled.oldest.to_bits(), sampled.newest.to_bits(), sampled.is_ahead.into()]);
                let (arousal, trend) = session.arousal().unwrap();
                seen.extend([arousal, trend].map(|value| u64::from(value.to_bits())));
            }
            Call::Interrupt(ms) => session.interrupt(Duration::from_millis(*ms)).unwrap(),
            Call::Reset => {
                session.reset().unwrap();
                *time = 0.0;
            }
            Call::Prompt(ids) => session.set_prompt(ids).unwrap(),
            Call::Seed(seed) => session.set_seed(*seed).unwrap(),
            Call::Temperature(temperature) => {
                let sampling = session.sampling().unwrap();
                session.set_sampling(umo_core::Sampling { temperature: *temperature, ..sampling }).unwrap();
            }
            Call::Gain(part, gain) => session.set_gain(*part, *gain).unwrap(),
            Call::SetIdle(idle) => session.set_idle(*idle),
            Call::LookAt(point, strength) => session.look_at(*point, *strength).unwrap(),
            Call::Attend(attention) => session.set_attention(*attention).unwrap(),
            Call::SetMood(mood, strength) => session.set_mood(*mood, *strength).unwrap(),
            Call::Express(expression) => session.set_expression(*expression).unwrap(),
            Call::SetLayer(layer, gain) => session.set_layer(*layer, *gain).unwrap(),
            Call::Gesture(which, at, side) => {
                let names: Vec<&str> = session.gesture_names().collect();
                let mut options = GestureOptions::default().side(*side);
                options.at = at.map(|after| *time + after);
                match session.play_gesture(names[which % names.len()], &options) {
                    Ok(()) => seen.push(1),
                    Err(error) => assert_eq!(error, SessionError::GesturesFull),
                }
            }
            Call::Lips(which, after, duration) => {
                match session.hint_lips(LipShape::ALL[*which], *time + after, *duration) {
                    Ok(()) => seen.push(2),
                    Err(error) => assert_eq!(error, SessionError::HintsFull),
                }
            }
            Call::Word(which, after, duration) => {
                match session.hint_words(WORDS[*which], *time + after, *time + after + duration) {
                    Ok(()) => seen.push(3),
                    Err(error) => assert_eq!(error, SessionError::WordsFull),
                }
            }
            Call::Other(count, level) => session.push_other_audio(&vec![*level; count * *channels]).unwrap(),
            Call::Wait(ms) => drop(timed.nanos.fetch_add(ms * 1_000_000, Ordering::SeqCst)),
            Call::Clock(ms) => {
                *clock += f64::from(*ms) / 1e3;
                session.set_clock(*clock).unwrap();
            }
            Call::Settle => settle(&timed.engine),
        }
        *settled = matches!(call, Call::Settle);
        let stats = session.stats();
        seen.extend([stats.chunks, stats.frames, stats.late_frames, stats.dropped_frames, stats.overruns]);
    }

    /// Continues from a state with these calls; returns their results and outputs, and the state
    /// after them.
    fn replay(&mut self, state: &[u8], (pushed, time, clock): (u64, f64, f64), calls: &[Call]) -> (Vec<u64>, Vec<u8>) {
        self.session.restore(state).unwrap();
        assert!(save(&self.session) == state, "a restored session saves the state that it was restored from");
        (self.pushed, self.time, self.clock) = (pushed, time, clock);
        self.seen.clear();
        calls.iter().for_each(|call| self.call(call));
        settle(&self.timed.engine);
        (std::mem::take(&mut self.seen), save(&self.session))
    }
}

fn save(session: &Session) -> Vec<u8> {
    let mut bytes = vec![0xA5; session.state_size() + 3];
    let count = session.save(&mut bytes).unwrap();
    assert!(count <= session.state_size() && bytes[session.state_size()..] == [0xA5; 3]);
    bytes.truncate(count);
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, ..ProptestConfig::default() })]

    /// Any model, rate, cut of the script, idle mode; rolled back in place, and in another session
    /// with a different past.
    #[test]
    fn a_restored_session_goes_on_with_the_same_bits(
        which in 0..NAMES.len(),
        target in 1_usize..3,
        lookahead in 0_usize..10,
        (sample_rate, channels) in prop::sample::select(vec![(16_000, 1), (48_000, 2), (8_000, 1), (44_100, 3), (22_050, 1)]),
        idle in any_idle(),
        (text, voice) in (any::<bool>(), prop::sample::select(vec![Voice::Delayed, Voice::Live, Voice::Mouth])),
        calls in prop::collection::vec(any_call(), 1..40),
        past in prop::collection::vec(any_call(), 0..10),
        cut in any::<prop::sample::Index>(),
    ) {
        let model = &MODELS[which];
        let mut config = SessionConfig { sample_rate, channels, idle, ..config(model, target, lookahead) };
        config.idle_after = Duration::from_millis(100);
        if text && model.config().templates.contains_key("text_to_motion") {
            (config.avatar.template, config.avatar.text) = ("text_to_motion".to_owned(), vec![3, 4]);
        }
        if model.mouth().is_some() && config.avatar.text.is_empty() {
            config.voice = voice;
        }
        let here = timed(model, 0, 2, 0);
        let there = timed(model, 1, 4, 55_000_000_000);
        let (mut first, mut other) = (Run::new(&here, &config), Run::new(&there, &config));
        let (before, after) = calls.split_at(cut.index(calls.len()));
        before.iter().for_each(|call| first.call(call));
        let state = save(&first.session);
        let times = (first.pushed, first.time, first.clock);
        first.seen.clear();
        after.iter().for_each(|call| first.call(call));
        settle(&here.engine);
        let wanted = (std::mem::take(&mut first.seen), save(&first.session));
        let rolled_back = first.replay(&state, times, after);
        prop_assert!(rolled_back == wanted, "rolled back");
        past.iter().for_each(|call| other.call(call));
        settle(&there.engine);
        let elsewhere = other.replay(&state, times, after);
        prop_assert!(elsewhere == wanted, "in another session");
    }
}

/// Restores with an epoch change in every stage: requested, seen by the audio side, by the frame
/// side, by the engine.
#[test]
fn an_epoch_on_its_way_arrives_after_a_restore() {
    use Call::{Finish, Interrupt, Pull, Push, Reset, Sample, Settle};
    let model = &MODELS[2];
    let (here, there) = (timed(model, 0, 2, 0), timed(model, 0, 2, 0));
    let config = config(model, 2, 3);
    let start = [Push(20_000), Settle, Pull(7)];
    let after = [Push(15_000), Settle, Pull(9), Sample(2.5), Finish, Settle, Pull(1000)];
    for epoch in [Interrupt(200), Reset] {
        for seen in
            [vec![], vec![Push(100)], vec![Pull(2)], vec![Settle], vec![Push(100), Pull(1)], vec![Pull(1), Settle]]
        {
            // The restored session has had more epochs, none, or as many of the other
            // kind.
            for past in [vec![], vec![Reset], vec![Interrupt(0), Push(7_000), Reset, Settle, Interrupt(100)]] {
                let (mut first, mut other) = (Run::new(&here, &config), Run::new(&there, &config));
                let before = start.iter().chain([&epoch]).chain(&seen);
                before.for_each(|call| first.call(call));
                let state = save(&first.session);
                let times = (first.pushed, first.time, first.clock);
                let wanted = first.replay(&state, times, &after);
                assert!(wanted.0.len() > 20 * 220, "frames came");
                [Reset, Push(9_000), Settle, Interrupt(50)].iter().for_each(|call| first.call(call));
                assert!(first.replay(&state, times, &after) == wanted, "{epoch:?}, {seen:?}");
                past.iter().for_each(|call| other.call(call));
                assert!(other.replay(&state, times, &after) == wanted, "{epoch:?}, {seen:?}, {past:?}");
            }
        }
    }
}

/// Silence that the engine fills in, late frames, speech faster than real time, and the return
/// from idle: cut at every place.
#[test]
fn time_goes_on_where_it_was() {
    use Call::{Finish, Interrupt, Pull, Push, Sample, SetIdle, Settle, Wait};
    let model = &MODELS[3];
    let script = [
        // Half a chunk waits when the audio stops.
        &[Push(9_600), Wait(150), Settle, Wait(60), Pull(1_000), Wait(400), Pull(9), Settle, Pull(1_000), Settle][..],
        &[Pull(1_000), Push(3_000), Settle, Pull(1_000), Wait(500), Pull(1), Settle, Pull(1_000)],
        // A second at once; its end is not due for a while.
        &[
            Push(16_000),
            Wait(700),
            Settle,
            Push(6_400),
            Wait(300),
            Settle,
            Wait(900),
            Push(12_000),
            Wait(1_500),
            Settle,
        ],
        &[Interrupt(150), Pull(2), Push(9_000), Settle, Pull(9), Sample(0.5), Wait(350), SetIdle(Idle::Rest)],
        &[Sample(6.0), Wait(100), Sample(4.0), Wait(100), Sample(4.0), Push(9_000), Settle, Sample(3.0), Wait(350)],
        &[Sample(3.0), Sample(3.0), Push(9_000), Finish, Wait(900), Settle, Pull(1_000)],
    ]
    .concat();
    let config = SessionConfig { idle: Idle::Live, ..config(model, 1, 2) };
    let mut late = 0;
    for cut in 0..script.len() {
        let (here, there) = (timed(model, 0, 2, 0), timed(model, 0, 2, 9_000_000_000));
        let (mut first, mut other) = (Run::new(&here, &config), Run::new(&there, &config));
        let (before, after) = script.split_at(cut);
        before.iter().for_each(|call| first.call(call));
        let (state, times) = (save(&first.session), (first.pushed, first.time, first.clock));
        first.seen.clear();
        after.iter().for_each(|call| first.call(call));
        settle(&here.engine);
        let wanted = (std::mem::take(&mut first.seen), save(&first.session));
        late = first.session.stats().late_frames;
        assert!(first.replay(&state, times, after) == wanted, "rolled back to {cut}");
        assert!(other.replay(&state, times, after) == wanted, "elsewhere from {cut}");
    }
    assert!((10..100).contains(&late), "{late}");
}

/// Full rings and a full prompt: the largest possible state.
#[test]
fn a_full_session_fits_the_size_that_was_said() {
    let timed = timed(&MODELS[1], 0, 1, 0);
    let config = SessionConfig { sample_rate: 48_000, ..config(&MODELS[1], 2, 0) };
    let session = timed.engine.session(&config).unwrap();
    let empty = save(&session).len();
    session.set_prompt(&[1; 128]).unwrap();
    for _ in 0..40 {
        session.push_audio(&vec![0.1; 48_000]).unwrap();
        settle(&timed.engine);
    }
    let (full, most) = (save(&session).len(), session.state_size());
    // The state may be short of one resampler block, one chunk of audio and one of frames.
    let chunk = 4 * (config.avatar.target * 3_200 + 1_920) + 4 * config.avatar.target * 6 * (5 + 223 + 100);
    assert!(empty < full && full <= most && full + chunk > most, "{empty}, {full}, {most}");
    let mut short = vec![0; most - 1];
    assert_eq!(session.save(&mut short), Err(SessionError::Short { needed: most }));
    let fresh = timed.engine.session(&config).unwrap();
    assert_eq!(fresh.state_size(), most);
    fresh.restore(&save(&session)).unwrap();
    assert!(save(&fresh) == save(&session));
}

/// A stream ends with a full queue, and another begins before the engine has made room.
#[test]
fn a_stream_that_begins_behind_a_full_queue_is_restored() {
    for sample_rate in [8_000, 16_000, 22_050, 44_100, 48_000, 96_000] {
        for begin in [Session::reset, |session: &Session| session.interrupt(Duration::from_millis(100))] {
            let timed = timed(&MODELS[3], 0, 2, 0);
            let config = SessionConfig { sample_rate, ..config(&MODELS[3], 1, 0) };
            let session = timed.engine.session(&config).unwrap();
            let sound: Vec<f32> = (0_u8..250).map(|i| (f32::from(i) * 0.2).sin() * 0.3).collect();
            while session.push_audio(&sound).unwrap().taken > 0 {}
            session.finish().unwrap();
            begin(&session).unwrap();
            assert_eq!(session.push_audio(&sound).unwrap().taken, 0, "{sample_rate} Hz");
            let state = save(&session);
            let other = timed.engine.session(&config).unwrap();
            other.restore(&state).unwrap();
            assert!(save(&other) == state);
            let more = || {
                settle(&timed.engine);
                let mut seen = Vec::new();
                for session in [&session, &other] {
                    for _ in 0..100 {
                        session.push_audio(&sound).unwrap();
                    }
                    session.finish().unwrap();
                    settle(&timed.engine);
                    seen.push(pull(session, session.ready_frames().unwrap()));
                }
                assert!(seen[0].len() > 1_000 && seen[0] == seen[1], "{sample_rate} Hz");
            };
            more();
        }
    }
}

/// The layers' random draws come from the restored state, not from the session's seed.
#[test]
fn a_session_with_another_seed_goes_on_with_the_state_alone() {
    let timed = timed(&MODELS[3], 0, 2, 0);
    let session = |seed: u64| {
        let mut config = config(&MODELS[3], 1, 0);
        config.avatar.sampler.seed = seed;
        timed.engine.session(&config).unwrap()
    };
    let (first, other) = (session(7), session(8));
    first.push_audio(&[0.2; 15_000]).unwrap();
    settle(&timed.engine);
    pull(&first, 5);
    other.restore(&save(&first)).unwrap();
    let [wanted, got] = [&first, &other].map(|session| {
        session.push_audio(&[0.1; 30_000]).unwrap();
        settle(&timed.engine);
        pull(session, session.ready_frames().unwrap())
    });
    assert!(wanted.len() > 30 * 220 && got == wanted);
}

#[test]
fn a_session_in_work_is_saved_and_not_restored() {
    let timed = timed(&MODELS[3], 0, 2, 0);
    let config = config(&MODELS[3], 2, 0);
    let session = timed.engine.session(&config).unwrap();
    let idle = save(&session);
    let mut bytes = vec![0; session.state_size()];
    session.push_audio(&[0.1; 6_400]).unwrap();
    let mut cut = 0;
    while timed.engine.poll(Duration::ZERO) == Ok(Poll::More) {
        // After the step that ends the batch, the session is in its slot again.
        if session.stats().chunks == 0 {
            cut += 1;
            session.save(&mut bytes).unwrap();
            assert!(matches!(session.restore(&idle), Err(SessionError::Busy(_))));
        }
    }
    assert!(cut > 10 && session.ready_frames().unwrap() > 0);
    let state = save(&session);
    let refused = |_: Frame| {
        let mut bytes = vec![0; session.state_size()];
        assert!(matches!(session.save(&mut bytes), Err(SessionError::Busy(_))));
        assert!(matches!(session.restore(&state), Err(SessionError::Busy(_))));
    };
    assert_eq!(session.pull_frames(1, refused), Ok(1));
    session.restore(&idle).unwrap();
    assert_eq!(session.ready_frames(), Ok(0));
    drop(timed);
    assert_eq!(session.save(&mut bytes), Err(SessionError::Closed));
    assert_eq!(session.restore(&state), Err(SessionError::Closed));
}

#[test]
fn a_state_of_another_model_or_config_is_refused_by_name() {
    let timed = timed(&MODELS[3], 0, 2, 0);
    let own = || SessionConfig { sample_rate: 44_100, channels: 2, ..config(&MODELS[3], 2, 1) };
    let state = save(&timed.engine.session(&own()).unwrap());
    let refused = |change: &dyn Fn(&mut SessionConfig)| {
        let mut config = own();
        change(&mut config);
        let session = timed.engine.session(&config).unwrap();
        let before = save(&session);
        let error = session.restore(&state).unwrap_err();
        assert!(save(&session) == before);
        match error {
            SessionError::State(StateError::Config { what, .. }) => what,
            other => panic!("{other}"),
        }
    };
    assert_eq!(refused(&|c| c.sample_rate = 48_000), "sample rate");
    assert_eq!(refused(&|c| c.channels = 1), "number of channels");
    assert_eq!(refused(&|c| c.avatar.target = 1), "target");
    assert_eq!(refused(&|c| c.avatar.lookahead = 9), "lookahead");
    assert_eq!(refused(&|c| c.avatar.smoothing = 0.0), "lookahead");
    assert_eq!(refused(&|c| c.avatar.smoothing = 1.4), "smoothing");
    assert_eq!(refused(&|c| c.avatar.template = "text_to_motion".to_owned()), "template");
    assert_eq!(refused(&|c| c.queue_frames += 1), "queue of frames");
    assert_eq!(refused(&|c| c.idle_after *= 2), "time until idle");
    assert_eq!(refused(&|c| c.ease *= 2), "ease");
    for model in [load(NAMES[3], Precision::Int8), load(NAMES[3], Precision::Bf16), Arc::clone(&MODELS[2])] {
        let other = self::timed(&model, 0, 1, 0);
        let mut config = own();
        (config.avatar.target, config.avatar.lookahead) = (1, 0);
        let session = other.engine.session(&config).unwrap();
        assert_eq!(session.restore(&state), Err(SessionError::State(StateError::Model)));
    }
    // The same file loaded again is the same model, on any processor.
    let file = ModelFile::from_bytes(ModelBytes::open(NAMES[3]).bytes()).unwrap();
    let scalar = Arc::new(Model::load(&file, Precision::F32, Isa::SCALAR).unwrap());
    let other = self::timed(&scalar, 0, 1, 0);
    assert_eq!(other.engine.session(&own()).unwrap().restore(&state), Ok(()));
    // A changed weight makes another model, if the fingerprint samples it.
    let mut bytes = ModelBytes::open(NAMES[3]);
    bytes.tensors.get_mut("lm.shared.weight").unwrap().bytes[0] ^= 1;
    let changed = Model::load(&ModelFile::from_bytes(bytes.bytes()).unwrap(), Precision::F32, Isa::detect()).unwrap();
    let other = self::timed(&Arc::new(changed), 0, 1, 0);
    let session = other.engine.session(&own()).unwrap();
    assert_eq!(session.restore(&state), Err(SessionError::State(StateError::Model)));
}

/// State of a busy session: audio and frames waiting, a history, an ease in progress.
fn lively(timed: &Timed, config: &SessionConfig) -> Session {
    let session = timed.engine.session(config).unwrap();
    session.set_prompt(&[1, 2, 3]).unwrap();
    let samples: Vec<f32> = (0_u16..11_000).map(|i| (f32::from(i) * 0.03).sin() * 0.3).collect();
    session.push_audio(&samples).unwrap();
    settle(&timed.engine);
    session.pull_frames(3, |_| ()).unwrap();
    session.interrupt(Duration::from_millis(200)).unwrap();
    session.push_audio(&samples).unwrap();
    session.pull_frames(2, |_| ()).unwrap();
    settle(&timed.engine);
    session.push_audio(&samples[..700]).unwrap();
    session
}

#[test]
fn changed_and_cut_states_are_refused_and_change_nothing() {
    let timed = timed(&MODELS[3], 0, 1, 0);
    let config = SessionConfig { sample_rate: 22_050, queue_frames: 24, ..config(&MODELS[3], 1, 2) };
    let (session, mut state) = (timed.engine.session(&config).unwrap(), save(&lively(&timed, &config)));
    let before = save(&session);
    let refused = |bytes: &[u8]| match session.restore(bytes) {
        Err(SessionError::State(error)) => error,
        other => panic!("{other:?}"),
    };
    for at in 0..state.len() {
        state[at] ^= 1 << (at % 8);
        let error = refused(&state);
        state[at] ^= 1 << (at % 8);
        match at {
            0..8 => assert_eq!(error, StateError::Foreign),
            8..12 => assert!(matches!(error, StateError::Version { .. })),
            16..24 => assert!(matches!(error, StateError::Length { .. })),
            _ => assert_eq!(error, StateError::Checksum),
        }
    }
    for length in 0..state.len() {
        assert!(matches!(refused(&state[..length]), StateError::Length { .. } | StateError::Foreign));
    }
    assert!(matches!(refused(&[&state[..], &[0]].concat()), StateError::Length { .. }));
    assert!(save(&session) == before);
    session.restore(&state).unwrap();
    assert!(save(&session) == state);
}

/// Updates a state's length and checksum.
fn sign(state: &mut [u8]) {
    let length = state.len() as u64;
    state[16..24].copy_from_slice(&length.to_le_bytes());
    let mut crc = u32::MAX;
    for &byte in &state[16..] {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    state[12..16].copy_from_slice(&(!crc).to_le_bytes());
}

/// Asserts that a host can show the frame: rotations are unit quaternions, all other values finite.
fn is_shown(frame: Frame) {
    for q in &frame.pose.rotations {
        let length: f32 = q.iter().map(|v| v * v).sum();
        assert!((length - 1.0).abs() < 2e-2, "a forged state gave the rotation {q:?}");
    }
    let values = frame.pose.translation.iter().chain(frame.face);
    assert!(values.into_iter().all(|v| v.is_finite()), "a forged state gave a frame that is not finite");
}

/// A session with a forged state may move wrongly or fail; it must not panic, hang, output
/// non-finite values, or affect another session.
fn survive(timed: &Timed, session: &Session) {
    let is_sound = |result: Result<(), SessionError>| {
        assert!(result != Err(SessionError::Panicked), "a forged state made the computation panic");
    };
    let polls = || {
        for _ in 0..3_000 {
            if timed.engine.poll(Duration::from_millis(20)) == Ok(Poll::Idle) {
                return;
            }
        }
        panic!("the engine never rests");
    };
    for round in 0..3 {
        is_sound(session.push_audio(&[0.2; 9_000]).map(drop));
        polls();
        is_sound(session.sample_pose(f64::from(round) / 3.0, is_shown).map(drop));
        is_sound(session.pull_frames(10, is_shown).map(drop));
        is_sound(session.ready_frames().map(drop));
        timed.nanos.fetch_add(400_000_000, Ordering::SeqCst);
        is_sound(session.sample_pose(f64::from(round) * 3.0, is_shown).map(drop));
        is_sound(session.pull_frames(1_000, is_shown).map(drop));
        polls();
        match round {
            0 => is_sound(session.finish()),
            1 => is_sound(session.interrupt(Duration::from_millis(100))),
            _ => is_sound(session.reset()),
        }
        polls();
        is_sound(session.pull_frames(1_000, is_shown).map(drop));
    }
}

#[test]
fn forged_states_do_no_harm() {
    for which in [0, 3] {
        let timed = timed(&MODELS[which], 0, 2, 1_000_000_000);
        let config =
            SessionConfig { sample_rate: 22_050, queue_frames: 40, idle: Idle::Live, ..config(&MODELS[which], 1, 8) };
        let state = save(&lively(&timed, &config));
        let mut noise = Noise::new(which as u64);
        let mut draw = |below: usize| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place in a state")]
            let at = ((noise.float(1.0) + 1.0) * 0.5 * below as f32) as usize;
            at.min(below - 1)
        };
        let (mut refused, mut taken) = (0, 0);
        let mut attempt = |forged: &mut [u8]| {
            sign(forged);
            let session = timed.engine.session(&config).unwrap();
            let before = save(&session);
            match session.restore(forged) {
                Ok(()) => {
                    taken += 1;
                    assert!(save(&session) == forged, "the restored state is the given one");
                    survive(&timed, &session);
                }
                Err(SessionError::State(_)) => {
                    refused += 1;
                    assert!(save(&session) == before);
                }
                Err(other) => panic!("{other}"),
            }
        };
        let numbers = [0, 1, 2, 5, 40, 255, 65_535, 1 << 20, 1 << 33, 1 << 40, 1 << 49, 1 << 60, 1 << 62, u64::MAX];
        // Fields are at the start, between the rings, and at the end: offsets depend on
        // the model.
        for _ in 0..200 {
            let mut forged = state.clone();
            let at = match draw(3) {
                0 => 24 + draw(200),
                1 => state.len() - 8 - draw(200.min(state.len() - 40)),
                _ => 24 + draw(state.len() - 32),
            };
            for _ in 0..=draw(2) {
                forged[at..at + 8].copy_from_slice(&numbers[draw(numbers.len())].to_le_bytes());
            }
            attempt(&mut forged);
        }
        // Every small number in a state is a field, a count or a code: changes many of them, one at a
        // time.
        for at in 24..state.len() - 8 {
            let value = u64::from_le_bytes(state[at..at + 8].try_into().unwrap());
            let is_tried = if at + 700 > state.len() { at % 8 == 0 } else { draw(50) == 0 };
            if value < 1 << 24 && is_tried {
                let mut forged = state.clone();
                let other = [value.wrapping_add(1), value.wrapping_sub(1), 2 * value + 7][draw(3)];
                forged[at..at + 8].copy_from_slice(&other.to_le_bytes());
                attempt(&mut forged);
            }
        }
        // Floats: replaces any possible one by a non-finite value, and by one too large for a body.
        for at in 24..state.len() - 4 {
            if draw(600) == 0 {
                let mut forged = state.clone();
                let values = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e38, 1e11];
                forged[at..at + 4].copy_from_slice(&values[draw(values.len())].to_le_bytes());
                attempt(&mut forged);
            }
        }
        for _ in 0..200 {
            let mut forged = state[..24 + draw(state.len() - 24)].to_vec();
            attempt(&mut forged);
        }
        assert!(refused > 100 && taken > 30, "{refused} refused, {taken} taken");
    }
}

/// A session with every influence on frames active: layers, a live mouth, gains, the interlocutor's audio.
fn busy(timed: &Timed, config: &SessionConfig) -> Session {
    let session = lively(timed, config);
    session.set_gain(Part::Face, 0.5).unwrap();
    session.set_gain(Part::Lower, 1.5).unwrap();
    session.set_mood(Mood::Sad, 0.7).unwrap();
    session.look_at([1.0, 1.5, 2.0], 0.8).unwrap();
    session.play_gesture("wave", &GestureOptions::default()).unwrap();
    session.push_other_audio(&[0.3; 3_000]).unwrap();
    for step in 0..20 {
        session.sample_pose(f64::from(step) / 30.0, |_| ()).unwrap();
        timed.nanos.fetch_add(33_000_000, Ordering::SeqCst);
        settle(&timed.engine);
    }
    session
}

#[test]
fn no_forged_number_gives_a_frame_that_is_not_finite() {
    const NUMBERS: [f32; 9] = [f32::NAN, f32::INFINITY, -1e38, 1e12, -1e12, 1e9, -1.0, 0.0, 1e-40];
    for voice in [Voice::Live, Voice::Delayed] {
        let timed = timed(&MODELS[3], 0, 2, 1_000_000_000);
        let config = SessionConfig { queue_frames: 24, voice, idle: Idle::Live, ..config(&MODELS[3], 1, 2) };
        let state = save(&busy(&timed, &config));
        // All floats are at even offsets. Layers and settings, at the end, are tried more often.
        let places = (24..state.len() - 8).step_by(2);
        let tried = places.filter(|at| at % 386 == 0 || at + 9_000 > state.len() && at % 46 == 0);
        for (round, at) in tried.enumerate() {
            let mut forged = state.clone();
            let number = NUMBERS[round % NUMBERS.len()];
            if round % 3 == 0 {
                forged[at..at + 8].copy_from_slice(&f64::from(number).to_le_bytes());
            } else {
                forged[at..at + 4].copy_from_slice(&number.to_le_bytes());
            }
            sign(&mut forged);
            let session = timed.engine.session(&config).unwrap();
            if session.restore(&forged).is_ok() {
                survive(&timed, &session);
            }
        }
    }
}

/// All packets that are ready.
fn packets(session: &Session) -> Vec<u8> {
    let (mut bytes, mut lengths) = (vec![0; 1 << 18], [0; 64]);
    let count = session.pull_packets(&mut bytes, &mut lengths).unwrap();
    bytes.truncate(lengths[..count].iter().sum());
    bytes
}

/// Ends a stream: pushes more audio, and returns all following frames and packets.
fn end(engine: &Engine, session: &Session) -> (Vec<u64>, Vec<u8>) {
    session.push_audio(&[0.1; 5_000]).unwrap();
    session.finish().unwrap();
    settle(engine);
    let frames = pull(session, session.ready_frames().unwrap());
    let packets = session.packet_size().checked_sub(1).map_or_else(Vec::new, |_| packets(session));
    assert!(session.is_done().unwrap());
    (frames, packets)
}

/// Saves at each step of a chunk, while frames are pulled as they come and settings change.
#[test]
fn a_session_that_is_saved_in_work_goes_on_with_the_same_bits() {
    for (which, with_packets) in [(0, false), (3, true), (5, true)] {
        let (here, there) = (timed(&MODELS[which], 0, 2, 0), timed(&MODELS[which], 0, 4, 5_000_000_000));
        let mut config = SessionConfig { sample_rate: 22_050, ..config(&MODELS[which], 2, 3) };
        config.packets = with_packets.then(|| PacketConfig::new(2));
        let session = here.engine.session(&config).unwrap();
        let sound: Vec<f32> = (0_u16..40_000).map(|i| (f32::from(i) * 0.03).sin() * 0.3).collect();
        session.push_audio(&sound).unwrap();
        // States, each with the frames and packets before it.
        let (mut states, mut frames, mut said) = (Vec::new(), Vec::new(), Vec::new());
        let mut step = 0_u64;
        while here.engine.poll(Duration::ZERO) == Ok(Poll::More) {
            step += 1;
            // From here on no setting changes; the last change takes effect with the next chunk.
            if step > 41 && step.is_multiple_of(3) {
                let ready = session.ready_frames().unwrap();
                frames.extend(pull(&session, ready.min(1)));
                states.push((save(&session), frames.len(), said.len()));
            }
            if step == 20 || step == 41 {
                session.set_seed(step).unwrap();
            }
            if with_packets && step.is_multiple_of(50) {
                said.extend(packets(&session));
            }
        }
        let (more, more_said) = end(&here.engine, &session);
        frames.extend(more);
        said.extend(more_said);
        let stats = session.stats();
        assert!(states.len() > 30 && stats.chunks > 4, "{} states, {} chunks", states.len(), stats.chunks);
        for (number, (state, shown, told)) in states.iter().enumerate() {
            let other = there.engine.session(&config).unwrap();
            other.restore(state).unwrap();
            assert!(save(&other) == *state);
            let (rest, rest_said) = end(&there.engine, &other);
            assert!(rest == frames[*shown..] && rest_said == said[*told..], "model {which}, state {number}");
            let others = other.stats();
            assert_eq!((others.chunks, others.frames), (stats.chunks, stats.frames));
        }
    }
}

/// Only the engine's own threads are at work.
#[test]
fn threads_that_compute_keep_nobody_from_saving_or_from_restoring_a_new_session() {
    let (one, two) = (own(2), timed(&MODELS[2], 0, 2, 0));
    let config = SessionConfig { queue_frames: 300, ..config(&MODELS[2], 1, 0) };
    let session = one.session(&config).unwrap();
    let mut bytes = vec![0; session.state_size()];
    session.push_audio(&[0.1; 100_000]).unwrap();
    let (mut states, chunks) = (Vec::new(), 100_000 / 3_200);
    while session.stats().chunks < chunks {
        let count = session.save(&mut bytes).unwrap();
        if states.len() < 100 {
            states.push(bytes[..count].to_vec());
        }
    }
    let wanted = pull(&session, session.ready_frames().unwrap());
    for state in states.iter().step_by(7) {
        let fresh = two.engine.session(&config).unwrap();
        fresh.restore(state).unwrap();
        settle(&two.engine);
        assert!(pull(&fresh, fresh.ready_frames().unwrap()) == wanted);
    }
    let idle = save(&two.engine.session(&config).unwrap());
    for _ in 0..200 {
        one.session(&config).unwrap().restore(&idle).unwrap();
    }
}

fn own(threads: usize) -> Engine {
    let config = EngineConfig { threads: Threads::Own(threads), max_sessions: 4, ..EngineConfig::default() };
    Engine::new(Arc::clone(&MODELS[2]), &config).unwrap()
}

/// Repeats a call while the engine's threads keep the session busy.
fn again<R>(mut call: impl FnMut() -> Result<R, SessionError>) -> R {
    let start = Instant::now();
    loop {
        match call() {
            Err(SessionError::Busy(_)) if start.elapsed() < Duration::from_secs(60) => std::thread::yield_now(),
            result => return result.unwrap(),
        }
    }
}

fn pull(session: &Session, count: usize) -> Vec<u64> {
    let (mut seen, mut frames, start) = (Vec::new(), 0, Instant::now());
    while frames < count {
        frames += again(|| session.pull_frames(count - frames, |frame| show(frame, &mut seen)));
        assert!(start.elapsed() < Duration::from_secs(60), "{frames} of {count} frames");
    }
    seen
}

#[test]
fn engines_of_their_own_threads_go_on_with_each_others_states() {
    let (one, two) = (own(1), own(2));
    let config = SessionConfig { sample_rate: 48_000, ..config(&MODELS[2], 2, 3) };
    #[expect(clippy::cast_precision_loss, reason = "a short sound")]
    let samples: Vec<f32> = (0..48_000 * 4).map(|i| (i as f32 * 0.01).sin() * 0.4).collect();
    for round in 0..10 {
        let (a, b) = (one.session(&config).unwrap(), two.session(&config).unwrap());
        assert_eq!(a.push_audio(&samples).unwrap().taken, samples.len());
        pull(&a, 3 * round);
        let mut bytes = vec![0; a.state_size()];
        let count = again(|| a.save(&mut bytes));
        again(|| a.finish());
        let wanted = pull(&a, 120 - 3 * round);
        again(|| b.restore(&bytes[..count]));
        again(|| b.finish());
        assert!(pull(&b, 120 - 3 * round) == wanted);
        // Restores again, when the work is done and the engine sleeps.
        again(|| a.restore(&bytes[..count]));
        again(|| a.finish());
        assert!(pull(&a, 120 - 3 * round) == wanted);
    }
}

/// The engine skips a session that is being saved, and must come back to it.
#[test]
fn saving_all_the_time_keeps_no_chunk_from_the_engine() {
    let engine = own(1);
    let mut config = config(&MODELS[2], 1, 0);
    config.avatar.smoothing = 0.0;
    let session = engine.session(&config).unwrap();
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let _end = Ends(&done);
        scope.spawn(|| {
            let mut bytes = vec![0; session.state_size()];
            while !done.load(Ordering::SeqCst) {
                match session.save(&mut bytes) {
                    Ok(_) | Err(SessionError::Busy(_)) => std::thread::sleep(Duration::from_micros(20)),
                    Err(error) => panic!("{error}"),
                }
            }
        });
        for round in 0..300 {
            let mut left = 3_200;
            while left > 0 {
                left -= again(|| session.push_audio(&vec![0.1; left])).taken;
            }
            // The first chunk ends with its keyframe.
            pull(&session, if round == 0 { 1 } else { 6 });
        }
    });
}

/// Restores concurrently with all other calls; afterwards the session still works.
#[test]
fn restores_beside_audio_frames_and_cues() {
    let engine = own(2);
    let mut config = config(&MODELS[2], 1, 0);
    config.avatar.smoothing = 0.0;
    let session = engine.session(&config).unwrap();
    let mut state = vec![0; session.state_size()];
    session.push_audio(&[0.1; 5_000]).unwrap();
    pull(&session, 1);
    let count = again(|| session.save(&mut state));
    let done = AtomicBool::new(false);
    let passes = |result: Result<(), SessionError>| match result {
        Ok(()) | Err(SessionError::Busy(_) | SessionError::Finished) => {}
        Err(error) => panic!("{error}"),
    };
    std::thread::scope(|scope| {
        let _end = Ends(&done);
        scope.spawn(|| {
            while !done.load(Ordering::SeqCst) {
                passes(session.push_audio(&[0.2; 480]).map(drop));
                std::thread::sleep(Duration::from_micros(100));
            }
        });
        scope.spawn(|| {
            while !done.load(Ordering::SeqCst) {
                passes(session.pull_frames(3, |frame| assert!(frame.face.iter().all(|v| v.is_finite()))).map(drop));
            }
        });
        scope.spawn(|| {
            for round in 0_u32.. {
                if done.load(Ordering::SeqCst) {
                    break;
                }
                passes(if round % 5 == 0 { session.reset() } else { session.interrupt(Duration::from_millis(40)) });
                passes(session.set_seed(round.into()));
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        for _ in 0..2_000 {
            passes(session.restore(&state[..count]));
            std::thread::sleep(Duration::from_micros(200));
        }
    });
    again(|| session.restore(&state[..count]));
    again(|| session.finish());
    pull(&session, 8);
    assert_eq!(again(|| session.pull_frames(1, |_| ())), 0);
}
