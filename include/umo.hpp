/*
 * umo for C++17: what umo.h declares, freed by itself. Header only, needs no exceptions, adds no logic.
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 *     auto model = umo::model::load("umo-people.safetensors");
 *     if (!model) return std::fputs(umo_last_error(), stderr), 1;
 *     auto engine = umo::engine::make(*model);
 *     auto avatar = umo::session::make(*engine);
 *     umo::frames frames(*model, 64);
 *     avatar->push_audio(samples, count);                         // the audio thread
 *     auto pulled = avatar->pull(frames);                         // the game thread
 *     for (std::size_t i = 0; i < pulled.value; ++i) draw(frames[i].rotation(0), frames[i].channels());
 */

#ifndef UMO_HPP
#define UMO_HPP

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "umo.h"

namespace umo {

/// Result of a call: a value if `status` is `UMO_STATUS_OK`.
template <class T> struct [[nodiscard]] result {
    umo_status status = UMO_STATUS_OK;
    T value{};

    explicit operator bool() const noexcept { return status == UMO_STATUS_OK; }
    T &operator*() noexcept { return value; }
    const T &operator*() const noexcept { return value; }
    T *operator->() noexcept { return &value; }
    const T *operator->() const noexcept { return &value; }
    const char *message() const noexcept { return umo_status_message(status); }
};

namespace detail {

/// A handle that is freed exactly once. A free that fails because another thread is in a call is retried after that
/// call.
template <class T, umo_status (*Free)(T *)> class handle {
public:
    handle() noexcept = default;
    explicit handle(T *raw) noexcept : raw_(raw) {}
    handle(handle &&other) noexcept : raw_(std::exchange(other.raw_, nullptr)) {}
    handle &operator=(handle &&other) noexcept {
        if (this != &other) {
            reset();
            raw_ = std::exchange(other.raw_, nullptr);
        }
        return *this;
    }
    handle(const handle &) = delete;
    handle &operator=(const handle &) = delete;
    ~handle() { reset(); }

    T *get() const noexcept { return raw_; }
    explicit operator bool() const noexcept { return raw_ != nullptr; }
    /// Releases ownership of the handle: the caller frees it.
    T *release() noexcept { return std::exchange(raw_, nullptr); }
    void reset() noexcept {
        while (Free(raw_) == UMO_STATUS_BUSY) std::this_thread::yield();
        raw_ = nullptr;
    }

private:
    T *raw_ = nullptr;
};

// umo.h's functions may be noexcept, which is part of a function's type; these wrappers are not.
inline umo_status free_model(umo_model *raw) { return umo_model_free(raw); }
inline umo_status free_engine(umo_engine *raw) { return umo_engine_free(raw); }
inline umo_status free_session(umo_session *raw) { return umo_session_free(raw); }
inline umo_status free_take(umo_take *raw) { return umo_take_free(raw); }
inline umo_status free_scene(umo_scene *raw) { return umo_scene_free(raw); }
inline umo_status free_retarget(umo_retarget *raw) { return umo_retarget_free(raw); }

} // namespace detail

/// A model: see `umo_model_…`.
class model : public detail::handle<umo_model, detail::free_model> {
public:
    using handle::handle;

    static umo_model_config defaults() noexcept {
        umo_model_config config{};
        (void)!umo_model_config_init(&config, sizeof config);
        return config;
    }
    static result<model> load(const char *path, const umo_model_config *config = nullptr) {
        umo_model *raw = nullptr;
        const umo_status status = umo_model_load(UMO_ABI_VERSION, path, config, &raw);
        return {status, model(raw)};
    }
    static result<model> load(const void *data, std::size_t size, const umo_model_config *config = nullptr) {
        umo_model *raw = nullptr;
        const umo_status status = umo_model_load_memory(UMO_ABI_VERSION, data, size, config, &raw);
        return {status, model(raw)};
    }

    umo_model_info info() const noexcept {
        umo_model_info info{};
        info.struct_size = sizeof info;
        (void)!umo_model_get_info(get(), &info);
        return info;
    }
    /// One of `UMO_MODEL_…`; empty for any other.
    std::string text(std::uint32_t which) const {
        const char *text = nullptr;
        return umo_model_get_text(get(), which, &text) == UMO_STATUS_OK ? text : "";
    }
    std::vector<std::string> channel_names() const {
        std::vector<std::string> names;
        const std::uint32_t count = info().channels;
        for (std::uint32_t i = 0; i < count; ++i) {
            const char *name = nullptr;
            if (umo_model_get_channel_name(get(), i, &name) == UMO_STATUS_OK) names.emplace_back(name);
        }
        return names;
    }
    /// Whether all checks of this machine passed; `report` is a text that is safe to publish. Takes about 10 seconds or
    /// less.
    result<bool> self_test(std::string &report) const {
        std::uint32_t passed = 0;
        report.assign(UMO_SELF_TEST_SIZE, '\0');
        const umo_status status = umo_self_test(get(), &passed, &report[0], report.size());
        report.resize(report.find('\0'));
        return {status, passed != 0};
    }
    umo_frame_layout layout() const noexcept {
        umo_frame_layout layout{};
        (void)!umo_frame_layout_init(&layout, sizeof layout, get());
        return layout;
    }
};

/// An engine: see `umo_engine_…`.
class engine : public detail::handle<umo_engine, detail::free_engine> {
public:
    using handle::handle;

    static umo_engine_config defaults() noexcept {
        umo_engine_config config{};
        (void)!umo_engine_config_init(&config, sizeof config);
        return config;
    }
    static result<engine> make(const model &model, const umo_engine_config *config = nullptr) {
        umo_engine *raw = nullptr;
        const umo_status status = umo_engine_new(model.get(), config, &raw);
        return {status, engine(raw)};
    }
    /// Holds bodies still, in turn, while chunks start more than `seconds` late; a negative number turns this off.
    [[nodiscard]] umo_status set_late_limit(double seconds) noexcept { return umo_engine_set_late_limit(get(), seconds); }

    /// The value says whether there is more work.
    result<bool> poll(std::uint32_t budget_us) noexcept {
        std::uint32_t more = 0;
        const umo_status status = umo_engine_poll(get(), budget_us, &more);
        return {status, more != 0};
    }

    static umo_gesture_clip clip_defaults() noexcept {
        umo_gesture_clip clip{};
        (void)!umo_gesture_clip_init(&clip, sizeof clip);
        return clip;
    }
    /// Adds a custom gesture for sessions created from now on.
    [[nodiscard]] umo_status add_gesture(const char *name, const umo_gesture_clip &clip) {
        return umo_engine_add_gesture(get(), name, &clip);
    }
    /// As `add_gesture`, from the animation in a `.glb` or `.vrm` file of any humanoid character: the named one, or the
    /// first. A negative stroke time means the middle.
    [[nodiscard]] umo_status add_gesture_file(const char *name, const char *path, const char *animation = nullptr,
                                              std::uint32_t parts = UMO_GESTURE_HEAD | UMO_GESTURE_TRUNK |
                                                                    UMO_GESTURE_LEFT_ARM | UMO_GESTURE_RIGHT_ARM,
                                              float stroke = -1) {
        return umo_engine_add_gesture_file(get(), name, path, animation, parts, stroke);
    }
    /// As `add_gesture_file`, from the bytes of a file.
    [[nodiscard]] umo_status add_gesture_memory(const char *name, const void *data, std::size_t size,
                                                const char *animation = nullptr,
                                                std::uint32_t parts = UMO_GESTURE_HEAD | UMO_GESTURE_TRUNK |
                                                                      UMO_GESTURE_LEFT_ARM | UMO_GESTURE_RIGHT_ARM,
                                                float stroke = -1) {
        return umo_engine_add_gesture_memory(get(), name, data, size, animation, parts, stroke);
    }
    /// Rules of words for sessions created later: of a language (`"en"`, `"de"`), and a file's text to add.
    [[nodiscard]] umo_status set_word_rules(const char *language, const char *toml = nullptr) {
        return umo_engine_set_word_rules(get(), language, toml);
    }
    /// Names of the gestures available to sessions created now.
    std::vector<std::string> gesture_names() const {
        std::vector<std::string> names;
        const char *name = nullptr;
        while (umo_engine_get_gesture_name(get(), static_cast<std::uint32_t>(names.size()), &name) == UMO_STATUS_OK) {
            names.emplace_back(name);
        }
        return names;
    }
};

/// One frame of `frames`.
class frame {
public:
    frame(const umo_frame_layout &layout, const unsigned char *bytes) noexcept : layout_(&layout), bytes_(bytes) {}

    std::uint64_t index() const noexcept { return *at<std::uint64_t>(layout_->index); }
    std::uint64_t sample() const noexcept { return *at<std::uint64_t>(layout_->sample); }
    /// x y z
    const float *translation() const noexcept { return at<float>(layout_->translation); }
    /// x y z w, relative to the joint's parent
    const float *rotation(std::size_t joint) const noexcept {
        return at<float>(layout_->rotations + static_cast<std::uint32_t>(joint) * layout_->rotation_stride);
    }
    const float *channels() const noexcept { return at<float>(layout_->channels); }
    /// Null if the model has no ARKit channels.
    const float *visemes() const noexcept {
        return layout_->visemes == UMO_ABSENT ? nullptr : at<float>(layout_->visemes);
    }

private:
    template <class T> const T *at(std::uint32_t offset) const noexcept {
        return reinterpret_cast<const T *>(bytes_ + offset);
    }
    const umo_frame_layout *layout_;
    const unsigned char *bytes_;
};

/// Buffer for tightly packed frames in the requested axes.
class frames {
public:
    frames(const model &model, std::size_t capacity, std::uint32_t axes = UMO_AXES_GLTF)
        : layout_(model.layout()), words_(capacity * layout_.frame_stride / sizeof(std::uint64_t)) {
        layout_.axes = axes;
    }

    frame operator[](std::size_t i) const noexcept {
        return {layout_, reinterpret_cast<const unsigned char *>(words_.data()) + i * layout_.frame_stride};
    }
    const umo_frame_layout &layout() const noexcept { return layout_; }
    void *data() noexcept { return words_.data(); }
    const void *data() const noexcept { return words_.data(); }
    /// Size in bytes.
    std::size_t size() const noexcept { return words_.size() * sizeof(std::uint64_t); }

private:
    umo_frame_layout layout_;
    // Aligned for every value of a frame.
    std::vector<std::uint64_t> words_;
};

/// Arousal of a voice, and its change per second.
struct voice_arousal {
    float arousal = 0.5F;
    float trend = 0.0F;
};

/// A take: a motion that was recorded.
class take : public detail::handle<umo_take, detail::free_take> {
public:
    using handle::handle;

    static result<take> read(const void *bytes, std::size_t size) {
        umo_take *raw = nullptr;
        const umo_status status = umo_take_new(bytes, size, &raw);
        return {status, take(raw)};
    }
    result<umo_take_info> info() const noexcept {
        umo_take_info info{};
        info.struct_size = sizeof info;
        const umo_status status = umo_take_get_info(get(), &info);
        return {status, info};
    }
};

/// A session: see `umo_session_…` for the thread that may make each call.
class session : public detail::handle<umo_session, detail::free_session> {
public:
    using handle::handle;

    static umo_session_config defaults(const model &model) noexcept {
        umo_session_config config{};
        (void)!umo_session_config_init(&config, sizeof config, model.get());
        return config;
    }
    static result<session> make(engine &engine, const umo_session_config *config = nullptr) {
        umo_session *raw = nullptr;
        const umo_status status = umo_session_new(engine.get(), config, &raw);
        return {status, session(raw)};
    }

    /// An avatar that is animated by received packets: it needs no engine.
    static result<session> decoder(const model &model, const umo_session_config *config = nullptr) {
        umo_session *raw = nullptr;
        const umo_status status = umo_decoder_new(model.get(), config, &raw);
        return {status, session(raw)};
    }
    [[nodiscard]] umo_status push_packet(const void *packet, std::size_t size) noexcept {
        return umo_decoder_push_packet(get(), packet, size);
    }
    /// An avatar that plays a take.
    static result<session> player(const model &model, const take &take, const umo_session_config *config = nullptr) {
        umo_session *raw = nullptr;
        const umo_status status = umo_decoder_new_of_take(model.get(), take.get(), config, &raw);
        return {status, session(raw)};
    }
    /// Whether there may be more packets of the take.
    result<bool> push_take() noexcept {
        std::uint32_t more = 0;
        const umo_status status = umo_decoder_push_take(get(), &more);
        return {status, more != 0};
    }
    /// The take that the session, whose configuration has `take_bytes`, has recorded so far.
    result<std::vector<unsigned char>> recorded() {
        std::size_t size = 0;
        umo_status status = umo_session_take_size(get(), &size);
        std::vector<unsigned char> bytes(size);
        if (status == UMO_STATUS_OK) {
            status = umo_session_take(get(), bytes.data(), bytes.size(), &size);
            bytes.resize(size);
        }
        return {status, std::move(bytes)};
    }
    /// Statistics of its packets.
    result<umo_received> received() noexcept {
        umo_received stats{};
        stats.struct_size = sizeof stats;
        const umo_status status = umo_decoder_stats(get(), &stats);
        return {status, stats};
    }
    /// Maximum packet size in bytes; 0 without packets.
    result<std::size_t> packet_size() noexcept {
        std::size_t size = 0;
        const umo_status status = umo_session_packet_size(get(), &size);
        return {status, size};
    }
    /// Number of packets pulled: back to back in `bytes`, the length of each in `lengths`.
    result<std::size_t> pull_packets(void *bytes, std::size_t size, std::size_t *lengths, std::size_t most) noexcept {
        std::size_t count = 0;
        const umo_status status = umo_session_pull_packets(get(), bytes, size, lengths, most, &count);
        return {status, count};
    }

    /// Number of samples taken.
    result<std::size_t> push_audio(const float *samples, std::size_t count) noexcept {
        std::size_t taken = 0;
        const umo_status status = umo_session_push_audio(get(), samples, count, &taken);
        return {status, taken};
    }
    result<std::size_t> push_audio(const std::int16_t *samples, std::size_t count) noexcept {
        std::size_t taken = 0;
        const umo_status status = umo_session_push_audio_i16(get(), samples, count, &taken);
        return {status, taken};
    }
    /// Feeds the interlocutor's audio, so that the avatar listens.
    [[nodiscard]] umo_status push_other_audio(const float *samples, std::size_t count) noexcept {
        return umo_session_push_other_audio(get(), samples, count);
    }
    [[nodiscard]] umo_status finish() noexcept { return umo_session_finish(get()); }
    [[nodiscard]] umo_status interrupt(std::uint32_t ease_ms) noexcept { return umo_session_interrupt(get(), ease_ms); }
    [[nodiscard]] umo_status reset_stream() noexcept { return umo_session_reset(get()); }

    /// Number of frames pulled.
    result<std::size_t> pull(frames &frames) noexcept {
        std::size_t count = 0;
        const umo_status status = umo_session_pull_frames(get(), &frames.layout(), frames.data(), frames.size(), &count);
        return {status, count};
    }
    result<std::size_t> ready() noexcept {
        std::size_t count = 0;
        const umo_status status = umo_session_ready_frames(get(), &count);
        return {status, count};
    }
    /// Arousal of the voice at the newest frame pulled or sampled, 0 to 1, 0.5 for an ordinary voice and for none; and its
    /// change per second.
    result<voice_arousal> arousal() noexcept {
        voice_arousal heard;
        const umo_status status = umo_session_arousal(get(), &heard.arousal, &heard.trend);
        return {status, heard};
    }
    /// Whether the stream has ended and all frames were pulled.
    result<bool> is_done() noexcept {
        std::uint32_t done = 0;
        const umo_status status = umo_session_is_done(get(), &done);
        return {status, done != 0};
    }
    /// Sets the host's time in seconds. Layers and easing follow it while no frames arrive.
    [[nodiscard]] umo_status set_clock(double seconds) noexcept { return umo_session_set_clock(get(), seconds); }
    /// The pose at a motion time, in the first of `frames`.
    result<umo_sampled> sample(double seconds, frames &frames) noexcept {
        umo_sampled sampled{};
        sampled.struct_size = sizeof sampled;
        const umo_status status =
            umo_session_sample_pose(get(), seconds, &frames.layout(), frames.data(), frames.size(), &sampled);
        return {status, sampled};
    }

    [[nodiscard]] umo_status set_prompt(std::string_view text) noexcept {
        return umo_session_set_prompt(get(), text.data(), text.size());
    }
    [[nodiscard]] umo_status set_seed(std::uint64_t seed) noexcept { return umo_session_set_seed(get(), seed); }
    /// Looks at a point in the avatar's space; a strength of 0 stops it.
    [[nodiscard]] umo_status look_at(const std::array<float, 3> &point, float strength = 1,
                                     std::uint32_t axes = UMO_AXES_GLTF) noexcept {
        return umo_session_look_at(get(), axes, point.data(), strength);
    }
    /// `UMO_MOOD_…`
    [[nodiscard]] umo_status set_mood(std::uint32_t mood, float strength = 1) noexcept {
        return umo_session_set_mood(get(), mood, strength);
    }
    /// `UMO_LIPS_…`
    [[nodiscard]] umo_status hint_lips(std::uint32_t shape, double start, double duration) noexcept {
        return umo_session_hint_lips(get(), shape, start, duration);
    }
    /// A word, or several that share the time by their syllables.
    [[nodiscard]] umo_status hint_words(const char *text, double start, double end) noexcept {
        return umo_session_hint_words(get(), text, start, end);
    }
    static umo_gesture_options gesture_defaults() noexcept {
        umo_gesture_options options{};
        (void)!umo_gesture_options_init(&options, sizeof options);
        return options;
    }
    /// One of `engine::gesture_names`; as soon as possible and at normal speed by default.
    [[nodiscard]] umo_status play_gesture(const char *name, const umo_gesture_options *options = nullptr) noexcept {
        return umo_session_play_gesture(get(), name, options);
    }
    [[nodiscard]] umo_status set(std::uint32_t parameter, double value) noexcept {
        return umo_session_set_parameter(get(), parameter, value);
    }
    result<double> parameter(std::uint32_t parameter) const noexcept {
        double value = 0;
        const umo_status status = umo_session_get_parameter(get(), parameter, &value);
        return {status, value};
    }

    /// The complete state of the session; empty if it cannot be saved now.
    result<std::vector<unsigned char>> save() {
        std::size_t size = 0;
        umo_status status = umo_session_state_size(get(), &size);
        std::vector<unsigned char> state(size);
        if (status == UMO_STATUS_OK) status = umo_session_save(get(), state.data(), state.size(), &size);
        state.resize(status == UMO_STATUS_OK ? size : 0);
        return {status, std::move(state)};
    }
    [[nodiscard]] umo_status restore(const std::vector<unsigned char> &state) noexcept {
        return umo_session_restore(get(), state.data(), state.size());
    }

    umo_latency latency() const noexcept {
        umo_latency latency{};
        latency.struct_size = sizeof latency;
        (void)!umo_session_latency(get(), &latency);
        return latency;
    }
    umo_stats stats() const noexcept {
        umo_stats stats{};
        stats.struct_size = sizeof stats;
        (void)!umo_session_stats(get(), &stats);
        return stats;
    }
    /// Detail of the last failed call.
    std::string last_error() const {
        char text[UMO_ERROR_SIZE] = "";
        return umo_session_last_error(get(), text, sizeof text, nullptr) == UMO_STATUS_OK ? text : "";
    }
};

/// A place of a scene, in the axes of glTF unless said otherwise.
inline umo_place place(const std::array<float, 3> &position, float facing = 0, float eye_height = 1.6F,
                       std::uint32_t axes = UMO_AXES_GLTF) noexcept {
    umo_place place{};
    (void)!umo_place_init(&place, sizeof place);
    for (std::size_t axis = 0; axis < 3; ++axis) place.position[axis] = position[axis];
    place.facing = facing;
    place.eye_height = eye_height;
    place.axes = axes;
    return place;
}

/// Avatars that know each other: see `umo_scene_…`.
class scene : public detail::handle<umo_scene, detail::free_scene> {
public:
    using handle::handle;

    static result<scene> make(std::uint64_t seed = 0) {
        umo_scene *raw = nullptr;
        const umo_status status = umo_scene_new(seed, &raw);
        return {status, scene(raw)};
    }

    /// Number of the member. The session may be freed at any time: then it leaves.
    result<std::uint32_t> add(session &session, const umo_place &place) noexcept {
        std::uint32_t member = 0;
        const umo_status status = umo_scene_add(get(), session.get(), &place, &member);
        return {status, member};
    }
    /// Adds a person, who speaks by `push_audio`.
    result<std::uint32_t> add(const umo_place &place) noexcept {
        std::uint32_t member = 0;
        const umo_status status = umo_scene_add(get(), nullptr, &place, &member);
        return {status, member};
    }
    [[nodiscard]] umo_status remove(std::uint32_t member) noexcept { return umo_scene_remove(get(), member); }
    [[nodiscard]] umo_status set_place(std::uint32_t member, const umo_place &place) noexcept {
        return umo_scene_set_place(get(), member, &place);
    }
    /// Looks at another member, whatever is said; 0: as the scene chooses.
    [[nodiscard]] umo_status set_target(std::uint32_t member, std::uint32_t other) noexcept {
        return umo_scene_set_target(get(), member, other, UMO_AXES_GLTF, nullptr);
    }
    /// Looks at a point of the scene.
    [[nodiscard]] umo_status set_target(std::uint32_t member, const std::array<float, 3> &point,
                                        std::uint32_t axes = UMO_AXES_GLTF) noexcept {
        return umo_scene_set_target(get(), member, 0, axes, point.data());
    }
    /// Parts that the scene plays: a sum of `UMO_SCENE_…`.
    [[nodiscard]] umo_status set_allowed(std::uint32_t member, std::uint32_t parts) noexcept {
        return umo_scene_set_allowed(get(), member, parts);
    }
    /// The voice of a member without a body.
    [[nodiscard]] umo_status push_audio(std::uint32_t member, const float *samples, std::size_t count) noexcept {
        return umo_scene_push_audio(get(), member, samples, count);
    }
    /// Once per picture, before frames are pulled or sampled.
    [[nodiscard]] umo_status update(double seconds) noexcept { return umo_scene_update(get(), seconds); }
    /// The member that has the floor, or 0.
    result<std::uint32_t> floor() const noexcept {
        std::uint32_t member = 0;
        const umo_status status = umo_scene_floor(get(), &member);
        return {status, member};
    }
    /// What a member does now.
    result<umo_member> member(std::uint32_t member) const noexcept {
        umo_member info{};
        info.struct_size = sizeof info;
        const umo_status status = umo_scene_member(get(), member, &info);
        return {status, info};
    }

    /// The state of the scene and of its members' sessions; empty if it cannot be saved now.
    result<std::vector<unsigned char>> save() {
        std::size_t size = 0;
        umo_status status = umo_scene_state_size(get(), &size);
        std::vector<unsigned char> state(size);
        if (status == UMO_STATUS_OK) status = umo_scene_save(get(), state.data(), state.size(), &size);
        state.resize(status == UMO_STATUS_OK ? size : 0);
        return {status, std::move(state)};
    }
    [[nodiscard]] umo_status restore(const std::vector<unsigned char> &state) noexcept {
        return umo_scene_restore(get(), state.data(), state.size());
    }
    /// Detail of the last failed call.
    std::string last_error() const {
        char text[UMO_ERROR_SIZE] = "";
        return umo_scene_last_error(get(), text, sizeof text, nullptr) == UMO_STATUS_OK ? text : "";
    }
};

/// A character that poses are put on: see `umo_retarget_…`.
class retarget : public detail::handle<umo_retarget, detail::free_retarget> {
public:
    retarget() noexcept = default;
    /// A handle of a character of so many bones.
    retarget(umo_retarget *raw, std::uint32_t bones) noexcept : handle(raw), bones_(bones) {}

    static umo_rig defaults() noexcept {
        umo_rig rig{};
        (void)!umo_rig_init(&rig, sizeof rig);
        return rig;
    }
    static result<retarget> make(const model &model, const umo_rig &rig) {
        umo_retarget *raw = nullptr;
        const umo_status status = umo_retarget_new(model.get(), &rig, &raw);
        return {status, retarget(raw, rig.bone_count)};
    }

    std::uint32_t bones() const noexcept { return bones_; }
    /// Joint that each bone follows, -1 for a bone that keeps its rest rotation.
    std::vector<std::int32_t> joints() const {
        std::vector<std::int32_t> joints(bones_);
        (void)!umo_retarget_get_joints(get(), bones_, joints.data());
        return joints;
    }
    /// Seconds from the last pose to the next; 1/30 at first.
    [[nodiscard]] umo_status set_step(float seconds) noexcept { return umo_retarget_set_step(get(), seconds); }
    /// `rotations` has room for four values for each bone, `place` for three; it may be null.
    [[nodiscard]] umo_status apply(const float *pose_rotations, const float *pose_translation, float *rotations,
                                   float *place = nullptr) noexcept {
        return umo_retarget_apply(get(), pose_rotations, pose_translation, bones_, rotations, place);
    }

private:
    std::uint32_t bones_ = 0;
};

/// Describes frames as an animation to write: the first `count` of `frames`. Model and frames must outlive it. `figure`
/// is one of `umo_figure_name`, or null for bones without a mesh.
inline umo_clip clip(const model &model, const frames &frames, std::size_t count,
                     const char *figure = umo_figure_name(0)) noexcept {
    umo_clip clip{};
    (void)!umo_clip_init(&clip, sizeof clip, model.get());
    clip.layout = &frames.layout();
    clip.frames = frames.data();
    clip.frame_count = static_cast<std::uint32_t>(count);
    clip.figure = figure;
    return clip;
}
/// Writes it as a file in a `UMO_FORMAT_…`; a failed write leaves no partial file. `path` is UTF-8.
[[nodiscard]] inline umo_status write_file(const umo_clip &clip, std::uint32_t format, const char *path) {
    return umo_clip_write_file(&clip, format, path);
}
/// Passes the file's bytes to `take(bytes, size)` piece by piece. If it returns false or throws, the result is
/// `UMO_STATUS_IO`.
template <class Take> [[nodiscard]] umo_status write(const umo_clip &clip, std::uint32_t format, Take &&take) {
    umo_output output{};
    output.userdata = const_cast<void *>(static_cast<const void *>(std::addressof(take)));
    output.write = [](void *userdata, const void *bytes, std::size_t size) noexcept -> std::int32_t {
        auto &write = *static_cast<std::remove_reference_t<Take> *>(userdata);
#if defined(__cpp_exceptions) || defined(_CPPUNWIND)
        try {
            return write(bytes, size) ? 0 : 1;
        } catch (...) {
            return 1;
        }
#else
        return write(bytes, size) ? 0 : 1;
#endif
    };
    return umo_clip_write(&clip, format, &output);
}

} // namespace umo

#endif
