/* The live voice: the mouth's frames arrive with the sound, before anything is computed; the body follows. */

#include "check.h"

enum { RATE = 16000, SECONDS = 2, SAMPLES = RATE * SECONDS };

static float speech[SAMPLES];
static char frames[1 << 20];

static size_t pull(umo_session *avatar, const umo_frame_layout *layout) {
    size_t count = 0;
    OK(umo_session_pull_frames(avatar, layout, frames, sizeof frames, &count));
    return count;
}

/* The mouth alone, of which no more is loaded, needs no engine's thread and is in step with the sound. */
static void mouth_alone(const char *path) {
    umo_model_config loading;
    umo_model *model = NULL;
    umo_engine *engine = NULL;
    umo_session *avatar = NULL;
    umo_session_config config;
    umo_frame_layout layout;
    OK(umo_model_config_init(&loading, sizeof loading));
    loading.parts = UMO_PARTS_MOUTH + 1;
    FAILS(INVALID_ARGUMENT, umo_model_load(UMO_ABI_VERSION, path, &loading, &model));
    loading.parts = UMO_PARTS_MOUTH;
    OK(umo_model_load(UMO_ABI_VERSION, path, &loading, &model));
    OK(umo_engine_new(model, NULL, &engine));
    OK(umo_session_config_init(&config, sizeof config, model));
    FAILS(INVALID_ARGUMENT, umo_session_new(engine, &config, &avatar));
    CHECK(strstr(umo_last_error(), "mouth alone"));
    config.voice = UMO_VOICE_MOUTH;
    OK(umo_session_new(engine, &config, &avatar));
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    size_t taken = 0, shown = 0;
    OK(umo_session_push_audio(avatar, speech, SAMPLES, &taken));
    CHECK(taken == SAMPLES);
    OK(umo_session_finish(avatar));
    for (size_t more = 1; more > 0; shown += more) more = pull(avatar, &layout);
    uint32_t done = 0;
    OK(umo_session_is_done(avatar, &done));
    CHECK(done && shown == SECONDS * 30);
    OK(umo_session_free(avatar));
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    umo_model *model = load_model(argv[1]);
    umo_engine *engine = polled_engine(model);
    umo_model_info info = {.struct_size = sizeof info};
    OK(umo_model_get_info(model, &info));
    CHECK(info.has_mouth == 1);

    umo_session_config config;
    umo_session *avatar = NULL, *delayed = NULL;
    umo_frame_layout layout;
    OK(umo_session_config_init(&config, sizeof config, model));
    CHECK(config.voice == UMO_VOICE_DELAYED);
    OK(umo_session_new(engine, &config, &delayed));
    config.voice = UMO_VOICE_LIVE;
    OK(umo_session_new(engine, &config, &avatar));
    OK(umo_frame_layout_init(&layout, sizeof layout, model));

    umo_latency latency = {.struct_size = sizeof latency};
    OK(umo_session_latency(delayed, &latency));
    CHECK(latency.mouth_samples == latency.algorithmic_samples);
    OK(umo_session_latency(avatar, &latency));
    CHECK(latency.mouth_samples > 0 && latency.mouth_samples <= RATE / 10);
    CHECK(latency.mouth_samples < latency.algorithmic_samples);

    speak(speech, SAMPLES, 0);
    mouth_alone(argv[1]);
    size_t taken = 0, shown = 0;
    for (size_t pushed = 0; pushed < SAMPLES; pushed += taken) {
        OK(umo_session_push_audio(avatar, speech + pushed, 500, &taken));
        CHECK(taken == 500);
        shown += pull(avatar, &layout);
        /* Every frame whose sound was heard, except at most one. */
        size_t heard = pushed + taken > latency.mouth_samples ? pushed + taken - latency.mouth_samples : 0;
        CHECK(shown + 1 >= heard * 30 / RATE);
    }
    OK(umo_session_finish(avatar));
    uint32_t done = 0;
    while (!done) {
        compute(engine);
        shown += pull(avatar, &layout);
        OK(umo_session_is_done(avatar, &done));
    }
    umo_stats stats = {.struct_size = sizeof stats};
    OK(umo_session_stats(avatar, &stats));
    size_t behind = (latency.algorithmic_samples * 30 + RATE - 1) / RATE + 2;
    CHECK(shown == stats.frames + behind);

    OK(umo_session_free(avatar));
    OK(umo_session_free(delayed));
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    return 0;
}
