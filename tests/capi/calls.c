/* Invalid calls return an error that says what is wrong, and change nothing. */

#include "check.h"

enum { CHUNK = 5 * 3200 };

static umo_model *model;
static umo_engine *engine;

static const umo_session *made_up(uintptr_t value) { return (const umo_session *)value; }

static void models_refuse(const char *path) {
    umo_model *none = NULL;
    FAILS(VERSION, umo_model_load(UMO_ABI_VERSION + 1, path, NULL, &none));
    FAILS(VERSION, umo_model_load(UMO_ABI_VERSION + 0x10000, path, NULL, &none));
    FAILS(NULL_POINTER, umo_model_load(UMO_ABI_VERSION, NULL, NULL, &none));
    FAILS(NULL_POINTER, umo_model_load(UMO_ABI_VERSION, path, NULL, NULL));
    FAILS(IO, umo_model_load(UMO_ABI_VERSION, "/no/such/model", NULL, &none));
    CHECK(strstr(umo_last_error(), "/no/such/model"));
    FAILS(IO, umo_model_load(UMO_ABI_VERSION, "/", NULL, &none));
    FAILS(INVALID_ARGUMENT, umo_model_load(UMO_ABI_VERSION, "\xff\xfe", NULL, &none));
    FAILS(MODEL, umo_model_load_memory(UMO_ABI_VERSION, "not a model", 11, NULL, &none));
    FAILS(MODEL, umo_model_load_memory(UMO_ABI_VERSION, NULL, 0, NULL, &none));
    FAILS(NULL_POINTER, umo_model_load_memory(UMO_ABI_VERSION, NULL, 8, NULL, &none));
    FAILS(INVALID_ARGUMENT, umo_model_load_memory(UMO_ABI_VERSION, "x", SIZE_MAX, NULL, &none));
    umo_model_config config;
    OK(umo_model_config_init(&config, sizeof config));
    config.precision = 77;
    FAILS(INVALID_ARGUMENT, umo_model_load(UMO_ABI_VERSION, path, &config, &none));
    config.precision = UMO_PRECISION_STORED;
    config.isa = 99;
    FAILS(INVALID_ARGUMENT, umo_model_load(UMO_ABI_VERSION, path, &config, &none));
    CHECK(none == NULL);
    OK(umo_model_free(NULL));
    FAILS(INVALID_HANDLE, umo_model_free((umo_model *)(uintptr_t)0x1234560));
}

static void a_machine_tests_itself(void) {
    static char report[UMO_SELF_TEST_SIZE];
    uint32_t passed = 7;
    FAILS(NULL_POINTER, umo_self_test(NULL, &passed, report, sizeof report));
    FAILS(NULL_POINTER, umo_self_test(model, NULL, report, sizeof report));
    FAILS(NULL_POINTER, umo_self_test(model, &passed, NULL, sizeof report));
    FAILS(BUFFER_TOO_SMALL, umo_self_test(model, &passed, report, sizeof report - 1));
    CHECK(passed == 7 && report[0] == 0);
    OK(umo_self_test(model, &passed, report, sizeof report));
    CHECK(passed == 1);
    CHECK(strstr(report, "self-test passed") && strstr(report, "all as the reference") && strstr(report, "as recorded"));
    CHECK(strstr(report, "avatars at once") && !strchr(report, '/'));
}

static void models_say_what_they_have(void) {
    const char *text = NULL;
    OK(umo_model_get_text(model, UMO_MODEL_NAME, &text));
    CHECK(strlen(text) > 0);
    OK(umo_model_get_text(model, UMO_MODEL_LICENSE, &text));
    CHECK(strlen(text) > 0);
    OK(umo_model_get_text(model, UMO_MODEL_PROMPTS, &text));
    CHECK(strstr(text, "calm\n") && !strstr(text, "friendly"));
    FAILS(INVALID_ARGUMENT, umo_model_get_text(model, 0, &text));
    FAILS(INVALID_ARGUMENT, umo_model_get_text(model, 6, &text));
    OK(umo_model_get_channel_name(model, 17, &text));
    CHECK(strcmp(text, "jawOpen") == 0);
    FAILS(INVALID_ARGUMENT, umo_model_get_channel_name(model, 52, &text));
    CHECK(strcmp(umo_joint_name(0), "pelvis") == 0 && strcmp(umo_joint_name(54), "right_thumb3") == 0);
    CHECK(umo_joint_name(55) == NULL && umo_viseme_name(15) == NULL && strcmp(umo_viseme_name(14), "ou") == 0);
    int32_t parents[UMO_JOINT_COUNT];
    float metres[3 * UMO_JOINT_COUNT], unreal[3 * UMO_JOINT_COUNT];
    OK(umo_model_get_skeleton(model, UMO_AXES_GLTF, parents, metres, UMO_JOINT_COUNT));
    OK(umo_model_get_skeleton(model, UMO_AXES_UNREAL, NULL, unreal, UMO_JOINT_COUNT));
    CHECK(parents[0] == -1 && parents[1] == 0);
    /* Unreal: forward, right, up in centimetres. */
    CHECK(unreal[3 * 16] == 100 * metres[3 * 16 + 2] && unreal[3 * 16 + 1] == -100 * metres[3 * 16]);
    FAILS(BUFFER_TOO_SMALL, umo_model_get_skeleton(model, UMO_AXES_GLTF, parents, metres, 54));
    FAILS(INVALID_ARGUMENT, umo_model_get_skeleton(model, 3, parents, metres, 55));
    for (uint32_t i = 0;; i++) {
        umo_parameter_info info = {.struct_size = sizeof info};
        umo_status status = umo_parameter_get_info(i, &info);
        if (status == UMO_STATUS_INVALID_ARGUMENT) {
            CHECK(i == 19);
            break;
        }
        CHECK(status == UMO_STATUS_OK && info.minimum == 0 && info.maximum > 0 && strlen(info.name) > 0);
    }
}

static void recordings_have_gains(void) {
    static float samples[2 * 32000];
    float gains[2] = {0, 0};
    /* A tone that comes and goes, in opposite channels. */
    for (int i = 0; i < 32000; i++) {
        float x = i % 4000 >= 2500 ? 0 : i / 50 % 2 == 0 ? 0.1f : -0.1f;
        samples[2 * i] = x;
        samples[2 * i + 1] = -x;
    }
    OK(umo_recording_gains(samples, 64000, 16000, 2, gains));
    CHECK(gains[0] == 1 && gains[1] == -1);
    OK(umo_recording_gains(samples, 64000, 16000, 1, gains));
    CHECK(gains[0] == 1);
    OK(umo_recording_gains(NULL, 0, 16000, 2, gains));
    CHECK(gains[0] == 1 && gains[1] == 1);
    FAILS(NULL_POINTER, umo_recording_gains(NULL, 2, 16000, 2, gains));
    FAILS(NULL_POINTER, umo_recording_gains(samples, 2, 16000, 2, NULL));
    FAILS(INVALID_ARGUMENT, umo_recording_gains(samples, 3, 16000, 2, gains));
    FAILS(INVALID_ARGUMENT, umo_recording_gains(samples, 2, 16000, 0, gains));
    FAILS(INVALID_ARGUMENT, umo_recording_gains(samples, 2, 999, 2, gains));
}

static void engines_refuse(void) {
    umo_engine *none = NULL;
    umo_engine_config config;
    FAILS(NULL_POINTER, umo_engine_new(NULL, NULL, &none));
    FAILS(INVALID_HANDLE, umo_engine_new((const umo_model *)(const void *)engine, NULL, &none));
#define WITH(status, field, value)                                                                                     \
    OK(umo_engine_config_init(&config, sizeof config));                                                                \
    config.field = (value);                                                                                            \
    FAILS(status, umo_engine_new(model, &config, &none))
    WITH(INVALID_ARGUMENT, threads, 0);
    WITH(INVALID_ARGUMENT, threads, 65);
    WITH(INVALID_ARGUMENT, mode, 2);
    WITH(INVALID_ARGUMENT, max_sessions, 0);
    WITH(INVALID_ARGUMENT, max_sessions, UINT32_MAX);
    CHECK(strstr(umo_last_error(), "max_sessions"));
    WITH(INVALID_ARGUMENT, max_batch, 0);
    WITH(INVALID_ARGUMENT, core_count, 65);
    WITH(INVALID_ARGUMENT, priority, 3);
    CHECK(strstr(umo_last_error(), "priority 3"));
    WITH(INVALID_ARGUMENT, core_kinds, UMO_CORES_EFFICIENCY + 1);
    CHECK(strstr(umo_last_error(), "core_kinds 4"));
    WITH(NULL_POINTER, core_count, 1);
    WITH(STRUCT_SIZE, struct_size, 4);
    WITH(STRUCT_SIZE, struct_size, sizeof config - 1);
    const uint32_t core = 100000;
    OK(umo_engine_config_init(&config, sizeof config));
    config.cores = &core;
    config.core_count = 1;
    FAILS(THREAD, umo_engine_new(model, &config, &none));
    CHECK(strstr(umo_last_error(), "cores 100000: ") && !strstr(umo_last_error(), "Some"));
    umo_jobs jobs = {NULL, NULL};
    OK(umo_engine_config_init(&config, sizeof config));
    config.jobs = &jobs;
    FAILS(INVALID_ARGUMENT, umo_engine_new(model, &config, &none));
    config.mode = UMO_ENGINE_POLLED;
    FAILS(NULL_POINTER, umo_engine_new(model, &config, &none));
    CHECK(none == NULL);
    OK(umo_engine_free(NULL));
    uint32_t more;
    FAILS(INVALID_HANDLE, umo_engine_poll((umo_engine *)(void *)model, 0, &more));
    OK(umo_engine_config_init(&config, sizeof config));
    OK(umo_engine_new(model, &config, &none));
    FAILS(UNSUPPORTED, umo_engine_poll(none, 0, &more));
    OK(umo_engine_free(none));
    FAILS(INVALID_HANDLE, umo_engine_free(none));
}

static void sessions_refuse_to_be_made(void) {
    umo_session *none = NULL;
    umo_session_config config;
    FAILS(NULL_POINTER, umo_session_new(NULL, NULL, &none));
    FAILS(NULL_POINTER, umo_session_new(engine, NULL, NULL));
#undef WITH
#define WITH(status, field, value)                                                                                     \
    OK(umo_session_config_init(&config, sizeof config, model));                                                        \
    config.field = (value);                                                                                            \
    FAILS(status, umo_session_new(engine, &config, &none))
    WITH(INVALID_ARGUMENT, sample_rate, 7999);
    CHECK(strstr(umo_last_error(), "sample_rate"));
    WITH(INVALID_ARGUMENT, sample_rate, UINT32_MAX);
    WITH(INVALID_ARGUMENT, channels, 0);
    WITH(INVALID_ARGUMENT, channels, 65);
    WITH(INVALID_ARGUMENT, target, 0);
    WITH(INVALID_ARGUMENT, target, 100);
    WITH(INVALID_ARGUMENT, lookahead, 100000);
    WITH(INVALID_ARGUMENT, idle, 3);
    WITH(INVALID_ARGUMENT, queue_frames, 1);
    WITH(INVALID_ARGUMENT, queue_frames, UINT32_MAX);
    WITH(INVALID_ARGUMENT, voice, UMO_VOICE_MOUTH + 1);
    WITH(INVALID_ARGUMENT, template_name, "no such template");
    umo_allocator half = {NULL, NULL, NULL};
    WITH(NULL_POINTER, allocator, &half);
    CHECK(none == NULL);
}

static void sessions_refuse_calls(void) {
    umo_session *avatar = NULL;
    umo_session_config config;
    OK(umo_session_config_init(&config, sizeof config, model));
    config.channels = 2;
    OK(umo_session_new(engine, &config, &avatar));
    static float samples[2 * CHUNK];
    size_t count = 0;
    umo_frame_layout layout;
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    static char frames[1 << 20];

    FAILS(INVALID_ARGUMENT, umo_session_push_audio(avatar, samples, 3, &count));
    char text[UMO_ERROR_SIZE];
    size_t length = 0;
    OK(umo_session_last_error(avatar, text, sizeof text, &length));
    CHECK(strstr(text, "sample count 3") && length == strlen(text));
    FAILS(BUFFER_TOO_SMALL, umo_session_last_error(avatar, text, 4, &length));
    OK(umo_session_last_error(avatar, NULL, 0, &length));
    FAILS(NULL_POINTER, umo_session_push_audio(avatar, NULL, 2, &count));
    FAILS(INVALID_ARGUMENT, umo_session_push_audio(avatar, samples, SIZE_MAX & ~(size_t)1, &count));
    FAILS(INVALID_ARGUMENT, umo_session_push_audio(avatar, (const float *)((const char *)samples + 1), 2, &count));
    OK(umo_session_push_audio(avatar, NULL, 0, &count));
    CHECK(count == 0);
    OK(umo_session_push_audio(avatar, samples, 2 * CHUNK, NULL));

    FAILS(NULL_POINTER, umo_session_pull_frames(avatar, NULL, frames, sizeof frames, &count));
    FAILS(NULL_POINTER, umo_session_pull_frames(avatar, &layout, NULL, sizeof frames, &count));
    FAILS(NULL_POINTER, umo_session_pull_frames(avatar, &layout, frames, sizeof frames, NULL));
    FAILS(BUFFER_TOO_SMALL, umo_session_pull_frames(avatar, &layout, frames, layout.frame_stride / 2, &count));
#undef WITH
#define WITH(status, field, value)                                                                                     \
    do {                                                                                                               \
        umo_frame_layout changed = layout;                                                                             \
        changed.field = (value);                                                                                       \
        FAILS(status, umo_session_pull_frames(avatar, &changed, frames, sizeof frames, &count));                       \
        FAILS(status, umo_frame_layout_check(&changed, model, sizeof frames, &count));                                 \
    } while (0)
    WITH(STRUCT_SIZE, struct_size, 3);
    WITH(INVALID_ARGUMENT, axes, 3);
    WITH(INVALID_ARGUMENT, frame_stride, 100);
    WITH(INVALID_ARGUMENT, frame_stride, UINT32_MAX);
    WITH(INVALID_ARGUMENT, rotations, UINT32_MAX - 1);
    WITH(INVALID_ARGUMENT, rotation_stride, 15);
    WITH(INVALID_ARGUMENT, rotation_stride, UINT32_MAX);
    WITH(INVALID_ARGUMENT, channel_stride, 0);
    WITH(INVALID_ARGUMENT, channels, layout.frame_stride);
    CHECK(strstr(umo_last_error(), "frame_stride"));
    WITH(INVALID_ARGUMENT, reserved, 1);
    CHECK(strstr(umo_last_error(), "`reserved` is 1") && strstr(umo_last_error(), "umo_frame_layout_init"));
    WITH(INVALID_ARGUMENT, index, 4);
    CHECK(strstr(umo_last_error(), "index at byte 4") && strstr(umo_last_error(), "multiple of 8"));
    WITH(INVALID_ARGUMENT, translation, layout.translation + 1);
    CHECK(strstr(umo_last_error(), "translation") && strstr(umo_last_error(), "multiple of 4"));
    WITH(INVALID_ARGUMENT, rotation_stride, 18);
    CHECK(strstr(umo_last_error(), "rotations") && strstr(umo_last_error(), "stride of 18"));
    WITH(INVALID_ARGUMENT, frame_stride, layout.frame_stride + 4);
    CHECK(strstr(umo_last_error(), "frame_stride") && strstr(umo_last_error(), "multiple of 8"));
    WITH(INVALID_ARGUMENT, sample, layout.index);
    CHECK(strstr(umo_last_error(), "index and sample overlap at byte 0"));
    WITH(INVALID_ARGUMENT, translation, layout.rotations + 16);
    CHECK(strstr(umo_last_error(), "translation and rotations overlap"));
    WITH(INVALID_ARGUMENT, channels, layout.rotations + 16 * UMO_JOINT_COUNT - 4);
    CHECK(strstr(umo_last_error(), "rotations and channels overlap"));
    WITH(INVALID_ARGUMENT, visemes, layout.channels + 8);
    CHECK(strstr(umo_last_error(), "channels and visemes overlap") && strstr(umo_last_error(), "UMO_ABSENT"));
    /* Values that are not written need no offset. */
    umo_frame_layout few = layout;
    few.index = few.sample = UMO_ABSENT;
    few.channels = UMO_ABSENT;
    few.channel_stride = 3;
    few.visemes = layout.channels;
    few.frame_stride = layout.frame_stride + 4;
    OK(umo_frame_layout_check(&few, model, sizeof frames, NULL));
    /* A channel between each joint's rotation and the next does not overlap; with another stride they meet at the
       second. */
    umo_frame_layout woven = layout;
    woven.rotations = 32;
    woven.rotation_stride = woven.channel_stride = 24;
    woven.channels = 48;
    woven.visemes = 32 + 24 * UMO_JOINT_COUNT;
    woven.frame_stride = 2048;
    OK(umo_frame_layout_check(&woven, model, sizeof frames, NULL));
    woven.channel_stride = 20;
    FAILS(INVALID_ARGUMENT, umo_frame_layout_check(&woven, model, sizeof frames, NULL));
    CHECK(strstr(umo_last_error(), "rotations and channels overlap at byte 68"));
    OK(umo_frame_layout_check(&layout, model, 10 * (size_t)layout.frame_stride, &count));
    CHECK(count == 10);

    FAILS(INVALID_ARGUMENT, umo_session_sample_pose(avatar, (double)NAN, &layout, frames, sizeof frames, NULL));
    FAILS(INVALID_ARGUMENT, umo_session_interrupt(avatar, 10001));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, 0, 1));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_TEMPERATURE, -1));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_TEMPERATURE, (double)NAN));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_TOP_K, 1.5));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_GAIN_LOWER, 2.5));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_ATTENTION, UMO_ATTENTION_SPEAKING + 1));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_ATTENTION, 0.5));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_LAYER_GAZE, 1.5));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, UMO_PARAMETER_LAYER_BODY + 1, 0.5));
    OK(umo_session_set_parameter(avatar, UMO_PARAMETER_TOP_K, 7));
    OK(umo_session_set_parameter(avatar, UMO_PARAMETER_GAIN_LOWER, 0.25));
    OK(umo_session_set_parameter(avatar, UMO_PARAMETER_IDLE, UMO_IDLE_REST));
    double value = 0;
    OK(umo_session_get_parameter(avatar, UMO_PARAMETER_TOP_K, &value));
    CHECK(value == 7);
    OK(umo_session_get_parameter(avatar, UMO_PARAMETER_GAIN_LOWER, &value));
    CHECK(value == 0.25);
    OK(umo_session_get_parameter(avatar, UMO_PARAMETER_IDLE, &value));
    CHECK(value == UMO_IDLE_REST);
    OK(umo_session_set_parameter(avatar, UMO_PARAMETER_ATTENTION, UMO_ATTENTION_THINKING));
    OK(umo_session_get_parameter(avatar, UMO_PARAMETER_ATTENTION, &value));
    CHECK(value == UMO_ATTENTION_THINKING);
    for (uint32_t layer = UMO_PARAMETER_LAYER_GAZE; layer <= UMO_PARAMETER_LAYER_BODY; layer++) {
        OK(umo_session_set_parameter(avatar, layer, (layer - 31) / 8.0));
        OK(umo_session_get_parameter(avatar, layer, &value));
        CHECK(value == (layer - 31) / 8.0);
    }

    const float place[3] = {0, 150, 100}, nowhere[3] = {0, (float)NAN, 1}, far_away[3] = {0, 0, 2e6f};
    FAILS(NULL_POINTER, umo_session_look_at(avatar, UMO_AXES_GLTF, NULL, 1));
    FAILS(INVALID_ARGUMENT, umo_session_look_at(avatar, 3, place, 1));
    FAILS(INVALID_ARGUMENT, umo_session_look_at(avatar, UMO_AXES_GLTF, nowhere, 1));
    FAILS(INVALID_ARGUMENT, umo_session_look_at(avatar, UMO_AXES_UNREAL, far_away, 1));
    FAILS(INVALID_ARGUMENT, umo_session_look_at(avatar, UMO_AXES_UNREAL, place, -0.5f));
    FAILS(INVALID_ARGUMENT, umo_session_look_at(avatar, UMO_AXES_UNREAL, place, (float)NAN));
    OK(umo_session_look_at(avatar, UMO_AXES_UNREAL, place, 0.5f));
    FAILS(INVALID_ARGUMENT, umo_session_set_mood(avatar, UMO_MOOD_AFRAID + 1, 1));
    FAILS(INVALID_ARGUMENT, umo_session_set_mood(avatar, UMO_MOOD_JOY, 1.5f));
    FAILS(INVALID_ARGUMENT, umo_session_set_mood(avatar, UMO_MOOD_JOY, (float)NAN));
    OK(umo_session_set_mood(avatar, UMO_MOOD_JOY, 0.5f));
    FAILS(NULL_POINTER, umo_engine_set_word_rules(NULL, "de", NULL));
    FAILS(INVALID_ARGUMENT, umo_engine_set_word_rules(engine, "xx", NULL));
    FAILS(INVALID_ARGUMENT, umo_engine_set_word_rules(engine, NULL, "[class"));
    OK(umo_engine_set_word_rules(engine, "en", "[class.negation]\nwords = ['nix']"));
    OK(umo_engine_set_word_rules(engine, "en", NULL));
    FAILS(INVALID_ARGUMENT, umo_session_hint_words(avatar, "no", -1, 0.1));
    FAILS(INVALID_ARGUMENT, umo_session_hint_words(avatar, "no", 1, 0.9));
    FAILS(INVALID_ARGUMENT, umo_session_hint_words(avatar, "no", (double)NAN, 1));
    FAILS(INVALID_ARGUMENT, umo_session_hint_words(avatar, "\xff", 0, 0.1));
    FAILS(NULL_POINTER, umo_session_hint_words(avatar, NULL, 0, 0.1));
    FAILS(NULL_POINTER, umo_session_hint_words(NULL, "no", 0, 0.1));
    for (int word = 0; word < 64; word++)
        OK(umo_session_hint_words(avatar, "table,", 1e6 + word, 1e6 + word));
    FAILS(BUSY, umo_session_hint_words(avatar, "table", 1e6, 1e6 + 0.1));
    FAILS(INVALID_ARGUMENT, umo_session_hint_lips(avatar, UMO_LIPS_ROUND + 1, 0, 0.1));
    FAILS(INVALID_ARGUMENT, umo_session_hint_lips(avatar, UMO_LIPS_CLOSED, -1, 0.1));
    FAILS(INVALID_ARGUMENT, umo_session_hint_lips(avatar, UMO_LIPS_CLOSED, 0, (double)NAN));
    FAILS(NULL_POINTER, umo_session_hint_lips(NULL, UMO_LIPS_CLOSED, 0, 0.1));
    for (int hint = 0; hint < 64; hint++)
        OK(umo_session_hint_lips(avatar, UMO_LIPS_CLOSED, 1e6 + hint, 0.1));
    FAILS(BUSY, umo_session_hint_lips(avatar, UMO_LIPS_CLOSED, 1e6, 0.1));
    FAILS(NULL_POINTER, umo_session_push_other_audio(avatar, NULL, 2));
    FAILS(INVALID_ARGUMENT, umo_session_push_other_audio(avatar, samples, 3));
    FAILS(INVALID_ARGUMENT, umo_session_push_other_audio(avatar, samples, SIZE_MAX));
    OK(umo_session_push_other_audio(avatar, NULL, 0));
    OK(umo_session_push_other_audio(avatar, samples, 2));
    FAILS(INVALID_HANDLE, umo_session_look_at((umo_session *)(void *)model, UMO_AXES_GLTF, place, 1));
    FAILS(NULL_POINTER, umo_session_set_mood(NULL, UMO_MOOD_JOY, 1));
    FAILS(NULL_POINTER, umo_session_push_other_audio(NULL, samples, 2));

    const uint32_t wild[] = {UINT32_MAX};
    FAILS(INVALID_ARGUMENT, umo_session_set_prompt_ids(avatar, wild, 1));
    static const uint32_t many[1000];
    FAILS(INVALID_ARGUMENT, umo_session_set_prompt_ids(avatar, many, 1000));
    FAILS(INVALID_ARGUMENT, umo_session_set_prompt(avatar, "\xff", 1));

    uint32_t done = 7;
    OK(umo_session_is_done(avatar, &done));
    CHECK(done == 0);
    OK(umo_session_finish(avatar));
    OK(umo_session_finish(avatar));
    FAILS(FINISHED, umo_session_push_audio(avatar, samples, 2, &count));
    /* After all that, the frames of the pushed second arrive. */
    compute(engine);
    OK(umo_session_ready_frames(avatar, &count));
    CHECK(count == 30);
    OK(umo_session_pull_frames(avatar, &layout, frames, 29 * (size_t)layout.frame_stride, &count));
    OK(umo_session_is_done(avatar, &done));
    CHECK(count == 29 && done == 0);
    float arousal = -1.0f, trend = 9.0f;
    OK(umo_session_arousal(avatar, &arousal, NULL));
    CHECK(arousal >= 0.0f && arousal <= 1.0f);
    OK(umo_session_arousal(avatar, &arousal, &trend));
    CHECK(trend >= -1.0f && trend <= 1.0f);
    FAILS(NULL_POINTER, umo_session_arousal(avatar, NULL, &trend));
    OK(umo_session_pull_frames(avatar, &layout, frames, sizeof frames, &count));
    OK(umo_session_is_done(avatar, &done));
    CHECK(count == 1 && done == 1);
    OK(umo_session_interrupt(avatar, 100));
    OK(umo_session_is_done(avatar, &done));
    CHECK(done == 0);
    OK(umo_session_pull_frames(avatar, &layout, frames, sizeof frames, &count));
    CHECK(count == 3); /* the ease */
    OK(umo_session_free(avatar));
    FAILS(INVALID_HANDLE, umo_session_free(avatar));
    FAILS(INVALID_HANDLE, umo_session_push_audio(avatar, samples, 2, &count));
    FAILS(INVALID_HANDLE, umo_session_finish((umo_session *)(void *)model));
    umo_stats stats = {.struct_size = sizeof stats};
    for (uintptr_t value = 1; value < 200000; value += 7) CHECK(umo_session_stats(made_up(value), &stats) < 0);
    FAILS(NULL_POINTER, umo_session_stats(NULL, &stats));
}

static void session_configs_are_read(void) {
    umo_session *avatar = NULL;
    umo_session_config config;
    umo_latency latency = {.struct_size = sizeof latency};
    uint64_t samples[2];
    OK(umo_session_config_init(&config, sizeof config, model));
    CHECK(config.smoothing > 0 && config.guidance == 1 && config.horizon == 0 && config.packets == UMO_PACKETS_NONE);
    config.lookahead = 0;
    for (int i = 0; i < 2; i++) {
        if (i == 1) config.smoothing = 0;
        OK(umo_session_new(engine, &config, &avatar));
        OK(umo_session_latency(avatar, &latency));
        samples[i] = latency.algorithmic_samples;
        OK(umo_session_free(avatar));
    }
    /* The low-pass looks 3 frames ahead. */
    CHECK(samples[0] == samples[1] + 3 * config.sample_rate / 30);

#undef WITH
#define WITH(field, value, word)                                                                                       \
    do {                                                                                                               \
        umo_session_config wrong;                                                                                      \
        OK(umo_session_config_init(&wrong, sizeof wrong, model));                                                      \
        wrong.field = (value);                                                                                         \
        FAILS(INVALID_ARGUMENT, umo_session_new(engine, &wrong, &avatar));                                             \
        CHECK(strstr(umo_last_error(), word));                                                                         \
    } while (0)
    WITH(smoothing, 2, "smoothing");
    WITH(smoothing, (float)NAN, "smoothing");
    WITH(guidance, 0, "guidance");
    WITH(guidance, 4, "guidance");
    WITH(horizon, 1000, "horizon");
    WITH(packets, 3, "packets");
#undef WITH
}

/* Motion without frames follows the time that the host sets. */
static void hosts_give_their_time(void) {
    static char frames[2][1 << 13];
    umo_session *avatar = NULL;
    umo_frame_layout layout;
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    OK(umo_session_new(engine, NULL, &avatar));
    FAILS(INVALID_ARGUMENT, umo_session_set_clock(avatar, -1));
    FAILS(INVALID_ARGUMENT, umo_session_set_clock(avatar, NAN));
    FAILS(NULL_POINTER, umo_session_set_clock(NULL, 1));
    OK(umo_session_set_clock(avatar, 100));
    for (int i = 0; i < 2; i++) OK(umo_session_sample_pose(avatar, 0, &layout, frames[i], sizeof *frames, NULL));
    OK(umo_session_sample_pose(avatar, 0, &layout, frames[1], sizeof *frames, NULL));
    CHECK(memcmp(frames[0], frames[1], sizeof *frames) == 0);
    OK(umo_session_set_clock(avatar, 101));
    OK(umo_session_sample_pose(avatar, 0, &layout, frames[1], sizeof *frames, NULL));
    CHECK(memcmp(frames[0], frames[1], sizeof *frames) != 0);
    OK(umo_session_free(avatar));
}

static void gestures_come_out_of_files(const char *path) {
    static char bytes[8192];
    umo_session *avatar = NULL;
    const uint32_t arm = UMO_GESTURE_RIGHT_ARM;
    FILE *file = fopen(path, "rb");
    CHECK(file);
    const size_t size = fread(bytes, 1, sizeof bytes, file);
    CHECK(fclose(file) == 0 && size > 1000);

    OK(umo_engine_add_gesture_file(engine, "greet", path, NULL, arm, -1));
    OK(umo_engine_add_gesture_memory(engine, "look", bytes, size, "turn", UMO_GESTURE_HEAD, 0.5f));
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_play_gesture(avatar, "greet", NULL));
    OK(umo_session_play_gesture(avatar, "look", NULL));
    OK(umo_session_free(avatar));

    FAILS(IO, umo_engine_add_gesture_file(engine, "greet", "/no/such/file.glb", NULL, arm, -1));
    CHECK(strstr(umo_last_error(), "/no/such/file.glb"));
    FAILS(IO, umo_engine_add_gesture_file(engine, "greet", "/", NULL, arm, -1));
    FAILS(NULL_POINTER, umo_engine_add_gesture_file(engine, "greet", NULL, NULL, arm, -1));
    FAILS(NULL_POINTER, umo_engine_add_gesture_file(NULL, "greet", path, NULL, arm, -1));
    FAILS(NULL_POINTER, umo_engine_add_gesture_memory(engine, "greet", NULL, 8, NULL, arm, -1));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_file(engine, "greet", path, "wave", arm, -1));
    CHECK(strstr(umo_last_error(), "salute") && strstr(umo_last_error(), "turn"));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_file(engine, "greet", path, NULL, 0, -1));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_file(engine, "greet", path, NULL, 16, -1));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_file(engine, "greet", path, NULL, arm, 2));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_file(engine, "greet", path, NULL, arm, NAN));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_file(engine, "gr/eet", path, NULL, arm, -1));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_memory(engine, "greet", bytes, 0, NULL, arm, -1));
    CHECK(strstr(umo_last_error(), "not a glb file"));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_memory(engine, "greet", bytes, size - 1, NULL, arm, -1));
    CHECK(strstr(umo_last_error(), "cut short"));
    for (size_t i = 0; i + 9 < size; i++) {
        if (memcmp(bytes + i, "rig:RightA", 10) == 0) bytes[i + 4] = 'X';
    }
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture_memory(engine, "greet", bytes, size, NULL, arm, -1));
    CHECK(strstr(umo_last_error(), "right_shoulder"));
}

static void gestures_refuse(void) {
    umo_session *avatar = NULL;
    umo_gesture_options options;
    umo_gesture_clip clip;
    static float rotations[31][UMO_JOINT_COUNT][4];
    for (size_t i = 0; i < 31; i++) {
        for (size_t joint = 0; joint < UMO_JOINT_COUNT; joint++) rotations[i][joint][3] = 1;
    }

    const char *name = NULL;
    uint32_t built_in = 0;
    while (umo_engine_get_gesture_name(engine, built_in, &name) == UMO_STATUS_OK) {
        CHECK(strlen(name) > 0);
        built_in++;
    }
    CHECK(built_in > 8);
    FAILS(INVALID_ARGUMENT, umo_engine_get_gesture_name(engine, built_in, &name));
    CHECK(strstr(umo_last_error(), "there are"));
    FAILS(NULL_POINTER, umo_engine_get_gesture_name(engine, 0, NULL));
    FAILS(NULL_POINTER, umo_engine_get_gesture_name(NULL, 0, &name));
    OK(umo_engine_get_gesture_name(engine, 0, &name));
    const char *first = name;

    FAILS(STRUCT_SIZE, umo_gesture_clip_init(&clip, sizeof clip - 1));
    FAILS(NULL_POINTER, umo_gesture_clip_init(NULL, sizeof clip));
    OK(umo_gesture_clip_init(&clip, sizeof clip));
    CHECK(clip.parts == 15 && clip.rate == 30);
    clip.frame_count = 31;
    FAILS(NULL_POINTER, umo_engine_add_gesture(engine, "salute", &clip));
    clip.rotations = &rotations[0][0][0];
    clip.stroke = 0.5f;
    FAILS(NULL_POINTER, umo_engine_add_gesture(engine, NULL, &clip));
    FAILS(NULL_POINTER, umo_engine_add_gesture(engine, "salute", NULL));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture(engine, "", &clip));
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture(engine, "a/b", &clip));
#undef WITH
#define WITH(field, value)                                                                                             \
    do {                                                                                                               \
        umo_gesture_clip wrong = clip;                                                                                 \
        wrong.field = (value);                                                                                         \
        FAILS(INVALID_ARGUMENT, umo_engine_add_gesture(engine, "salute", &wrong));                                     \
    } while (0)
    WITH(parts, 0);
    WITH(parts, 16);
    WITH(axes, 3);
    WITH(frame_count, 1);
    WITH(frame_count, 3601);
    WITH(frame_count, UINT32_MAX);
    CHECK(strstr(umo_last_error(), "frame_count"));
    WITH(rate, 0);
    WITH(rate, (float)NAN);
    WITH(stroke, 1.5f);
#undef WITH
    rotations[30][54][3] = (float)INFINITY;
    FAILS(INVALID_ARGUMENT, umo_engine_add_gesture(engine, "salute", &clip));
    rotations[30][54][3] = 1;
    clip.parts = UMO_GESTURE_HEAD | UMO_GESTURE_RIGHT_ARM;

    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_engine_add_gesture(engine, "salute", &clip));
    OK(umo_engine_add_gesture(engine, "salute", &clip));
    OK(umo_engine_get_gesture_name(engine, built_in, &name));
    CHECK(strcmp(name, "salute") == 0);
    FAILS(INVALID_ARGUMENT, umo_engine_get_gesture_name(engine, built_in + 1, &name));
    CHECK(strlen(first) > 0); /* still good */
    char detail[UMO_ERROR_SIZE];
    /* A session created before does not know it. */
    FAILS(INVALID_ARGUMENT, umo_session_play_gesture(avatar, "salute", NULL));
    OK(umo_session_last_error(avatar, detail, sizeof detail, NULL));
    CHECK(strstr(detail, "salute") && strstr(detail, "umo_engine_get_gesture_name"));
    OK(umo_session_free(avatar));
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_play_gesture(avatar, "salute", NULL));

    FAILS(NULL_POINTER, umo_session_play_gesture(avatar, NULL, NULL));
    FAILS(NULL_POINTER, umo_session_play_gesture(NULL, "wave", NULL));
    FAILS(INVALID_ARGUMENT, umo_session_play_gesture(avatar, "\xff", NULL));
    FAILS(STRUCT_SIZE, umo_gesture_options_init(&options, sizeof options - 1));
    OK(umo_gesture_options_init(&options, sizeof options));
    CHECK(options.at < 0 && options.speed == 1 && options.strength == 1 && options.has_target == 0);
#define WITH(field, value)                                                                                             \
    do {                                                                                                               \
        umo_gesture_options wrong = options;                                                                           \
        wrong.field = (value);                                                                                         \
        FAILS(INVALID_ARGUMENT, umo_session_play_gesture(avatar, "point", &wrong));                                    \
    } while (0)
    WITH(side, UMO_SIDE_BOTH + 1);
    WITH(axes, 3);
    WITH(has_target, 2);
    WITH(at, (double)NAN);
    WITH(speed, 0);
    WITH(strength, 1.5f);
    WITH(variant, 256);
    options.has_target = 1;
    WITH(target[1], (float)NAN);
#undef WITH
    options.struct_size = 8;
    FAILS(STRUCT_SIZE, umo_session_play_gesture(avatar, "point", &options));
    OK(umo_gesture_options_init(&options, sizeof options));
    options.at = 2.5;
    uint32_t waiting = 1;
    umo_status played = UMO_STATUS_OK;
    while (waiting < 100 && (played = umo_session_play_gesture(avatar, "Thumbs up", &options)) == UMO_STATUS_OK) waiting++;
    CHECK(played == UMO_STATUS_BUSY && waiting == 8);
    OK(umo_session_free(avatar));
}

static void a_full_engine_says_so(void) {
    umo_engine_config config;
    umo_engine *small = NULL;
    umo_session *avatars[3] = {NULL, NULL, NULL};
    OK(umo_engine_config_init(&config, sizeof config));
    config.mode = UMO_ENGINE_POLLED;
    config.max_sessions = 2;
    OK(umo_engine_new(model, &config, &small));
    OK(umo_session_new(small, NULL, &avatars[0]));
    OK(umo_session_new(small, NULL, &avatars[1]));
    FAILS(FULL, umo_session_new(small, NULL, &avatars[2]));
    CHECK(avatars[2] == NULL);
    OK(umo_session_free(avatars[0]));
    OK(umo_session_new(small, NULL, &avatars[0]));
    /* The engine is freed first: ready frames can still be pulled, then the sessions report that it is gone. */
    static float samples[CHUNK];
    speak(samples, CHUNK, 0);
    OK(umo_session_push_audio(avatars[0], samples, CHUNK, NULL));
    compute(small);
    OK(umo_engine_free(small));
    umo_frame_layout layout;
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    static char frames[1 << 20];
    size_t count = 0;
    OK(umo_session_pull_frames(avatars[0], &layout, frames, sizeof frames, &count));
    CHECK(count > 0);
    FAILS(CLOSED, umo_session_pull_frames(avatars[0], &layout, frames, sizeof frames, &count));
    uint32_t done = 7;
    FAILS(CLOSED, umo_session_is_done(avatars[0], &done));
    CHECK(done == 7);
    FAILS(CLOSED, umo_session_push_audio(avatars[1], samples, CHUNK, NULL));
    OK(umo_session_free(avatars[0]));
    OK(umo_session_free(avatars[1]));
}

/* Two avatars and a person in one room; one avatar is freed while it is there. */
static void scenes_know_their_members(void) {
    static float samples[CHUNK];
    static char frames[1 << 20], state[1 << 22];
    umo_session *avatars[2] = {NULL, NULL};
    umo_scene *scene = NULL, *none = NULL;
    umo_place place;
    umo_frame_layout layout;
    umo_member info = {.struct_size = sizeof info};
    uint32_t ids[3] = {0, 0, 0}, id = 0, speaker = 9;
    size_t size = 0, written = 0, count = 0;
    FAILS(NULL_POINTER, umo_scene_new(1, NULL));
    FAILS(NULL_POINTER, umo_scene_update(NULL, 0.1));
    FAILS(INVALID_HANDLE, umo_scene_update((umo_scene *)(uintptr_t)made_up(0x50), 0.1));
    OK(umo_scene_new(1, &scene));
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    FAILS(STRUCT_SIZE, umo_place_init(&place, sizeof place - 1));
    OK(umo_place_init(&place, sizeof place));
    CHECK(place.axes == UMO_AXES_GLTF && place.position[2] == 0 && place.facing == 0 && place.eye_height > 1.5f);
    for (int i = 0; i < 2; i++) {
        OK(umo_session_new(engine, NULL, &avatars[i]));
        place.position[0] = i == 0 ? 0.7f : -0.7f;
        OK(umo_scene_add(scene, avatars[i], &place, &ids[i]));
    }
    /* In Unreal's axes and units: 1.5 m ahead of the origin, turned round. */
    umo_place person = {.struct_size = sizeof person, .axes = UMO_AXES_UNREAL, .position = {150, 0, 0}};
    person.facing = 3.14159f;
    person.eye_height = 170;
    OK(umo_scene_add(scene, NULL, &person, &ids[2]));
    CHECK(ids[0] == 1 && ids[1] == 2 && ids[2] == 3);
    FAILS(NULL_POINTER, umo_scene_add(scene, NULL, &place, NULL));
    FAILS(INVALID_HANDLE, umo_scene_add(scene, (umo_session *)(void *)scene, &place, &id));
    place.axes = 3;
    FAILS(INVALID_ARGUMENT, umo_scene_add(scene, NULL, &place, &id));
    place.axes = UMO_AXES_GLTF;
    place.eye_height = (float)NAN;
    FAILS(INVALID_ARGUMENT, umo_scene_set_place(scene, ids[0], &place));
    FAILS(NULL_POINTER, umo_scene_set_place(scene, ids[0], NULL));
    FAILS(INVALID_ARGUMENT, umo_scene_set_place(scene, 99, &person));
    FAILS(INVALID_ARGUMENT, umo_scene_set_allowed(scene, ids[0], 32));
    OK(umo_scene_set_allowed(scene, ids[0], UMO_SCENE_LOOK | UMO_SCENE_YIELD));
    FAILS(INVALID_ARGUMENT, umo_scene_update(scene, -1));
    char detail[UMO_ERROR_SIZE];
    OK(umo_scene_last_error(scene, detail, sizeof detail, NULL));
    CHECK(strstr(detail, "seconds"));

    /* The person speaks; the first avatar listens. */
    speak(samples, CHUNK, 0);
    FAILS(INVALID_ARGUMENT, umo_scene_push_audio(scene, ids[0], samples, 533)); /* has a body */
    FAILS(NULL_POINTER, umo_scene_push_audio(scene, ids[2], NULL, 533));
    OK(umo_session_push_audio(avatars[0], samples, CHUNK, NULL));
    compute(engine);
    int contact = 0;
    for (int picture = 0; picture < 45; picture++) {
        OK(umo_scene_push_audio(scene, ids[2], samples + 300 * picture, 533));
        OK(umo_scene_update(scene, 1.0 / 60));
        OK(umo_scene_update(scene, 1.0 / 60));
        OK(umo_scene_member(scene, ids[0], &info));
        contact += info.is_contact == 1 && info.attends_to == ids[2];
    }
    CHECK(contact > 15);
    OK(umo_scene_floor(scene, &speaker));
    OK(umo_scene_member(scene, ids[0], &info));
    CHECK(speaker == ids[2] && info.role == UMO_ROLE_LISTENING);
    OK(umo_scene_member(scene, ids[2], &info));
    CHECK(info.role == UMO_ROLE_SPEAKING && info.level > 0.05f && info.attends_to == 0);
    OK(umo_session_pull_frames(avatars[0], &layout, frames, layout.frame_stride, &count));
    CHECK(count == 1);

    /* Targets: a member, a point, and not both. */
    const float point[3] = {1, 2, 3};
    OK(umo_scene_set_target(scene, ids[0], ids[1], 0, NULL));
    OK(umo_scene_member(scene, ids[0], &info));
    CHECK(info.attends_to == ids[1] && info.is_contact == 1);
    OK(umo_scene_set_target(scene, ids[0], 0, UMO_AXES_UNITY, point));
    OK(umo_scene_set_target(scene, ids[0], 0, 77, NULL));
    FAILS(INVALID_ARGUMENT, umo_scene_set_target(scene, ids[0], 0, 77, point));
    FAILS(INVALID_ARGUMENT, umo_scene_set_target(scene, ids[0], ids[1], UMO_AXES_GLTF, point));
    FAILS(INVALID_ARGUMENT, umo_scene_set_target(scene, ids[0], ids[0], UMO_AXES_GLTF, NULL));

    /* Saved and restored as a whole. */
    OK(umo_scene_state_size(scene, &size));
    CHECK(size > 1000 && size <= sizeof state);
    FAILS(BUFFER_TOO_SMALL, umo_scene_save(scene, state, size - 1, &written));
    OK(umo_scene_save(scene, state, size, &written));
    OK(umo_scene_restore(scene, state, written));
    FAILS(STATE, umo_scene_restore(scene, state, written - 1));
    FAILS(STATE, umo_session_restore(avatars[0], state, written));
    state[written / 2] ^= 1;
    FAILS(STATE, umo_scene_restore(scene, state, written));

    /* A session that is freed leaves. */
    OK(umo_session_free(avatars[0]));
    OK(umo_scene_update(scene, 1.0 / 30));
    FAILS(INVALID_ARGUMENT, umo_scene_member(scene, ids[0], &info));
    OK(umo_scene_remove(scene, ids[1]));
    FAILS(INVALID_ARGUMENT, umo_scene_remove(scene, ids[1]));
    OK(umo_scene_add(scene, avatars[1], NULL, &id));
    CHECK(id == 4);
    for (int i = 0; i < UMO_SCENE_MEMBER_COUNT - 2; i++) OK(umo_scene_add(scene, NULL, NULL, &id));
    FAILS(FULL, umo_scene_add(scene, NULL, NULL, &id));
    OK(umo_scene_free(scene));
    FAILS(INVALID_HANDLE, umo_scene_free(scene));
    OK(umo_scene_free(none));
    OK(umo_session_free(avatars[1]));
}

int main(int argc, char **argv) {
    CHECK(argc == 3);
    CHECK(strlen(umo_status_message(UMO_STATUS_BUSY)) > 0 && strlen(umo_status_message(12345)) > 0);
    models_refuse(argv[1]);
    model = load_model(argv[1]);
    engine = polled_engine(model);
    models_say_what_they_have();
    a_machine_tests_itself();
    recordings_have_gains();
    engines_refuse();
    sessions_refuse_to_be_made();
    session_configs_are_read();
    sessions_refuse_calls();
    hosts_give_their_time();
    gestures_refuse();
    gestures_come_out_of_files(argv[2]);
    a_full_engine_says_so();
    scenes_know_their_members();
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    FAILS(INVALID_HANDLE, umo_model_get_text(model, UMO_MODEL_NAME, &(const char *){NULL}));
    return 0;
}
