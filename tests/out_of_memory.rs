//! Fails every large allocation of loading a model, making an engine and making a session, alone and
//! with all later ones: each call returns an error and frees its allocations; none ends the process.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use umo_core::{
    Engine, EngineConfig, EngineError, LoadError, Model, ModelFile, OutOfMemory, Precision, SessionConfig, Threads,
};
use umo_core_base::memory;
use umo_core_model::weights::AlignedBox;
use umo_kernels::Isa;

/// Smallest size, in bytes, of an allocation that scales with a model's file or a configuration, in
/// the small model. No allocation of the Fourier transform's planner is this large.
const LARGE: usize = 9 << 10;

/// Size from which memory is mapped and not allocated, bytes.
const REGION: usize = 4 << 20;

/// Large allocations until one fails; negative if none does.
static LEFT: AtomicI64 = AtomicI64::new(-1);
/// Whether all later ones fail too.
static ALL: AtomicI64 = AtomicI64::new(0);
/// Bytes in large allocations.
static HELD: AtomicI64 = AtomicI64::new(0);

struct Failing;

#[global_allocator]
static ALLOCATOR: Failing = Failing;

impl Failing {
    fn fails(size: usize) -> bool {
        if size < LARGE || LEFT.load(Ordering::Relaxed) < 0 {
            return false;
        }
        match LEFT.fetch_sub(1, Ordering::Relaxed) {
            0 if ALL.load(Ordering::Relaxed) == 1 => {
                LEFT.store(0, Ordering::Relaxed);
                true
            }
            left => left == 0,
        }
    }

    fn count(size: usize, sign: i64) {
        if size >= LARGE {
            HELD.fetch_add(sign * i64::try_from(size).unwrap_or_default(), Ordering::Relaxed);
        }
    }
}

// SAFETY: forwards every call to the system allocator, or returns null.
unsafe impl GlobalAlloc for Failing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if Self::fails(layout.size()) {
            return std::ptr::null_mut();
        }
        Self::count(layout.size(), 1);
        // SAFETY: by the caller's contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        Self::count(layout.size(), -1);
        // SAFETY: by the caller's contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Fails each large allocation of `make` in turn and returns their number, which must be at least `least`. `make`
/// returns whether it was refused for lack of memory.
fn fail_each(first: i64, least: i64, make: impl Fn() -> bool) -> i64 {
    // Warms up allocations that this and other libraries make once and keep.
    assert!(!make());
    for all in [0, 1] {
        ALL.store(all, Ordering::Relaxed);
        // The first hundred, then every thirteenth: the many rows of a tensor are alike.
        for n in (first..first + 100).chain((first + 100..).step_by(13)) {
            let before = HELD.load(Ordering::Relaxed);
            LEFT.store(n, Ordering::Relaxed);
            let refused = make();
            let reached = LEFT.swap(-1, Ordering::Relaxed) < 0 || (all == 1 && refused);
            assert_eq!(refused, reached, "allocation {n}");
            assert_eq!(HELD.load(Ordering::Relaxed), before, "allocation {n}");
            if !reached {
                assert!(n >= least, "{n}");
                if all == 1 {
                    return n;
                }
                break;
            }
        }
    }
    unreachable!("the loop ends where no allocation is left to fail")
}

/// Fails the allocation of a mapped region after the reserve, as in a limited address space.
fn a_region_leaves_room_for_small_pieces() {
    ALL.store(1, Ordering::Relaxed);
    // The reserve succeeds, the next allocation fails.
    LEFT.store(1, Ordering::Relaxed);
    let made = memory::catch(|| AlignedBox::<u8>::zeroed(REGION).len());
    LEFT.store(-1, Ordering::Relaxed);
    assert_eq!(made, Err(OutOfMemory { bytes: REGION }));
    assert_eq!(memory::catch(|| AlignedBox::<u8>::zeroed(REGION).len()), Ok(REGION));
}

#[test]
fn no_large_allocation_ends_the_process() {
    a_region_leaves_room_for_small_pieces();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/umo-people/model.safetensors");
    let file = ModelFile::open(path.as_ref()).unwrap();
    let load = || Model::load(&file, Precision::Stored, Isa::detect());
    let loads = fail_each(0, 6, || match load() {
        Ok(_) => false,
        Err(LoadError::Memory(missing)) => {
            assert!(missing.bytes >= 1 && missing.to_string().contains("not enough memory"));
            true
        }
        Err(other) => panic!("{other}"),
    });
    let model = Arc::new(load().unwrap());
    for threads in [Threads::Host(0), Threads::Own(2)] {
        let engine_config = EngineConfig { threads, ..EngineConfig::default() };
        let engines = fail_each(0, 6, || match Engine::new(Arc::clone(&model), &engine_config) {
            Ok(_) => false,
            Err(EngineError::Memory(_)) => true,
            Err(other) => panic!("{other}"),
        });
        let engine = Engine::new(Arc::clone(&model), &engine_config).unwrap();
        let mut config = SessionConfig::new(model.config());
        config.sample_rate = model.config().audio.sample_rate;
        let sessions = fail_each(0, 1, || match engine.session(&config) {
            Ok(session) => {
                drop(session);
                false
            }
            Err(EngineError::Memory(_)) => true,
            Err(other) => panic!("{other}"),
        });
        // The engine caches the filter for this rate.
        let other_rate = SessionConfig { sample_rate: 44_100, ..config };
        let before = engines - 13;
        let sessions_of_another_rate = fail_each(before, before + 2, || {
            let engine = Engine::new(Arc::clone(&model), &engine_config);
            match engine.and_then(|engine| engine.session(&other_rate).map(drop)) {
                Ok(()) => false,
                Err(EngineError::Memory(_)) => true,
                Err(other) => panic!("{other}"),
            }
        });
        println!(
            "{loads} large allocations of a model, {engines} of an engine, {sessions} of a session, \
            {sessions_of_another_rate} of an engine and a session of another rate"
        );
    }
}
