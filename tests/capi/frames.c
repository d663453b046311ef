/* Frames in a game's own structures, in each engine's axes; gains; sampling; the host's allocator and threads; a
   priority that the system refuses. */

#define _GNU_SOURCE
#include <pthread.h>

#if defined(__linux__) && !defined(__ANDROID__)
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#endif

#include "check.h"

/* The Windows C library has no aligned memory that free() accepts. */
#ifdef _WIN32
#include <malloc.h>
#define aligned_alloc(alignment, size) _aligned_malloc(size, alignment)
#define aligned_free(memory) _aligned_free(memory)
#else
#define aligned_free(memory) free(memory)
#endif

enum { SECONDS = 4, SAMPLES = 16000 * SECONDS, FRAMES = 30 * SECONDS };

/* A skeleton as one engine might store it, and a face as another might. */
typedef struct {
    char name[8];
    float place[3];
    float rotation[4];
    float scale;
} bone;

typedef struct {
    uint64_t number;
    bone bones[UMO_JOINT_COUNT];
    struct {
        float weight;
        int dirty;
    } morphs[52];
    float root[3];
    float visemes[UMO_VISEME_COUNT];
    uint64_t sample;
} game_frame;

static umo_model *model;
static float speech[SAMPLES];

static umo_frame_layout game_layout(uint32_t axes) {
    umo_frame_layout layout;
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    layout.axes = axes;
    layout.frame_stride = sizeof(game_frame);
    layout.index = offsetof(game_frame, number);
    layout.sample = offsetof(game_frame, sample);
    layout.translation = offsetof(game_frame, root);
    layout.rotations = offsetof(game_frame, bones) + offsetof(bone, rotation);
    layout.rotation_stride = sizeof(bone);
    layout.channels = offsetof(game_frame, morphs);
    layout.channel_stride = 8;
    layout.visemes = offsetof(game_frame, visemes);
    return layout;
}

static void run(umo_engine *engine, umo_session *avatar, const umo_frame_layout *layout, game_frame *frames) {
    memset(frames, 0x5a, FRAMES * sizeof *frames);
    size_t taken = 0, count = 0, done = 0;
    for (size_t pushed = 0; pushed < SAMPLES; pushed += taken) {
        OK(umo_session_push_audio(avatar, speech + pushed, SAMPLES - pushed < 4800 ? SAMPLES - pushed : 4800, &taken));
    }
    OK(umo_session_finish(avatar));
    while (done < FRAMES) {
        compute(engine);
        OK(umo_session_pull_frames(avatar, layout, frames + done, (FRAMES - done) * sizeof *frames, &count));
        done += count;
    }
}

/* Frames of a new session. */
static void fresh(umo_engine *engine, const umo_session_config *config, uint32_t axes, game_frame *frames) {
    umo_session *avatar = NULL;
    umo_frame_layout layout = game_layout(axes);
    OK(umo_session_new(engine, config, &avatar));
    run(engine, avatar, &layout, frames);
    OK(umo_session_free(avatar));
}

static game_frame plain[FRAMES], other[FRAMES];

static void frames_lie_where_they_are_wanted(umo_engine *engine) {
    fresh(engine, NULL, UMO_AXES_GLTF, plain);
    for (size_t i = 0; i < FRAMES; i++) {
        CHECK(plain[i].number == i && plain[i].sample == i * 16000 / 30);
        float sum = 0;
        for (size_t v = 0; v < UMO_VISEME_COUNT; v++) sum += plain[i].visemes[v];
        CHECK(fabsf(sum - 1) < 1e-4f);
        for (size_t j = 0; j < UMO_JOINT_COUNT; j++) {
            const float *q = plain[i].bones[j].rotation;
            CHECK(fabsf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1) < 1e-5f);
            /* Bytes outside the layout were left alone. */
            for (size_t b = 0; b < sizeof plain[i].bones[j].name; b++) CHECK(plain[i].bones[j].name[b] == 0x5a);
        }
        for (size_t m = 0; m < 52; m++) {
            CHECK(plain[i].morphs[m].weight >= 0 && plain[i].morphs[m].weight <= 1 && plain[i].morphs[m].dirty == 0x5a5a5a5a);
        }
    }
    /* With every value absent, nothing is written. */
    umo_session *avatar = NULL;
    umo_frame_layout layout = game_layout(UMO_AXES_GLTF);
    layout.index = layout.sample = layout.translation = layout.rotations = layout.channels = layout.visemes = UMO_ABSENT;
    OK(umo_session_new(engine, NULL, &avatar));
    run(engine, avatar, &layout, other);
    for (size_t i = 0; i < sizeof other; i++) CHECK(((const char *)other)[i] == 0x5a);
    OK(umo_session_free(avatar));
}

static void axes_are_each_engine_s(umo_engine *engine) {
    fresh(engine, NULL, UMO_AXES_UNREAL, other);
    for (size_t i = 0; i < FRAMES; i++) {
        const float *p = plain[i].root, *u = other[i].root;
        CHECK(u[0] == 100 * p[2] && u[1] == -100 * p[0] && u[2] == 100 * p[1]);
        const float *q = plain[i].bones[15].rotation, *r = other[i].bones[15].rotation;
        CHECK(r[0] == -q[2] && r[1] == q[0] && r[2] == -q[1] && r[3] == q[3]);
    }
    fresh(engine, NULL, UMO_AXES_UNITY, other);
    for (size_t i = 0; i < FRAMES; i++) {
        const float *p = plain[i].root, *u = other[i].root;
        CHECK(u[0] == -p[0] && u[1] == p[1] && u[2] == p[2]);
        const float *q = plain[i].bones[15].rotation, *r = other[i].bones[15].rotation;
        CHECK(r[0] == q[0] && r[1] == -q[1] && r[2] == -q[2] && r[3] == q[3]);
    }
}

static void gains_still_a_part(umo_engine *engine) {
    umo_session *avatar = NULL;
    umo_frame_layout layout = game_layout(UMO_AXES_GLTF);
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_set_parameter(avatar, UMO_PARAMETER_GAIN_FACE, 0));
    OK(umo_session_set_parameter(avatar, UMO_PARAMETER_GAIN_LOWER, 0));
    run(engine, avatar, &layout, other);
    float most = 0;
    for (size_t i = 1; i < FRAMES; i++) {
        for (size_t m = 0; m < 52; m++) CHECK(other[i].morphs[m].weight == other[0].morphs[m].weight);
        CHECK(memcmp(other[i].bones[22].rotation, other[0].bones[22].rotation, 16) == 0);
        CHECK(memcmp(other[i].bones[1].rotation, other[0].bones[1].rotation, 16) == 0);
        CHECK(memcmp(other[i].root, other[0].root, 12) == 0);
        /* Arms and fingers are unchanged. */
        CHECK(memcmp(other[i].bones[18].rotation, plain[i].bones[18].rotation, 16) == 0);
        CHECK(memcmp(other[i].bones[40].rotation, plain[i].bones[40].rotation, 16) == 0);
        for (size_t m = 0; m < 52; m++) most = fmaxf(most, fabsf(plain[i].morphs[m].weight - other[i].morphs[m].weight));
    }
    CHECK(most > 0);
    OK(umo_session_free(avatar));
}

static void poses_lie_between_frames(umo_engine *engine) {
    umo_session *avatar = NULL;
    umo_frame_layout layout = game_layout(UMO_AXES_GLTF);
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_push_audio(avatar, speech, 32000, NULL));
    compute(engine);
    umo_sampled sampled = {.struct_size = sizeof sampled};
    game_frame pose;
    for (size_t i = 0; i < 40; i++) {
        OK(umo_session_sample_pose(avatar, ((double)i + 0.5) / 30, &layout, &pose, sizeof pose, &sampled));
        CHECK(!sampled.is_ahead && sampled.newest > sampled.oldest);
        float between = 0.5f * (plain[i].root[1] + plain[i + 1].root[1]);
        CHECK(fabsf(pose.root[1] - between) < 1e-5f);
    }
    OK(umo_session_sample_pose(avatar, 100, &layout, &pose, sizeof pose, &sampled));
    CHECK(sampled.is_ahead);
    OK(umo_session_free(avatar));
}

/* A device with a latency of an eighth of a second shows the pose from that much earlier; pulled frames are the
   same. */
static void an_output_device_may_be_late(umo_engine *engine) {
    umo_session *avatar = NULL, *late = NULL;
    umo_frame_layout layout = game_layout(UMO_AXES_GLTF);
    double delay = 1;
    umo_sampled sampled = {.struct_size = sizeof sampled};
    static game_frame pose, late_pose;
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_new(engine, NULL, &late));
    OK(umo_session_get_parameter(late, UMO_PARAMETER_OUTPUT_DELAY, &delay));
    CHECK(delay == 0);
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(late, UMO_PARAMETER_OUTPUT_DELAY, 2.5));
    FAILS(INVALID_ARGUMENT, umo_session_set_parameter(late, UMO_PARAMETER_OUTPUT_DELAY, -0.125));
    OK(umo_session_set_parameter(late, UMO_PARAMETER_OUTPUT_DELAY, 0.125));
    OK(umo_session_get_parameter(late, UMO_PARAMETER_OUTPUT_DELAY, &delay));
    CHECK(delay == 0.125);
    OK(umo_session_push_audio(avatar, speech, 32000, NULL));
    OK(umo_session_push_audio(late, speech, 32000, NULL));
    compute(engine);
    for (size_t i = 0; i < 64; i++) {
        double seconds = (double)i / 64;
        OK(umo_session_sample_pose(avatar, seconds, &layout, &pose, sizeof pose, NULL));
        OK(umo_session_sample_pose(late, seconds + 0.125, &layout, &late_pose, sizeof late_pose, &sampled));
        CHECK(!sampled.is_ahead && memcmp(&pose, &late_pose, sizeof pose) == 0);
    }
    OK(umo_session_free(avatar));
    OK(umo_session_free(late));
    umo_session_config config;
    OK(umo_session_config_init(&config, sizeof config, model));
    OK(umo_session_new(engine, &config, &late));
    OK(umo_session_set_parameter(late, UMO_PARAMETER_OUTPUT_DELAY, 0.125));
    run(engine, late, &layout, other);
    CHECK(memcmp(other, plain, sizeof plain) == 0);
    OK(umo_session_free(late));
}

typedef struct {
    size_t size, alignment;
    int allocated, released;
    void *memory;
} pool;

static void *pool_allocate(void *userdata, size_t size, size_t alignment) {
    pool *p = userdata;
    CHECK(p->memory == NULL && alignment >= 8 && (alignment & (alignment - 1)) == 0);
    p->allocated++;
    p->size = size;
    p->alignment = alignment;
    p->memory = aligned_alloc(alignment, size);
    memset(p->memory, 0xcd, size);
    return p->memory;
}

static void pool_release(void *userdata, void *memory, size_t size, size_t alignment) {
    pool *p = userdata;
    CHECK(memory == p->memory && size == p->size && alignment == p->alignment);
    p->released++;
    p->memory = NULL;
    aligned_free(memory);
}

static void *no_memory(void *userdata, size_t size, size_t alignment) {
    (void)userdata, (void)size, (void)alignment;
    return NULL;
}

static void memory_is_the_host_s(umo_engine *engine) {
    umo_session_config config;
    pool counted = {0};
    umo_allocator allocator = {&counted, pool_allocate, pool_release};
    for (uint32_t rate = 16000; rate <= 48000; rate += 16000) {
        OK(umo_session_config_init(&config, sizeof config, model));
        size_t size = 0, alignment = 0;
        config.sample_rate = rate;
        OK(umo_session_memory(engine, &config, &size, &alignment));
        counted = (pool){0};
        config.allocator = &allocator;
        umo_session *avatar = NULL;
        OK(umo_session_new(engine, &config, &avatar));
        CHECK(counted.allocated == 1 && counted.size == size && counted.alignment == alignment);
        CHECK(size > 100000 && size < 8000000);
        if (rate == 16000) {
            umo_frame_layout layout = game_layout(UMO_AXES_GLTF);
            run(engine, avatar, &layout, other);
            CHECK(memcmp(other, plain, sizeof plain) == 0);
        }
        CHECK(counted.released == 0);
        OK(umo_session_free(avatar));
        CHECK(counted.allocated == 1 && counted.released == 1);
    }
    umo_allocator empty = {NULL, no_memory, pool_release};
    config.allocator = &empty;
    umo_session *none = NULL;
    FAILS(OUT_OF_MEMORY, umo_session_new(engine, &config, &none));
    CHECK(none == NULL);
}

/* A job system of two threads, one of which starts slowly. */
typedef struct {
    pthread_t threads[64];
    int count;
} job_system;

typedef struct {
    void (*job)(void *context);
    void *context;
} job;

static void *run_job(void *argument) {
    job *j = argument;
    j->job(j->context);
    free(j);
    return NULL;
}

static void submit(void *userdata, void (*function)(void *context), void *context) {
    job_system *jobs = userdata;
    job *j = malloc(sizeof *j);
    *j = (job){function, context};
    if (jobs->count == 64) {
        free(j); /* a host that is too busy drops jobs */
        return;
    }
    /* The minimum stack size that umo.h requires. */
    pthread_attr_t attributes;
    CHECK(pthread_attr_init(&attributes) == 0 && pthread_attr_setstacksize(&attributes, 1 << 20) == 0);
    CHECK(pthread_create(&jobs->threads[jobs->count++], &attributes, run_job, j) == 0);
    pthread_attr_destroy(&attributes);
}

static int submitted;

/* A job system that runs jobs where they are submitted; polling there is refused. */
static void run_now(void *userdata, void (*function)(void *context), void *context) {
    CHECK(umo_engine_poll(*(umo_engine **)userdata, 0, NULL) == UMO_STATUS_BUSY);
    function(context);
    submitted++;
}

static void threads_are_the_host_s(void) {
    umo_engine_config config;
    umo_engine *engine = NULL;
    job_system system = {.count = 0};
    umo_jobs jobs = {&system, submit};
    OK(umo_engine_config_init(&config, sizeof config));
    config.mode = UMO_ENGINE_POLLED;
    config.threads = 3;
    config.jobs = &jobs;
    OK(umo_engine_new(model, &config, &engine));
    fresh(engine, NULL, UMO_AXES_GLTF, other);
    CHECK(memcmp(other, plain, sizeof plain) == 0);
    CHECK(system.count > 0);
    for (int i = 0; i < system.count; i++) CHECK(pthread_join(system.threads[i], NULL) == 0);
    OK(umo_engine_free(engine));

    jobs = (umo_jobs){&engine, run_now};
    OK(umo_engine_new(model, &config, &engine));
    fresh(engine, NULL, UMO_AXES_GLTF, other);
    CHECK(memcmp(other, plain, sizeof plain) == 0);
    CHECK(submitted > 0);
    OK(umo_engine_free(engine));
}

static char *said[64];
static int lines;

static void keep(void *userdata, uint32_t level, const char *message) {
    CHECK(userdata == (void *)said && level >= UMO_LOG_INFO && level <= UMO_LOG_ERROR && lines < 64);
    said[lines] = malloc(strlen(message) + 1);
    strcpy(said[lines++], message);
}

static void the_log_is_told(const char *path) {
    umo_log log = {said, keep};
    umo_model_config config;
    umo_engine_config engine_config;
    umo_session_config session_config;
    umo_model *loud = NULL;
    umo_engine *engine = NULL;
    umo_session *none = NULL;
    OK(umo_model_config_init(&config, sizeof config));
    config.log = &log;
    OK(umo_model_load(UMO_ABI_VERSION, path, &config, &loud));
    CHECK(lines >= 1 && strstr(said[0], "loaded"));
    OK(umo_engine_config_init(&engine_config, sizeof engine_config));
    engine_config.log = &log;
    OK(umo_engine_new(loud, &engine_config, &engine));
    int before = lines;
    OK(umo_session_config_init(&session_config, sizeof session_config, loud));
    session_config.channels = 0;
    FAILS(INVALID_ARGUMENT, umo_session_new(engine, &session_config, &none));
    CHECK(lines == before + 1 && strstr(said[before], "channels"));
    uint32_t ids[128];
    size_t count = 0;
    umo_session *avatar = NULL;
    OK(umo_session_new(engine, NULL, &avatar));
    before = lines;
    OK(umo_model_encode_text(loud, "joyful", 6, ids, 128, &count));
    OK(umo_session_set_prompt(avatar, "joyful", 6));
    CHECK(lines == before);
    OK(umo_model_encode_text(loud, "a backflip", 10, ids, 128, &count));
    OK(umo_session_set_prompt(avatar, "a backflip", 10));
    CHECK(lines == before + 2 && strstr(said[before], "not trained with the prompt `a backflip`"));
    CHECK(strstr(said[before + 1], "a backflip") && strstr(said[before + 1], "joyful"));
    OK(umo_session_free(avatar));
    OK(umo_model_free(loud));
    OK(umo_engine_free(engine));
    while (lines > 0) free(said[--lines]);
}

/* As a user without the privilege, in a separate process that drops it. */
static void a_refused_priority_is_told(void) {
#if defined(__linux__) && !defined(__ANDROID__)
    enum { NOBODY = 65534 };
    pid_t child = fork();
    CHECK(child >= 0);
    if (child == 0) {
        const struct rlimit none = {0, 0};
        CHECK(setrlimit(RLIMIT_NICE, &none) == 0 && (geteuid() != 0 || setuid(NOBODY) == 0));
        umo_log log = {said, keep};
        umo_engine_config config;
        umo_engine *engine = NULL;
        OK(umo_engine_config_init(&config, sizeof config));
        config.log = &log;
        config.priority = UMO_PRIORITY_HIGH;
        OK(umo_engine_new(model, &config, &engine));
        CHECK(lines == 2 && strstr(said[0], "priority 1: the system refuses it") && strstr(said[0], "ulimit -e 30"));
        config.priority = UMO_PRIORITY_LOW;
        OK(umo_engine_free(engine));
        lines = 0;
        OK(umo_engine_new(model, &config, &engine));
        CHECK(lines == 1 && strstr(said[0], "engine of "));
        _exit(0);
    }
    int status = 1;
    CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
#endif
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    speak(speech, SAMPLES, 0);
    model = load_model(argv[1]);
    umo_engine *engine = polled_engine(model);
    frames_lie_where_they_are_wanted(engine);
    axes_are_each_engine_s(engine);
    gains_still_a_part(engine);
    poses_lie_between_frames(engine);
    an_output_device_may_be_late(engine);
    memory_is_the_host_s(engine);
    threads_are_the_host_s();
    the_log_is_told(argv[1]);
    a_refused_priority_is_told();
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    return 0;
}
