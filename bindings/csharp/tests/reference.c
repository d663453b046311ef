// SPDX-License-Identifier: MIT OR Apache-2.0
// reference MODEL WAV AXES: writes the frames of a 16-bit mono recording with the usual 44-byte header, as the C
// interface returns them: packed, one after the other, to standard output.

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "umo.h"

static void check(umo_status status) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "%s: %s\n", umo_status_message(status), umo_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    umo_model *model;
    umo_engine *engine;
    umo_session *session;
    umo_session_config config;
    umo_frame_layout layout;
    check(umo_model_load(UMO_ABI_VERSION, argv[1], NULL, &model));
    check(umo_engine_new(model, NULL, &engine));
    check(umo_session_config_init(&config, sizeof config, model));
    check(umo_frame_layout_init(&layout, sizeof layout, model));
    layout.axes = (uint32_t)atoi(argv[3]);

    FILE *wav = fopen(argv[2], "rb");
    unsigned char header[44];
    if (!wav || fread(header, 1, sizeof header, wav) != sizeof header) return 1;
    memcpy(&config.sample_rate, header + 24, 4);
    check(umo_session_new(engine, &config, &session));

    static int16_t samples[1 << 20];
    size_t count = fread(samples, 2, sizeof samples / 2, wav), done = 0, frames = 0;
    size_t all = count * 30 / config.sample_rate;
    unsigned char *buffer = calloc(16, layout.frame_stride);
    while (frames < all) {
        size_t taken = 0, pulled = 0;
        if (done < count) {
            check(umo_session_push_audio_i16(session, samples + done, count - done, &taken));
            done += taken;
            if (done == count) check(umo_session_finish(session));
        }
        check(umo_session_pull_frames(session, &layout, buffer, 16 * (size_t)layout.frame_stride, &pulled));
        if (fwrite(buffer, layout.frame_stride, pulled, stdout) != pulled) return 1;
        frames += pulled;
        if (pulled == 0) nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    return 0;
}
