// Writes every frame of a recording as computed by the native library with UMO_ISA_PORTABLE, whose results equal WebAssembly's
// bit for bit: `native MODEL SAMPLES OUT`, where SAMPLES are 32-bit floats at 16 kHz.
#include <stdio.h>
#include <stdlib.h>
#include <umo.h>

static void check(umo_status status, const char *what) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "%s: %s: %s\n", what, umo_status_message(status), umo_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    umo_model_config config;
    check(umo_model_config_init(&config, sizeof config), "model config");
    config.isa = UMO_ISA_BEST | UMO_ISA_PORTABLE;
    umo_model *model = NULL;
    check(umo_model_load(UMO_ABI_VERSION, argv[1], &config, &model), "model");
    umo_engine_config engine_config;
    check(umo_engine_config_init(&engine_config, sizeof engine_config), "engine config");
    engine_config.mode = UMO_ENGINE_POLLED;
    engine_config.threads = 1;
    umo_engine *engine = NULL;
    check(umo_engine_new(model, &engine_config, &engine), "engine");
    umo_session *session = NULL;
    check(umo_session_new(engine, NULL, &session), "session");
    umo_frame_layout layout;
    check(umo_frame_layout_init(&layout, sizeof layout, model), "layout");
    FILE *in = fopen(argv[2], "rb"), *out = fopen(argv[3], "wb");
    if (!in || !out) return 1;
    static float samples[16000];
    char *frame = malloc(layout.frame_stride);
    uint32_t done = 0;
    int finished = 0;
    while (!done) {
        size_t count = fread(samples, sizeof *samples, 16000, in), taken = 0;
        if (count) check(umo_session_push_audio(session, samples, count, &taken), "push");
        if (taken != count) return 3;
        if (!count && !finished) {
            check(umo_session_finish(session), "finish");
            finished = 1;
        }
        uint32_t more = 1;
        while (more) check(umo_engine_poll(engine, 1000000, &more), "poll");
        for (size_t got = 1; got;) {
            check(umo_session_pull_frames(session, &layout, frame, layout.frame_stride, &got), "pull");
            if (got) fwrite(frame, layout.frame_stride, 1, out);
        }
        check(umo_session_is_done(session, &done), "done");
    }
    fclose(out);
    umo_session_free(session);
    umo_engine_free(engine);
    umo_model_free(model);
    return 0;
}
