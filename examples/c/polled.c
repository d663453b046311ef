/*
 * The polled mode, for a host that provides everything: `polled MODEL speech.wav frames.txt`.
 *
 * The library starts no thread, opens no file and reads no clock: it computes in umo_engine_poll, in memory that it is
 * given, at the time that it is told. So it works on systems with their own threads and files, such as consoles. Files
 * are read with stdio here; a game would use its own functions. Frames are written like animate.c does, with the same
 * bits.
 *
 *     cc -std=c11 polled.c $(pkg-config --cflags --libs umo) -o polled
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umo.h"

/* Game ticks a second, samples of speech a second, and the header size of a plain WAV file in bytes. */
enum { TICKS = 60, RATE = 16000, WAV_HEADER = 44 };

static unsigned char *read_file(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    unsigned char *bytes = NULL;
    if (fseek(file, 0, SEEK_END) == 0) {
        long end = ftell(file);
        rewind(file);
        *size = end < 0 ? 0 : (size_t)end;
        bytes = malloc(*size + 1);
        if (bytes && fread(bytes, 1, *size, file) != *size) {
            free(bytes);
            bytes = NULL;
        }
    }
    fclose(file);
    return bytes;
}

/* Prints one frame in the layout of `umo_frame_layout_init`. */
static void print_frame(FILE *out, const umo_frame_layout *layout, const char *bytes, uint32_t channels) {
    uint64_t index;
    float value;
    memcpy(&index, bytes + layout->index, sizeof index);
    fprintf(out, "%llu", (unsigned long long)index);
    for (uint32_t i = 0; i < 3; i++) {
        memcpy(&value, bytes + layout->translation + 4 * i, sizeof value);
        fprintf(out, " %.9g", (double)value);
    }
    for (uint32_t i = 0; i < 4 * UMO_JOINT_COUNT; i++) {
        memcpy(&value, bytes + layout->rotations + i / 4 * layout->rotation_stride + 4 * (i % 4), sizeof value);
        fprintf(out, " %.9g", (double)value);
    }
    for (uint32_t i = 0; i < channels; i++) {
        memcpy(&value, bytes + layout->channels + i * layout->channel_stride, sizeof value);
        fprintf(out, " %.9g", (double)value);
    }
    fputc('\n', out);
}

static void check(umo_status status, const char *what) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "%s: %s (%s)\n", what, umo_status_message(status), umo_last_error());
    exit(EXIT_FAILURE);
}

int main(int argc, char **argv) {
    if (argc != 4) {
        fprintf(stderr, "usage: polled MODEL speech.wav frames.txt\n");
        return 2;
    }
    size_t model_size = 0, wav_size = 0;
    unsigned char *model_bytes = read_file(argv[1], &model_size), *wav = read_file(argv[2], &wav_size);
    FILE *out = fopen(argv[3], "w");
    if (!model_bytes || !wav || !out || wav_size <= WAV_HEADER) {
        fprintf(stderr, "a file cannot be opened\n");
        return EXIT_FAILURE;
    }

    /* Set-up: the only place that allocates memory. */
    umo_model *model = NULL;
    check(umo_model_load_memory(UMO_ABI_VERSION, model_bytes, model_size, NULL, &model), "model");
    free(model_bytes); /* The model has copied what it needs. */
    umo_model_info info = {.struct_size = sizeof info};
    check(umo_model_get_info(model, &info), "model info");
    umo_engine_config engine_config;
    check(umo_engine_config_init(&engine_config, sizeof engine_config), "engine configuration");
    engine_config.mode = UMO_ENGINE_POLLED;
    engine_config.threads = 1; /* The polling one. More if `jobs` lends them. */
    umo_engine *engine = NULL;
    check(umo_engine_new(model, &engine_config, &engine), "engine");
    umo_session_config config;
    check(umo_session_config_init(&config, sizeof config, model), "session configuration");
    config.sample_rate = RATE;
    config.horizon = info.max_horizon;
    umo_session *avatar = NULL;
    check(umo_session_new(engine, &config, &avatar), "session");
    umo_frame_layout layout;
    check(umo_frame_layout_init(&layout, sizeof layout, model), "layout");
    char *frame = malloc(layout.frame_stride);
    if (!frame) return EXIT_FAILURE;

    /* The game's loop: push a tick's samples, compute due work layer by layer, pull the ready frames. */
    size_t count = (wav_size - WAV_HEADER) / 2, pushed = 0, shown = 0;
    uint32_t done = 0;
    for (uint64_t tick = 0; !done; tick++) {
        float samples[RATE / TICKS + 1];
        size_t wanted = 0, taken = 0;
        while (pushed + wanted < count && (pushed + wanted) * TICKS < (tick + 1) * RATE) {
            const unsigned char *bytes = wav + WAV_HEADER + 2 * (pushed + wanted);
            samples[wanted++] = (float)(int16_t)(uint16_t)(bytes[0] | bytes[1] << 8) / 32768.0f;
        }
        check(umo_session_set_clock(avatar, (double)tick / TICKS), "clock");
        if (wanted > 0) {
            check(umo_session_push_audio(avatar, samples, wanted, &taken), "push");
            pushed += taken;
            if (pushed == count) check(umo_session_finish(avatar), "finish");
        }
        /* A budget of 0 computes one layer. A game stops when its time for this tick is used up and continues in the
           next. */
        uint32_t more = 1;
        while (more) check(umo_engine_poll(engine, 0, &more), "poll");
        for (size_t got = 1; got > 0; shown += got) {
            check(umo_session_pull_frames(avatar, &layout, frame, layout.frame_stride, &got), "pull");
            if (got > 0) print_frame(out, &layout, frame, info.channels);
        }
        check(umo_session_is_done(avatar, &done), "done");
    }
    printf("%zu frames of %s\n", shown, argv[2]);

    int result = fclose(out) == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
    free(frame);
    free(wav);
    umo_session_free(avatar);
    umo_engine_free(engine);
    umo_model_free(model);
    return result;
}
