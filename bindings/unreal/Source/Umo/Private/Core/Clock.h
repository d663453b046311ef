// Which pose belongs to what is heard now.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <atomic>
#include <cstdint>

namespace umo_unreal {

/// How much audio the library was given, as the audio thread says it buffer by buffer and the game thread reads it between
/// them. One thread writes.
class AudioClock {
public:
    explicit AudioClock(double rate) : rate_(rate) {}

    /// The audio thread: `frames` more were given at `now` seconds.
    void advance(std::uint64_t frames, double now) noexcept {
        // A reader that sees an odd number, or two different ones, reads again.
        ++turn_;
        start_ = start_ + last_;
        last_ = frames;
        time_ = now;
        ++turn_;
    }

    struct Reading {
        /// Seconds of audio: the last buffer is played from when it was given.
        double seconds = 0;
        /// No buffer has come for some time.
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

/// The time of the motion to show, so that it is that of the audio that is heard. It never runs back: it waits where it is
/// ahead, runs a little faster or slower where they are near, and skips where it is far behind. One thread.
class MotionClock {
public:
    explicit MotionClock(double frame_rate) : frame_(1 / frame_rate) {}

    /// The time to sample, `step` seconds after the last. `heard` is the second of the audio that is heard now, which says
    /// nothing where `is_quiet`; `reach` is how far beyond the newest frame the time may run: idle modes need that.
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

    /// What was found at that time: the frame's number, the second of audio that it is stamped with, and the time of the
    /// newest frame.
    void found(std::uint64_t index, double stamp, double newest) noexcept {
        // Frames that belong to no audio, an ease after an interrupt or silence of the engine's own, have the stamp of the
        // frame before: they are shown at their own pace.
        if (index != index_) is_stamped_ = stamp != stamp_;
        index_ = index;
        stamp_ = stamp;
        newest_ = newest;
        shown_ = stamp + time_ - static_cast<double>(index) * frame_;
    }

    double time() const noexcept { return time_; }
    /// The second of the audio that the pose belongs to.
    double shown() const noexcept { return shown_; }

private:
    /// A quarter of a second: lips that far from the sound are better moved at once.
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
