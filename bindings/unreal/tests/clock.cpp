// The clocks, the delay and the ring by themselves: this program also runs under the thread sanitizer.
// SPDX-License-Identifier: MIT OR Apache-2.0

#include <thread>
#include <vector>

#include "Clock.h"
#include "Delay.h"
#include "Expect.h"

using namespace umo_unreal;

namespace {

void audio_is_played_from_when_it_was_given() {
    AudioClock clock(1000);
    EXPECT(clock.read(5).is_quiet && clock.read(5).seconds == 0);
    clock.advance(100, 10.0);
    EXPECT_NEAR(clock.read(9.9).seconds, 0, 0);
    EXPECT_NEAR(clock.read(10.04).seconds, 0.04, 1e-9);
    // Not beyond the audio that was given.
    EXPECT_NEAR(clock.read(10.2).seconds, 0.1, 1e-9);
    EXPECT(!clock.read(10.3).is_quiet && clock.read(10.4).is_quiet);
    clock.advance(50, 10.1);
    EXPECT_NEAR(clock.read(10.12).seconds, 0.12, 1e-9);
}

/// A stream at 30 frames a second whose frame `i` belongs to second `i / 30` of the audio, fully computed.
struct Stream {
    MotionClock clock{30};
    double newest = 100;

    double tick(double step, double heard, bool is_quiet = false) {
        const double time = clock.next(step, heard, is_quiet, 1.0 / 30);
        const auto index = static_cast<std::uint64_t>(std::fmin(time, newest) * 30 + 1e-9);
        clock.found(index, static_cast<double>(index) / 30, newest);
        return time;
    }
};

void motion_waits_for_its_sound_and_then_goes_with_it() {
    Stream stream;
    double heard = -1;
    for (; heard < 0; heard += 1.0 / 60) EXPECT_NEAR(stream.tick(1.0 / 60, heard), 0, heard < -0.25 ? 0 : 0.13);
    double last = 0;
    for (int i = 0; i < 600; ++i, heard += 1.0 / 60) {
        // The audio clock advances in steps of 20 ms.
        const double stepped = std::floor(heard * 50) / 50;
        const double time = stream.tick(1.0 / 60, stepped);
        EXPECT(time >= last);
        if (i > 60) EXPECT_NEAR(time, heard, 0.03);
        last = time;
    }
    // Half a second without ticks: it skips.
    heard += 0.5;
    EXPECT_NEAR(stream.tick(1.0 / 60, heard), heard, 0.06);
    // The audio stalls: motion soon stops.
    for (int i = 0; i < 120; ++i) last = stream.tick(1.0 / 60, heard);
    EXPECT_NEAR(last, heard, 0.26);
    // It is quiet: motion continues by itself.
    const double before = last;
    for (int i = 0; i < 60; ++i) last = stream.tick(1.0 / 60, heard, true);
    EXPECT_NEAR(last - before, 1, 0.02);
}

void it_does_not_run_beyond_the_newest_frame() {
    Stream stream;
    stream.newest = 1;
    double heard = 0;
    for (int i = 0; i < 120; ++i, heard += 1.0 / 60) stream.tick(1.0 / 60, heard);
    EXPECT_NEAR(stream.clock.time(), 1 + 1.0 / 30, 1e-9);
    // Late frames are caught up with in two ticks.
    stream.newest = 3;
    stream.tick(1.0 / 60, heard);
    EXPECT_NEAR(stream.tick(1.0 / 60, heard), heard, 0.06);
}

void frames_of_no_audio_go_at_their_own_pace() {
    MotionClock clock(30);
    clock.found(0, 0, 10);
    clock.next(0.1, 0.1, false, 0);
    clock.found(3, 0.1, 10);
    // An ease: its frames repeat the stamp of the one before.
    clock.next(1.0 / 30, 0.1, false, 0);
    clock.found(4, 0.1, 10);
    const double start = clock.time();
    for (int i = 1; i <= 10; ++i) {
        EXPECT_NEAR(clock.next(1.0 / 30, 5, false, 0), start + i / 30.0, 1e-9);
        clock.found(static_cast<std::uint64_t>(4 + i), 0.1, 10);
    }
    // Then the next stream arrives, whose sound is not heard yet.
    clock.next(1.0 / 30, 5, false, 0);
    clock.found(15, 6, 10);
    const double held = clock.time();
    EXPECT_NEAR(clock.next(1.0 / 30, 5.1, false, 0), held, 0);
}

void delay_gives_what_was_there_so_many_frames_ago() {
    Delay delay(3, 2);
    float samples[10] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
    delay.run(samples, 4, 2);
    delay.run(samples + 4, 6, 2);
    const float wanted[10] = {0, 0, 0, 0, 0, 0, 1, 2, 3, 4};
    for (int i = 0; i < 10; ++i) EXPECT(samples[i] == wanted[i]);
    float more[4] = {11, 12, 13, 14};
    delay.clear();
    delay.run(more, 4, 2);
    EXPECT(more[0] == 0 && more[3] == 0);
    // Mono after stereo restarts from silence; more channels than expected, or no delay, change nothing.
    float mono[4] = {1, 2, 3, 4};
    delay.run(mono, 4, 1);
    EXPECT(mono[0] == 0 && mono[2] == 0 && mono[3] == 1);
    float wide[3] = {1, 2, 3};
    delay.run(wide, 3, 3);
    EXPECT(wide[0] == 1 && wide[2] == 3);
    Delay none;
    none.run(wide, 3, 1);
    EXPECT(wide[0] == 1 && wide[2] == 3);
}

void ring_keeps_order_between_threads() {
    Ring ring(64);
    float sample = 0;
    EXPECT(ring.read(&sample, 1) == 0);
    std::vector<float> many(100, 1.0F);
    EXPECT(ring.write(many.data(), many.size()) == 64);
    std::vector<float> all(100);
    EXPECT(ring.read(all.data(), all.size()) == 64);
    EXPECT(ring.read(&sample, 1) == 0);
    constexpr int count = 200000;
    std::thread writer([&] {
        float block[17];
        for (int next = 0; next < count;) {
            int filled = 0;
            for (; filled < 17 && next + filled < count; ++filled) block[filled] = static_cast<float>(next + filled);
            const int taken = static_cast<int>(ring.write(block, static_cast<std::size_t>(filled)));
            if (taken == 0) std::this_thread::yield();
            next += taken;
        }
    });
    int wrong = 0;
    for (int next = 0; next < count;) {
        float block[23];
        const int given = static_cast<int>(ring.read(block, 23));
        if (given == 0) std::this_thread::yield();
        for (int i = 0; i < given; ++i) wrong += block[i] != static_cast<float>(next + i) ? 1 : 0;
        next += given;
    }
    writer.join();
    EXPECT(wrong == 0);
}

void clock_is_read_whole() {
    // Every buffer matches its time, so a torn read would be off the line.
    AudioClock clock(1000);
    std::atomic<bool> is_over{false};
    std::thread writer([&] {
        double now = 0;
        for (int i = 0; i < 200000; ++i) {
            const std::uint64_t frames = static_cast<std::uint64_t>(i % 7 + 1);
            clock.advance(frames, now);
            now += static_cast<double>(frames) / 1000;
        }
        is_over = true;
    });
    int wrong = 0;
    double last = 0;
    while (!is_over) {
        // Before the last buffer, the reading is that buffer's start: a whole number of thousandths.
        const double seconds = clock.read(-1).seconds;
        wrong += seconds < last || std::fabs(seconds * 1000 - std::round(seconds * 1000)) > 1e-6 ? 1 : 0;
        last = seconds;
    }
    writer.join();
    EXPECT(wrong == 0);
}

} // namespace

int main() {
    audio_is_played_from_when_it_was_given();
    motion_waits_for_its_sound_and_then_goes_with_it();
    it_does_not_run_beyond_the_newest_frame();
    frames_of_no_audio_go_at_their_own_pace();
    delay_gives_what_was_there_so_many_frames_ago();
    ring_keeps_order_between_threads();
    clock_is_read_whole();
    return verdict("clock");
}
