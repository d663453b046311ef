//! Any sequence of calls of the C interface, from up to three threads at once, with arbitrary handles, sizes, numbers,
//! structures and texts: they return statuses, and nothing else happens.
#![no_main]

use std::ffi::{CStr, c_char, c_void};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicUsize, Ordering};

use arbitrary::{Arbitrary, Result, Unstructured};

use libfuzzer_sys::fuzz_target;
use umo::engine::*;
use umo::frame::*;
use umo::gesture::*;
use umo::memory::*;
use umo::model::inspect::*;
use umo::model::*;
use umo::parameter::*;
use umo::session::settings::*;
use umo::session::state::*;
use umo::session::stream::*;
use umo::session::*;
use umo::status::*;
use umo::*;

/// Number of slots for handles of each kind.
const PLACES: usize = 4;
/// Available samples, 16 bits or floats.
const SAMPLES: usize = 20_000;
/// Available bytes for frames and states.
const ROOM: usize = 1 << 21;

/// A character with two animations.
static SALUTE: &[u8] = include_bytes!("../../capi/salute.glb");
/// Gesture names: known ones, one that may be added, and invalid ones.
const GESTURES: [&CStr; 8] = [c"wave", c"nod", c"point", c"clap", c"Thumbs Up", c"own", c"no such", c""];

/// The default model, and one of layout `frames` with text.
static MODELS: [&[u8]; 2] = [
    include_bytes!("../../../models/umo-people/model.safetensors"),
    include_bytes!("../../golden/frames_seven/model.safetensors"),
];

/// Index of the model that this run loads.
static CHOSEN: AtomicUsize = AtomicUsize::new(0);

fn model_bytes() -> &'static [u8] {
    MODELS[CHOSEN.load(Ordering::Relaxed)]
}

/// Handles of this run: valid, freed and made-up ones.
#[derive(Default)]
struct Handles {
    models: [AtomicUsize; PLACES],
    engines: [AtomicUsize; PLACES],
    sessions: [AtomicUsize; PLACES],
}

/// The handle that a call gets.
#[derive(Arbitrary, Clone, Copy, Debug)]
enum Which {
    Model(u8),
    Engine(u8),
    Session(u8),
    Null,
    MadeUp(usize),
}

/// A size: one that is available, or any.
#[derive(Arbitrary, Clone, Copy, Debug)]
enum Size {
    Small(u8),
    There(u16),
    All,
    Any(usize),
}

impl Size {
    /// Size argument of a call with `most` elements of memory, and whether it fits: a larger size is passed with NULL.
    fn of(self, most: usize) -> (usize, bool) {
        match self {
            Self::Small(n) => (usize::from(n).min(most), true),
            Self::There(n) => (usize::from(n).min(most), true),
            Self::All => (most, true),
            Self::Any(n) if n <= most => (n, true),
            Self::Any(n) => (n, false),
        }
    }
}

/// Changed fields of a configuration, by their offset in 4-byte words.
#[derive(Arbitrary, Clone, Debug)]
struct Changes {
    words: [(u8, u32); 2],
    count: u8,
}

#[derive(Arbitrary, Clone, Debug)]
enum Call {
    ModelLoad { to: u8, abi: u32, good_abi: bool, len: Size, changes: Changes },
    ModelFree(Which),
    ModelAsk(Which, u32),
    Encode(Which, Vec<u8>, Size),
    EngineNew { of: Which, to: u8, changes: Changes },
    EngineFree(Which),
    Poll(Which, u16),
    SessionNew { of: Which, to: u8, changes: Changes, hooks: bool },
    SessionMemory(Which, Changes),
    SessionFree(Which),
    Push(Which, Size, bool),
    Finish(Which),
    Interrupt(Which, u32),
    Reset(Which),
    Pull(Which, Changes, Size),
    Sample(Which, f64, Changes, Size),
    Ready(Which),
    Prompt(Which, Vec<u8>),
    PromptIds(Which, Vec<u32>),
    Seed(Which, u64),
    Set(Which, u8, f64),
    Get(Which, u32),
    Ask(Which, u32),
    LastError(Which, Size),
    Save(Which, Size),
    Restore(Which, Size, Option<(u16, u8)>),
    Free(u8),
    LookAt(Which, u32, [f32; 3], f32),
    Mood(Which, u32, f32),
    Other(Which, Size),
    Clock(Which, f64),
    Layer(Which, u8, f32),
    Gesture(Which, u8, Option<Changes>),
    Lips(Which, u32, f64, f64),
    AddGesture(Which, u8, Changes, Size),
    AddGestureFile { of: Which, name: u8, animation: u8, parts: u32, stroke: f32, size: Size, change: (u16, u8) },
    GestureName(Which, u32),
    Live { of: Which, to: u8, smoothing: f32, guidance: f32, horizon: u32 },
}

#[derive(Debug)]
struct Script {
    threads: Vec<Vec<Call>>,
    /// Whether it starts with a model, an engine and a session.
    ready: bool,
    /// Whether models are of layout `frames`.
    frames: bool,
}

impl<'a> Arbitrary<'a> for Script {
    fn arbitrary(u: &mut Unstructured<'a>) -> Result<Self> {
        let ready = u.ratio(7, 8)?;
        let threads = u.int_in_range(1..=3)?;
        let mut script = Self { threads: vec![Vec::new(); threads], ready, frames: false };
        for _ in 0..u.int_in_range(0..=60)? {
            let thread = u.int_in_range(0..=threads - 1)?;
            script.threads[thread].push(u.arbitrary()?);
        }
        // Read last, so that older inputs keep their meaning.
        script.frames = u.arbitrary()?;
        Ok(script)
    }
}

impl Handles {
    fn get(&self, which: Which) -> *mut c_void {
        let place = |table: &[AtomicUsize; PLACES], n: u8| table[usize::from(n) % PLACES].load(Ordering::Relaxed);
        let value = match which {
            Which::Model(n) => place(&self.models, n),
            Which::Engine(n) => place(&self.engines, n),
            Which::Session(n) => place(&self.sessions, n),
            Which::Null => 0,
            Which::MadeUp(value) => value,
        };
        std::ptr::without_provenance_mut(value)
    }

    /// Stores a new handle, and frees the previous one.
    fn put(table: &[AtomicUsize; PLACES], n: u8, handle: *mut c_void, free: impl Fn(*mut c_void) -> i32) {
        let before = table[usize::from(n) % PLACES].swap(handle.addr(), Ordering::Relaxed);
        while free(std::ptr::without_provenance_mut(before)) == UMO_STATUS_BUSY {
            std::thread::yield_now();
        }
    }
}

fn change<T>(value: &mut T, changes: &Changes) {
    let words = size_of::<T>() / 4;
    for &(at, word) in &changes.words[..usize::from(changes.count % 3)] {
        let at = usize::from(at) % words;
        // The structure must be as long as it says: other tests check its size. The library cannot check pointers.
        if at > 0 {
            unsafe { (&raw mut *value).cast::<u32>().add(at).write(word) };
        }
    }
}

/// Buffers of one thread.
struct Hands {
    floats: Vec<f32>,
    words: Vec<i16>,
    room: Vec<u8>,
}

unsafe extern "C" fn allocate(_: *mut c_void, size: usize, alignment: usize) -> *mut c_void {
    let layout = std::alloc::Layout::from_size_align(size, alignment).unwrap();
    unsafe { std::alloc::System.alloc(layout) }.cast()
}

unsafe extern "C" fn release(_: *mut c_void, memory: *mut c_void, size: usize, alignment: usize) {
    let layout = std::alloc::Layout::from_size_align(size, alignment).unwrap();
    unsafe { std::alloc::System.dealloc(memory.cast(), layout) };
}
use std::alloc::GlobalAlloc as _;

const HOOKS: UmoAllocator = UmoAllocator { userdata: null_mut(), allocate: Some(allocate), release: Some(release) };

fn check(status: UmoStatus) {
    assert!((UMO_STATUS_PACKET..=UMO_STATUS_OK).contains(&status), "{status} is not a status");
    assert!(status != UMO_STATUS_PANIC, "a defect was caught");
    for text in [umo_status_message(status), umo_last_error()] {
        // Both are terminated.
        assert!(unsafe { CStr::from_ptr(text) }.count_bytes() < UMO_ERROR_SIZE);
    }
}

fn model_config(changes: &Changes) -> UmoModelConfig {
    let mut config = unsafe { std::mem::zeroed() };
    check(unsafe { umo_model_config_init(&mut config, size_of::<UmoModelConfig>()) });
    change(&mut config, changes);
    config.log = null();
    config
}

/// Size of a structure, for its `struct_size`.
fn sized<T>() -> u32 {
    u32::try_from(size_of::<T>()).expect("a structure is small")
}

fn layout(model: *const UmoModel, changes: &Changes) -> UmoFrameLayout {
    let mut layout: UmoFrameLayout = unsafe { std::mem::zeroed() };
    layout.struct_size = sized::<UmoFrameLayout>();
    check(unsafe { umo_frame_layout_init(&mut layout, size_of::<UmoFrameLayout>(), model) });
    change(&mut layout, changes);
    layout
}

#[expect(clippy::too_many_lines, reason = "one arm for each call")]
fn run(call: &Call, handles: &Handles, hands: &mut Hands) {
    let model = |which| handles.get(which).cast::<UmoModel>();
    let engine = |which| handles.get(which).cast::<UmoEngine>();
    let session = |which| handles.get(which).cast::<UmoSession>();
    let any_model = || handles.get(Which::Model(0)).cast::<UmoModel>();
    let mut count = 0;
    let status = match call {
        Call::ModelLoad { to, abi, good_abi, len, changes } => {
            let abi = if *good_abi { UMO_ABI_VERSION } else { *abi };
            let (len, there) = len.of(model_bytes().len());
            let data = if there { model_bytes().as_ptr() } else { null() };
            let (config, mut made) = (model_config(changes), null_mut());
            let status = unsafe { umo_model_load_memory(abi, data.cast(), len, &config, &mut made) };
            if status == UMO_STATUS_OK {
                Handles::put(&handles.models, *to, made.cast(), |handle| umo_model_free(handle.cast()));
            }
            status
        }
        Call::ModelFree(which) => umo_model_free(model(*which)),
        Call::ModelAsk(which, what) => {
            let (mut info, mut text) = (unsafe { std::mem::zeroed::<UmoModelInfo>() }, null());
            let whole = sized::<UmoModelInfo>();
            info.struct_size = if what % 3 == 0 { *what % whole } else { whole };
            check(unsafe { umo_model_get_info(model(*which), &mut info) });
            // Only the pointer is checked: another thread may free the model, and with it the text.
            check(unsafe { umo_model_get_text(model(*which), *what, &mut text) });
            let (mut parents, mut offsets) = ([0; 55], [0.0; 3 * 55]);
            let (parents, offsets) = (parents.as_mut_ptr(), offsets.as_mut_ptr());
            check(unsafe { umo_model_get_skeleton(model(*which), what % 4, parents, offsets, (what % 56) as usize) });
            unsafe { umo_model_get_channel_name(model(*which), *what, &mut text) }
        }
        Call::Encode(which, text, size) => {
            let mut ids = [0; 128];
            let (capacity, there) = size.of(ids.len());
            let ids = if there { ids.as_mut_ptr() } else { null_mut() };
            let (text, len) = (text.as_ptr().cast::<c_char>(), text.len());
            unsafe { umo_model_encode_text(model(*which), text, len, ids, capacity, &mut count) }
        }
        Call::EngineNew { of, to, changes } => {
            let mut config: UmoEngineConfig = unsafe { std::mem::zeroed() };
            check(unsafe { umo_engine_config_init(&mut config, size_of::<UmoEngineConfig>()) });
            (config.max_sessions, config.max_batch) = (4, 2);
            change(&mut config, changes);
            // Limited, so that creating threads does not take all the time.
            (config.threads, config.max_batch) = (config.threads.min(70) % 66, config.max_batch % 6);
            if config.threads > 3 && config.threads < 65 {
                config.threads = 3;
            }
            (config.cores, config.jobs, config.log) = (null(), null(), null());
            let mut made = null_mut();
            let status = unsafe { umo_engine_new(model(*of), &config, &mut made) };
            if status == UMO_STATUS_OK {
                Handles::put(&handles.engines, *to, made.cast(), |handle| umo_engine_free(handle.cast()));
            }
            status
        }
        Call::EngineFree(which) => umo_engine_free(engine(*which)),
        Call::Poll(which, budget) => {
            let mut more = 0;
            unsafe { umo_engine_poll(engine(*which), u32::from(*budget), &mut more) }
        }
        Call::SessionNew { of, to, changes, hooks } => {
            let mut config = session_config(any_model(), changes);
            config.allocator = if *hooks { &HOOKS } else { null() };
            let mut made = null_mut();
            let status = unsafe { umo_session_new(engine(*of), &config, &mut made) };
            if status == UMO_STATUS_OK {
                Handles::put(&handles.sessions, *to, made.cast(), |handle| umo_session_free(handle.cast()));
            }
            status
        }
        Call::SessionMemory(of, changes) => {
            let config = session_config(any_model(), changes);
            unsafe { umo_session_memory(engine(*of), &config, &mut count, null_mut()) }
        }
        Call::SessionFree(which) => umo_session_free(session(*which)),
        Call::Push(which, size, floats) => {
            let (len, there) = size.of(SAMPLES);
            if *floats {
                let samples = if there { hands.floats.as_ptr() } else { null() };
                unsafe { umo_session_push_audio(session(*which), samples, len, &mut count) }
            } else {
                let samples = if there { hands.words.as_ptr() } else { null() };
                unsafe { umo_session_push_audio_i16(session(*which), samples, len, null_mut()) }
            }
        }
        Call::Finish(which) => umo_session_finish(session(*which)),
        Call::Interrupt(which, ease) => umo_session_interrupt(session(*which), *ease),
        Call::Reset(which) => umo_session_reset(session(*which)),
        Call::Pull(which, changes, size) => {
            let (size, there) = size.of(ROOM);
            let frames = if there { hands.room.as_mut_ptr() } else { null_mut() };
            let layout = layout(any_model(), changes);
            unsafe { umo_session_pull_frames(session(*which), &layout, frames.cast(), size, &mut count) }
        }
        Call::Sample(which, seconds, changes, size) => {
            let (size, there) = size.of(ROOM);
            let frame = if there { hands.room.as_mut_ptr() } else { null_mut() };
            let (layout, mut sampled) = (layout(any_model(), changes), unsafe { std::mem::zeroed::<UmoSampled>() });
            sampled.struct_size = sized::<UmoSampled>();
            unsafe { umo_session_sample_pose(session(*which), *seconds, &layout, frame.cast(), size, &mut sampled) }
        }
        Call::Ready(which) => {
            let mut done = 0;
            check(unsafe { umo_session_is_done(session(*which), &mut done) });
            let [mut arousal, mut trend] = [0.0; 2];
            check(unsafe { umo_session_arousal(session(*which), &mut arousal, &mut trend) });
            unsafe { umo_session_ready_frames(session(*which), &mut count) }
        }
        Call::Prompt(which, text) => unsafe {
            umo_session_set_prompt(session(*which), text.as_ptr().cast(), text.len())
        },
        Call::PromptIds(which, ids) => unsafe { umo_session_set_prompt_ids(session(*which), ids.as_ptr(), ids.len()) },
        Call::Seed(which, seed) => umo_session_set_seed(session(*which), *seed),
        Call::Set(which, parameter, value) => umo_session_set_parameter(session(*which), (*parameter).into(), *value),
        Call::Get(which, parameter) => {
            let mut value = 0.0;
            unsafe { umo_session_get_parameter(session(*which), *parameter, &mut value) }
        }
        Call::Ask(which, size) => {
            let (mut latency, mut stats) =
                (unsafe { std::mem::zeroed::<UmoLatency>() }, unsafe { std::mem::zeroed::<UmoStats>() });
            let whole = sized::<UmoStats>();
            latency.struct_size = sized::<UmoLatency>();
            stats.struct_size = if size % 2 == 0 { whole } else { size % (whole + 1) };
            check(unsafe { umo_session_latency(session(*which), &mut latency) });
            unsafe { umo_session_stats(session(*which), &mut stats) }
        }
        Call::LastError(which, size) => {
            let (size, there) = size.of(ROOM);
            let buffer = if there { hands.room.as_mut_ptr() } else { null_mut() };
            unsafe { umo_session_last_error(session(*which), buffer.cast(), size, &mut count) }
        }
        Call::Save(which, size) => {
            let (size, there) = size.of(ROOM);
            let state = if there { hands.room.as_mut_ptr() } else { null_mut() };
            unsafe { umo_session_save(session(*which), state.cast(), size, &mut count) }
        }
        Call::Restore(which, size, change) => {
            let mut written = 0;
            let target = session(*which);
            let state = hands.room.as_mut_ptr();
            check(unsafe { umo_session_save(target, state.cast(), ROOM, &mut written) });
            if let Some((at, value)) = change {
                hands.room[usize::from(*at)] ^= value;
            }
            let size = if written > 0 { written } else { size.of(ROOM).0.min(ROOM) };
            unsafe { umo_session_restore(target, hands.room.as_ptr().cast(), size) }
        }
        Call::LookAt(which, axes, point, strength) => {
            let point = if axes % 7 == 6 { null() } else { point.as_ptr() };
            unsafe { umo_session_look_at(session(*which), axes % 4, point, *strength) }
        }
        Call::Mood(which, mood, strength) => umo_session_set_mood(session(*which), mood % 9, *strength),
        Call::Other(which, size) => {
            let (len, there) = size.of(SAMPLES);
            let samples = if there { hands.floats.as_ptr() } else { null() };
            unsafe { umo_session_push_other_audio(session(*which), samples, len) }
        }
        Call::Clock(which, seconds) => umo_session_set_clock(session(*which), *seconds),
        Call::Layer(which, layer, gain) => {
            let parameter = UMO_PARAMETER_LAYER_GAZE + u32::from(layer % 7);
            umo_session_set_parameter(session(*which), parameter, f64::from(*gain))
        }
        Call::Gesture(which, name, changes) => {
            let mut options: UmoGestureOptions = unsafe { std::mem::zeroed() };
            check(unsafe { umo_gesture_options_init(&mut options, size_of::<UmoGestureOptions>()) });
            let given = changes.as_ref().map_or(null(), |changes| {
                change(&mut options, changes);
                &raw const options
            });
            unsafe { umo_session_play_gesture(session(*which), gesture(*name), given) }
        }
        Call::Lips(which, shape, start, duration) => umo_session_hint_lips(session(*which), shape % 4, *start, *duration),
        Call::AddGesture(of, name, changes, size) => {
            let mut clip: UmoGestureClip = unsafe { std::mem::zeroed() };
            check(unsafe { umo_gesture_clip_init(&mut clip, size_of::<UmoGestureClip>()) });
            change(&mut clip, changes);
            // As many frames as there are floats for, or more with NULL.
            let (frames, there) = size.of(SAMPLES / (4 * UMO_JOINT_COUNT as usize));
            clip.frame_count = u32::try_from(frames).unwrap_or(u32::MAX);
            clip.rotations = if there { hands.floats.as_ptr() } else { null() };
            unsafe { umo_engine_add_gesture(engine(*of), gesture(*name), &clip) }
        }
        Call::AddGestureFile { of, name, animation, parts, stroke, size, change: (at, value) } => {
            let mut file = SALUTE.to_vec();
            file[usize::from(*at) % SALUTE.len()] ^= value;
            let (size, there) = size.of(file.len());
            let data = if there { file.as_ptr() } else { null() };
            let animation = [null(), c"turn".as_ptr(), c"none".as_ptr()][usize::from(animation % 3)];
            let add = umo_engine_add_gesture_memory;
            unsafe { add(engine(*of), gesture(*name), data.cast(), size, animation, parts % 18, *stroke) }
        }
        Call::GestureName(of, index) => {
            let mut name = null();
            unsafe { umo_engine_get_gesture_name(engine(*of), index % 40, &mut name) }
        }
        Call::Live { of, to, smoothing, guidance, horizon } => {
            let mut config = session_config(any_model(), &Changes { words: [(0, 0); 2], count: 0 });
            config.voice = UMO_VOICE_LIVE;
            (config.smoothing, config.guidance, config.horizon) = (*smoothing, *guidance, *horizon);
            let mut made = null_mut();
            let status = unsafe { umo_session_new(engine(*of), &config, &mut made) };
            if status == UMO_STATUS_OK {
                Handles::put(&handles.sessions, *to, made.cast(), |handle| umo_session_free(handle.cast()));
            }
            status
        }
        Call::Free(n) => {
            let which = Which::Session(*n);
            umo_session_free(session(which))
        }
    };
    check(status);
}

/// A gesture's name, or NULL.
fn gesture(n: u8) -> *const c_char {
    GESTURES.get(usize::from(n) % (GESTURES.len() + 1)).map_or(null(), |name| name.as_ptr())
}

fn session_config(model: *const UmoModel, changes: &Changes) -> UmoSessionConfig {
    let mut config: UmoSessionConfig = unsafe { std::mem::zeroed() };
    check(unsafe { umo_session_config_init(&mut config, size_of::<UmoSessionConfig>(), model) });
    change(&mut config, changes);
    // Filters between rates without a common divisor take seconds to plan under a sanitizer; other tests cover them.
    if config.sample_rate % 50 != 0 {
        config.sample_rate = 48_000;
    }
    (config.template_name, config.allocator) = (null(), null());
    config
}

/// Each model, loaded once, and again after a call has freed it: loading takes longer than everything else.
static KEPT: [AtomicUsize; MODELS.len()] = [const { AtomicUsize::new(0) }; MODELS.len()];

/// Slot of the model that this run loads.
fn place() -> &'static AtomicUsize {
    &KEPT[CHOSEN.load(Ordering::Relaxed)]
}

fn kept_model() -> usize {
    let mut info = unsafe { std::mem::zeroed::<UmoModelInfo>() };
    info.struct_size = sized::<UmoModelInfo>();
    let kept = place().load(Ordering::Relaxed);
    if unsafe { umo_model_get_info(std::ptr::without_provenance(kept), &mut info) } == UMO_STATUS_OK {
        return kept;
    }
    let mut made = null_mut();
    let loaded = unsafe {
        umo_model_load_memory(UMO_ABI_VERSION, model_bytes().as_ptr().cast(), model_bytes().len(), null(), &mut made)
    };
    assert_eq!(loaded, UMO_STATUS_OK);
    place().store(made.addr(), Ordering::Relaxed);
    made.addr()
}

fuzz_target!(|script: Script| {
    CHOSEN.store(usize::from(script.frames), Ordering::Relaxed);
    let handles = Handles::default();
    let none = Changes { words: [(0, 0); 2], count: 0 };
    let hands = || Hands {
        floats: (0..SAMPLES as u32)
            .map(|i| if i % 997 == 0 { f32::from_bits(i * 7_919) } else { (i % 200) as f32 / 400.0 })
            .collect(),
        words: (0..SAMPLES as i32).map(|i| (i * 7_919 % 60_000 - 30_000) as i16).collect(),
        room: vec![0; ROOM],
    };
    if script.ready {
        let mut hands = hands();
        handles.models[0].store(kept_model(), Ordering::Relaxed);
        let polled = Changes { words: [(1, UMO_ENGINE_POLLED), (2, 1)], count: script.threads.len() as u8 % 3 };
        run(&Call::EngineNew { of: Which::Model(0), to: 0, changes: polled }, &handles, &mut hands);
        run(&Call::SessionNew { of: Which::Engine(0), to: 0, changes: none, hooks: false }, &handles, &mut hands);
    }
    std::thread::scope(|scope| {
        let threads: Vec<_> = script
            .threads
            .iter()
            .map(|calls| {
                let handles = &handles;
                scope.spawn(move || {
                    let mut hands = hands();
                    calls.iter().for_each(|call| run(call, handles, &mut hands));
                })
            })
            .collect();
        // Joined explicitly: allocations of a thread that has not ended yet would count as leaks.
        threads.into_iter().for_each(|thread| thread.join().expect("calls do not panic"));
    });
    // The model kept between runs is not freed, unless a call has freed it.
    let kept = place().load(Ordering::Relaxed);
    for model in &handles.models {
        let _ = model.compare_exchange(kept, 0, Ordering::Relaxed, Ordering::Relaxed);
    }
    for n in 0..PLACES as u8 {
        Handles::put(&handles.sessions, n, null_mut(), |handle| umo_session_free(handle.cast()));
        Handles::put(&handles.engines, n, null_mut(), |handle| umo_engine_free(handle.cast()));
        Handles::put(&handles.models, n, null_mut(), |handle| umo_model_free(handle.cast()));
    }
});
