//! The report of `umo bench`.

use std::fmt;
use std::time::Duration;

use serde_json::json;
use umo_core::{CoreKind, Cores, Engine, Priority};
use umo_core_tools::floor::Machine;
use umo_self_test::speed::{Crowd, quantile};

use super::Stage;

/// Everything measured.
#[derive(Debug)]
pub(super) struct Report {
    pub(super) model: String,
    pub(super) isa: &'static str,
    pub(super) threads: usize,
    pub(super) cores: Placed,
    /// Keyframes per chunk.
    pub(super) target: usize,
    pub(super) load: Duration,
    /// Time to first frame of each measured start.
    pub(super) first: Vec<Duration>,
    /// Duration of each measured chunk.
    pub(super) chunks: Vec<Duration>,
    /// Number of frames in these chunks.
    pub(super) frames: usize,
    pub(super) stages: Vec<Stage>,
    /// Peaks from which the stages' floors are computed.
    pub(super) machine: Machine,
    pub(super) memory: Option<u64>,
    /// Processor time of all threads over all chunks.
    pub(super) processor: Option<Duration>,
    /// Whether other programs kept the machine busy.
    pub(super) is_busy: bool,
    /// Priority of the computing threads.
    pub(super) priority: Priority,
    /// Measurement of several avatars in real time.
    pub(super) crowd: Option<Crowd>,
    /// Processor time of all threads during that measurement.
    pub(super) crowd_processor: Option<Duration>,
}

/// The machine's cores, and which of them the engine uses.
#[derive(Debug)]
pub(super) struct Placed {
    machine: Cores,
    team: Option<CoreKind>,
    slow: Option<CoreKind>,
    slow_chunks: u64,
}

impl Placed {
    pub(super) fn of(machine: Cores, engine: &Engine) -> Self {
        let [team, slow] = engine.placed().map(|group| group.map(|group| group.kind));
        Self { machine, team, slow, slow_chunks: engine.slow_chunks() }
    }

    fn json(&self) -> serde_json::Value {
        let groups: Vec<_> = (self.machine.groups().iter())
            .map(|group| {
                let speed = (f64::from(group.speed) * 100.0).round() / 100.0;
                json!({ "kind": group.kind.to_string(), "cores": group.cores, "speed": speed })
            })
            .collect();
        let name = |kind: Option<CoreKind>| kind.map(|kind| kind.to_string());
        json!({ "kinds": groups, "threads_on": name(self.team), "lone_avatar_on": name(self.slow), "chunks_there": self.slow_chunks })
    }
}

impl fmt::Display for Placed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.machine)?;
        if let Some(team) = self.team {
            write!(f, "; threads on {team} cores")?;
        }
        if let Some(slow) = self.slow {
            write!(f, ", a lone avatar on a core of {slow} while it has room: {} chunks", self.slow_chunks)?;
        }
        Ok(())
    }
}

fn ms(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

/// Rounds to a hundredth of a millisecond, which is finer than the variation between runs.
fn rounded(time: Duration) -> f64 {
    (ms(time) * 100.0).round() / 100.0
}

impl Report {
    fn count(&self) -> u32 {
        u32::try_from(self.chunks.len()).unwrap_or(u32::MAX)
    }

    fn frames_per_second(&self) -> f64 {
        self.frames as f64 / self.chunks.iter().sum::<Duration>().as_secs_f64()
    }

    /// Returns the report as one line of JSON.
    pub(super) fn json(&self) -> String {
        let quantiles = |times: &[Duration]| {
            let of = |share| rounded(quantile(times, share));
            json!({ "p50": of(0.5), "p99": of(0.99), "max": of(1.0), "count": times.len() })
        };
        let mut chunks = quantiles(&self.chunks);
        chunks["times"] = self.chunks.iter().copied().map(rounded).collect();
        let stage =
            |stage: &Stage| json!({ "stage": stage.name, "ms": rounded(stage.time), "floor_ms": rounded(stage.floor) });
        let stages: Vec<_> = self.stages.iter().map(stage).collect();
        let giga = |per_second: f64| (per_second / 1e8).round() / 10.0;
        let peaks = json!({
            "read_gb_per_s": giga(self.machine.bytes_per_second), "cache_gb_per_s": self.machine.cache_per_second.map(giga),
            "int8_gmac_per_s": self.machine.int8_per_second.map(giga),
            "f32_gmac_per_s": self.machine.f32_per_second.map(giga),
        });
        let mut report = json!({
            "version": env!("CARGO_PKG_VERSION"), "model": self.model, "isa": self.isa, "threads": self.threads,
            "target": self.target, "load_ms": rounded(self.load), "first_frame_ms": quantiles(&self.first),
            "chunk_ms": chunks, "frames_per_second": (self.frames_per_second() * 10.0).round() / 10.0,
            "stages": stages, "peaks": peaks,
        });
        report["cores"] = self.cores.json();
        report["busy_machine"] = json!(self.is_busy);
        report["priority"] = json!(self.priority.to_string());
        if let Some(bytes) = self.memory {
            report["peak_memory_bytes"] = json!(bytes);
        }
        if let Some(time) = self.processor {
            report["processor_ms_per_chunk"] = json!(rounded(time / self.count()));
        }
        if let Some(crowd) = &self.crowd {
            report["real_time"] = json!({
                "sessions": crowd.sessions, "seconds": crowd.seconds.round(), "frames": crowd.frames,
                "late_frames": crowd.late, "held_chunks": crowd.held, "overruns": crowd.overruns,
                "chunk_ms": { "p50": rounded(crowd.p50), "p99": rounded(crowd.p99), "max": rounded(crowd.max) },
                "busy": (crowd.busy * 1000.0).round() / 1000.0,
                "sessions_at_full_load": crowd.at_full_load(),
                "processor_seconds": self.crowd_processor.map(|time| time.as_secs_f64()),
            });
        }
        report.to_string()
    }
}

/// Returns the plural suffix for a count.
fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { model, isa, threads, target, priority, .. } = self;
        writeln!(
            f,
            "{model}, {isa}, {threads} thread{}{}, {target} keyframe{} a chunk, loaded in {:.0} ms{}",
            plural(*threads),
            if *priority == Priority::Normal { String::new() } else { format!(" of {priority} priority") },
            plural(*target),
            ms(self.load),
            if self.is_busy { ", beside a program on every core and one that wakes up at 10 kHz" } else { "" }
        )?;
        writeln!(f, "cores: {}", self.cores)?;
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
        if let Some(time) = self.processor {
            writeln!(f, "processor time            {:>9.1} ms a chunk, of all threads", ms(time / self.count()))?;
        }
        if let Some(bytes) = self.memory {
            writeln!(f, "peak memory               {:>9.1} MB", bytes as f64 / 1e6)?;
        }
        self.write_stages(f)?;
        self.crowd.as_ref().map_or(Ok(()), |crowd| self.write_crowd(crowd, f))
    }
}

impl Report {
    fn write_stages(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nstage                ms a chunk   share      floor   floor / time")?;
        let total: Duration = self.stages.iter().map(|stage| stage.time).sum();
        for Stage { name, time, floor } in &self.stages {
            let share = |part: &Duration, of: &Duration| 100.0 * part.as_secs_f64() / of.as_secs_f64();
            let (of_all, reached) = (share(time, &total), share(floor, time));
            writeln!(f, "{name:<20} {:>10.2} {of_all:>6.1} % {:>9.2} {reached:>12.0} %", ms(*time), ms(*floor))?;
        }
        let floor: Duration = self.stages.iter().map(|stage| stage.floor).sum();
        let reached = 100.0 * floor.as_secs_f64() / total.as_secs_f64();
        writeln!(f, "{:<20} {:>10.2} {:>8} {:>9.2} {reached:>12.0} %", "all", ms(total), "", ms(floor))?;
        writeln!(f, "{}", self.machine)
    }

    fn write_crowd(&self, crowd: &Crowd, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "\n{} avatars for {:.0} s in real time: {} frames, {} late, {} chunks with held bodies, {} overruns; chunk p50 {:.1} ms, p99 {:.1} ms, \
                 largest {:.1} ms; busy for {:.0} % of the time, so that {} could speak{}",
            crowd.sessions,
            crowd.seconds,
            crowd.frames,
            crowd.late,
            crowd.held,
            crowd.overruns,
            ms(crowd.p50),
            ms(crowd.p99),
            ms(crowd.max),
            100.0 * crowd.busy,
            crowd.at_full_load(),
            self.crowd_processor
                .map_or_else(String::new, |time| format!("; {:.2} s of processor time", time.as_secs_f64()))
        )
    }
}
