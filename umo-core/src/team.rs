//! Fork-join over a few threads: the work of one product is cut by columns or rows, each piece by
//! the same arithmetic, so that neither the number of threads nor where the cuts are ever changes a
//! bit.
//!
//! Cores are not equally fast: some have a neighbour on the same core or another program, some are
//! small. A thread's share of a job follows the time that it took for its pieces of those before,
//! and the last pieces of a large job go to the thread that is done first (a dynamic schedule).
//!
//! A token costs 80 to 100 joins, so waking a sleeping thread for each (15 to 35 us) is out of the
//! question: workers spin for a bounded time and only then sleep, and so does the caller that waits
//! for them. A worker that has no core when a job begins delays nobody: the caller takes the pieces that
//! nobody has begun. Nothing here allocates or locks once the team is made, and the only system calls are
//! those that put a thread to sleep and wake it.
#![expect(
    unsafe_code,
    reason = "a job borrows the caller's stack while the caller waits for it, and the system sets threads' cores and priorities"
)]

mod cores;
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

pub use priority::Priority;

use crate::defect::{Defect, contain, contain_quietly, resume};
use crate::error::StepError;
use crate::memory;
use crate::sync::{wait, wake_all, wake_one};
use crate::thread::{self, JoinHandle};
use crate::time::Instant;

/// Most threads of a team.
pub const MAX_THREADS: usize = 64;

/// Extra pieces of a large job, taken by the threads that finish first.
const DYNAMIC_CHUNKS: usize = 4;

/// Most pieces of a job.
pub const MAX_PIECES: usize = MAX_THREADS + DYNAMIC_CHUNKS;

/// Multiply-adds from which a job is worth a dynamic schedule: pieces of a smaller one are too
/// short.
const DYNAMIC_THRESHOLD: usize = 1 << 24;

/// Threads of which the pieces of a job are kept in little memory.
const FEW_THREADS: usize = 4;

/// Multiply-adds below which a job is not worth sharing: about a microsecond of one core.
const PARALLEL_THRESHOLD: usize = 1 << 15;

/// Times that a worker looks for a job, and the caller for a job's end, before it sleeps: 20 to 100
/// us, as long as the processor's pause is. With more threads than cores, the one that it waits for
/// may need just that core.
const SPINS_BEFORE_SLEEP: u32 = 2_000;

/// Times that the caller looks whether the workers have begun before it takes their pieces: a worker that is
/// awake begins within a tenth of that, and has its piece's weights in its cache.
const SPINS_BEFORE_TAKEOVER: u32 = 100;

/// A job: called once per thread with the thread's index.
type Job<'a> = dyn Fn(usize) + Sync + 'a;

/// A few threads that share each piece of work. `threads` of them, the caller included.
#[derive(Debug)]
pub struct Team {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
    threads: usize,
    /// Each thread's share of a job, f32 as bits.
    shares: Box<[AtomicU32]>,
    /// Whether external workers take part: any of them may take any piece.
    is_lent: bool,
    /// Whether the caller works without the others for now.
    is_alone: AtomicBool,
}

/// Where a team's threads run, and before whom.
#[derive(Clone, Copy, Debug, Default)]
pub struct Placement<'a> {
    /// The core that the calling thread is bound to.
    pub caller: Option<usize>,
    /// One core for each of the others, as far as they go.
    pub cores: &'a [usize],
    /// That of the others.
    pub priority: Priority,
}

/// Cuts two things in two at the same place.
#[expect(clippy::type_complexity, reason = "a pair of pairs, and a type of its own would say no more")]
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
pub(crate) struct ExternalWorkers {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    /// Counts jobs; a change is the signal to start. Workers sleep on it.
    epoch: AtomicU32,
    /// The job of this epoch: a pointer to a `&Job` on the caller's stack.
    job: AtomicPtr<()>,
    /// Pieces of the job, but the caller's own, that are not done; the caller sleeps on it.
    pending: AtomicU32,
    /// The pieces of the job that nobody has begun, a bit for each.
    open: AtomicU64,
    /// A piece of the job panicked, and what the first one said.
    panicked: AtomicBool,
    defect: Mutex<Option<Defect>>,
    /// The team is being dropped.
    stop: AtomicBool,
    /// A job is under way.
    busy: AtomicBool,
    /// Workers that may be asleep.
    asleep: AtomicU32,
    /// Whether the caller may be asleep.
    waiting: AtomicBool,
    /// Whether a worker did not get its core.
    unbound: AtomicBool,
    /// Whether a worker did not get its priority.
    refused: AtomicBool,
    /// Odd while external workers may join; a change ends the work of those that joined before.
    joining: AtomicU32,
    /// What each of the team's own threads will read next.
    expected: Box<[SharedHint]>,
}

impl Team {
    /// A team of `threads` threads (1 to [`MAX_THREADS`]), of which the caller is one; with 1
    /// everything runs inline.
    ///
    /// # Errors
    /// What the system says when it cannot start a thread.
    pub fn new(threads: usize) -> std::io::Result<Self> {
        Self::placed(threads, Placement::default())
    }

    /// The same, with threads bound to cores and of a priority.
    ///
    /// # Errors
    /// As [`Self::new`], and where the system does not let a thread have its core. Where it refuses the
    /// priority, [`Self::has_priority`] says so.
    pub fn placed(threads: usize, placement: Placement) -> std::io::Result<Self> {
        let Placement { caller, cores, priority } = placement;
        // Before the calling thread is bound, and may use one core only.
        let usable = if caller.is_some() || !cores.is_empty() { cores::usable() } else { Vec::new() };
        let threads = threads.clamp(1, MAX_THREADS);
        let mut team = Self::bare(threads, false);
        team.workers.reserve_exact(threads - 1);
        team.shared.pending.store(count(threads - 1), Ordering::Relaxed);
        for index in 1..threads {
            let shared = Arc::clone(&team.shared);
            let name = format!("umo-{index}");
            let core = cores.get(index - 1).copied();
            let life = move || {
                if core.is_some_and(|core| !cores::bind(core)) {
                    shared.unbound.store(true, Ordering::Relaxed);
                }
                if !priority.set() {
                    shared.refused.store(true, Ordering::Relaxed);
                }
                // A piece that panics is caught before this: here it is only kept from being
                // printed.
                let _ = contain_quietly(|| {
                    shared.done();
                    work(&shared, index);
                });
            };
            memory::require_thread();
            team.workers.push(thread::start(name, life)?);
        }
        let bound = caller.is_none_or(cores::bind);
        // A thread allocates while it starts: it has done so when it says that it is there.
        team.shared.wait_for_workers();
        // The threads' heaps may have taken what was left.
        memory::require(memory::SPARE);
        if !bound || team.shared.unbound.load(Ordering::Relaxed) {
            return Err(std::io::Error::other(binding_error(caller, cores, &usable)));
        }
        Ok(team)
    }

    /// Whether its own threads have the priority that was asked for.
    pub fn has_priority(&self) -> bool {
        !self.shared.refused.load(Ordering::Relaxed)
    }

    /// A team of `threads` that owns none: the caller, and external workers that join while they are
    /// admitted (`admit`). Without external workers the caller computes everything.
    pub(crate) fn with_external_workers(threads: usize) -> Self {
        Self::bare(threads.clamp(1, MAX_THREADS), true)
    }

    /// A team of the calling thread.
    pub(crate) fn alone() -> Self {
        Self::bare(1, false)
    }

    /// Without workers.
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

    /// The entry point of external workers.
    pub(crate) fn external_workers(&self) -> ExternalWorkers {
        ExternalWorkers { shared: Arc::clone(&self.shared) }
    }

    /// Lets external workers in until the result is dropped.
    pub(crate) fn admit(&self) -> JoinGuard<'_> {
        self.shared.joining.fetch_or(1, Ordering::SeqCst);
        JoinGuard(&self.shared)
    }

    /// Whether the caller does its next jobs without the others, which go to sleep.
    pub(crate) fn set_alone(&self, alone: bool) {
        self.is_alone.store(alone, Ordering::Relaxed);
    }

    /// Number of threads, the caller included.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Most pieces that a job is cut into.
    pub(crate) fn pieces(&self) -> usize {
        if self.threads == 1 { 1 } else { self.threads + DYNAMIC_CHUNKS }
    }

    /// Runs `job(i)` for every `i` below the number of threads, each on its own thread, and waits
    /// for all.
    ///
    /// A call while another is under way runs all of them on the calling thread. Panics where `job`
    /// did.
    #[cfg_attr(not(feature = "internals"), doc(hidden))]
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

    /// Says what the job behind the next one reads first: `ahead(piece)` for each piece of its
    /// `total` columns or rows, cut as `split` cuts little work. Threads that wait fetch it: memory
    /// is idle then, and most of a token's time goes into reading.
    #[cfg_attr(not(feature = "internals"), doc(hidden))]
    pub fn expect<'a>(&self, total: usize, granule: usize, ahead: impl Fn(Range<usize>) -> PrefetchHint<'a>) {
        if self.threads == 1 || self.is_lent || self.is_alone.load(Ordering::Relaxed) {
            return;
        }
        let mut ends = [0; MAX_THREADS];
        self.cut(total.div_ceil(granule), &mut [1.0; MAX_THREADS][..self.threads], &mut ends[..self.threads]);
        let mut start = 0;
        for (expected, end) in self.shared.expected.iter().zip(ends) {
            let end = (end * granule).min(total);
            expected.set(if start < end { ahead(start..end) } else { PrefetchHint::NONE });
            start = end;
        }
    }

    /// Where each thread's piece of `granules` ends, and its share.
    fn cut(&self, granules: usize, shares: &mut [f32], ends: &mut [usize]) {
        for (share, known) in shares.iter_mut().zip(&self.shares) {
            *share = f32::from_bits(known.load(Ordering::Relaxed));
        }
        shares::cut(shares, granules, ends);
    }

    /// Cuts the columns of `y` into one piece per thread, each a multiple of `granule` wide (but
    /// the last), and calls `f(columns, piece)` for each. `work` is the job's multiply-adds: little
    /// work is not shared.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    #[cfg_attr(not(feature = "internals"), doc(hidden))]
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

    /// The same for rows.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    pub(crate) fn rows<'a, T: Send>(
        &self,
        y: MatMut<'a, T>,
        work: usize,
        f: impl Fn(Range<usize>, MatMut<'a, T>) -> Result<(), StepError> + Sync,
    ) -> Result<(), StepError> {
        let total = y.rows();
        self.split(y, total, 1, work, |y, at| y.split_rows(at), f)
    }

    /// The same for the rows of two outputs, of which there are as many.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    pub(crate) fn rows_of_two<'a, T: Send, U: Send>(
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

    /// Cuts `y` by `cut` into one piece per thread, each a multiple of `granule` of the `total`
    /// wide or high (but the last), and calls `f` for each. `work` is the job's multiply-adds:
    /// little work is not shared.
    ///
    /// # Errors
    /// One of the errors that `f` returned.
    pub(crate) fn split<Y: Send>(
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

    /// Hands `total` rows or columns out to the threads, in at most `CAPACITY` pieces: one for each
    /// thread and, if the job is large, a few more for the threads that finish first.
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
        // Any external worker may take any piece.
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
            // A worker catches panics of its jobs, so it cannot have panicked itself.
            drop(worker.join());
        }
    }
}

/// Lets external workers join while it lives.
#[derive(Debug)]
pub(crate) struct JoinGuard<'a>(&'a Shared);

impl Drop for JoinGuard<'_> {
    fn drop(&mut self) {
        self.0.joining.fetch_add(1, Ordering::SeqCst);
        self.0.signal();
    }
}

impl ExternalWorkers {
    /// Works for the team until joining ends; returns at once where none
    /// is. Never allocates.
    pub(crate) fn work(&self) {
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

    /// Wakes the threads that wait for a job.
    fn signal(&self) {
        // SeqCst pairs with the worker's: either it sees the new epoch before it sleeps, or we see
        // that it sleeps.
        self.epoch.fetch_add(1, Ordering::SeqCst);
        if self.asleep.load(Ordering::SeqCst) > 0 {
            wake_all(&raw const self.epoch);
        }
    }

    /// Waits a little for every piece to be begun.
    fn await_start(&self) {
        for _ in 0..SPINS_BEFORE_TAKEOVER {
            if self.open.load(Ordering::Relaxed) == 0 {
                return;
            }
            std::hint::spin_loop();
        }
    }

    /// Does the pieces that nobody has begun.
    fn help(&self) {
        loop {
            let open = self.open.load(Ordering::Relaxed);
            if open == 0 {
                return;
            }
            self.take(open.trailing_zeros() as usize);
        }
    }

    /// Does a piece of the job, unless somebody has begun it.
    fn take(&self, index: usize) {
        let bit = 1 << index;
        if self.open.load(Ordering::Relaxed) & bit == 0 || self.open.fetch_and(!bit, Ordering::Acquire) & bit == 0 {
            return;
        }
        let job = self.job.load(Ordering::Relaxed).cast::<&Job>();
        // SAFETY: `run` stored a pointer to its own `job` argument before it opened the piece that this thread
        // alone has taken (release and acquire through `open`), and it does not return before `pending`, which
        // counts the piece, reaches 0 below.
        let job: &Job = unsafe { *job };
        self.contained(|| job(index));
        self.done();
    }

    /// Runs a piece of the job; the job's first panic is kept for [`Self::end_job`].
    fn contained(&self, piece: impl FnOnce()) {
        if let Err(defect) = contain(piece) {
            self.panicked.store(true, Ordering::Relaxed);
            self.defect.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(defect);
        }
    }

    /// Ends the job that every thread is done with. Panics where a piece of it did.
    fn end_job(&self) {
        let panicked = self.panicked.swap(false, Ordering::Relaxed);
        let defect = if panicked { self.defect.lock().unwrap_or_else(PoisonError::into_inner).take() } else { None };
        self.busy.store(false, Ordering::Release);
        if let Some(defect) = defect {
            resume(defect);
        }
    }

    /// Spins, then sleeps, until nothing is pending any more.
    fn wait_for_workers(&self) {
        self.expected[0].fetch(|| self.pending.load(Ordering::Acquire) == 0);
        for _ in 0..SPINS_BEFORE_SLEEP {
            if self.pending.load(Ordering::Acquire) == 0 {
                return;
            }
            std::hint::spin_loop();
        }
        // SeqCst pairs with that of the last to be done: either it sees that we wait, or we see that it is
        // done.
        self.waiting.store(true, Ordering::SeqCst);
        loop {
            match self.pending.load(Ordering::SeqCst) {
                0 => break,
                pending => wait(&self.pending, pending),
            }
        }
        self.waiting.store(false, Ordering::Relaxed);
    }

    /// Reports that one of those that are pending is done.
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

/// Why threads could not be bound to cores: the cores of the config that the process may not use, and those
/// that it may.
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

/// A number of threads or pieces.
fn count(threads: usize) -> u32 {
    threads.try_into().expect("at most 64")
}

/// A worker's life: wait for the epoch to change, do its own piece of the job, unless the caller has.
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

/// One thread's piece of the output, and what became of it.
struct Piece<T> {
    input: UnsafeCell<Option<T>>,
    /// What went wrong, and how long it took.
    end: UnsafeCell<(Option<StepError>, Duration)>,
}

// SAFETY: during `run` the cells of piece `i` are touched by one thread alone, the one that took piece `i` of the
// job, or, where the job has no such piece, the one that was given the number `i`; before and after it by the
// caller alone, and `run` orders the two.
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
        // SAFETY: called for piece `i` by the one thread that has it.
        let input = unsafe { &mut *self.input.get() };
        input.take()
    }

    fn finish(&self, result: Result<(), StepError>, time: Duration) {
        // SAFETY: called for piece `i` by the one thread that has it.
        let end = unsafe { &mut *self.end.get() };
        *end = (result.err(), time);
    }

    /// Its error, and how long it took: nothing where there was nothing to do.
    fn end(&self) -> (Option<StepError>, Duration) {
        // SAFETY: called by the caller after `run`, when every thread is done.
        let end = unsafe { &*self.end.get() };
        *end
    }
}
