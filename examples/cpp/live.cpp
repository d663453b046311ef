// A miniature game: an audio thread that receives speech as it is spoken, and a game thread that draws 60 frames a
// second.
//
//     c++ -std=c++17 live.cpp $(pkg-config --cflags --libs umo) -pthread -o live
//     ./live MODEL speech.wav [SPEED]
//
// A frame is one line: the time, how open the mouth is, where the right hand points. SPEED 2 plays twice as fast.

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

#include "umo.hpp"

namespace {

using clock_type = std::chrono::steady_clock;

struct recording {
    std::vector<std::int16_t> samples;
    std::uint32_t rate = 0;
    std::uint32_t channels = 0;
};

/// Reads a WAV file of 16-bit samples; empty if it is not one.
recording read_wav(const char *path) {
    std::ifstream file(path, std::ios::binary);
    const std::vector<unsigned char> bytes{std::istreambuf_iterator<char>(file), {}};
    const auto little = [&](std::size_t at, int count) {
        std::uint32_t value = 0;
        while (count-- > 0) value = value << 8 | bytes[at + static_cast<std::size_t>(count)];
        return value;
    };
    recording wav;
    for (std::size_t at = 12; at + 8 <= bytes.size();) {
        const std::size_t size = little(at + 4, 4), start = at + 8;
        if (std::memcmp(&bytes[at], "fmt ", 4) == 0 && start + 16 <= bytes.size()) {
            if (little(start, 2) != 1 || little(start + 14, 2) != 16) return {};
            wav.channels = little(start + 2, 2);
            wav.rate = little(start + 4, 4);
        } else if (std::memcmp(&bytes[at], "data", 4) == 0 && wav.channels > 0) {
            for (std::size_t i = start; i + 2 <= bytes.size() && i < start + size; i += 2) {
                wav.samples.push_back(static_cast<std::int16_t>(little(i, 2)));
            }
            wav.samples.resize(wav.samples.size() / wav.channels * wav.channels);
            return wav;
        }
        at = start + size + (size & 1);
    }
    return {};
}

/// The audio driver's callback, every 10 ms: pushes captured speech. Never waits or allocates.
void hear(umo::session &avatar, const recording &wav, double speed, std::atomic<bool> &failed) {
    const std::size_t piece = wav.rate / 100 * wav.channels;
    auto next = clock_type::now();
    for (std::size_t at = 0; at < wav.samples.size();) {
        const std::size_t count = std::min(piece, wav.samples.size() - at);
        const auto taken = avatar.push_audio(wav.samples.data() + at, count);
        if (!taken) {
            failed = true;
            return;
        }
        at += *taken;
        next += std::chrono::microseconds(static_cast<long>(10'000 / speed));
        std::this_thread::sleep_until(next);
    }
    if (avatar.finish() != UMO_STATUS_OK) failed = true;
}

} // namespace

int main(int argc, char **argv) {
    if (argc < 3) return std::fputs("usage: live MODEL speech.wav [SPEED]\n", stderr), 2;
    const double speed = argc > 3 ? std::atof(argv[3]) : 1.0;
    const recording wav = read_wav(argv[2]);
    if (wav.samples.empty() || speed <= 0) return std::fputs("expected a WAV file of 16-bit samples, and a speed above 0\n", stderr), 1;

    const auto model = umo::model::load(argv[1]);
    if (!model) return std::fprintf(stderr, "%s: %s\n", argv[1], umo_last_error()), 1;
    auto engine = umo::engine::make(*model);
    auto config = umo::session::defaults(*model);
    config.sample_rate = wav.rate;
    config.channels = wav.channels;
    config.idle = UMO_IDLE_REST;
    auto avatar = engine ? umo::session::make(*engine, &config) : umo::result<umo::session>{engine.status, {}};
    if (!avatar) return std::fprintf(stderr, "cannot start: %s\n", umo_last_error()), 1;

    // Motion lags speech by the audio that the avatar needs in advance: a game delays its sound by as much.
    const double delay = static_cast<double>(avatar->latency().algorithmic_samples) / wav.rate;
    const double seconds = static_cast<double>(wav.samples.size() / wav.channels) / wav.rate;
    std::printf("%.1f s of speech; motion lags it by %.2f s plus the time to compute it\n", seconds, delay);

    std::atomic<bool> failed{false};
    const auto start = clock_type::now();
    std::thread audio([&] { hear(*avatar, wav, speed, failed); });

    umo::frames frame(*model, 1);
    std::size_t mouth = 0;
    const auto names = model->channel_names();
    while (mouth + 1 < names.size() && names[mouth] != "jawOpen") ++mouth;
    int drawn = 0, ahead = 0;
    for (double time = 0; time < seconds && !failed; ++drawn) {
        std::this_thread::sleep_until(start + std::chrono::microseconds(static_cast<long>(1e6 * drawn / (60 * speed))));
        // The sound heard now was spoken `delay` ago.
        time = drawn / 60.0 - delay - 0.1;
        if (time < 0) continue;
        const auto sampled = avatar->sample(time, frame);
        if (!sampled) failed = true;
        ahead += static_cast<int>(sampled->is_ahead);
        if (drawn % 15 == 0) {
            const float open = frame[0].channels()[mouth];
            const float *wrist = frame[0].rotation(21);
            std::printf("%6.2f s  mouth %-20s  right wrist % .2f % .2f % .2f % .2f\n", time,
                        std::string(static_cast<std::size_t>(20 * open), '#').c_str(), static_cast<double>(wrist[0]),
                        static_cast<double>(wrist[1]), static_cast<double>(wrist[2]), static_cast<double>(wrist[3]));
        }
    }
    audio.join();
    const auto stats = avatar->stats();
    const auto latency = avatar->latency();
    std::printf("%d frames drawn, %d of them before their pose was ready; %llu frames, %llu late; chunks took %.1f ms (p99 %.1f)\n",
                drawn, ahead, static_cast<unsigned long long>(stats.frames),
                static_cast<unsigned long long>(stats.late_frames), 1e3 * latency.compute_p50, 1e3 * latency.compute_p99);
    if (failed) std::fprintf(stderr, "the avatar failed: %s\n", avatar->last_error().c_str());
    return failed ? 1 : 0;
}
