/* Session states as bytes: rolled back, moved to another engine, truncated and corrupted. */

#include "check.h"

enum { SAMPLES = 16000 * 3, ROOM = 1 << 20 };

static umo_model *model;
static umo_frame_layout layout;
static float speech[SAMPLES];
static char state[1 << 22], again[1 << 22];
static char first[ROOM], second[ROOM];

static size_t save(umo_session *avatar, char *bytes) {
    size_t size = 0, written = 0;
    OK(umo_session_state_size(avatar, &size));
    CHECK(size <= sizeof state);
    FAILS(INVALID_ARGUMENT, umo_session_save(avatar, bytes, size - 1, &written));
    OK(umo_session_save(avatar, bytes, size, &written));
    CHECK(written > 0 && written <= size);
    return written;
}

/* Frames of the rest of the speech. */
static size_t go_on(umo_engine *engine, umo_session *avatar, size_t from, char *frames) {
    size_t count = 0, taken = 0;
    for (size_t at = from; at < SAMPLES; at += taken) {
        OK(umo_session_push_audio(avatar, speech + at, SAMPLES - at < 1000 ? SAMPLES - at : 1000, &taken));
    }
    OK(umo_session_finish(avatar));
    compute(engine);
    memset(frames, 0, ROOM);
    OK(umo_session_pull_frames(avatar, &layout, frames, ROOM, &count));
    return count;
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    speak(speech, SAMPLES, 0);
    model = load_model(argv[1]);
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    umo_engine *engine = polled_engine(model), *other_engine = polled_engine(model);
    umo_session *avatar = NULL, *other = NULL, *faster = NULL;
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_new(other_engine, NULL, &other));

    /* Half of the speech, some frames shown, a gain set; then to the end, restored, and to the end again. */
    size_t taken = 0, count = 0;
    OK(umo_session_push_audio(avatar, speech, 30000, &taken));
    CHECK(taken == 30000);
    compute(engine);
    OK(umo_session_set_parameter(avatar, UMO_PARAMETER_GAIN_UPPER, 0.5));
    OK(umo_session_pull_frames(avatar, &layout, first, 10 * (size_t)layout.frame_stride, &count));
    size_t size = save(avatar, state);
    size_t shown = go_on(engine, avatar, 30000, first);
    CHECK(count == 10 && shown == 80);
    OK(umo_session_restore(avatar, state, size));
    CHECK(save(avatar, again) == size); /* the same bytes except for the time */
    CHECK(go_on(engine, avatar, 30000, second) == shown && memcmp(first, second, ROOM) == 0);

    /* In another engine. */
    OK(umo_session_restore(other, state, size));
    CHECK(go_on(other_engine, other, 30000, second) == shown && memcmp(first, second, ROOM) == 0);

    /* An invalid state changes nothing. */
    size_t before = save(other, again);
    FAILS(STATE, umo_session_restore(other, state, size - 1));
    FAILS(STATE, umo_session_restore(other, state, 0));
    FAILS(NULL_POINTER, umo_session_restore(other, NULL, size));
    FAILS(STATE, umo_session_restore(other, speech, sizeof speech));
    for (size_t at = 0; at < size; at += 97) {
        state[at] ^= 0x10;
        FAILS(STATE, umo_session_restore(other, state, size));
        state[at] ^= 0x10;
    }
    char text[UMO_ERROR_SIZE];
    OK(umo_session_last_error(other, text, sizeof text, NULL));
    CHECK(strstr(text, "checksum"));
    CHECK(save(other, again) == before);
    OK(umo_session_restore(other, state, size));
    CHECK(go_on(other_engine, other, 30000, second) == shown && memcmp(first, second, ROOM) == 0);

    /* A different configuration is reported by name. */
    umo_session_config config;
    OK(umo_session_config_init(&config, sizeof config, model));
    config.sample_rate = 48000;
    OK(umo_session_new(engine, &config, &faster));
    FAILS(STATE, umo_session_restore(faster, state, size));
    OK(umo_session_last_error(faster, text, sizeof text, NULL));
    CHECK(strstr(text, "sample rate") && strstr(text, "48000"));

    OK(umo_session_free(avatar));
    OK(umo_session_free(other));
    OK(umo_session_free(faster));
    OK(umo_engine_free(engine));
    OK(umo_engine_free(other_engine));
    OK(umo_model_free(model));
    return 0;
}
