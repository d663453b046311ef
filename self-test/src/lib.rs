//! Self-test of umo on the machine on which it is installed: processor features, every kernel of every back-end
//! against its scalar reference, a model's motion against recorded motion, and the model's speed.
//!
//! ```
//! fn is_sound(model: &std::sync::Arc<umo_core::Model>) -> bool {
//!     let report = umo_self_test::run(model, 2);
//!     println!("{report}");
//!     report.passed()
//! }
//! ```
//!
//! | feature | effect |
//! |---|---|
//! | `threads`, `clock` | both: measures the model's speed |
//! | `files` | reads processor, cores and power mode from files of Linux |

pub mod kernels;
pub mod machine;
pub mod motion;
#[cfg(all(feature = "threads", feature = "clock", not(target_family = "wasm")))]
pub mod speed;
pub mod voice;

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use umo_core::Model;
use umo_kernels::Isa;

use kernels::Checked;
use machine::Machine;
use motion::Motion;

/// Upper bound on the time to compare kernels, so that a whole self-test takes about 10 s even on a slow processor.
const KERNEL_TIME: Duration = Duration::from_secs(4);

/// Findings of a self-test. Their text can be published: it contains no host name, user name or path.
#[derive(Clone, Debug)]
pub struct Report {
    /// The machine.
    pub machine: Machine,
    /// Back-end for which the model was loaded.
    pub isa: Isa,
    /// Result of the kernels.
    pub kernels: Checked,
    /// Name of the model, and its motion, or the problem with it.
    pub motion: (String, Result<Motion, String>),
    /// A line about the model's speed, or why measuring failed; `None` in a library without a clock or threads.
    pub speed: Option<Result<String, String>>,
}

/// Tests this machine with a model, for about 10 s at most, on `threads` threads, 1 to [`umo_core::MAX_THREADS`].
pub fn run(model: &Arc<Model>, threads: usize) -> Report {
    Report {
        machine: Machine::this(),
        isa: model.isa(),
        kernels: kernels::check(KERNEL_TIME),
        motion: (model.config().name.clone(), motion::check(model, &motion::records())),
        speed: speed(model, threads),
    }
}

#[cfg(all(feature = "threads", feature = "clock", not(target_family = "wasm")))]
fn speed(model: &Arc<Model>, threads: usize) -> Option<Result<String, String>> {
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    let text = |speed: speed::Speed| {
        let speed::Speed { first, chunk, motion, avatars, .. } = speed;
        let (first, chunk, motion) = (ms(first), ms(chunk), motion.as_secs_f64());
        format!(
            "first frame after {first:.1} ms; {motion:.2} s of motion in {chunk:.1} ms; {avatars} avatars at once ({threads} thread{})",
            plural(threads)
        )
    };
    Some(speed::measure(model, threads).map(text).map_err(|error| error.to_string()))
}

#[cfg(not(all(feature = "threads", feature = "clock", not(target_family = "wasm"))))]
fn speed(_model: &Arc<Model>, _threads: usize) -> Option<Result<String, String>> {
    None
}

/// Plural ending for `count` items.
fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

impl Report {
    /// Whether all tests passed.
    pub fn passed(&self) -> bool {
        self.kernels.wrong.is_empty() && self.motion.1.is_ok() && !matches!(self.speed, Some(Err(_)))
    }

    fn write_kernels(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Checked { cases, is_cut, wrong } = &self.kernels;
        let (kernels, isas) = (kernels::CALLS.len(), Isa::available().map(Isa::name).collect::<Vec<_>>());
        let cut = if *is_cut { ", fewer than on a faster machine" } else { "" };
        let result = if wrong.is_empty() { "all as the reference" } else { "FAILED" };
        writeln!(f, "kernels     {result}: {kernels} on {}, {cases} cases{cut}", isas.join(", "))?;
        for wrong in wrong {
            writeln!(f, "            {} on {}: {}", wrong.kernel, wrong.isa, wrong.detail)?;
        }
        Ok(())
    }

    fn write_motion(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ((model, motion), isa) = (&self.motion, self.isa.name());
        match motion {
            Ok(Motion::AsRecorded(frames, difference)) => {
                writeln!(
                    f,
                    "motion      as recorded: {frames} frames of {model} for {isa}, off by {difference:.0e} at most"
                )
            }
            Ok(Motion::Repeated(frames)) => writeln!(
                f,
                "motion      the same twice: {frames} frames of {model}; no reference is recorded for it on {isa}, so nothing else was compared"
            ),
            Err(error) => writeln!(f, "motion      FAILED: {model} on {isa}: {error}"),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Machine { processor, threads, cores, features } = &self.machine;
        let (version, result) = (env!("CARGO_PKG_VERSION"), if self.passed() { "passed" } else { "FAILED" });
        writeln!(f, "umo {version}, {}, {}: self-test {result}", std::env::consts::OS, std::env::consts::ARCH)?;
        writeln!(f, "processor   {processor}")?;
        let cores = cores.as_deref().unwrap_or("kinds not known");
        writeln!(f, "cores       {threads} thread{} at once; {cores}", plural(*threads))?;
        writeln!(f, "features    {}", features.join(" "))?;
        writeln!(f, "back-end    {}: {}", self.isa.name(), machine::reason(self.isa))?;
        self.write_kernels(f)?;
        self.write_motion(f)?;
        match &self.speed {
            Some(Ok(speed)) => writeln!(f, "speed       {speed}")?,
            Some(Err(error)) => writeln!(f, "speed       FAILED: {error}")?,
            None => writeln!(f, "speed       not measured: this library has no clock or no threads")?,
        }
        let advice = machine::advice(self.isa, &self.machine);
        if advice.is_empty() {
            return write!(f, "faster      no known setting would make it faster here");
        }
        for (i, advice) in advice.iter().enumerate() {
            write!(f, "{}faster      {advice}", if i == 0 { "" } else { "\n" })?;
        }
        Ok(())
    }
}
