//! Progress bars on standard error for long-running work.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Returns a bar that counts frames; hidden if standard error is not a terminal.
pub(crate) fn frames(total: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} frames, {per_sec}, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// Progress of a batch's lines, with the remaining time: a bar, or a line every ten seconds if standard error
/// is not a terminal.
#[derive(Debug)]
pub(crate) struct Lines {
    bar: ProgressBar,
    total: u64,
    start: Instant,
    said: Instant,
}

/// Returns the progress of a batch of `total` lines.
pub(crate) fn lines(total: usize) -> Lines {
    let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr_with_hz(10));
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} lines, {per_sec}, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let now = Instant::now();
    Lines { bar, total: total as u64, start: now, said: now }
}

impl Lines {
    /// Counts one more finished line.
    pub(crate) fn advance(&mut self) {
        self.bar.inc(1);
        if self.bar.is_hidden() && self.said.elapsed() >= Duration::from_secs(10) {
            self.said = Instant::now();
            let (done, passed) = (self.bar.position(), self.start.elapsed().as_secs_f64());
            let left = passed * (self.total - done) as f64 / done as f64;
            eprintln!("{done}/{} lines, {left:.0} s left", self.total);
        }
    }

    /// Prints while the bar is hidden.
    pub(crate) fn suspend(&self, print: impl FnOnce()) {
        self.bar.suspend(print);
    }

    /// Removes the bar.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
