//! Metrics for Prometheus.

use std::sync::atomic::AtomicU64;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::{Registry, Unit};

/// Label for why a session ended or a client was refused: a word of [`Code`](crate::protocol::Code), `closed`,
/// or the word of a refused connection or request.
#[derive(Clone, Debug, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Reason {
    reason: &'static str,
}

/// Counters and gauges of a server.
#[derive(Debug)]
pub(crate) struct Metrics {
    registry: Registry,
    sessions: Gauge,
    places: Gauge,
    draining: Gauge,
    pub(crate) started: Counter,
    pub(crate) restored: Counter,
    pub(crate) handed_over: Counter,
    refused: Family<Reason, Counter>,
    ended: Family<Reason, Counter>,
    pub(crate) samples: Counter,
    pub(crate) frames: Counter,
    pub(crate) packets: Counter,
    pub(crate) late_frames: Counter,
    audio: Counter<f64, AtomicU64>,
    sent: Counter,
}

impl Metrics {
    pub(crate) fn new() -> Self {
        let mut registry = Registry::with_prefix("umo_serve");
        let all = Self {
            registry: Registry::default(),
            sessions: Gauge::default(),
            places: Gauge::default(),
            draining: Gauge::default(),
            started: Counter::default(),
            restored: Counter::default(),
            handed_over: Counter::default(),
            refused: Family::default(),
            ended: Family::default(),
            samples: Counter::default(),
            frames: Counter::default(),
            packets: Counter::default(),
            late_frames: Counter::default(),
            audio: Counter::default(),
            sent: Counter::default(),
        };
        registry.register("sessions", "Sessions at present", all.sessions.clone());
        registry.register("places", "Most sessions at once", all.places.clone());
        registry.register("draining", "1 after the server was told to stop", all.draining.clone());
        registry.register("sessions_started", "Sessions that began", all.started.clone());
        registry.register("sessions_restored", "Sessions that began with a state", all.restored.clone());
        registry.register("sessions_handed_over", "Sessions whose state was handed over", all.handed_over.clone());
        registry.register("sessions_refused", "Refused clients, by reason", all.refused.clone());
        registry.register("sessions_ended", "Sessions that ended, by reason", all.ended.clone());
        registry.register("samples", "Samples of audio that were taken", all.samples.clone());
        registry.register("frames", "Frames that were sent", all.frames.clone());
        registry.register("packets", "Packets that were sent", all.packets.clone());
        registry.register("late_frames", "Frames that missed their real-time deadline", all.late_frames.clone());
        registry.register_with_unit("audio", "Audio that was taken", Unit::Seconds, all.audio.clone());
        registry.register_with_unit("sent", "Frames, packets and states that were sent", Unit::Bytes, all.sent.clone());
        Self { registry, ..all }
    }

    pub(crate) fn refused(&self, reason: &'static str) {
        self.refused.get_or_create(&Reason { reason }).inc();
    }

    pub(crate) fn ended(&self, reason: &'static str) {
        self.ended.get_or_create(&Reason { reason }).inc();
    }

    pub(crate) fn took(&self, samples: usize, rate: usize) {
        self.samples.inc_by(samples as u64);
        self.audio.inc_by(samples as f64 / rate as f64);
    }

    pub(crate) fn sent(&self, bytes: usize) {
        self.sent.inc_by(bytes as u64);
    }

    /// Returns all metrics in the OpenMetrics text format.
    pub(crate) fn text(&self, sessions: usize, places: usize, is_draining: bool) -> String {
        let number = |count: usize| i64::try_from(count).unwrap_or(i64::MAX);
        self.sessions.set(number(sessions));
        self.places.set(number(places));
        self.draining.set(is_draining.into());
        let mut text = String::new();
        match encode(&mut text, &self.registry) {
            Ok(()) => text,
            // Writing to a `String` cannot fail.
            Err(std::fmt::Error) => String::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_have_their_names_and_reasons() {
        let metrics = Metrics::new();
        metrics.refused("full");
        metrics.refused("full");
        metrics.took(8_000, 16_000);
        let text = metrics.text(3, 32, false);
        for line in [
            "umo_serve_sessions 3",
            "umo_serve_places 32",
            "umo_serve_sessions_refused_total{reason=\"full\"} 2",
            "umo_serve_samples_total 8000",
            "umo_serve_audio_seconds_total 0.5",
        ] {
            assert!(text.lines().any(|have| have == line), "{line}: {text}");
        }
    }
}
