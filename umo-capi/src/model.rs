//! Models: loaded once, immutable, shared by any number of engines.

pub mod inspect;

use std::ffi::{CString, c_char, c_void};
use std::sync::Arc;

use umo_core::{
    FaceKind, JOINTS, LoadError, MAX_PROMPT_TOKENS, Model, ModelFile, Precision, SessionConfig, VISEMES, Visemes,
};
use umo_core_base::memory;
use umo_core_base::time::Instant;
use umo_kernels::Isa;

use crate::UMO_ABI_VERSION;
use crate::ffi::{self, Sized32, guard, put, wanted};
use crate::handle::{self, Guard, Table};
use crate::log::{Log, UMO_LOG_INFO, UMO_LOG_WARNING, UmoLog};
use crate::status::{Failure, UMO_STATUS_VERSION, UmoStatus};

/// A loaded model. A handle, never a pointer to memory.
pub struct UmoModel {
    _opaque: [u8; 0],
}

/// Weights as stored in the file.
pub const UMO_PRECISION_STORED: u32 = 0;
/// All products in f32.
pub const UMO_PRECISION_F32: u32 = 1;
/// Weights rounded to bfloat16.
pub const UMO_PRECISION_BF16: u32 = 2;
/// Weights rounded to int8.
pub const UMO_PRECISION_INT8: u32 = 3;

/// All networks of the model.
pub const UMO_PARTS_ALL: u32 = 0;
/// The live mouth alone, at its stored precision: a fraction of the memory. Sessions need `UMO_VOICE_MOUTH`, and engines have
/// no threads.
pub const UMO_PARTS_MOUTH: u32 = 1;

/// The fastest instruction set of the processor.
pub const UMO_ISA_BEST: u32 = 0;
/// Portable code.
pub const UMO_ISA_SCALAR: u32 = 1;
/// At most AVX2.
pub const UMO_ISA_AVX2: u32 = 2;
/// At most AVX-512 with VNNI.
pub const UMO_ISA_AVX512VNNI: u32 = 3;
/// At most AMX.
pub const UMO_ISA_AMX: u32 = 4;
/// At most AVX-512 with VNNI and products of bfloat16.
pub const UMO_ISA_AVX512BF16: u32 = 5;
/// At most AVX2 with VNNI.
pub const UMO_ISA_AVXVNNI: u32 = 6;
/// At most NEON, on 64-bit Arm.
pub const UMO_ISA_NEON: u32 = 7;
/// At most NEON with dot products of int8.
pub const UMO_ISA_NEON_DOTPROD: u32 = 8;
/// At most NEON with dot products and matrix products of int8.
pub const UMO_ISA_NEON_I8MM: u32 = 9;
/// Added to one of the others: the same bits on every processor, from the same sound. docs/packets.md says when it pays.
pub const UMO_ISA_PORTABLE: u32 = 256;

/// Options for loading a model. Initialise them with `umo_model_config_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoModelConfig {
    /// `sizeof(umo_model_config)`.
    pub struct_size: u32,
    /// One of `UMO_PRECISION_…`.
    pub precision: u32,
    /// Upper bound on the instruction set: one of `UMO_ISA_…`. Float products round differently on some of
    /// them, so a session can give other frames, unless `UMO_ISA_PORTABLE` is added: docs/spec.md, section 2.9, says
    /// which give equal ones.
    pub isa: u32,
    /// Networks to load: one of `UMO_PARTS_…`.
    pub parts: u32,
    /// Log callback for this model, or NULL. The structure is copied while the model is loaded.
    pub log: *const UmoLog,
}

// SAFETY: `repr(C)`, starts with its size, integers and a pointer that may be NULL.
unsafe impl Sized32 for UmoModelConfig {
    const FIRST: usize = 16 + size_of::<*const UmoLog>();
}

/// Properties of a model. Set `struct_size`; `umo_model_get_info` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoModelInfo {
    /// `sizeof(umo_model_info)`.
    pub struct_size: u32,
    /// Frames per second: 30.
    pub frame_rate: u32,
    /// Sample rate of the model's input in Hz; sessions take any rate and resample.
    pub sample_rate: u32,
    /// Joints of the body: the 55 of SMPL-X.
    pub joints: u32,
    /// Face channels.
    pub channels: u32,
    /// 1 if face channels are the 52 ARKit blendshapes, 0 to 1; 0 if they are SMPL-X expression
    /// coefficients.
    pub is_arkit: u32,
    /// Frames from one keyframe to the next.
    pub keyframe_stride: u32,
    /// Keyframes predicted per chunk by default.
    pub target: u32,
    /// Maximum number of keyframes per chunk.
    pub max_target: u32,
    /// Frames held back by default.
    pub lookahead: u32,
    /// Frames of future speech that a frame needs at most, with the default configuration.
    pub latency_frames: u32,
    /// Maximum number of ids in a prompt.
    pub max_prompt: u32,
    /// 1 if texts can be prompts, so that `umo_session_set_prompt` works.
    pub has_text: u32,
    /// 1 if `UMO_MODEL_NOTICE` must be shown to users: for example, that the model was never trained.
    pub has_notice: u32,
    /// Size of the model file in bytes.
    pub file_size: u64,
    /// 1 if the model has a mouth network, so that sessions can use `UMO_VOICE_LIVE` and `UMO_VOICE_MOUTH`.
    pub has_mouth: u32,
    /// Upper bound on `umo_session_config.horizon`: keyframes of audio behind a chunk that a session can
    /// wait for. Useful if the whole recording is available. 0 if the model does not hear ahead.
    pub max_horizon: u32,
}

// SAFETY: `repr(C)`, starts with its size, integers.
unsafe impl Sized32 for UmoModelInfo {
    const FIRST: usize = 72;
}

/// Name of the model.
pub const UMO_MODEL_NAME: u32 = 1;
/// Licence of its weights.
pub const UMO_MODEL_LICENSE: u32 = 2;
/// Notice that must be shown to users; may be empty.
pub const UMO_MODEL_NOTICE: u32 = 3;
/// Instruction set that the model was packed for, such as `avx512vnni`.
pub const UMO_MODEL_ISA: u32 = 4;
/// Prompts that the model was trained with, one a line; empty if it has no list.
pub const UMO_MODEL_PROMPTS: u32 = 5;

/// Visemes per frame.
pub const UMO_VISEME_COUNT: u32 = 15;
/// Joints of every model.
pub const UMO_JOINT_COUNT: u32 = 55;

const _: () = assert!(VISEMES == UMO_VISEME_COUNT as usize && JOINTS == UMO_JOINT_COUNT as usize);

/// Object of a model's handle.
pub(crate) struct ModelHandle {
    pub(crate) model: Arc<Model>,
    pub(crate) visemes: Option<Visemes>,
    texts: [CString; 5],
    channels: Box<[CString]>,
    pub(crate) channel_texts: Texts,
    info: UmoModelInfo,
    pub(crate) log: Log,
}

/// C strings that live as long and never change.
pub(crate) struct Texts(pub(crate) Box<[*const c_char]>);

// SAFETY: the strings, which are in the same `ModelHandle`, are never written.
unsafe impl Send for Texts {}
// SAFETY: as above.
unsafe impl Sync for Texts {}

/// Maximum number of models at once.
const MAX_MODELS: usize = 1024;
/// Models, each shared by its handle and its engines.
pub(crate) static MODELS: Table<Arc<ModelHandle>, MAX_MODELS> = Table::new(1, "model");

pub(crate) fn get(model: *const UmoModel) -> Result<Guard<'static, Arc<ModelHandle>>, Failure> {
    if model.is_null() {
        return Err(Failure::null("model"));
    }
    MODELS.get(model.addr())
}

/// Checks that a program compiled with `abi` can use this library: equal major version, and at most this
/// minor version.
pub(crate) fn check_abi(abi: u32) -> Result<(), Failure> {
    if abi >> 16 == UMO_ABI_VERSION >> 16 && abi & 0xffff <= UMO_ABI_VERSION & 0xffff {
        return Ok(());
    }
    let (major, minor) = (abi >> 16, abi & 0xffff);
    let (have_major, have_minor) = (UMO_ABI_VERSION >> 16, UMO_ABI_VERSION & 0xffff);
    let what = format_args!("umo.h has ABI {major}.{minor}, this library has ABI {have_major}.{have_minor}");
    Err(Failure::new(UMO_STATUS_VERSION, what))
}

impl UmoModelConfig {
    const DEFAULT: Self = Self {
        struct_size: 0,
        precision: UMO_PRECISION_STORED,
        isa: UMO_ISA_BEST,
        parts: UMO_PARTS_ALL,
        log: std::ptr::null(),
    };
}

fn precision(number: u32) -> Result<Precision, Failure> {
    match number {
        UMO_PRECISION_STORED => Ok(Precision::Stored),
        UMO_PRECISION_F32 => Ok(Precision::F32),
        UMO_PRECISION_BF16 => Ok(Precision::Bf16),
        UMO_PRECISION_INT8 => Ok(Precision::Int8),
        _ => Err(Failure::argument(format_args!("precision {number} is not one of UMO_PRECISION_…"))),
    }
}

/// Returns the fastest back-end up to a cap; a cap of another architecture gives portable code.
fn isa(number: u32) -> Result<Isa, Failure> {
    let best: &[&str] = &[];
    let allowed = match number & !UMO_ISA_PORTABLE {
        UMO_ISA_BEST => best,
        UMO_ISA_SCALAR => &["scalar"],
        UMO_ISA_AVX2 => &["scalar", "avx2"],
        UMO_ISA_AVXVNNI => &["scalar", "avx2", "avxvnni"],
        UMO_ISA_AVX512VNNI => &["scalar", "avx2", "avxvnni", "avx512vnni"],
        UMO_ISA_AVX512BF16 => &["scalar", "avx2", "avxvnni", "avx512vnni", "avx512bf16"],
        UMO_ISA_AMX => &["scalar", "avx2", "avxvnni", "avx512vnni", "avx512bf16", "amx"],
        UMO_ISA_NEON => &["scalar", "neon"],
        UMO_ISA_NEON_DOTPROD => &["scalar", "neon", "neon_dotprod"],
        UMO_ISA_NEON_I8MM => &["scalar", "neon", "neon_dotprod", "neon_i8mm"],
        _ => return Err(Failure::argument(format_args!("isa {number} is not one of UMO_ISA_…"))),
    };
    let is_allowed = |isa: &Isa| allowed.is_empty() || allowed.contains(&isa.name());
    let isa = Isa::available().filter(is_allowed).last().unwrap_or(Isa::SCALAR);
    Ok(if number & UMO_ISA_PORTABLE == 0 { isa } else { isa.portable() })
}

/// # Safety
/// `config` is NULL or has as many readable bytes as its `struct_size` says; its `log` is NULL or
/// readable.
unsafe fn read_config(config: *const UmoModelConfig) -> Result<(Loading, Log), Failure> {
    let config = if config.is_null() {
        UmoModelConfig::DEFAULT
    } else {
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::read(config, "config")? }
    };
    let is_mouth = match config.parts {
        UMO_PARTS_ALL => false,
        UMO_PARTS_MOUTH => true,
        parts => return Err(Failure::argument(format_args!("parts {parts} is not one of UMO_PARTS_…"))),
    };
    // SAFETY: guaranteed by the caller (see # Safety).
    let log = Log(unsafe { crate::read_if_given(config.log, "config.log")? });
    Ok((Loading { precision: precision(config.precision)?, isa: isa(config.isa)?, is_mouth }, log))
}

/// What is loaded of a model, and for which products.
#[derive(Clone, Copy)]
struct Loading {
    precision: Precision,
    isa: Isa,
    /// Whether the live mouth alone is loaded.
    is_mouth: bool,
}

/// Loads on threads that end before it returns, so that the library can be unloaded.
#[cfg(all(feature = "threads", not(target_family = "wasm")))]
fn load_model(file: &ModelFile, loading: Loading) -> Result<Model, Failure> {
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, Barrier, Mutex, PoisonError};
    use umo_core_base::thread;

    /// What a thread of the pool allocates by itself at its start, bytes, at most.
    const START: usize = 64 << 10;

    let Loading { precision, isa, is_mouth } = loading;
    if is_mouth {
        return Ok(Model::load_mouth(file, isa)?);
    }
    let count = thread::available();
    let threads = Mutex::new(Vec::with_capacity(count));
    let starved = AtomicBool::new(false);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(count).spawn_handler(|builder| {
        let name = format!("umo-load-{}", builder.index());
        let starves = || {
            starved.store(true, Ordering::Relaxed);
            std::io::Error::from(std::io::ErrorKind::OutOfMemory)
        };
        memory::check_thread().map_err(|_| starves())?;
        // The system ends the process where a thread has no memory for what it keeps by itself: it takes its heap before the
        // next thread may use up what is left.
        let (met, has_heap) = (Arc::new(Barrier::new(2)), Arc::new(AtomicBool::new(false)));
        let (meets, tells) = (Arc::clone(&met), Arc::clone(&has_heap));
        let started = thread::start(name, move || {
            let fits = memory::check(START).is_ok();
            tells.store(fits, Ordering::Release);
            meets.wait();
            if fits {
                builder.run();
            }
        })?;
        threads.lock().unwrap_or_else(PoisonError::into_inner).push(started);
        met.wait();
        if has_heap.load(Ordering::Acquire) { Ok(()) } else { Err(starves()) }
    });
    // Without memory for a thread, the system says only that it did not start it.
    let no_thread = |error| match memory::check_thread() {
        _ if starved.load(Ordering::Relaxed) => memory::OutOfMemory { bytes: START }.into(),
        Ok(()) => Failure::new(crate::status::UMO_STATUS_THREAD, error),
        Err(missing) => missing.into(),
    };
    let pool = pool.build().map_err(no_thread)?;
    // Rayon's threads register destructors when they first look for work, for which the system ends the process where it
    // has no memory: they have looked before the model takes any.
    pool.broadcast(|_| ());
    let model = pool.install(|| Model::load(file, precision, isa));
    drop(pool);
    // Their last instructions are also in this library.
    for thread in threads.into_inner().unwrap_or_else(PoisonError::into_inner) {
        drop(thread.join());
    }
    Ok(model?)
}

/// Loads on the calling thread, the only one.
#[cfg(not(all(feature = "threads", not(target_family = "wasm"))))]
fn load_model(file: &ModelFile, loading: Loading) -> Result<Model, Failure> {
    let Loading { precision, isa, is_mouth } = loading;
    Ok(if is_mouth { Model::load_mouth(file, isa)? } else { Model::load(file, precision, isa)? })
}

#[cfg(feature = "files")]
fn open(path: &str) -> Result<ModelFile, Failure> {
    Ok(ModelFile::open(path.as_ref())?)
}

#[cfg(not(feature = "files"))]
fn open(path: &str) -> Result<ModelFile, Failure> {
    Err(Failure::no_files(path, "umo_model_load_memory"))
}

/// Loads a model from the file that `open` returns; returns its handle.
fn load(
    open: impl FnOnce() -> Result<ModelFile, Failure>,
    (loading, log): (Loading, Log),
) -> Result<*mut UmoModel, Failure> {
    let start = Instant::now();
    let loaded = memory::watch(|| {
        let file = open()?;
        let handle = ModelHandle::new(Arc::new(load_model(&file, loading)?), &file, log)?;
        handle::boxed(Arc::new(handle))
    })??;
    let (config, ms, mib) = (loaded.model.config(), start.elapsed().as_millis(), loaded.info.file_size >> 20);
    log.say(UMO_LOG_INFO, format_args!("loaded {} ({mib} MiB, {}) in {ms} ms", config.name, loading.isa.name()));
    if let Some(notice) = &config.notice {
        log.say(UMO_LOG_WARNING, notice);
    }
    Ok(std::ptr::without_provenance_mut(MODELS.insert(loaded)?))
}

impl ModelHandle {
    fn new(model: Arc<Model>, file: &ModelFile, log: Log) -> Result<Self, Failure> {
        let config = model.config();
        let c_string = |text: &str| {
            let bad = |_| LoadError::File("a name in the config holds a zero byte".to_owned());
            CString::new(text).map_err(bad)
        };
        let notice = config.notice.as_deref().unwrap_or_default();
        let count = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
        let info = UmoModelInfo {
            struct_size: 0,
            frame_rate: count(config.frame_rate),
            sample_rate: count(config.audio.sample_rate),
            joints: UMO_JOINT_COUNT,
            channels: count(config.face.names.len()),
            is_arkit: u32::from(config.face.kind == FaceKind::Arkit),
            keyframe_stride: count(config.keyframe_stride),
            target: count(config.target),
            max_target: count(config.max_target),
            lookahead: count(config.lookahead),
            latency_frames: count(SessionConfig::new(config).avatar.latency_frames(config)),
            max_prompt: count(MAX_PROMPT_TOKENS),
            has_text: u32::from(model.text().is_some()),
            has_notice: u32::from(!notice.is_empty()),
            file_size: file.len() as u64,
            has_mouth: u32::from(model.mouth().is_some()),
            max_horizon: count(config.audio.ahead),
        };
        let channels: Box<[CString]> = config.face.names.iter().map(|name| c_string(name)).collect::<Result<_, _>>()?;
        Ok(Self {
            visemes: Visemes::new(&config.face),
            texts: [
                c_string(&config.name)?,
                c_string(&config.license)?,
                c_string(notice)?,
                c_string(model.isa().name())?,
                c_string(&config.prompts.as_deref().unwrap_or_default().join("\n"))?,
            ],
            channel_texts: Texts(channels.iter().map(|name| name.as_ptr()).collect()),
            channels,
            info,
            log,
            model,
        })
    }
}

/// Fills a model configuration with its defaults. `size` is `sizeof *config`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `config` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_config_init(config: *mut UmoModelConfig, size: usize) -> UmoStatus {
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { ffi::initialise(config, size, "config", &UmoModelConfig::DEFAULT) })
}

/// Loads a model from a file. `abi` is `UMO_ABI_VERSION`; `path` is UTF-8; `config` may be NULL.
///
/// Threads: any but the audio thread. Allocates, reads the file, starts threads for the duration of the
/// call, and waits for them: a base-size int8 model takes some 0.3 s.
/// Errors: `VERSION`, `NULL_POINTER`, `IO`, `MODEL` (`umo_last_error` names the tensor or key),
/// `OUT_OF_MEMORY`, `FULL` (1,024 models), `THREAD`, `INVALID_ARGUMENT`, `STRUCT_SIZE`,
/// `UNSUPPORTED` (the library was built without files: docs/platforms.md, "Consoles").
///
/// # Safety
/// `path` is NULL or ends with a zero byte; `config` is NULL or as long as its `struct_size` says;
/// `model` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_load(
    abi: u32,
    path: *const c_char,
    config: *const UmoModelConfig,
    model: *mut *mut UmoModel,
) -> UmoStatus {
    guard(|| {
        check_abi(abi)?;
        wanted(model, "model")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let path = unsafe { ffi::string(path, "path")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let config = unsafe { read_config(config)? };
        let loaded = load(|| open(path), config)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(model, "model", loaded) }
    })
}

/// Loads a model from memory, which is not copied and no longer needed when the call returns: weights are
/// repacked for the processor.
///
/// Threads, errors: as `umo_model_load`, except `IO` and `UNSUPPORTED`.
///
/// # Safety
/// As `umo_model_load`; `data` is NULL or has `size` readable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_load_memory(
    abi: u32,
    data: *const c_void,
    size: usize,
    config: *const UmoModelConfig,
    model: *mut *mut UmoModel,
) -> UmoStatus {
    guard(|| {
        check_abi(abi)?;
        wanted(model, "model")?;
        // SAFETY: the bytes are readable during this call, guaranteed by the caller (see # Safety), and the
        // file that borrows them as static is dropped before it returns; a `Model` keeps nothing of its
        // file.
        let bytes: &'static [u8] = unsafe { ffi::slice(data.cast::<u8>(), size, "data")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let config = unsafe { read_config(config)? };
        let loaded = load(|| Ok(ModelFile::from_static(bytes)?), config)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(model, "model", loaded) }
    })
}

/// Frees a model. Its engines keep the parts that they need. NULL is fine.
///
/// Threads: any but the audio thread. Texts and names of the model are freed with it.
/// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_model_free`
/// again; it takes no other calls).
#[unsafe(no_mangle)]
pub extern "C" fn umo_model_free(model: *mut UmoModel) -> UmoStatus {
    guard(|| {
        if model.is_null() {
            return Ok(());
        }
        let freed = MODELS.remove(model.addr())?;
        freed.log.say(UMO_LOG_INFO, format_args!("freed model {}", freed.model.config().name));
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cap allows only the back-ends that it names, and the highest allows all.
    #[test]
    fn a_cap_is_the_fastest_that_is_allowed() {
        let name = |number| isa(number).map(Isa::name).expect("a cap");
        assert_eq!(name(UMO_ISA_SCALAR), "scalar");
        assert!(["scalar", "avx2"].contains(&name(UMO_ISA_AVX2)));
        assert!(["scalar", "avx2", "avxvnni"].contains(&name(UMO_ISA_AVXVNNI)));
        assert!(["scalar", "avx2", "avxvnni", "avx512vnni"].contains(&name(UMO_ISA_AVX512VNNI)));
        assert_ne!(name(UMO_ISA_AVX512BF16), "amx");
        assert!(["scalar", "neon"].contains(&name(UMO_ISA_NEON)));
        assert!(["scalar", "neon", "neon_dotprod"].contains(&name(UMO_ISA_NEON_DOTPROD)));
        let highest = if cfg!(target_arch = "aarch64") { UMO_ISA_NEON_I8MM } else { UMO_ISA_AMX };
        assert_eq!(name(highest), Isa::detect().name());
        assert_eq!(name(UMO_ISA_BEST), Isa::detect().name());
        for number in [UMO_ISA_BEST, UMO_ISA_SCALAR] {
            assert!(!isa(number).expect("a cap").is_portable());
            assert!(isa(number | UMO_ISA_PORTABLE).expect("a cap").is_portable());
            assert_eq!(name(number | UMO_ISA_PORTABLE), name(number));
        }
        for number in [10, 11, UMO_ISA_PORTABLE | 10, u32::MAX] {
            assert!(isa(number).is_err(), "{number}");
        }
    }
}
