// One speaking character: a library session, the audio on its way to it, and the pose that belongs to the sound being
// heard.
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

/// A model and its engine, shared by all characters of a process.
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
    /// Closes hosts that no character uses.
    void close_unused();
    bool has(const std::string &path) const;
    std::size_t count() const { return hosts_.size(); }

private:
    std::vector<std::pair<std::string, std::shared_ptr<Host>>> hosts_;
};

/// Settings of a character.
struct Settings {
    std::uint32_t sample_rate = 48000;
    /// Keyframes per chunk, 0 for the model's default.
    std::uint32_t target = 0;
    /// Frames held back for smoother seams, below 0 for the model's default.
    std::int32_t lookahead = -1;
    /// `UMO_IDLE_…`
    std::uint32_t idle = UMO_IDLE_LIVE;
    std::uint64_t seed = 0;
    /// Low-pass filter of the body's motion, standard deviation in frames; below 0 for the default.
    float smoothing = -1;
    /// Guidance strength of the prompt, 1 to 3.
    float guidance = 1;
    /// Keyframes of future speech to use.
    std::uint32_t horizon = 0;
    /// Time reserved for computing in seconds, in addition to the audio that frames need.
    double margin = 0.2;
    /// Seconds from a buffer's callback to the loudspeaker.
    double output_latency = 0.04;
    /// Whether speech is delayed until its motion is ready.
    bool delays_speech = true;
    /// Whether the mouth moves with undelayed speech, if the model has a mouth network; the body follows later.
    bool has_live_voice = true;
    /// Whether `mouthClose` is output. If not, it is 0 and subtracted from `jawOpen`.
    bool has_mouth_close = true;
    /// Language of the words of `hint_words`.
    std::string language = "en";
    /// Word rules of one's own in TOML, added to the language's.
    std::string word_rules;
};

/// A frame for the animation threads.
struct Pose {
    std::uint64_t index = 0;
    float translation[3] = {};
    float rotations[4 * joint_count] = {};
    std::vector<float> channels;
};

/// Describes a status of the library to the user.
std::string explain(umo_status status, const std::string &detail);

class Avatar {
public:
    /// Null on failure: `problem` says why.
    static std::shared_ptr<Avatar> make(std::shared_ptr<Host> host, const Settings &settings, std::string &problem);

    /// Audio thread: takes `frames` of interleaved speech, passes them to the library, and replaces them with the
    /// speech to be heard now. Never allocates or waits. `now` is on the same clock as for `show`.
    void hear(float *samples, std::size_t frames, std::size_t channels, std::uint32_t rate, double now) noexcept;

    /// Game thread: the pose at `now`, `step` seconds after the last. Motion without speech advances by `game_step`,
    /// the game's time: a film renders slower than it plays, and a game can pause. Never allocates or waits.
    umo_status show(double step, double now, double game_step);
    umo_status show(double step, double now) { return show(step, now, step); }
    const Pose &pose() const { return pose_; }

    /// Game thread. Shows a take of the same model, the bytes of a `.umo` file, from the next `show` on, which passes its
    /// time; its sound is the caller's to begin. After its end the avatar idles, until `stop_take`. Looks, moods, gestures
    /// and parameters are the take's meanwhile. `problem` says why it cannot be played.
    umo_status play_take(const void *bytes, std::size_t size, std::string &problem);
    /// Game thread. Shows the avatar's own motion again.
    void stop_take();
    /// Game thread. Whether a take is shown that has not ended.
    bool plays_take();
    /// Game thread. Drops speech and motion that were not shown yet.
    umo_status interrupt(std::uint32_t ease_ms);
    /// Game thread.
    umo_status set_prompt(const std::string &text) { return session_.set_prompt(text); }
    umo_status set(std::uint32_t parameter, double value);
    umo_status set_idle(std::uint32_t idle);
    /// Game thread. A point in the avatar's space: centimetres, X forward, Y to its right, Z up from the floor.
    umo_status look_at(const std::array<float, 3> &point, float strength);
    /// Game thread. `UMO_MOOD_…`
    umo_status set_mood(std::uint32_t mood, float strength) { return note(shown_session().set_mood(mood, strength)); }
    /// Game thread: schedules a lip shape `UMO_LIPS_…` for a sound, in seconds of the audio given to `hear`. `BUSY` if
    /// 64 are queued.
    umo_status hint_lips(std::uint32_t shape, double start, double duration) {
        return note(session_.hint_lips(shape, start, duration));
    }
    /// Game thread: gives a word and its time, on the clock of `hint_lips`. `BUSY` if 64 are queued.
    umo_status hint_words(const std::string &text, double start, double end) {
        return note(session_.hint_words(text.c_str(), start, end));
    }
    /// Seconds of audio given to `hear` up to `now`.
    double given(double now) const noexcept { return audio_.read(now).seconds; }
    /// Game thread: plays a gesture by name. `target` is a point as for `look_at`, null for none.
    umo_status play_gesture(const std::string &name, std::uint32_t side, float strength, std::uint32_t variant,
                            const std::array<float, 3> *target);
    /// Adds a custom gesture for avatars of the same model created from now on: see `umo_engine_add_gesture_file`.
    umo_status add_gesture(const std::string &name, const std::string &path, const std::string &animation, std::uint32_t parts,
                           float stroke) {
        return host_->engine.add_gesture_file(name.c_str(), path.c_str(), animation.empty() ? nullptr : animation.c_str(), parts,
                                              stroke);
    }
    std::vector<std::string> gesture_names() const { return host_->engine.gesture_names(); }
    /// Any one thread: the interlocutor's audio, mono, at the settings' rate. Never allocates or waits.
    umo_status push_other_audio(const float *samples, std::size_t count) noexcept {
        return note(umo_session_push_other_audio(heard_, samples, count));
    }
    /// Game thread: frees the session and releases the host whatever the audio thread is doing, so that the audio
    /// thread never has to free anything. No more frames follow.
    void close();

    /// Reason why no more frames arrive, returned once; otherwise empty.
    std::string failure();
    /// The detail of the last failed call.
    std::string last_error() const { return (player_ ? player_ : session_).last_error(); }
    /// Sample rate of audio that did not match the settings' rate; 0 if all did.
    std::uint32_t other_rate() const { return other_rate_.load(std::memory_order_relaxed); }
    /// Whether the mouth moves with the sound.
    bool is_live() const { return is_live_; }
    /// Seconds from a sound's callback to the loudspeaker and the motion, without the output's latency. With the live
    /// voice, to the mouth's motion only.
    double delay() const { return delay_seconds_; }
    /// Second of the audio that the pose belongs to and that is being heard.
    double shown() const { return motion_.shown(); }
    /// Motion time being shown.
    double time() const { return motion_.time(); }
    double heard(double now) const { return audio_.read(now).seconds - delay_seconds_ - settings_.output_latency; }
    umo_stats stats() const { return session_.stats(); }
    /// Game thread: arousal of the voice that is shown.
    float arousal() { return shown_session().arousal().value.arousal; }
    /// Game thread: its change per second.
    float arousal_trend() { return shown_session().arousal().value.trend; }
    /// The skeleton with this session's rest position.
    const SourceSkeleton &skeleton() const { return skeleton_; }

    Avatar(std::shared_ptr<Host> host, umo::session session, const Settings &settings, bool is_live, double delay_seconds);

private:
    friend class Scene;

    umo_status show_take(double step);
    umo::session &shown_session() { return player_ ? player_ : session_; }
    void keep(const umo::frame &frame);
    void leave_mouth_to_jaw();
    umo_status note(umo_status status) noexcept;

    std::shared_ptr<Host> host_;
    umo::session session_;
    /// The take that is shown, if any, and its time.
    umo::session player_;
    double take_time_ = 0;
    /// The same handle for the audio thread: it remains after the session is freed, and calls then return an error.
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
