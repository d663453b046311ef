//! What `umo bench` says.

use std::fmt;
use std::time::Duration;

use serde_json::json;

use super::Stages;

/// Everything that was measured.
#[derive(Debug)]
pub(super) struct Report {
    pub(super) model: String,
    pub(super) isa: &'static str,
    pub(super) threads: usize,
    /// Keyframes per chunk.
    pub(super) target: usize,
    pub(super) load: Duration,
    /// Times to the first frame.
    pub(super) first: Vec<Duration>,
    /// Times of chunks.
    pub(super) chunks: Vec<Duration>,
    /// Frames of these chunks.
    pub(super) frames: usize,
    pub(super) stages: Stages,
    pub(super) memory: Option<u64>,
    pub(super) crowd: Option<Crowd>,
}

/// Several avatars in real time.
#[derive(Debug)]
pub(super) struct Crowd {
    pub(super) sessions: usize,
    pub(super) seconds: f64,
    pub(super) frames: u64,
    pub(super) late: u64,
    pub(super) overruns: u64,
    /// Of the slowest avatar each.
    pub(super) p50: Duration,
    pub(super) p99: Duration,
    pub(super) max: Duration,
    /// Share of the time that the engine computed.
    pub(super) busy: f64,
}

/// The time that a share of `times` stayed within.
pub(super) fn quantile(times: &[Duration], share: f64) -> Duration {
    let mut sorted = times.to_vec();
    sorted.sort();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index of the slice")]
    let at = (share * (sorted.len() - 1) as f64).round() as usize;
    sorted[at]
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// To the hundredth of a millisecond, which is finer than any run repeats.
fn rounded(time: Duration) -> f64 {
    (ms(time) * 100.0).round() / 100.0
}

impl Report {
    fn frames_per_second(&self) -> f64 {
        self.frames as f64 / self.chunks.iter().sum::<Duration>().as_secs_f64()
    }

    /// One line.
    pub(super) fn json(&self) -> String {
        let quantiles = |times: &[Duration]| {
            let of = |share| rounded(quantile(times, share));
            json!({ "p50": of(0.5), "p99": of(0.99), "max": of(1.0), "count": times.len() })
        };
        let stages: serde_json::Map<_, _> =
            self.stages.0.iter().map(|&(name, time)| (name.to_owned(), json!(rounded(time)))).collect();
        let mut report = json!({
            "version": env!("CARGO_PKG_VERSION"), "model": self.model, "isa": self.isa, "threads": self.threads,
            "target": self.target, "load_ms": rounded(self.load), "first_frame_ms": quantiles(&self.first),
            "chunk_ms": quantiles(&self.chunks), "frames_per_second": (self.frames_per_second() * 10.0).round() / 10.0,
            "stages_ms": stages,
        });
        if let Some(bytes) = self.memory {
            report["peak_memory_bytes"] = json!(bytes);
        }
        if let Some(crowd) = &self.crowd {
            report["real_time"] = json!({
                "sessions": crowd.sessions, "seconds": crowd.seconds.round(), "frames": crowd.frames,
                "late_frames": crowd.late, "overruns": crowd.overruns,
                "chunk_ms": { "p50": rounded(crowd.p50), "p99": rounded(crowd.p99), "max": rounded(crowd.max) },
                "busy": (crowd.busy * 1000.0).round() / 1000.0,
            });
        }
        report.to_string()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { model, isa, threads, target, .. } = self;
        writeln!(
            f,
            "{model}, {isa}, {threads} threads, {target} keyframes a chunk, loaded in {:.0} ms",
            ms(self.load)
        )?;
        let (first, chunk) = (quantile(&self.first, 0.5), quantile(&self.chunks, 0.5));
        let (p99, max) = (quantile(&self.chunks, 0.99), quantile(&self.chunks, 1.0));
        writeln!(f, "\ntime to the first frame   {:>9.1} ms  (median of {})", ms(first), self.first.len())?;
        writeln!(f, "frames per second         {:>9.1}     (one avatar)", self.frames_per_second())?;
        writeln!(f, "a chunk                   {:>9.1} ms  (median of {})", ms(chunk), self.chunks.len())?;
        let ratio = p99.as_secs_f64() / chunk.as_secs_f64();
        writeln!(
            f,
            "  99th percentile         {:>9.1} ms  ({ratio:.2} of the median), largest {:.1} ms",
            ms(p99),
            ms(max)
        )?;
        if let Some(bytes) = self.memory {
            writeln!(f, "peak memory               {:>9.1} MB", bytes as f64 / 1e6)?;
        }
        writeln!(f, "\nstage                ms a chunk   share")?;
        let total: Duration = self.stages.0.iter().map(|&(_, time)| time).sum();
        for &(name, time) in &self.stages.0 {
            let share = 100.0 * time.as_secs_f64() / total.as_secs_f64();
            writeln!(f, "{name:<20} {:>10.2} {share:>6.1} %", ms(time))?;
        }
        writeln!(f, "{:<20} {:>10.2}", "all", ms(total))?;
        if let Some(crowd) = &self.crowd {
            writeln!(
                f,
                "\n{} avatars for {:.0} s in real time: {} frames, {} late, {} overruns; chunk p50 {:.1} ms, p99 {:.1} ms, \
                 largest {:.1} ms; busy for {:.0} % of the time",
                crowd.sessions,
                crowd.seconds,
                crowd.frames,
                crowd.late,
                crowd.overruns,
                ms(crowd.p50),
                ms(crowd.p99),
                ms(crowd.max),
                100.0 * crowd.busy
            )?;
        }
        Ok(())
    }
}
