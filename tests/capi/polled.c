/* A library built without threads, files, a clock and glTF refuses what it lacks, and computes on lent threads:
 * `polled MODEL`. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umo.h"

#define CHECK(condition) ((condition) ? (void)0 : fail(#condition, __LINE__))

static void fail(const char *what, int line) {
    fprintf(stderr, "polled.c:%d: %s (%s)\n", line, what, umo_last_error());
    exit(1);
}

/* Whether a call was refused because of how the library was built, with an error that names an alternative. */
static int refused(umo_status status, const char *instead) {
    return status == UMO_STATUS_UNSUPPORTED && strstr(umo_last_error(), "built without") && strstr(umo_last_error(), instead);
}

static unsigned char *read_file(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    CHECK(file && fseek(file, 0, SEEK_END) == 0);
    *size = (size_t)ftell(file);
    rewind(file);
    unsigned char *bytes = malloc(*size);
    CHECK(bytes && fread(bytes, 1, *size, file) == *size);
    fclose(file);
    return bytes;
}

/* The host's thread: runs a job as soon as there is one. */
typedef struct {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    void (*job)(void *context);
    void *context;
    int jobs, ends;
} worker;

static void *work(void *userdata) {
    worker *self = userdata;
    pthread_mutex_lock(&self->lock);
    while (!self->ends) {
        if (!self->job) {
            pthread_cond_wait(&self->changed, &self->lock);
            continue;
        }
        void (*job)(void *context) = self->job;
        void *context = self->context;
        self->job = NULL;
        self->jobs++;
        pthread_mutex_unlock(&self->lock);
        job(context);
        pthread_mutex_lock(&self->lock);
    }
    pthread_mutex_unlock(&self->lock);
    return NULL;
}

static void submit(void *userdata, void (*job)(void *context), void *context) {
    worker *self = userdata;
    pthread_mutex_lock(&self->lock);
    self->job = job;
    self->context = context;
    pthread_cond_signal(&self->changed);
    pthread_mutex_unlock(&self->lock);
}

/* Frames of three seconds of noise. */
static size_t frames_of(umo_engine *engine, umo_model *model, char *frames, size_t size) {
    umo_session *avatar = NULL;
    umo_frame_layout layout;
    CHECK(umo_session_new(engine, NULL, &avatar) == UMO_STATUS_OK);
    CHECK(umo_frame_layout_init(&layout, sizeof layout, model) == UMO_STATUS_OK);
    static float samples[48000];
    uint32_t random = 1, done = 0, more = 1;
    for (size_t i = 0; i < 48000; i++) {
        random = random * 1664525 + 1013904223;
        samples[i] = (float)(int32_t)random / 8.0e9f;
    }
    size_t taken = 0, all = 0, got = 0;
    CHECK(umo_session_push_audio(avatar, samples, 48000, &taken) == UMO_STATUS_OK && taken == 48000);
    CHECK(umo_session_finish(avatar) == UMO_STATUS_OK);
    while (!done) {
        /* No clock ends a poll: with any budget but 0 it computes all due work. */
        CHECK(umo_engine_poll(engine, 1, &more) == UMO_STATUS_OK && !more);
        CHECK(umo_session_pull_frames(avatar, &layout, frames + all * layout.frame_stride, size - all * layout.frame_stride, &got) ==
              UMO_STATUS_OK);
        all += got;
        CHECK(umo_session_is_done(avatar, &done) == UMO_STATUS_OK);
    }
    CHECK(umo_session_free(avatar) == UMO_STATUS_OK);
    return all * layout.frame_stride;
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    umo_model *model = NULL;
    umo_engine *engine = NULL, *lent = NULL;
    CHECK(refused(umo_model_load(UMO_ABI_VERSION, argv[1], NULL, &model), "umo_model_load_memory"));
    size_t size = 0;
    unsigned char *bytes = read_file(argv[1], &size);
    CHECK(umo_model_load_memory(UMO_ABI_VERSION, bytes, size, NULL, &model) == UMO_STATUS_OK);
    free(bytes);

    umo_engine_config config;
    CHECK(umo_engine_config_init(&config, sizeof config) == UMO_STATUS_OK);
    CHECK(config.mode == UMO_ENGINE_POLLED && config.threads == 1);
    config.threads = 2;
    CHECK(refused(umo_engine_new(model, &config, &engine), "`jobs`"));
    config.threads = 1;
    config.mode = UMO_ENGINE_THREADS;
    CHECK(refused(umo_engine_new(model, &config, &engine), "UMO_ENGINE_POLLED"));
    CHECK(umo_engine_new(model, NULL, &engine) == UMO_STATUS_OK);
    CHECK(refused(umo_engine_add_gesture_file(engine, "bow", "bow.glb", NULL, UMO_GESTURE_HEAD, -1), "umo_engine_add_gesture_memory"));

    umo_clip clip;
    umo_output output = {0};
    CHECK(umo_clip_init(&clip, sizeof clip, model) == UMO_STATUS_OK && clip.channel_count > 0 && clip.figure == NULL);
    CHECK(refused(umo_clip_write(&clip, UMO_FORMAT_GLB, &output), "`gltf`") && umo_figure_name(0) == NULL);
    CHECK(refused(umo_clip_write_file(&clip, UMO_FORMAT_GLB, "motion.glb"), "`gltf`"));

    worker host = {.lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};
    pthread_t thread;
    CHECK(pthread_create(&thread, NULL, work, &host) == 0);
    umo_jobs jobs = {.userdata = &host, .submit = submit};
    config.mode = UMO_ENGINE_POLLED;
    config.threads = 2;
    config.jobs = &jobs;
    CHECK(umo_engine_new(model, &config, &lent) == UMO_STATUS_OK);
    enum { ROOM = 4 << 20 };
    char *alone = calloc(1, ROOM), *shared = calloc(1, ROOM);
    CHECK(alone && shared);
    size_t length = frames_of(engine, model, alone, ROOM);
    CHECK(length > 0 && frames_of(lent, model, shared, ROOM) == length && memcmp(alone, shared, length) == 0);

    pthread_mutex_lock(&host.lock);
    host.ends = 1;
    CHECK(host.jobs > 0);
    pthread_cond_signal(&host.changed);
    pthread_mutex_unlock(&host.lock);
    pthread_join(thread, NULL);
    CHECK(umo_engine_free(lent) == UMO_STATUS_OK && umo_engine_free(engine) == UMO_STATUS_OK && umo_model_free(model) == UMO_STATUS_OK);
    free(alone);
    free(shared);
    printf("polled: refused all it must, %d jobs lent, the same bits\n", host.jobs);
    return 0;
}
