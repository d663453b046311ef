/*
 * A recording in, frames out: `animate MODEL speech.wav frames.txt`, or a file for viewers and engines: `… motion.glb`.
 *
 * Text output has one line per frame: its index, the root's position, 55 rotations (x y z w), the face channels, with
 * enough digits to read back the same bits. C11 and umo.h only.
 *
 *     cc -std=c11 animate.c $(pkg-config --cflags --libs umo) -o animate
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umo.h"

/* Frames pulled at a time. */
enum { FRAMES = 64 };

/* A recording: interleaved samples, full scale 1. */
typedef struct {
    float *samples;
    size_t count;
    uint32_t rate;
    uint32_t channels;
} recording;

static uint32_t little(const unsigned char *bytes, int count) {
    uint32_t value = 0;
    for (int i = count - 1; i >= 0; i--) value = value << 8 | bytes[i];
    return value;
}

/* Reads a WAV file of 16-bit samples, the kind that most programs write. Returns NULL, or what is wrong. */
static const char *read_wav(const char *path, recording *wav) {
    FILE *file = fopen(path, "rb");
    if (!file) return "cannot be opened";
    unsigned char head[12], chunk[8], format[16];
    const char *problem = "is not a WAV file of 16-bit samples";
    int has_format = 0;
    if (fread(head, 1, 12, file) != 12 || memcmp(head, "RIFF", 4) != 0 || memcmp(head + 8, "WAVE", 4) != 0) goto done;
    while (fread(chunk, 1, 8, file) == 8) {
        uint32_t size = little(chunk + 4, 4);
        if (memcmp(chunk, "fmt ", 4) == 0 && size >= 16 && fread(format, 1, 16, file) == 16) {
            wav->channels = little(format + 2, 2);
            wav->rate = little(format + 4, 4);
            if (little(format, 2) != 1 || little(format + 14, 2) != 16 || wav->channels == 0) goto done;
            has_format = 1;
            size -= 16;
        } else if (memcmp(chunk, "data", 4) == 0 && has_format) {
            wav->count = size / 2 / wav->channels * wav->channels;
            unsigned char *bytes = malloc(wav->count * 2 + 1);
            wav->samples = malloc(wav->count * sizeof(float) + 1);
            if (bytes && wav->samples && fread(bytes, 2, wav->count, file) == wav->count) {
                for (size_t i = 0; i < wav->count; i++) {
                    wav->samples[i] = (float)(int16_t)(uint16_t)little(bytes + 2 * i, 2) / 32768.0f;
                }
                problem = NULL;
            }
            free(bytes);
            goto done;
        }
        if (fseek(file, (long)(size + (size & 1)), SEEK_CUR) != 0) goto done;
    }
done:
    fclose(file);
    return problem;
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

static int fail(const char *what, umo_status status) {
    fprintf(stderr, "%s: %s (%s)\n", what, umo_status_message(status), umo_last_error());
    return EXIT_FAILURE;
}

int main(int argc, char **argv) {
    if (argc != 4) {
        fprintf(stderr, "usage: animate MODEL speech.wav frames.txt|motion.glb\n");
        return 2;
    }
    recording wav = {0};
    const char *problem = read_wav(argv[2], &wav);
    if (problem) {
        fprintf(stderr, "%s %s\n", argv[2], problem);
        free(wav.samples);
        return EXIT_FAILURE;
    }

    /* Set-up: the only place that allocates memory. */
    umo_model *model = NULL;
    umo_engine *engine = NULL;
    umo_session *avatar = NULL;
    umo_session_config config;
    umo_frame_layout layout;
    umo_model_info info = {.struct_size = sizeof info};
    umo_status status = umo_model_load(UMO_ABI_VERSION, argv[1], NULL, &model);
    if (status == UMO_STATUS_OK) status = umo_model_get_info(model, &info);
    if (status == UMO_STATUS_OK) status = umo_frame_layout_init(&layout, sizeof layout, model);
    if (status == UMO_STATUS_OK) status = umo_engine_new(model, NULL, &engine);
    if (status == UMO_STATUS_OK) status = umo_session_config_init(&config, sizeof config, model);
    if (status == UMO_STATUS_OK) {
        config.sample_rate = wav.rate;
        config.channels = wav.channels;
        config.horizon = info.max_horizon; /* The whole recording is available: lookahead costs nothing. */
        status = umo_session_new(engine, &config, &avatar);
    }
    char *frames = malloc((size_t)layout.frame_stride * FRAMES);
    const char *suffix = strrchr(argv[3], '.');
    int is_glb = suffix && strcmp(suffix, ".glb") == 0;
    FILE *out = is_glb ? NULL : fopen(argv[3], "w");
    int result = EXIT_SUCCESS;
    if (status != UMO_STATUS_OK || !frames || (!out && !is_glb)) result = fail("cannot start", status);

    /* Speech in, frames out, until the last frame of the recording. */
    size_t pushed = 0, shown = 0, kept = 0;
    uint32_t done = 0;
    while (result == EXIT_SUCCESS && !done) {
        size_t taken = 0, count = 0;
        if (pushed < wav.count) {
            status = umo_session_push_audio(avatar, wav.samples + pushed, wav.count - pushed, &taken);
            pushed += taken;
            if (status == UMO_STATUS_OK && pushed == wav.count) status = umo_session_finish(avatar);
        }
        if (status == UMO_STATUS_OK) {
            status = umo_session_pull_frames(avatar, &layout, frames + kept, (size_t)layout.frame_stride * FRAMES, &count);
        }
        for (size_t i = 0; i < count && out; i++) print_frame(out, &layout, frames + i * layout.frame_stride, info.channels);
        shown += count;
        if (is_glb && count > 0) {
            /* A file holds all frames: grow by the number pulled at a time. */
            kept = shown * layout.frame_stride;
            char *more = realloc(frames, kept + (size_t)layout.frame_stride * FRAMES);
            if (more) frames = more;
            else result = fail("too many frames", status);
        }
        if (status == UMO_STATUS_OK) status = umo_session_is_done(avatar, &done);
        if (status != UMO_STATUS_OK) result = fail("the session failed", status);
    }
    if (result == EXIT_SUCCESS && is_glb) {
        umo_clip clip;
        status = umo_clip_init(&clip, sizeof clip, model); /* The model's skeleton and face, the default figure. */
        clip.layout = &layout;
        clip.frames = frames;
        clip.frame_count = (uint32_t)shown;
        if (status == UMO_STATUS_OK) status = umo_clip_write_file(&clip, UMO_FORMAT_GLB, argv[3]);
        if (status != UMO_STATUS_OK) result = fail("cannot write", status);
    }
    if (result == EXIT_SUCCESS) printf("%zu frames of %s\n", shown, argv[2]);

    if (out && fclose(out) != 0) result = EXIT_FAILURE;
    free(frames);
    free(wav.samples);
    umo_session_free(avatar);
    umo_engine_free(engine);
    umo_model_free(model);
    return result;
}
