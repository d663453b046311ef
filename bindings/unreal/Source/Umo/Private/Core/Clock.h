// The pose that belongs to the sound being heard.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <atomic>
#include <cstdint>

namespace umo_unreal {

/// Amount of audio given to the library: the audio thread reports it buffer by buffer, and the game thread interpolates
/// between buffers. One writer thread.
class AudioClock {
public:
    explicit AudioClock(double rate) : rate_(rate) {}

    /// Audio thread: `frames` more were given at `now` seconds.
    void advance(std::uint64_t frames, double now) noexcept {
        // A sequence lock: a reader that sees an odd or changed number retries.
        ++turn_;
        start_ = start_ + last_;
        last_ = frames;
        time_ = now;
        ++turn_;
    }

    struct Reading {
        /// Seconds of audio: the last buffer plays from the time it was given.
        double seconds = 0;
        /// No buffer has arrived for some time.
        bool is_quiet = true;
    };

    /// Any thread: at `now` seconds.
    Reading read(double now) const noexcept {
        for (;;) {
            const std::uint32_t turn = turn_;
            const std::uint64_t start = start_;
            const std::uint64_t last = last_;
            const double time = time_;
            if (turn % 2 != 0 || turn_ != turn) continue;
            if (turn == 0) return {};
            const double length = static_cast<double>(last) / rate_;
            const double since = now - time;
            const double played = since < 0 ? 0 : since > length ? length : since;
            return {static_cast<double>(start) / rate_ + played, since > length + quiet_after};
        }
    }

private:
    static constexpr double quiet_after = 0.25;

    double rate_;
    std::atomic<std::uint32_t> turn_{0};
    std::atomic<std::uint64_t> start_{0};
    std::atomic<std::uint64_t> last_{0};
    std::atomic<double> time_{0};
};

/// Motion time to show, so that it matches the audio being heard. It never runs back: it waits if ahead, runs slightly
/// faster or slower if close, and skips if far behind. For one thread.
class MotionClock {
public:
    explicit MotionClock(double frame_rate) : frame_(1 / frame_rate) {}

    /// The time to sample, `step` seconds after the last. `heard` is the second of the audio being heard, ignored if
    /// `is_quiet`; `reach` is how far the time may run beyond the newest frame, which idle modes need.
    double next(double step, double heard, bool is_quiet, double reach) noexcept {
        const double late = heard - shown_;
        double run = step;
        if (is_stamped_ && !is_quiet) {
            const double pace = 1 + late / far_off;
            run = late > far_off ? step + late : step * (pace < 0 ? 0 : pace);
        }
        const double most = newest_ + reach;
        const double wanted = time_ + run;
        if (wanted > most) return time_ = time_ > most ? time_ : most;
        return time_ = wanted;
    }

    /// Reports the frame found at that time: its index, the second of audio that it is stamped with, and the time of
    /// the newest frame.
    void found(std::uint64_t index, double stamp, double newest) noexcept {
        // Frames without audio (an ease after an interrupt, or silence inserted by the engine) repeat the stamp of the
        // frame before: they play at their own pace.
        if (index != index_) is_stamped_ = stamp != stamp_;
        index_ = index;
        stamp_ = stamp;
        newest_ = newest;
        shown_ = stamp + time_ - static_cast<double>(index) * frame_;
    }

    double time() const noexcept { return time_; }
    /// Second of the audio that the pose belongs to.
    double shown() const noexcept { return shown_; }

private:
    /// A quarter of a second: lips that far from the sound had better jump at once.
    static constexpr double far_off = 0.25;

    double frame_;
    double time_ = 0;
    double newest_ = 0;
    double shown_ = 0;
    double stamp_ = 0;
    std::uint64_t index_ = 0;
    bool is_stamped_ = true;
};

} // namespace umo_unreal
