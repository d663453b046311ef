// SPDX-License-Identifier: MIT OR Apache-2.0

#include "Avatar.h"

#include <algorithm>
#include <cmath>

namespace umo_unreal {

namespace {

/// A submix has at most the 8 channels of 7.1.
constexpr std::size_t most_channels = 8;
/// Frames mixed at a time: 2 KiB of the audio thread's stack.
constexpr std::size_t block_frames = 512;

std::string detail_of(umo_status status) { return explain(status, umo_last_error()); }

/// Statuses after which a session cannot be used any more.
bool is_final(umo_status status) {
    return status == UMO_STATUS_FAILED || status == UMO_STATUS_CLOSED || status == UMO_STATUS_PANIC;
}

} // namespace

std::string explain(umo_status status, const std::string &detail) {
    std::string text = umo_status_message(status);
    if (!detail.empty()) text += ": " + detail;
    return text;
}

std::shared_ptr<Host> Hosts::open(const std::string &path, const umo_engine_config &config, std::string &problem,
                                  const void *content, std::size_t size) {
    for (const auto &[known, host] : hosts_) {
        if (known == path) return host;
    }
    auto host = std::make_shared<Host>();
    auto model = content != nullptr ? umo::model::load(content, size) : umo::model::load(path.c_str());
    if (!model) {
        problem = detail_of(model.status);
        return nullptr;
    }
    host->model = std::move(*model);
    host->info = host->model.info();
    host->channels = host->model.channel_names();
    umo_status status = umo_model_get_skeleton(host->model.get(), UMO_AXES_UNREAL, host->skeleton.parents,
                                               host->skeleton.offsets, joint_count);
    host->skeleton.model = host->model.get();
    if (status == UMO_STATUS_OK) {
        auto engine = umo::engine::make(host->model, &config);
        status = engine.status;
        host->engine = std::move(*engine);
    }
    if (status != UMO_STATUS_OK) {
        problem = detail_of(status);
        return nullptr;
    }
    hosts_.emplace_back(path, host);
    return host;
}

bool Hosts::has(const std::string &path) const {
    return std::any_of(hosts_.begin(), hosts_.end(), [&](const auto &entry) { return entry.first == path; });
}

void Hosts::close_unused() {
    const auto unused = [](const auto &entry) { return entry.second.use_count() == 1; };
    hosts_.erase(std::remove_if(hosts_.begin(), hosts_.end(), unused), hosts_.end());
}

std::shared_ptr<Avatar> Avatar::make(std::shared_ptr<Host> host, const Settings &settings, std::string &problem) {
    umo_session_config config = umo::session::defaults(host->model);
    config.sample_rate = settings.sample_rate;
    config.channels = 1;
    if (settings.target != 0) config.target = settings.target;
    if (settings.lookahead >= 0) config.lookahead = static_cast<std::uint32_t>(settings.lookahead);
    config.idle = settings.idle;
    config.seed = settings.seed;
    if (settings.smoothing >= 0) config.smoothing = settings.smoothing;
    config.guidance = settings.guidance;
    config.horizon = settings.horizon;
    const bool is_live = settings.has_live_voice && !settings.delays_speech && host->info.has_mouth != 0;
    config.voice = is_live ? UMO_VOICE_LIVE : UMO_VOICE_DELAYED;
    // The engine is shared: its rules are set for each character, whose session keeps them.
    const umo_status ruled = host->engine.set_word_rules(settings.language.c_str(),
                                                         settings.word_rules.empty() ? nullptr : settings.word_rules.c_str());
    if (ruled != UMO_STATUS_OK) {
        problem = detail_of(ruled);
        return nullptr;
    }
    auto session = umo::session::make(host->engine, &config);
    if (!session) {
        problem = detail_of(session.status);
        return nullptr;
    }
    const umo_latency latency = session->latency();
    const double rate = settings.sample_rate;
    // The live mouth does not wait for computing; the output's latency is added when the sound is heard.
    const double delay = is_live ? std::max(static_cast<double>(latency.mouth_samples) / rate - settings.output_latency, 0.0)
                                 : static_cast<double>(latency.algorithmic_samples) / rate + settings.margin;
    auto avatar = std::make_shared<Avatar>(std::move(host), std::move(*session), settings, is_live, delay);
    avatar->ease_seconds_ = config.ease_ms / 1000.0;
    // Before there is any audio, show the rest pose.
    const auto rest = avatar->session_.sample(0, avatar->frame_);
    if (!rest) {
        problem = explain(rest.status, avatar->session_.last_error());
        return nullptr;
    }
    avatar->keep(avatar->frame_[0]);
    std::copy_n(avatar->pose_.translation, 3, avatar->skeleton_.rest_translation);
    return avatar;
}

Avatar::Avatar(std::shared_ptr<Host> host, umo::session session, const Settings &settings, bool is_live, double delay_seconds)
    : host_(std::move(host)), session_(std::move(session)), heard_(session_.get()), settings_(settings),
      skeleton_(host_->skeleton), is_live_(is_live), delay_seconds_(delay_seconds),
      delay_(settings.delays_speech ? static_cast<std::size_t>(std::lround(delay_seconds * settings.sample_rate)) : 0,
             most_channels),
      audio_(settings.sample_rate), motion_(host_->info.frame_rate), frame_(host_->model, 1, UMO_AXES_UNREAL),
      frame_seconds_(1.0 / host_->info.frame_rate), ease_seconds_(0), idle_(settings.idle) {
    pose_.channels.resize(host_->channels.size());
}

void Avatar::hear(float *samples, std::size_t frames, std::size_t channels, std::uint32_t rate, double now) noexcept {
    if (rate != settings_.sample_rate || channels == 0) {
        other_rate_.store(rate, std::memory_order_relaxed);
        return;
    }
    if (is_cut_.exchange(false, std::memory_order_acq_rel)) delay_.clear();
    float mixed[block_frames];
    std::size_t given = 0;
    for (std::size_t first = 0; first < frames; first += block_frames) {
        const std::size_t count = std::min(block_frames, frames - first);
        for (std::size_t i = 0; i < count; ++i) {
            float sum = 0;
            for (std::size_t channel = 0; channel < channels; ++channel) sum += samples[(first + i) * channels + channel];
            mixed[i] = sum / static_cast<float>(channels);
        }
        std::size_t taken = 0;
        // The library drops and counts samples that do not fit: the engine is ten seconds behind.
        if (note(umo_session_push_audio(heard_, mixed, count, &taken)) == UMO_STATUS_OK) given += taken;
    }
    audio_.advance(given, now);
    delay_.run(samples, frames * channels, channels);
}

umo_status Avatar::show(double step, double now, double game_step) {
    game_time_ += std::max(game_step, 0.0);
    const umo_status told = shown_session().set_clock(game_time_);
    if (told != UMO_STATUS_OK) return note(told);
    if (player_) return show_take(step);
    const AudioClock::Reading reading = audio_.read(now);
    const double heard = reading.seconds - delay_seconds_ - settings_.output_latency;
    // Without audio, idle modes must be sampled beyond the newest frame.
    const bool rests = reading.is_quiet && idle_ == UMO_IDLE_REST;
    const double time = motion_.next(step, heard, reading.is_quiet, frame_seconds_ + (rests ? ease_seconds_ : 0));
    const auto found = session_.sample(time, frame_);
    // A failed session returns its last pose; the failure is reported elsewhere.
    if (!found) return note(found.status);
    keep(frame_[0]);
    motion_.found(pose_.index, static_cast<double>(frame_[0].sample()) / settings_.sample_rate, found->newest);
    return UMO_STATUS_OK;
}

umo_status Avatar::play_take(const void *bytes, std::size_t size, std::string &problem) {
    auto take = umo::take::read(bytes, size);
    if (!take) {
        problem = detail_of(take.status);
        return take.status;
    }
    umo_session_config config = umo::session::defaults(host_->model);
    config.idle = idle_;
    auto player = umo::session::player(host_->model, *take, &config);
    if (!player) {
        problem = detail_of(player.status);
        return player.status;
    }
    player_ = std::move(*player);
    take_time_ = -settings_.output_latency;
    return UMO_STATUS_OK;
}

void Avatar::stop_take() { player_.reset(); }

bool Avatar::plays_take() { return player_ && !player_.is_done().value; }

umo_status Avatar::show_take(double step) {
    // Two seconds are kept ready. A packet has a frame or more, but for the first ones.
    const std::uint32_t ahead = 2 * host_->info.frame_rate;
    for (std::uint32_t i = 0; i < ahead && player_.ready().value < ahead; ++i) {
        const auto pushed = player_.push_take();
        if (!pushed) return note(pushed.status);
        if (!*pushed) break;
    }
    const auto found = player_.sample(std::max(take_time_, 0.0), frame_);
    if (!found) return note(found.status);
    keep(frame_[0]);
    take_time_ += std::max(step, 0.0);
    return UMO_STATUS_OK;
}

void Avatar::keep(const umo::frame &frame) {
    pose_.index = frame.index();
    std::copy_n(frame.translation(), 3, pose_.translation);
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        std::copy_n(frame.rotation(joint), 4, pose_.rotations + 4 * joint);
    }
    std::copy_n(frame.channels(), pose_.channels.size(), pose_.channels.begin());
    if (!settings_.has_mouth_close) leave_mouth_to_jaw();
}

void Avatar::leave_mouth_to_jaw() {
    const auto channel = [this](const char *name) -> float * {
        const auto found = std::find(host_->channels.begin(), host_->channels.end(), name);
        return found == host_->channels.end() ? nullptr : &pose_.channels[static_cast<std::size_t>(found - host_->channels.begin())];
    };
    float *close = channel("mouthClose"), *jaw = channel("jawOpen");
    if (close == nullptr || jaw == nullptr) return;
    *jaw = std::max(*jaw - *close, 0.0F);
    *close = 0;
}

umo_status Avatar::interrupt(std::uint32_t ease_ms) {
    const umo_status status = session_.interrupt(ease_ms);
    if (status == UMO_STATUS_OK) is_cut_.store(true, std::memory_order_release);
    return note(status);
}

umo_status Avatar::set(std::uint32_t parameter, double value) {
    const umo_status status = note(session_.set(parameter, value));
    return player_ && status == UMO_STATUS_OK ? note(player_.set(parameter, value)) : status;
}

umo_status Avatar::set_idle(std::uint32_t idle) {
    const umo_status status = set(UMO_PARAMETER_IDLE, idle);
    if (status == UMO_STATUS_OK) idle_ = idle;
    return status;
}

umo_status Avatar::look_at(const std::array<float, 3> &point, float strength) {
    return note(shown_session().look_at(point, strength, UMO_AXES_UNREAL));
}

umo_status Avatar::play_gesture(const std::string &name, std::uint32_t side, float strength, std::uint32_t variant,
                                const std::array<float, 3> *target) {
    umo_gesture_options options = umo::session::gesture_defaults();
    options.side = side;
    options.strength = strength;
    options.variant = variant;
    if (target != nullptr) {
        options.axes = UMO_AXES_UNREAL;
        options.has_target = 1;
        std::copy(target->begin(), target->end(), options.target);
    }
    return note(shown_session().play_gesture(name.c_str(), &options));
}

void Avatar::close() {
    player_.reset();
    session_.reset();
    host_.reset();
}

/// Records whether the session is lost.
umo_status Avatar::note(umo_status status) noexcept {
    if (is_final(status)) failed_.store(status, std::memory_order_relaxed);
    return status;
}

std::string Avatar::failure() {
    const umo_status status = failed_.load(std::memory_order_relaxed);
    if (status == UMO_STATUS_OK || is_told_) return "";
    is_told_ = true;
    return explain(status, session_.last_error());
}

} // namespace umo_unreal
