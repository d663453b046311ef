// One speaking character: a session of the library, the audio on its way to it, and the pose that belongs to what is heard.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "Clock.h"
#include "Delay.h"
#include "Retarget.h"
#include "umo.hpp"

namespace umo_unreal {

/// A model and the engine that computes with it, shared by all characters of a process.
struct Host {
    umo::model model;
    umo::engine engine;
    umo_model_info info{};
    std::vector<std::string> channels;
    SourceSkeleton skeleton;
};

/// The hosts of a process, one per model file. One thread.
class Hosts {
public:
    /// `config` is read when the file is opened first. Null where that fails: `problem` says why. `content` is what
    /// the file holds where the system cannot open it by its path.
    std::shared_ptr<Host> open(const std::string &path, const umo_engine_config &config, std::string &problem,
                               const void *content = nullptr, std::size_t size = 0);
    /// Lets go of those that no character uses.
    void close_unused();
    bool has(const std::string &path) const;
    std::size_t count() const { return hosts_.size(); }

private:
    std::vector<std::pair<std::string, std::shared_ptr<Host>>> hosts_;
};

/// What a character is made with.
struct Settings {
    std::uint32_t sample_rate = 48000;
    /// Keyframes per chunk, 0 for the model's default.
    std::uint32_t target = 0;
    /// Frames held back for smoother seams, below 0 for the model's default.
    std::int32_t lookahead = -1;
    /// `UMO_IDLE_…`
    std::uint32_t idle = UMO_IDLE_LIVE;
    std::uint64_t seed = 0;
    /// Standard deviation of the body's low-pass, frames; below 0 for the default.
    float smoothing = -1;
    /// How strongly the prompt steers, 1 to 3.
    float guidance = 1;
    /// Keyframes of speech that it hears ahead.
    std::uint32_t horizon = 0;
    /// Seconds for computing, on top of the audio that frames need.
    double margin = 0.2;
    /// Seconds from a buffer's callback to the loudspeaker.
    double output_latency = 0.04;
    /// Whether speech is heard only when its motion is there.
    bool delays_speech = true;
    /// Whether the mouth moves with speech that is not delayed, where the model has a mouth network: the body follows.
    bool has_live_voice = true;
    /// Whether `mouthClose` is given. Without it the shape is 0, and `jawOpen` less by as much.
    bool has_mouth_close = true;
};

/// A frame, as the animation threads get it.
struct Pose {
    std::uint64_t index = 0;
    float translation[3] = {};
    float rotations[4 * joint_count] = {};
    std::vector<float> channels;
};

/// What a status of the library came to, for people.
std::string explain(umo_status status, const std::string &detail);

class Avatar {
public:
    /// Null where that fails: `problem` says why.
    static std::shared_ptr<Avatar> make(std::shared_ptr<Host> host, const Settings &settings, std::string &problem);

    /// The audio thread: `frames` of interleaved speech. They are given to the library, and changed to those that are to be
    /// heard now. Never allocates, never waits. `now` is the clock that `show` is asked with.
    void hear(float *samples, std::size_t frames, std::size_t channels, std::uint32_t rate, double now) noexcept;

    /// The game thread: the pose at `now`, `step` seconds after the last. What moves while nothing is said is `game_step` seconds
    /// later, the game's time: a film is rendered slower than it is shown, and a game may pause. Never allocates, never waits.
    umo_status show(double step, double now, double game_step);
    umo_status show(double step, double now) { return show(step, now, step); }
    const Pose &pose() const { return pose_; }

    /// The game thread. Speech that is not shown yet is neither shown nor heard.
    umo_status interrupt(std::uint32_t ease_ms);
    /// The game thread.
    umo_status set_prompt(const std::string &text) { return session_.set_prompt(text); }
    umo_status set(std::uint32_t parameter, double value);
    umo_status set_idle(std::uint32_t idle);
    /// The game thread. A point in the avatar's space: centimetres, X ahead, Y to its right, Z up from the floor.
    umo_status look_at(const std::array<float, 3> &point, float strength);
    /// The game thread. `UMO_MOOD_…`
    umo_status set_mood(std::uint32_t mood, float strength) { return note(session_.set_mood(mood, strength)); }
    /// The game thread: a sound that one sees on the lips, `UMO_LIPS_…`, in seconds of the audio that was given to `hear`. `BUSY`
    /// while 64 wait.
    umo_status hint_lips(std::uint32_t shape, double start, double duration) {
        return note(session_.hint_lips(shape, start, duration));
    }
    /// Seconds of audio that were given to `hear`, up to `now`.
    double given(double now) const noexcept { return audio_.read(now).seconds; }
    /// The game thread: a gesture by its name. `target` is a point as that of `look_at`, null for none.
    umo_status play_gesture(const std::string &name, std::uint32_t side, float strength, const std::array<float, 3> *target);
    /// A gesture of the host's own, for avatars of the same model that are made from now on: see `umo_engine_add_gesture_file`.
    umo_status add_gesture(const std::string &name, const std::string &path, const std::string &animation, std::uint32_t parts,
                           float stroke) {
        return host_->engine.add_gesture_file(name.c_str(), path.c_str(), animation.empty() ? nullptr : animation.c_str(), parts,
                                              stroke);
    }
    std::vector<std::string> gesture_names() const { return host_->engine.gesture_names(); }
    /// One thread, any: who speaks to the avatar, mono, at the settings' rate. Never allocates, never waits.
    umo_status push_other_audio(const float *samples, std::size_t count) noexcept {
        return note(umo_session_push_other_audio(heard_, samples, count));
    }
    /// The game thread: frees the session and lets go of the host, whatever the audio thread does, so that nothing is left that
    /// the audio thread could not free. It gives no more frames.
    void close();

    /// Why it gives no more frames, once; empty while it does, and when asked again.
    std::string failure();
    /// The detail of the last failed call.
    std::string last_error() const { return session_.last_error(); }
    /// Samples per second of audio that came at another rate than the settings', 0 where none did.
    std::uint32_t other_rate() const { return other_rate_.load(std::memory_order_relaxed); }
    /// Whether the mouth moves with the sound.
    bool is_live() const { return is_live_; }
    /// Seconds from a sound's callback to the loudspeaker and to the motion, the output's latency left out. With the live
    /// voice, to the mouth's motion alone.
    double delay() const { return delay_seconds_; }
    /// The second of the audio that the pose belongs to, and that is heard.
    double shown() const { return motion_.shown(); }
    /// The time of the motion that is shown.
    double time() const { return motion_.time(); }
    double heard(double now) const { return audio_.read(now).seconds - delay_seconds_ - settings_.output_latency; }
    umo_stats stats() const { return session_.stats(); }
    /// The skeleton with this session's place of rest.
    const SourceSkeleton &skeleton() const { return skeleton_; }

    Avatar(std::shared_ptr<Host> host, umo::session session, const Settings &settings, bool is_live, double delay_seconds);

private:
    void keep(const umo::frame &frame);
    void leave_mouth_to_jaw();
    umo_status note(umo_status status) noexcept;

    std::shared_ptr<Host> host_;
    umo::session session_;
    /// The same handle, for the audio thread: it stays when the session is freed, and is an error then.
    umo_session *const heard_;
    Settings settings_;
    SourceSkeleton skeleton_;
    bool is_live_;
    double delay_seconds_;
    Delay delay_;
    AudioClock audio_;
    MotionClock motion_;
    double game_time_ = 0;
    umo::frames frame_;
    Pose pose_;
    double frame_seconds_;
    double ease_seconds_;
    std::uint32_t idle_;
    std::atomic<bool> is_cut_{false};
    std::atomic<std::uint32_t> other_rate_{0};
    std::atomic<umo_status> failed_{UMO_STATUS_OK};
    bool is_told_ = false;
};

} // namespace umo_unreal
