//! Fork-join over a few threads. The work of one product is divided by columns or rows, and every piece uses the same
//! arithmetic: neither the number of threads nor the division ever changes a bit of the result.
//!
//! Cores differ in speed: some share a physical core or run another program, some are small. A thread's share of a
//! job follows the time that its earlier pieces took, and the last pieces of a large job go to the thread that
//! finishes first (a dynamic schedule).
//!
//! A token needs 80 to 100 joins, so waking a sleeping thread for each (15 to 35 us) is too slow. Workers spin for a
//! bounded time before they sleep, and so does the caller while it waits for them. A worker that has no core when a
//! job begins delays nobody: the caller takes the pieces that have not been started. After construction nothing here
//! allocates or locks, and the only system calls are those that put threads to sleep and wake them.
#![expect(
    unsafe_code,
    reason = "a job borrows the caller's stack while the caller waits for it, and the system sets threads' cores and priorities"
)]

mod cores;
mod kinds;
mod priority;
mod shares;
#[cfg(test)]
mod tests;

use std::cell::UnsafeCell;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use umo_kernels::{MatMut, PrefetchHint, SharedHint};

pub use kinds::{CoreGroup, CoreKind, Cores};
pub use priority::Priority;

use crate::defect::{Defect, contain, contain_quietly, resume};
use crate::error::StepError;
use crate::memory;
use crate::sync::{wait, wake_all, wake_one};
use crate::thread::{self, JoinHandle};
use crate::time::Instant;

/// Maximum number of threads in a team.
pub const MAX_THREADS: usize = 64;

/// Extra pieces of a large job, for the threads that finish first.
const DYNAMIC_CHUNKS: usize = 4;

/// Maximum number of pieces in a job.
pub const MAX_PIECES: usize = MAX_THREADS + DYNAMIC_CHUNKS;

/// Multiply-adds from which a dynamic schedule pays: the pieces of smaller jobs are too short.
const DYNAMIC_THRESHOLD: usize = 1 << 24;

/// Number of threads up to which a job's pieces are kept in a small array.
const FEW_THREADS: usize = 4;

/// Multiply-adds below which sharing a job does not pay: about a microsecond of one core.
const PARALLEL_THRESHOLD: usize = 1 << 15;

/// Number of times that a worker polls for a job, and the caller for a job's end, before it sleeps: 20 to 100 us,
/// depending on the processor's pause instruction. With more threads than cores, the awaited thread may need this
/// very core.
const SPINS_BEFORE_SLEEP: u32 = 2_000;

/// Number of times that the caller polls whether the workers have started before it takes their pieces. A worker that
/// is awake starts within a tenth of that, and has its piece's weights in its cache.
const SPINS_BEFORE_TAKEOVER: u32 = 100;

/// A job: called once per piece, with its index.
type Job<'a> = dyn Fn(usize) + Sync + 'a;

/// A few threads that share each piece of work: `threads` of them, including the caller.
#[derive(Debug)]
pub struct Team {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
    threads: usize,
    /// Each thread's share of a job, as the bits of an f32.
    shares: Box<[AtomicU32]>,
    /// Whether external workers take part, each of which may take any piece.
    is_lent: bool,
    /// Whether the caller currently works without the others.
    is_alone: AtomicBool,
}

/// Cores and priority of a team's threads.
#[derive(Clone, Copy, Debug, Default)]
pub struct Placement<'a> {
    /// Core that the calling thread is bound to.
    pub caller: Option<usize>,
    /// Cores of the other threads, in order; surplus threads are not bound.
    pub cores: &'a [usize],
    /// Kind of cores that the threads which are not bound stay on, if the system allows it.
    pub kind: Option<&'a CoreGroup>,
    /// Priority of the other threads.
    pub priority: Priority,
}

/// Splits two values at the same position.
#[expect(clippy::type_complexity, reason = "a pair of pairs; a named type would add nothing")]
pub fn zip_split<A, B>(
    cut: impl Fn(A, usize) -> (A, A),
    and: impl Fn(B, usize) -> (B, B),
) -> impl Fn((A, B), usize) -> ((A, B), (A, B)) {
    move |(a, b), at| {
        let ((a, a_rest), (b, b_rest)) = (cut(a, at), and(b, at));
        ((a, b), (a_rest, b_rest))
    }
}

/// Entry point of external workers: threads that the team does not own.
#[derive(Clone, Debug)]
pub struct ExternalWorkers {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    /// Number of jobs so far; a change is the signal to start. Workers sleep on it.
    epoch: AtomicU32,
    /// The current job: a pointer to a `&Job` on the caller's stack.
    job: AtomicPtr<()>,
    /// Unfinished pieces of the job, other than the caller's own; the caller sleeps on it.
    pending: AtomicU32,
    /// Pieces of the job that have not been started, one bit each.
    open: AtomicU64,
    /// Whether a piece of the job panicked, and the first panic.
    panicked: AtomicBool,
    defect: Mutex<Option<Defect>>,
    /// Whether the team is being dropped.
    stop: AtomicBool,
    /// Whether a job is running.
    busy: AtomicBool,
    /// Workers that may be asleep.
    asleep: AtomicU32,
    /// Whether the caller may be asleep.
    waiting: AtomicBool,
    /// Whether a worker could not be bound to its core.
    unbound: AtomicBool,
    /// Whether a worker did not get its priority.
    refused: AtomicBool,
    /// Odd while external workers may join; a change ends the work of those that joined before.
    joining: AtomicU32,
    /// Prefetch hint for each of the team's own threads.
    expected: Box<[SharedHint]>,
}

impl Team {
    /// Creates a team of `threads` threads (1 to [`MAX_THREADS`]), including the caller; with 1 everything runs
    /// inline.
    ///
    /// # Errors
    /// The system's error if a thread cannot be started.
    pub fn new(threads: usize) -> std::io::Result<Self> {
        Self::placed(threads, Placement::default())
    }

    /// Creates a team whose threads are bound to cores and have a priority.
    ///
    /// # Errors
    /// As in [`Self::new`], and if the system refuses to bind a thread. If it refuses the priority,
    /// [`Self::has_priority`] is false.
    pub fn placed(threads: usize, placement: Placement) -> std::io::Result<Self> {
        let Placement { caller, cores, kind, priority } = placement;
        // Queried before the calling thread is bound to a single core.
        let usable = if caller.is_some() || !cores.is_empty() { cores::usable() } else { Vec::new() };
        let threads = threads.clamp(1, MAX_THREADS);
        let mut team = Self::bare(threads, false);
        team.workers.reserve_exact(threads - 1);
        team.shared.pending.store(count(threads - 1), Ordering::Relaxed);
        for index in 1..threads {
            let shared = Arc::clone(&team.shared);
            let name = format!("umo-{index}");
            let (core, kind) = (cores.get(index - 1).copied(), kind.cloned());
            let work = move || {
                match (core, kind) {
                    (Some(core), _) if !cores::bind(core) => shared.unbound.store(true, Ordering::Relaxed),
                    // Where it is refused, a thread runs where the system puts it.
                    (None, Some(kind)) => {
                        let _ = cores::prefer(&kind);
                    }
                    _ => {}
                }
                if !priority.set() {
                    shared.refused.store(true, Ordering::Relaxed);
                }
                // Panics of pieces are caught earlier; this only keeps a panic from being printed.
                let _ = contain_quietly(|| {
                    shared.done();
                    work(&shared, index);
                });
            };
            memory::require_thread();
            team.workers.push(thread::start(name, work)?);
        }
        let bound = match (caller, kind) {
            (Some(core), _) => cores::bind(core),
            (None, kind) => {
                let _ = kind.map(cores::prefer);
                true
            }
        };
        // Starting a thread allocates; once it reports, that is over.
        team.shared.wait_for_workers();
        // The threads' heaps may have used up what was left.
        memory::require(memory::SPARE);
        if !bound || team.shared.unbound.load(Ordering::Relaxed) {
            return Err(std::io::Error::other(binding_error(caller, cores, &usable)));
        }
        Ok(team)
    }

    /// Whether its own threads got the requested priority.
    pub fn has_priority(&self) -> bool {
        !self.shared.refused.load(Ordering::Relaxed)
    }

    /// Creates a team of `threads` that owns no threads: the caller, and external workers that join while admitted
    /// (`admit`). Without external workers the caller computes everything.
    #[doc(hidden)]
    pub fn with_external_workers(threads: usize) -> Self {
        Self::bare(threads.clamp(1, MAX_THREADS), true)
    }

    /// Creates a team of the calling thread only.
    #[doc(hidden)]
    pub fn alone() -> Self {
        Self::bare(1, false)
    }

    /// Creates a team without workers.
    fn bare(threads: usize, is_lent: bool) -> Self {
        let shares = (0..threads).map(|_| AtomicU32::new(1.0_f32.to_bits())).collect();
        Self {
            shared: Arc::new(Shared::new(threads)),
            workers: Vec::new(),
            threads,
            shares,
            is_lent,
            is_alone: AtomicBool::new(false),
        }
    }

    /// Entry point for external workers.
    #[doc(hidden)]
    pub fn external_workers(&self) -> ExternalWorkers {
        ExternalWorkers { shared: Arc::clone(&self.shared) }
    }

    /// Admits external workers until the result is dropped.
    #[doc(hidden)]
    pub fn admit(&self) -> JoinGuard<'_> {
        self.shared.joining.fetch_or(1, Ordering::SeqCst);
        JoinGuard(&self.shared)
    }

    /// Sets whether the caller runs its next jobs without the others, which go to sleep.
    #[doc(hidden)]
    pub fn set_alone(&self, alone: bool) {
        self.is_alone.store(alone, Ordering::Relaxed);
    }

    /// Number of threads, including the caller.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Maximum number of pieces that a job is divided into.
    #[doc(hidden)]
    pub fn pieces(&self) -> usize {
        if self.threads == 1 { 1 } else { self.threads + DYNAMIC_CHUNKS }
    }

    /// Runs `job(i)` for every `i` below the number of threads, and waits for all. Each worker runs its own index;
    /// the caller runs 0, and the indices that no worker has started.
    ///
    /// If another call is running, all indices run on the calling thread. Panics if `job` panicked.
    #[doc(hidden)]
    pub fn run(&self, job: &Job) {
        let alone = self.threads == 1 || self.shared.busy.swap(true, Ordering::Acquire);
        if alone {
            (0..self.threads).for_each(job);
            return;
        }
        let shared = &*self.shared;
        shared.job.store((&raw const job).cast_mut().cast(), Ordering::Relaxed);
        shared.pending.store(count(self.threads - 1), Ordering::Relaxed);
        let all = u64::MAX >> (u64::BITS - count(self.threads));
        shared.open.store(all & !1, Ordering::Release);
        shared.signal();
        shared.contained(|| job(0));
        if !self.is_lent {
            shared.await_start();
        }
        shared.help();
        shared.wait_for_workers();
        shared.end_job();
    }

    /// Announces the first reads of the job after the next: `hint(piece)` for each piece of its `total` columns or
    /// rows, divided as `split` divides small jobs. Waiting threads prefetch them: memory is idle then, and most of a
    /// token's time is spent reading.
    #[doc(hidden)]
    pub fn prefetch_next<'a>(&self, total: usize, granule: usize, hint: impl Fn(Range<usize>) -> PrefetchHint<'a>) {
        if self.threads == 1 || self.is_lent || self.is_alone.load(Ordering::Relaxed) {
            return;
        }
        let mut ends = [0; MAX_THREADS];
        self.cut(total.div_ceil(granule), &mut [1.0; MAX_THREADS][..self.threads], &mut ends[..self.threads]);
        let mut start = 0;
        for (expected, end) in self.shared.expected.iter().zip(ends) {
            let end = (end * granule).min(total);
            expected.set(if start < end { hint(start..end) } else { PrefetchHint::NONE });
            start = end;
        }
    }

    /// Computes where each thread's piece of `granules` ends, and its share.
    fn cut(&self, granules: usize, shares: &mut [f32], ends: &mut [usize]) {
        for (share, known) in shares.iter_mut().zip(&self.shares) {
            *share = f32::from_bits(known.load(Ordering::Relaxed));
        }
        shares::cut(shares, granules, ends);
    }

    /// Divides the columns of `y` into one piece per thread, each a multiple of `granule` wide (except the last), and
    /// calls `f(columns, piece)` for each. `work` is the number of the job's multiply-adds: small jobs are not
    /// shared.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    #[doc(hidden)]
    pub fn columns<'a, T: Send>(
        &self,
        y: MatMut<'a, T>,
        granule: usize,
        work: usize,
        f: impl Fn(Range<usize>, MatMut<'a, T>) -> Result<(), StepError> + Sync,
    ) -> Result<(), StepError> {
        let total = y.cols();
        self.split(y, total, granule, work, |y, at| y.split_columns(at), f)
    }

    /// Like [`Self::columns`], for rows.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    #[doc(hidden)]
    pub fn rows<'a, T: Send>(
        &self,
        y: MatMut<'a, T>,
        work: usize,
        f: impl Fn(Range<usize>, MatMut<'a, T>) -> Result<(), StepError> + Sync,
    ) -> Result<(), StepError> {
        let total = y.rows();
        self.split(y, total, 1, work, |y, at| y.split_rows(at), f)
    }

    /// Like [`Self::columns`], for the rows of two outputs of equal height.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    #[doc(hidden)]
    pub fn rows_of_two<'a, T: Send, U: Send>(
        &self,
        y: MatMut<'a, T>,
        z: MatMut<'a, U>,
        work: usize,
        f: impl Fn(Range<usize>, MatMut<'a, T>, MatMut<'a, U>) -> Result<(), StepError> + Sync,
    ) -> Result<(), StepError> {
        assert_eq!(y.rows(), z.rows(), "outputs of different heights");
        let total = y.rows();
        let cut = zip_split(MatMut::split_rows, MatMut::split_rows);
        self.split((y, z), total, 1, work, cut, |range, (y, z)| f(range, y, z))
    }

    /// Divides `y` by `cut` into one piece per thread, each a multiple of `granule` of the `total` rows or columns
    /// (except the last), and calls `f` for each. `work` is the number of the job's multiply-adds: small jobs are not
    /// shared.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    #[doc(hidden)]
    pub fn split<Y: Send>(
        &self,
        y: Y,
        total: usize,
        granule: usize,
        work: usize,
        cut: impl Fn(Y, usize) -> (Y, Y),
        f: impl Fn(Range<usize>, Y) -> Result<(), StepError> + Sync,
    ) -> Result<(), StepError> {
        let is_alone = self.threads == 1 || self.is_alone.load(Ordering::Relaxed);
        if is_alone || work < PARALLEL_THRESHOLD || total <= granule {
            return f(0..total, y);
        }
        let is_dynamic = work >= DYNAMIC_THRESHOLD;
        if self.threads <= FEW_THREADS {
            self.share::<Y, { FEW_THREADS + DYNAMIC_CHUNKS }>(y, total, granule, is_dynamic, cut, f)
        } else {
            self.share::<Y, MAX_PIECES>(y, total, granule, is_dynamic, cut, f)
        }
    }

    /// Distributes `total` rows or columns over the threads, in at most `CAPACITY` pieces: one per thread and, for a
    /// large job, a few more for the threads that finish first.
    fn share<Y: Send, const CAPACITY: usize>(
        &self,
        y: Y,
        total: usize,
        granule: usize,
        is_dynamic: bool,
        cut: impl Fn(Y, usize) -> (Y, Y),
        f: impl Fn(Range<usize>, Y) -> Result<(), StepError> + Sync,
    ) -> Result<(), StepError> {
        let threads = self.threads;
        let (mut shares, mut ends) = ([1.0; CAPACITY], [0; CAPACITY]);
        let shares = &mut shares[..threads];
        let granules = total.div_ceil(granule);
        let chunk = if is_dynamic { shares::dynamic_chunk(granules) } else { 0 };
        let count = threads + if chunk > 0 { DYNAMIC_CHUNKS } else { 0 };
        let ends = &mut ends[..count];
        self.cut(granules - chunk * (count - threads), shares, &mut ends[..threads]);
        for piece in threads..count {
            ends[piece] = ends[piece - 1] + chunk;
        }
        ends.iter_mut().for_each(|end| *end = (*end * granule).min(total));
        let pieces: [Piece<Y>; CAPACITY] = std::array::from_fn(|_| Piece::empty());
        let (mut rest, mut start) = (y, 0);
        for (piece, &end) in pieces.iter().zip(&*ends) {
            let (head, tail) = cut(rest, end - start);
            piece.put(head);
            (rest, start) = (tail, end);
        }
        let (ends, next) = (&*ends, AtomicUsize::new(threads));
        self.run(&|thread| {
            let mut i = thread;
            while let Some(&end) = ends.get(i) {
                let (piece, range) = (&pieces[i], if i == 0 { 0 } else { ends[i - 1] }..end);
                if let (Some(y), false) = (piece.take(), range.is_empty()) {
                    let start = Instant::now();
                    piece.finish(f(range, y), start.elapsed());
                }
                i = next.fetch_add(1, Ordering::Relaxed);
            }
        });
        let (mut times, mut error) = ([Duration::ZERO; CAPACITY], None);
        for (time, piece) in times.iter_mut().zip(&pieces) {
            let end = piece.end();
            (*time, error) = (end.1, error.or(end.0));
        }
        // External workers may take any piece, so times do not belong to threads.
        if !self.is_lent && shares::learn(shares, &times[..threads]) {
            for (share, known) in shares.iter().zip(&self.shares) {
                known.store(share.to_bits(), Ordering::Relaxed);
            }
        }
        error.map_or(Ok(()), Err)
    }
}

impl Drop for Team {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.shared.epoch.fetch_add(1, Ordering::SeqCst);
        wake_all(&raw const self.shared.epoch);
        for worker in self.workers.drain(..) {
            // Workers catch the panics of their jobs, so they do not panic themselves.
            drop(worker.join());
        }
    }
}

/// Admits external workers while it lives.
#[derive(Debug)]
pub struct JoinGuard<'a>(&'a Shared);

impl Drop for JoinGuard<'_> {
    fn drop(&mut self) {
        self.0.joining.fetch_add(1, Ordering::SeqCst);
        self.0.signal();
    }
}

impl ExternalWorkers {
    /// Works for the team until admission ends; returns at once if the team admits nobody. Never allocates.
    pub fn work(&self) {
        let shared = &*self.shared;
        let joining = shared.joining.load(Ordering::SeqCst);
        if joining & 1 == 0 {
            return;
        }
        loop {
            let seen = shared.epoch.load(Ordering::SeqCst);
            shared.help();
            if shared.joining.load(Ordering::SeqCst) != joining {
                return;
            }
            shared.next_epoch(seen);
        }
    }
}

impl Shared {
    fn new(threads: usize) -> Self {
        Self {
            open: AtomicU64::new(0),
            epoch: AtomicU32::new(0),
            job: AtomicPtr::new(std::ptr::null_mut()),
            pending: AtomicU32::new(0),
            panicked: AtomicBool::new(false),
            defect: Mutex::new(None),
            stop: AtomicBool::new(false),
            busy: AtomicBool::new(false),
            asleep: AtomicU32::new(0),
            waiting: AtomicBool::new(false),
            unbound: AtomicBool::new(false),
            refused: AtomicBool::new(false),
            joining: AtomicU32::new(0),
            expected: (0..threads).map(|_| SharedHint::default()).collect(),
        }
    }

    /// Wakes threads that wait for a job.
    fn signal(&self) {
        // SeqCst pairs with the worker's: either it sees the new epoch before it sleeps, or we see that it sleeps.
        self.epoch.fetch_add(1, Ordering::SeqCst);
        if self.asleep.load(Ordering::SeqCst) > 0 {
            wake_all(&raw const self.epoch);
        }
    }

    /// Spins briefly until every piece has been started.
    fn await_start(&self) {
        for _ in 0..SPINS_BEFORE_TAKEOVER {
            if self.open.load(Ordering::Relaxed) == 0 {
                return;
            }
            std::hint::spin_loop();
        }
    }

    /// Runs the pieces that have not been started.
    fn help(&self) {
        loop {
            let open = self.open.load(Ordering::Relaxed);
            if open == 0 {
                return;
            }
            self.take(open.trailing_zeros() as usize);
        }
    }

    /// Runs a piece of the job, unless another thread has started it.
    fn take(&self, index: usize) {
        let bit = 1 << index;
        if self.open.load(Ordering::Relaxed) & bit == 0 || self.open.fetch_and(!bit, Ordering::Acquire) & bit == 0 {
            return;
        }
        let job = self.job.load(Ordering::Relaxed).cast::<&Job>();
        // SAFETY: `run` stored a pointer to its own `job` argument before it opened the piece, which only this thread
        // has taken (release and acquire through `open`). It does not return before `pending`, which counts the
        // piece, reaches 0 below.
        let job: &Job = unsafe { *job };
        self.contained(|| job(index));
        self.done();
    }

    /// Runs a piece of the job; the first panic is kept for [`Self::end_job`].
    fn contained(&self, piece: impl FnOnce()) {
        if let Err(defect) = contain(piece) {
            self.panicked.store(true, Ordering::Relaxed);
            self.defect.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(defect);
        }
    }

    /// Ends a job after all threads are done with it. Panics if a piece panicked.
    fn end_job(&self) {
        let panicked = self.panicked.swap(false, Ordering::Relaxed);
        let defect = if panicked { self.defect.lock().unwrap_or_else(PoisonError::into_inner).take() } else { None };
        self.busy.store(false, Ordering::Release);
        if let Some(defect) = defect {
            resume(defect);
        }
    }

    /// Spins, then sleeps, until nothing is pending.
    fn wait_for_workers(&self) {
        self.expected[0].fetch(|| self.pending.load(Ordering::Acquire) == 0);
        for _ in 0..SPINS_BEFORE_SLEEP {
            if self.pending.load(Ordering::Acquire) == 0 {
                return;
            }
            std::hint::spin_loop();
        }
        // SeqCst pairs with the last thread's: either it sees that we wait, or we see that it is done.
        self.waiting.store(true, Ordering::SeqCst);
        loop {
            match self.pending.load(Ordering::SeqCst) {
                0 => break,
                pending => wait(&self.pending, pending),
            }
        }
        self.waiting.store(false, Ordering::Relaxed);
    }

    /// Reports that one pending piece or thread is done.
    fn done(&self) {
        if self.pending.fetch_sub(1, Ordering::SeqCst) == 1 && self.waiting.load(Ordering::SeqCst) {
            wake_one(&raw const self.pending);
        }
    }

    /// Spins, then sleeps, until the epoch differs from `seen`.
    fn next_epoch(&self, seen: u32) -> u32 {
        for _ in 0..SPINS_BEFORE_SLEEP {
            let epoch = self.epoch.load(Ordering::Acquire);
            if epoch != seen {
                return epoch;
            }
            std::hint::spin_loop();
        }
        self.asleep.fetch_add(1, Ordering::SeqCst);
        let epoch = loop {
            let epoch = self.epoch.load(Ordering::SeqCst);
            if epoch != seen {
                break epoch;
            }
            wait(&self.epoch, seen);
        };
        self.asleep.fetch_sub(1, Ordering::Relaxed);
        epoch
    }
}

/// Message for a failed binding: the configured cores that the process may not use, and those that it may.
fn binding_error(caller: Option<usize>, cores: &[usize], usable: &[usize]) -> String {
    let list =
        |cores: &mut dyn Iterator<Item = usize>| cores.map(|core| core.to_string()).collect::<Vec<_>>().join(", ");
    let asked = || caller.into_iter().chain(cores.iter().copied());
    if usable.is_empty() {
        return format!("cores {}: this system cannot bind threads to cores; leave `cores` empty", list(&mut asked()));
    }
    let mut wrong = list(&mut asked().filter(|core| !usable.contains(core)));
    if wrong.is_empty() {
        wrong = list(&mut asked());
    }
    let usable = list(&mut usable.iter().copied());
    format!("cores {wrong}: no thread can be bound to them; this process may use cores {usable}")
}

/// Converts a number of threads or pieces.
fn count(threads: usize) -> u32 {
    threads.try_into().expect("at most 64")
}

/// Main loop of a worker: waits for a new epoch, then runs its own piece of the job, unless the caller has.
fn work(shared: &Shared, index: usize) {
    let mut seen = 0;
    loop {
        shared.expected[index].fetch(|| shared.epoch.load(Ordering::Acquire) != seen);
        seen = shared.next_epoch(seen);
        if shared.stop.load(Ordering::Relaxed) {
            return;
        }
        shared.take(index);
    }
}

/// One thread's piece of the output, and its result.
struct Piece<T> {
    input: UnsafeCell<Option<T>>,
    /// Error, and duration.
    end: UnsafeCell<(Option<StepError>, Duration)>,
}

// SAFETY: during `run` only one thread accesses the cells of piece `i`: the one that took it, or, if the job has no
// such piece, the one with the index `i`. Before and after, only the caller does, and `run` orders the two.
unsafe impl<T: Send> Sync for Piece<T> {}

impl<T> Piece<T> {
    fn empty() -> Self {
        Self { input: UnsafeCell::new(None), end: UnsafeCell::new((None, Duration::ZERO)) }
    }

    fn put(&self, value: T) {
        // SAFETY: called by the caller before `run`, when no other thread has the piece.
        let input = unsafe { &mut *self.input.get() };
        *input = Some(value);
    }

    fn take(&self) -> Option<T> {
        // SAFETY: only the one thread that has piece `i` calls this.
        let input = unsafe { &mut *self.input.get() };
        input.take()
    }

    fn finish(&self, result: Result<(), StepError>, time: Duration) {
        // SAFETY: only the one thread that has piece `i` calls this.
        let end = unsafe { &mut *self.end.get() };
        *end = (result.err(), time);
    }

    /// Error and duration; `None` and zero if it did nothing.
    fn end(&self) -> (Option<StepError>, Duration) {
        // SAFETY: called by the caller after `run`, when every thread is done.
        let end = unsafe { &*self.end.get() };
        *end
    }
}
