// A character that speaks assets/hello.wav with the real library: frames equal the library's, lips are in sync with the
// sound, nothing is allocated, and two threads take part. Arguments: the model, the recording, a model with a mouth
// network.
// SPDX-License-Identifier: MIT OR Apache-2.0

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "Avatar.h"
#include "Expect.h"
#include "Recording.h"

namespace {

thread_local long allocations = 0;

} // namespace

// Not inlined: gcc reports the inlined pairs as mismatched.
[[gnu::noinline]] void *operator new(std::size_t size) {
    ++allocations;
    if (void *memory = std::malloc(size)) return memory;
    std::abort();
}
[[gnu::noinline]] void operator delete(void *memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void *memory, std::size_t) noexcept { std::free(memory); }

using namespace umo_unreal;

namespace {

constexpr std::uint32_t rate = 16000;

umo_engine_config one_thread() {
    umo_engine_config config = umo::engine::defaults();
    config.threads = 1;
    return config;
}

/// Turns the layers off: they never stand still and follow the clock while there are no frames, so poses could not be
/// compared.
template <class T> void without_layers(T &to) {
    for (std::uint32_t layer = UMO_PARAMETER_LAYER_GAZE; layer <= UMO_PARAMETER_LAYER_BODY; ++layer) {
        EXPECT(to.set(layer, 0) == UMO_STATUS_OK);
    }
}

/// The library's frames for the whole recording, to be sampled at rising times.
struct Reference {
    umo::session session;
    umo::frames frame;

    Reference(Host &host, const std::vector<float> &samples)
        : session(make(host, samples.size())), frame(host.model, 1, UMO_AXES_UNREAL) {
        without_layers(session);
        const auto pushed = session.push_audio(samples.data(), samples.size());
        EXPECT(pushed && *pushed == samples.size());
        EXPECT(session.finish() == UMO_STATUS_OK);
        const std::size_t frames = samples.size() * 30 / rate;
        for (int i = 0; i < 60000 && *session.ready() < frames; ++i) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
        EXPECT(*session.ready() >= frames);
    }

    /// All frames of the recording stay in the queue until they are sampled.
    static umo::session make(Host &host, std::size_t samples) {
        umo_session_config config = umo::session::defaults(host.model);
        config.sample_rate = rate;
        config.queue_frames = static_cast<std::uint32_t>(samples * 30 / rate + 60);
        return std::move(*umo::session::make(host.engine, &config));
    }

    bool equals(double seconds, const Pose &pose) {
        if (!session.sample(seconds, frame)) return false;
        const umo::frame found = frame[0];
        bool same = found.index() == pose.index && std::memcmp(found.translation(), pose.translation, 12) == 0;
        for (std::size_t joint = 0; joint < joint_count; ++joint) {
            same &= std::memcmp(found.rotation(joint), pose.rotations + 4 * joint, 16) == 0;
        }
        return same && std::memcmp(found.channels(), pose.channels.data(), 4 * pose.channels.size()) == 0;
    }
};

Settings plain() {
    Settings settings;
    settings.sample_rate = rate;
    settings.idle = UMO_IDLE_HOLD;
    settings.output_latency = 0;
    return settings;
}

/// Speech in stereo with a simulated clock: the engine gets as long as it needs.
void frames_are_the_library_s_and_go_with_the_sound(const std::shared_ptr<Host> &host,
                                                    const std::vector<float> &samples) {
    std::string problem;
    const auto avatar = Avatar::make(host, plain(), problem);
    EXPECT(avatar != nullptr);
    if (!avatar) return;
    without_layers(*avatar);
    // Layers shown before are eased out in game time.
    for (int i = 0; i < 90; ++i) EXPECT(avatar->show(0, 100, 1 / 30.0) == UMO_STATUS_OK);
    Reference reference(*host, samples);

    constexpr std::size_t block = 160;
    const auto delayed = static_cast<std::size_t>(std::lround(avatar->delay() * rate));
    double now = 100;
    std::size_t pushed = 0, ticks = 0, compared = 0, wrong = 0, moved = 0;
    const Pose first = avatar->pose();
    float stereo[2 * block];
    long audio_allocations = 0, game_allocations = 0;
    double worst = 0;
    for (; pushed + block <= samples.size(); now += static_cast<double>(block) / rate) {
        for (std::size_t i = 0; i < block; ++i) {
            stereo[2 * i] = samples[pushed + i] * 1.5F;
            stereo[2 * i + 1] = samples[pushed + i] * 0.5F;
        }
        allocations = 0;
        avatar->hear(stereo, block, 2, rate, now);
        audio_allocations += allocations;
        for (std::size_t i = 0; i < block; ++i) {
            const std::size_t at = pushed + i;
            const float wanted = at < delayed ? 0 : samples[at - delayed] * 1.5F;
            EXPECT(stereo[2 * i] == wanted);
        }
        pushed += block;
        // 50 ticks a second. First wait for all frames up to two after the sound being heard.
        if (++ticks % 2 != 0) continue;
        const double audio = static_cast<double>(pushed) / rate;
        const double due = std::floor((audio - avatar->delay()) * 30) + 3;
        for (int i = 0; i < 20000 && static_cast<double>(avatar->stats().frames) < due; ++i) {
            std::this_thread::sleep_for(std::chrono::microseconds(100));
        }
        allocations = 0;
        const umo_status status = avatar->show(0.02, now);
        game_allocations += allocations;
        EXPECT(status == UMO_STATUS_OK);
        if (audio > avatar->delay() + 0.5) {
            worst = std::fmax(worst, std::fabs(avatar->shown() - avatar->heard(now)));
            ++compared;
            wrong += reference.equals(avatar->time(), avatar->pose()) ? 0 : 1;
            moved += std::memcmp(first.rotations, avatar->pose().rotations, sizeof first.rotations) != 0 ? 1 : 0;
        }
    }
    EXPECT(compared > 200);
    EXPECT_NEAR(static_cast<double>(wrong), 0, 0);
    EXPECT(moved == compared);
    EXPECT(audio_allocations == 0);
    EXPECT(game_allocations == 0);
    // Within a frame.
    EXPECT_NEAR(worst, 0, 1.0 / 30);
    EXPECT(avatar->stats().overruns == 0 && avatar->failure().empty());
    std::printf("%zu poses compared bit for bit, lips within %.1f ms of the sound, which is heard %.2f s late\n", compared,
                1000 * worst, avatar->delay());
}

/// If the file is in an archive, its contents are passed instead.
void a_model_of_memory_is_that_of_the_file(const char *model) {
    std::ifstream file(model, std::ios::binary);
    const std::vector<char> content{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    std::string problem;
    Hosts hosts;
    EXPECT(!hosts.has("assets/model"));
    const auto host = hosts.open("assets/model", one_thread(), problem, content.data(), content.size());
    EXPECT(host != nullptr && hosts.has("assets/model"));
    EXPECT(hosts.open("assets/model", one_thread(), problem) == host);
    EXPECT(hosts.open("assets/other", one_thread(), problem, content.data(), 16) == nullptr && !problem.empty());
}

/// A take shows the recorded frames by the game's steps, then idles, and gives way to the avatar's own motion.
void a_take_plays_what_was_recorded(const std::shared_ptr<Host> &host, const std::vector<float> &samples) {
    umo_session_config config = umo::session::defaults(host->model);
    config.sample_rate = rate;
    config.take_bytes = 1 << 20;
    auto recorded = umo::session::make(host->engine, &config);
    EXPECT(bool(recorded));
    constexpr std::size_t seconds = 3;
    EXPECT(recorded->push_audio(samples.data(), seconds * rate).value == seconds * rate);
    EXPECT(recorded->finish() == UMO_STATUS_OK);
    umo::frames one(host->model, 1, UMO_AXES_UNREAL);
    std::vector<std::array<float, 4 * joint_count>> frames;
    for (int i = 0; i < 60000 && frames.size() < 30 * seconds; ++i) {
        if (recorded->pull(one).value == 0) {
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
            continue;
        }
        auto &rotations = frames.emplace_back();
        for (std::size_t joint = 0; joint < joint_count; ++joint) std::copy_n(one[0].rotation(joint), 4, &rotations[4 * joint]);
    }
    EXPECT(frames.size() == 30 * seconds);
    if (frames.size() != 30 * seconds) return;
    const std::vector<unsigned char> take = *recorded->recorded();

    Settings settings = plain();
    settings.output_latency = 0.1;
    std::string problem;
    const auto avatar = Avatar::make(host, settings, problem);
    EXPECT(avatar != nullptr);
    if (!avatar) return;
    EXPECT(!avatar->plays_take());
    EXPECT(avatar->play_take(take.data() + 1, take.size() - 1, problem) == UMO_STATUS_TAKE && problem.find("not a take") != std::string::npos);
    EXPECT(avatar->play_take(take.data(), take.size(), problem) == UMO_STATUS_OK && avatar->plays_take());
    std::size_t same = 0;
    long most = 0;
    // The sound is heard three frames after it began.
    for (std::size_t i = 0; i < 30 * seconds + 3; ++i) {
        allocations = 0;
        EXPECT(avatar->show(1 / 30.0, 100) == UMO_STATUS_OK);
        most = std::max(most, allocations);
        const auto &rotations = frames[i < 3 ? 0 : i - 3];
        float far = 0;
        for (std::size_t k = 0; k < rotations.size(); ++k) far = std::fmax(far, std::fabs(rotations[k] - avatar->pose().rotations[k]));
        same += far < 1e-5F ? 1 : 0;
    }
    EXPECT(same == 30 * seconds + 3 && most == 0);
    EXPECT(avatar->look_at({200, 50, 160}, 1) == UMO_STATUS_OK && avatar->set(UMO_PARAMETER_GAIN_FACE, 0.5) == UMO_STATUS_OK);
    for (int i = 0; i < 30; ++i) EXPECT(avatar->show(1 / 30.0, 100) == UMO_STATUS_OK);
    EXPECT(!avatar->plays_take() && avatar->failure().empty());
    avatar->stop_take();
    EXPECT(avatar->show(1 / 30.0, 100) == UMO_STATUS_OK);
    std::printf("a take of %zu bytes: %zu poses as recorded\n", take.size(), same);
}

/// Speech is heard at once, and the mouth's frames belong to the sound being heard, computed or not. A hint closes the
/// lips, which are open without it; a word raises a hand.
void hints_close_the_lips_and_words_raise_a_hand(const std::shared_ptr<Host> &host, const std::vector<float> &samples) {
    const std::vector<std::string> names = host->model.channel_names();
    const auto index = [&](const char *name) { return std::find(names.begin(), names.end(), name) - names.begin(); };
    const auto jaw = static_cast<std::size_t>(index("jawOpen")), close = static_cast<std::size_t>(index("mouthClose"));
    EXPECT(jaw < names.size() && close < names.size());
    double widest[2] = {};
    constexpr std::size_t shoulder = 17; // the right one
    float raised[2][4] = {};
    Settings settings = plain();
    // "now" means nothing in English.
    settings.word_rules = "[class.own]\nwords = ['now']\ngestures = [{ name = 'stop', side = 'right' }]";
    for (const bool is_hinted : {false, true}) {
        std::string problem;
        const auto avatar = Avatar::make(host, settings, problem);
        EXPECT(avatar != nullptr);
        if (!avatar) return;
        EXPECT(avatar->hint_lips(3, 1, 0.1) == UMO_STATUS_INVALID_ARGUMENT);
        EXPECT(avatar->hint_lips(UMO_LIPS_CLOSED, -1, 0.1) == UMO_STATUS_INVALID_ARGUMENT);
        EXPECT(!is_hinted || avatar->hint_lips(UMO_LIPS_CLOSED, 1, 0.5) == UMO_STATUS_OK);
        // Without the voice, so that the model's own arms are down when the word comes.
        EXPECT(avatar->set(UMO_PARAMETER_EXPRESSION, 0) == UMO_STATUS_OK);
        EXPECT(avatar->hint_words("now", 2, 1.9) == UMO_STATUS_INVALID_ARGUMENT);
        EXPECT(!is_hinted || avatar->hint_words("now", 2, 2.4) == UMO_STATUS_OK);
        constexpr std::size_t block = 160;
        double now = 100;
        std::size_t looked = 0;
        for (std::size_t at = 0; at + block <= 4 * rate; at += block) {
            float heard[block];
            std::copy_n(samples.data() + at, block, heard);
            avatar->hear(heard, block, 1, rate, now);
            now += static_cast<double>(block) / rate;
            EXPECT_NEAR(avatar->given(now), static_cast<double>(at + block) / rate, 1e-6);
            const double due = std::floor((static_cast<double>(at + block) / rate - avatar->delay()) * 30) + 2;
            for (int i = 0; i < 20000 && static_cast<double>(avatar->stats().frames) < due; ++i) {
                std::this_thread::sleep_for(std::chrono::microseconds(100));
            }
            EXPECT(avatar->show(0.01, now) == UMO_STATUS_OK);
            if (avatar->shown() < 2.2) std::copy_n(avatar->pose().rotations + 4 * shoulder, 4, raised[is_hinted]);
            if (avatar->shown() < 1.04 || avatar->shown() > 1.46) continue;
            ++looked;
            widest[is_hinted] = std::fmax(widest[is_hinted], avatar->pose().channels[jaw] - avatar->pose().channels[close]);
        }
        EXPECT(looked > 20);
    }
    EXPECT(widest[0] > 0.1 && widest[1] < 0.01);
    float turned = 0;
    for (std::size_t i = 0; i < 4; ++i) turned = std::fmax(turned, std::fabs(raised[1][i] - raised[0][i]));
    EXPECT(turned > 0.2);
    std::printf("words: the arm turns by %.2f\n", static_cast<double>(turned));
    std::printf("hints: lips open by %.2f without, by %.2f with\n", widest[0], widest[1]);
}

void a_live_mouth_goes_with_the_sound(const char *model, const std::vector<float> &samples) {
    std::string problem;
    Hosts hosts;
    const auto host = hosts.open(model, one_thread(), problem);
    EXPECT(host != nullptr && host->info.has_mouth == 1);
    if (!host) return;
    Settings settings = plain();
    EXPECT(!Avatar::make(host, settings, problem)->is_live());
    settings.delays_speech = false;
    settings.has_live_voice = false;
    EXPECT(!Avatar::make(host, settings, problem)->is_live());
    settings.has_live_voice = true;
    const auto avatar = Avatar::make(host, settings, problem);
    EXPECT(avatar != nullptr && avatar->is_live() && avatar->delay() > 0 && avatar->delay() <= 0.1);
    if (!avatar) return;
    // A second avatar hears the same; its mouth is closed by the jaw.
    settings.has_mouth_close = false;
    const auto jawed = Avatar::make(host, settings, problem);
    const auto index = [&](const char *name) {
        return static_cast<std::size_t>(std::find(host->channels.begin(), host->channels.end(), name) - host->channels.begin());
    };
    const std::size_t jaw = index("jawOpen"), close = index("mouthClose");
    EXPECT(jawed != nullptr && jaw < host->channels.size() && close < host->channels.size());
    if (!jawed) return;
    without_layers(*avatar);
    without_layers(*jawed);
    constexpr std::size_t block = 160;
    double now = 100, worst = 0, closed = 0;
    std::size_t moved = 0;
    std::vector<float> last;
    for (std::size_t at = 0; at + block <= 3 * rate; at += block, now += static_cast<double>(block) / rate) {
        float heard[block];
        std::copy_n(samples.data() + at, block, heard);
        avatar->hear(heard, block, 1, rate, now);
        EXPECT(std::memcmp(heard, samples.data() + at, sizeof heard) == 0);
        EXPECT(avatar->show(0.01, now) == UMO_STATUS_OK);
        jawed->hear(heard, block, 1, rate, now);
        EXPECT(jawed->show(0.01, now) == UMO_STATUS_OK);
        const std::vector<float> &as_made = avatar->pose().channels, &by_jaw = jawed->pose().channels;
        EXPECT(by_jaw[close] == 0);
        EXPECT_NEAR(by_jaw[jaw], std::fmax(as_made[jaw] - as_made[close], 0.0F), 1e-5);
        closed = std::fmax(closed, as_made[close]);
        if (at > rate) worst = std::fmax(worst, std::fabs(avatar->shown() - avatar->heard(now)));
        moved += last == avatar->pose().channels ? 0 : 1;
        last = avatar->pose().channels;
    }
    EXPECT_NEAR(worst, 0, 1.0 / 30);
    EXPECT(moved > 30 && closed > 0.01);
    EXPECT(avatar->failure().empty());
    std::printf("live: the mouth within %.1f ms of the sound, %.0f ms behind it\n", 1000 * worst, 1000 * avatar->delay());
}

double wall() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// An audio thread and a game thread in real time, an interrupt, and closing while audio arrives.
void two_threads_speak_are_interrupted_and_end(const std::shared_ptr<Host> &host, const std::vector<float> &samples) {
    std::string problem;
    Settings settings = plain();
    settings.target = 2;
    settings.lookahead = 0;
    settings.idle = UMO_IDLE_LIVE;
    const auto avatar = Avatar::make(host, settings, problem);
    EXPECT(avatar != nullptr);
    if (!avatar) return;
    std::atomic<bool> is_over{false};
    std::thread audio([&] {
        double next = wall();
        float block[320];
        for (std::size_t at = 0; !is_over; at += 320, next += 0.02) {
            for (std::size_t i = 0; i < 320; ++i) block[i] = samples[(at + i) % samples.size()];
            avatar->hear(block, 320, 1, rate, wall());
            while (wall() < next + 0.02) std::this_thread::sleep_for(std::chrono::milliseconds(1));
        }
    });
    const double start = wall();
    double last = start, previous_time = 0;
    std::vector<double> off;
    std::uint64_t at_interrupt = 0, previous_index = 0;
    bool is_interrupted = false;
    while (wall() - start < 5) {
        std::this_thread::sleep_for(std::chrono::milliseconds(15));
        const double now = wall();
        EXPECT(avatar->show(now - last, now) == UMO_STATUS_OK);
        last = now;
        EXPECT(avatar->time() >= previous_time && avatar->pose().index >= previous_index);
        previous_time = avatar->time();
        previous_index = avatar->pose().index;
        const double since = now - start;
        if (!is_interrupted && since > 2.5) {
            EXPECT(avatar->interrupt(200) == UMO_STATUS_OK);
            is_interrupted = true;
            at_interrupt = avatar->pose().index;
        }
        const bool settled = (since > 1.6 && since < 2.4) || since > 2.5 + avatar->delay() + 0.7;
        if (settled) off.push_back(std::fabs(avatar->shown() - avatar->heard(now)));
    }
    // The next stream's frames follow those of the ease.
    EXPECT(avatar->pose().index > at_interrupt + 6 + 10);
    // One tick and one buffer at most; the median, since a busy machine is sometimes late.
    EXPECT(off.size() > 20);
    std::sort(off.begin(), off.end());
    const double median = off.empty() ? 1 : off[off.size() / 2];
    EXPECT_NEAR(median, 0, 0.05);
    EXPECT(avatar->failure().empty());
    EXPECT(avatar->set(UMO_PARAMETER_GAIN_FACE, 0.5) == UMO_STATUS_OK);
    EXPECT(avatar->set(UMO_PARAMETER_EXPRESSION, 1.5) == UMO_STATUS_INVALID_ARGUMENT);
    EXPECT(avatar->arousal() >= 0 && avatar->arousal() <= 1 && std::fabs(avatar->arousal_trend()) < 1);
    EXPECT(avatar->set(UMO_PARAMETER_GAIN_FACE, -1) == UMO_STATUS_INVALID_ARGUMENT);
    EXPECT(!avatar->last_error().empty());
    EXPECT(avatar->set(UMO_PARAMETER_ATTENTION, UMO_ATTENTION_THINKING) == UMO_STATUS_OK);
    EXPECT(avatar->look_at({200, 50, 160}, 1) == UMO_STATUS_OK);
    EXPECT(avatar->look_at({200, 50, 160}, 2) == UMO_STATUS_INVALID_ARGUMENT);
    EXPECT(avatar->set_mood(UMO_MOOD_JOY, 0.5F) == UMO_STATUS_OK);
    EXPECT(avatar->set_mood(99, 0.5F) == UMO_STATUS_INVALID_ARGUMENT);
    const std::vector<std::string> names = avatar->gesture_names();
    EXPECT(std::find(names.begin(), names.end(), "wave") != names.end());
    EXPECT(avatar->play_gesture("wave", UMO_SIDE_LEFT, 1, 5, nullptr) == UMO_STATUS_OK);
    const std::array<float, 3> target{300, 50, 100};
    EXPECT(avatar->play_gesture("point", UMO_SIDE_AUTO, 0.5F, 0, &target) == UMO_STATUS_OK);
    EXPECT(avatar->play_gesture("somersault", UMO_SIDE_AUTO, 1, 0, nullptr) == UMO_STATUS_INVALID_ARGUMENT);
    EXPECT(avatar->last_error().find("somersault") != std::string::npos);
    EXPECT(avatar->push_other_audio(samples.data(), 480) == UMO_STATUS_OK);
    EXPECT(avatar->set_prompt("be calm") == UMO_STATUS_OK);
    EXPECT(avatar->set_idle(UMO_IDLE_REST) == UMO_STATUS_OK);
    avatar->close();
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT(avatar->show(0.01, wall()) != UMO_STATUS_OK);
    is_over = true;
    audio.join();
    std::printf("two threads: lips within %.0f ms of the sound, the median\n", 1000 * median);
}

/// In real time: before any audio it moves as while listening, or rests if so configured.
void idle_modes_go_on_without_audio(const std::shared_ptr<Host> &host) {
    std::string problem;
    Settings settings = plain();
    settings.target = 1;
    settings.lookahead = 0;
    settings.idle = UMO_IDLE_LIVE;
    const auto avatar = Avatar::make(host, settings, problem);
    EXPECT(avatar != nullptr);
    if (!avatar) return;
    without_layers(*avatar);
    EXPECT(avatar->show(0.01, wall()) == UMO_STATUS_OK);
    const Pose rest = avatar->pose();
    const auto run = [&](double seconds) {
        double last = wall();
        for (const double end = last + seconds; last < end;) {
            std::this_thread::sleep_for(std::chrono::milliseconds(15));
            const double now = wall();
            EXPECT(avatar->show(now - last, now) == UMO_STATUS_OK);
            last = now;
        }
    };
    run(2);
    EXPECT(avatar->pose().index > 15);
    EXPECT(std::memcmp(rest.rotations, avatar->pose().rotations, sizeof rest.rotations) != 0);
    EXPECT(avatar->set_idle(UMO_IDLE_REST) == UMO_STATUS_OK);
    run(2);
    for (std::size_t i = 0; i < 4 * joint_count; ++i) EXPECT_NEAR(avatar->pose().rotations[i], rest.rotations[i], 1e-3);
}

void hosts_are_shared_and_errors_say_what(const char *model) {
    Hosts hosts;
    std::string problem;
    EXPECT(hosts.open("no/such/model.safetensors", umo::engine::defaults(), problem) == nullptr);
    EXPECT(problem.find("no/such/model.safetensors") != std::string::npos);
    auto host = hosts.open(model, one_thread(), problem);
    EXPECT(host != nullptr && hosts.open(model, one_thread(), problem) == host && hosts.count() == 1);
    if (!host) return;
    // The curves are ARKit's, with the names used by MetaHuman and Live Link Face.
    EXPECT(host->info.is_arkit == 1 && host->channels.size() == 52);
    EXPECT(host->channels.front() == "eyeBlinkLeft" && host->channels.back() == "tongueOut");
    EXPECT(host->skeleton.parents[0] == -1 && host->skeleton.parents[15] == 12);
    // Right is +Y, up is +Z, centimetres.
    EXPECT(host->skeleton.offsets[3 * 19 + 1] > 10 && host->skeleton.offsets[3 * 6 + 2] > 1);

    Settings settings = plain();
    settings.target = 10000;
    EXPECT(Avatar::make(host, settings, problem) == nullptr && problem.find("target") != std::string::npos);
    settings.target = 1;
    auto avatar = Avatar::make(host, settings, problem);
    EXPECT(avatar != nullptr && avatar->skeleton().rest_translation[2] > 50);
    float samples[64] = {1.0F};
    avatar->hear(samples, 64, 1, 44100, 0);
    EXPECT(avatar->other_rate() == 44100 && samples[0] == 1.0F);

    host.reset();
    hosts.close_unused();
    EXPECT(hosts.count() == 1);
    // The engine is freed: the character reports it once.
    avatar->close();
    avatar.reset();
    hosts.close_unused();
    EXPECT(hosts.count() == 0);
}

/// A film is rendered frame by frame, however long that takes; a paused game stands still.
void what_moves_in_silence_goes_by_the_game_s_time(const std::shared_ptr<Host> &host) {
    std::string problem;
    const auto avatar = Avatar::make(host, plain(), problem);
    EXPECT(avatar != nullptr);
    if (!avatar) return;
    const auto shown = [&](double game_step) {
        EXPECT(avatar->show(0, 100, game_step) == UMO_STATUS_OK);
        return std::vector<float>(avatar->pose().rotations, avatar->pose().rotations + 4 * joint_count);
    };
    for (int i = 0; i < 60; ++i) shown(1 / 30.0);
    const std::vector<float> paused = shown(0);
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    EXPECT(shown(0) == paused);
    EXPECT(shown(1 / 24.0) != paused);
}

void gestures_and_settings_are_the_host_s(const std::shared_ptr<Host> &host, const char *salute) {
    std::string problem;
    const auto before = Avatar::make(host, plain(), problem);
    EXPECT(before && before->add_gesture("greet", salute, "", UMO_GESTURE_RIGHT_ARM, -1) == UMO_STATUS_OK);
    EXPECT(before && before->add_gesture("greet", salute, "wave", UMO_GESTURE_RIGHT_ARM, -1) == UMO_STATUS_INVALID_ARGUMENT);
    EXPECT(std::string(umo_last_error()).find("salute") != std::string::npos);
    Settings settings = plain();
    settings.lookahead = 0;
    settings.smoothing = 0;
    const auto rough = Avatar::make(host, settings, problem);
    settings.smoothing = -1;
    const auto smooth = Avatar::make(host, settings, problem);
    EXPECT(smooth && smooth->play_gesture("greet", UMO_SIDE_AUTO, 1, 0, nullptr) == UMO_STATUS_OK);
    // The low-pass filter looks three frames ahead.
    EXPECT(rough && smooth && std::abs(smooth->delay() - rough->delay() - 0.1) < 1e-9);
    settings.language = "xx";
    EXPECT(!Avatar::make(host, settings, problem) && problem.find("xx") != std::string::npos);
    settings.language = "de";
    settings.guidance = 9;
    EXPECT(!Avatar::make(host, settings, problem) && problem.find("guidance") != std::string::npos);
}

void a_lost_engine_is_told_once(const char *model) {
    std::string problem;
    Hosts hosts;
    auto host = hosts.open(model, one_thread(), problem);
    auto avatar = Avatar::make(host, plain(), problem);
    EXPECT(avatar && avatar->failure().empty());
    host->engine.reset();
    // It keeps its pose; the failure shows in audio that is not taken.
    EXPECT(avatar->show(0.01, 1) == UMO_STATUS_OK);
    float samples[16] = {};
    avatar->hear(samples, 16, 1, rate, 1);
    EXPECT(avatar->failure().find("engine was freed") != std::string::npos);
    EXPECT(avatar->failure().empty());
}

} // namespace

int main(int count, char **arguments) {
    if (count != 5) return EXIT_FAILURE;
    const std::vector<float> samples = recording(arguments[2]);
    EXPECT(samples.size() > 100000);
    allocations = 0;
    { const std::vector<int> counted(1); }
    EXPECT(allocations == 1);
    hosts_are_shared_and_errors_say_what(arguments[1]);
    a_model_of_memory_is_that_of_the_file(arguments[1]);
    a_lost_engine_is_told_once(arguments[1]);
    a_live_mouth_goes_with_the_sound(arguments[3], samples);
    Hosts hosts;
    std::string problem;
    const auto host = hosts.open(arguments[1], umo::engine::defaults(), problem);
    EXPECT(host != nullptr);
    if (host) {
        frames_are_the_library_s_and_go_with_the_sound(host, samples);
        a_take_plays_what_was_recorded(host, samples);
        hints_close_the_lips_and_words_raise_a_hand(host, samples);
        two_threads_speak_are_interrupted_and_end(host, samples);
        idle_modes_go_on_without_audio(host);
        what_moves_in_silence_goes_by_the_game_s_time(host);
        gestures_and_settings_are_the_host_s(host, arguments[4]);
    }
    return verdict("avatar");
}
