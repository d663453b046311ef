/* Writes the C interface's frames: reference PREFIX RATE CHANNELS AXES <samples.i16 >frames.bin
 *
 * SPDX-License-Identifier: MIT OR Apache-2.0 */
#include <stdio.h>
#include <stdlib.h>
#include <umo.h>

static void need(umo_status status) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "%s: %s\n", umo_status_message(status), umo_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    if (argc != 5) return 2;
    char path[4096];
    snprintf(path, sizeof path, "%s/share/umo/models/umo-people.safetensors", argv[1]);
    umo_model *model;
    need(umo_model_load(UMO_ABI_VERSION, path, NULL, &model));

    umo_engine_config engine_config;
    need(umo_engine_config_init(&engine_config, sizeof engine_config));
    engine_config.mode = UMO_ENGINE_POLLED;
    engine_config.threads = 1;
    umo_engine *engine;
    need(umo_engine_new(model, &engine_config, &engine));

    umo_session_config config;
    need(umo_session_config_init(&config, sizeof config, model));
    config.sample_rate = (uint32_t)atoi(argv[2]);
    config.channels = (uint32_t)atoi(argv[3]);
    config.idle = UMO_IDLE_HOLD;
    umo_model_info info = {.struct_size = sizeof info};
    need(umo_model_get_info(model, &info));
    config.horizon = info.max_horizon;
    umo_session *session;
    need(umo_session_new(engine, &config, &session));

    umo_frame_layout layout;
    need(umo_frame_layout_init(&layout, sizeof layout, model));
    layout.axes = (uint32_t)atoi(argv[4]);
    void *frames = calloc(16, layout.frame_stride);
    int16_t samples[960];
    size_t read = 1;
    while (read > 0) {
        read = fread(samples, sizeof *samples, 960, stdin);
        if (read > 0) {
            size_t taken;
            need(umo_session_push_audio_i16(session, samples, read, &taken));
            if (taken != read) return 3;
        } else {
            need(umo_session_finish(session));
        }
        for (size_t count = 1; count > 0;) {
            need(umo_engine_poll(engine, UINT32_MAX, NULL));
            need(umo_session_pull_frames(session, &layout, frames, 16 * layout.frame_stride, &count));
            fwrite(frames, layout.frame_stride, count, stdout);
        }
    }
    free(frames);
    umo_session_free(session);
    umo_engine_free(engine);
    umo_model_free(model);
    return 0;
}
