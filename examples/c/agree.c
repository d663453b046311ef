/*
 * Two processes that send the voice alone: `agree MODEL speech.wav SECONDS ISA ISA`, with ISA scalar, avx2, avx512vnni or best.
 *
 * The first process starts the second and sends it the sound of a microphone, here a recording over and over. Each
 * animates it with its own instruction set, with UMO_ISA_PORTABLE. With each second of sound comes a digest of all frames
 * so far, which a game would not send: the second process fails at the first frame that differs in a bit. SECONDS 3600
 * is an hour of the avatar; nothing waits for the time to pass. POSIX, C11 and umo.h only.
 *
 *     cc -std=c11 -D_DEFAULT_SOURCE agree.c $(pkg-config --cflags --libs umo) -o agree
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umo.h"

/* Samples of speech a second, and the header size of a plain WAV file in bytes. */
enum { RATE = 16000, WAV_HEADER = 44 };

/* An avatar and what it showed. */
typedef struct {
    umo_model *model;
    umo_engine *engine;
    umo_session *session;
    umo_frame_layout layout;
    unsigned char *frame;
    uint64_t digest, frames;
} avatar;

static void check(umo_status status, const char *what) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "%s: %s: %s\n", what, umo_status_message(status), umo_last_error());
    exit(1);
}

static uint32_t isa(const char *name) {
    if (strcmp(name, "scalar") == 0) return UMO_ISA_SCALAR;
    if (strcmp(name, "avx2") == 0) return UMO_ISA_AVX2;
    if (strcmp(name, "avx512vnni") == 0) return UMO_ISA_AVX512VNNI;
    if (strcmp(name, "best") == 0) return UMO_ISA_BEST;
    fprintf(stderr, "%s: expected scalar, avx2, avx512vnni or best\n", name);
    exit(2);
}

static void start(avatar *self, const char *model, const char *name) {
    umo_model_config config;
    umo_engine_config polled;
    memset(self, 0, sizeof *self);
    check(umo_model_config_init(&config, sizeof config), "model config");
    config.isa = isa(name) | UMO_ISA_PORTABLE;
    check(umo_model_load(UMO_ABI_VERSION, model, &config, &self->model), "model");
    check(umo_engine_config_init(&polled, sizeof polled), "engine config");
    polled.mode = UMO_ENGINE_POLLED;
    check(umo_engine_new(self->model, &polled, &self->engine), "engine");
    check(umo_session_new(self->engine, NULL, &self->session), "session");
    check(umo_frame_layout_init(&self->layout, sizeof self->layout, self->model), "layout");
    self->frame = calloc(1, self->layout.frame_stride);
    self->digest = 14695981039346656037u;
    if (!self->frame) exit(1);
}

/* Hears a second of sound, and adds the frames that it brings to the digest. */
static void hear(avatar *self, const int16_t *sound) {
    static float samples[RATE];
    for (int i = 0; i < RATE; i++) samples[i] = (float)sound[i] / 32768.0f;
    check(umo_session_push_audio(self->session, samples, RATE, NULL), "push");
    for (uint32_t more = 1; more;) {
        check(umo_engine_poll(self->engine, 1000000, &more), "poll");
        for (size_t got = 1; got;) {
            check(umo_session_pull_frames(self->session, &self->layout, self->frame, self->layout.frame_stride, &got), "pull");
            if (!got) break;
            for (size_t i = 0; i < self->layout.frame_stride; i++) {
                self->digest = (self->digest ^ self->frame[i]) * 1099511628211u;
            }
            self->frames++;
        }
    }
}

static void end(avatar *self) {
    free(self->frame);
    check(umo_session_free(self->session), "session");
    check(umo_engine_free(self->engine), "engine");
    check(umo_model_free(self->model), "model");
}

/* The second process: `agree MODEL ISA`. */
static int follow(const char *model, const char *name) {
    static int16_t sound[RATE];
    avatar mine;
    uint64_t wanted = 0, seconds = 0;
    start(&mine, model, name);
    while (fread(sound, sizeof *sound, RATE, stdin) == RATE && fread(&wanted, sizeof wanted, 1, stdin) == 1) {
        hear(&mine, sound);
        seconds++;
        if (mine.digest != wanted) {
            fprintf(stderr, "%s: other frames in second %llu\n", name, (unsigned long long)seconds);
            return 1;
        }
    }
    printf("%llu s of sound, %llu frames: the same bits\n", (unsigned long long)seconds, (unsigned long long)mine.frames);
    end(&mine);
    return mine.frames == 0;
}

int main(int argc, char **argv) {
    static int16_t sound[RATE];
    if (argc == 3) return follow(argv[1], argv[2]);
    if (argc != 6) {
        fprintf(stderr, "usage: agree MODEL speech.wav SECONDS ISA ISA\n");
        return 2;
    }
    avatar mine;
    start(&mine, argv[1], argv[4]);
    char command[4096];
    isa(argv[5]);
    if (snprintf(command, sizeof command, "'%s' '%s' %s", argv[0], argv[1], argv[5]) >= (int)sizeof command) return 2;
    FILE *wav = fopen(argv[2], "rb"), *other = popen(command, "w");
    if (!wav || !other) {
        fprintf(stderr, "%s: cannot be opened\n", argv[2]);
        return 1;
    }
    fseek(wav, WAV_HEADER, SEEK_SET);
    for (long left = strtol(argv[3], NULL, 10); left > 0; left--) {
        if (fread(sound, sizeof *sound, RATE, wav) != RATE) {
            fseek(wav, WAV_HEADER, SEEK_SET);
            if (fread(sound, sizeof *sound, RATE, wav) != RATE) return 1;
        }
        hear(&mine, sound);
        if (fwrite(sound, sizeof *sound, RATE, other) != RATE) return 1;
        if (fwrite(&mine.digest, sizeof mine.digest, 1, other) != 1) return 1;
    }
    fclose(wav);
    end(&mine);
    return pclose(other) != 0;
}
