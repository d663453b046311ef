// Delays speech until its motion is ready, and transfers samples to the audio thread.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <utility>
#include <vector>

namespace umo_unreal {

/// Outputs interleaved samples a fixed number of frames later. For one thread; allocates only in the constructor.
class Delay {
public:
    Delay() = default;
    Delay(std::size_t frames, std::size_t most_channels) : frames_(frames), samples_(frames * most_channels, 0.0F) {}

    /// Replaces `samples` with those of `frames` ago. A change of `channels` restarts from silence; with more channels
    /// than expected the samples stay unchanged.
    void run(float *samples, std::size_t count, std::size_t channels) noexcept {
        const std::size_t wanted = frames_ * channels;
        if (wanted == 0 || wanted > samples_.size()) return;
        if (wanted != length_) {
            length_ = wanted;
            clear();
        }
        for (std::size_t i = 0; i < count; ++i) {
            std::swap(samples[i], samples_[at_]);
            at_ = at_ + 1 == length_ ? 0 : at_ + 1;
        }
    }

    void clear() noexcept {
        std::fill(samples_.begin(), samples_.end(), 0.0F);
        at_ = 0;
    }

private:
    std::size_t frames_ = 0;
    std::size_t length_ = 0;
    std::size_t at_ = 0;
    std::vector<float> samples_;
};

/// Lock-free queue of samples between two threads. Allocates only in the constructor.
class Ring {
public:
    explicit Ring(std::size_t capacity) : samples_(capacity + 1) {}

    /// Writes up to `count` samples and returns how many fitted. One writer.
    std::size_t write(const float *samples, std::size_t count) noexcept {
        const std::size_t size = samples_.size();
        const std::size_t from = read_.load(std::memory_order_acquire);
        std::size_t to = write_.load(std::memory_order_relaxed);
        count = std::min(count, (from + size - to - 1) % size);
        for (std::size_t i = 0; i < count; ++i) {
            samples_[to] = samples[i];
            to = to + 1 == size ? 0 : to + 1;
        }
        write_.store(to, std::memory_order_release);
        return count;
    }

    /// Reads at most `count` samples. One reader, concurrent with the writer.
    std::size_t read(float *samples, std::size_t count) noexcept {
        const std::size_t size = samples_.size();
        const std::size_t to = write_.load(std::memory_order_acquire);
        std::size_t from = read_.load(std::memory_order_relaxed);
        count = std::min(count, (to + size - from) % size);
        for (std::size_t i = 0; i < count; ++i) {
            samples[i] = samples_[from];
            from = from + 1 == size ? 0 : from + 1;
        }
        read_.store(from, std::memory_order_release);
        return count;
    }

private:
    std::vector<float> samples_;
    std::atomic<std::size_t> write_{0};
    std::atomic<std::size_t> read_{0};
};

} // namespace umo_unreal
