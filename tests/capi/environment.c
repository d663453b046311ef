/* Hosts with a non-default floating-point environment (traps, another rounding mode, flushed denormals): frames keep
 * their bits, no exception is raised, and the host's environment is restored: `environment MODEL`. */

#define _GNU_SOURCE
#include <fenv.h>
#include <pthread.h>
#include <unistd.h>

#include "check.h"

enum { RATE = 24000, SAMPLES = RATE, FRAMES = 30, FLOATS = 3 + 4 * UMO_JOINT_COUNT + 52 + UMO_VISEME_COUNT };

/* The control register, exception flags included. */
#if defined(__x86_64__)
#include <xmmintrin.h>
typedef unsigned int control;
static control get(void) { return _mm_getcsr(); }
static void set(control value) { _mm_setcsr(value); }
/* Bits to flip: traps by cleared masks (invalid, denormal, divide by zero, overflow, underflow, inexact); the other
 * rounding modes; flush denormal results and inputs to zero. */
static const control flips[] = {0x80, 0x100, 0x200, 0x400, 0x800, 0x1000, 0x1f80, 0x2000, 0x4000, 0x6000, 0x8000, 0x40, 0xffc0};
#elif defined(__aarch64__)
typedef unsigned long control;
static control get(void) {
    control value, flags;
    __asm__ volatile("mrs %0, fpcr\n\tmrs %1, fpsr" : "=r"(value), "=r"(flags)::"memory");
    return value | flags << 32;
}
static void set(control value) {
    __asm__ volatile("msr fpcr, %0\n\tmsr fpsr, %1" ::"r"(value & 0xffffffff), "r"(value >> 32) : "memory");
}
/* As above; a processor without traps ignores the first seven. */
static const control flips[] = {0x100, 0x8000, 0x200, 0x400, 0x800, 0x1000, 0x9f00, 0x400000, 0x800000, 0xc00000, 0x1000000, 0x2000000, 0x3c09f00};
#else
typedef int control;
static control get(void) { return fegetround(); }
static void set(control value) { CHECK(fesetround(value) == 0); }
static const control flips[] = {FE_TONEAREST ^ FE_UPWARD, FE_TONEAREST ^ FE_DOWNWARD, FE_TONEAREST ^ FE_TOWARDZERO};
#endif

/* The test's own environment, and the one that the host calls with. */
static control ordinary, host;

/* A call made in the host's environment. */
#define STATUS(status, call)                                                                                           \
    do {                                                                                                               \
        set(host);                                                                                                     \
        umo_status got = (call);                                                                                       \
        control left = get();                                                                                          \
        set(ordinary);                                                                                                 \
        CHECK(got == (status));                                                                                        \
        CHECK(left == host);                                                                                           \
    } while (0)
#define CALL(call) STATUS(UMO_STATUS_OK, call)

typedef struct {
    float frames[FRAMES][FLOATS];
    float pose[FLOATS];
    uint64_t file;
} motion;

static float speech[SAMPLES];
static motion plain, other;

/* Threads lent by the host, with its environment. */
typedef struct {
    pthread_t threads[256];
    int count;
    void (*function)(void *context);
    void *context;
    control left;
} job_system;

static void *lent(void *argument) {
    job_system *jobs = argument;
    set(host);
    jobs->function(jobs->context);
    if (get() != host) jobs->left = get();
    set(ordinary);
    return NULL;
}

static void submit(void *userdata, void (*function)(void *context), void *context) {
    job_system *jobs = userdata;
    if (jobs->count == 256) return;
    jobs->function = function, jobs->context = context;
    CHECK(pthread_create(&jobs->threads[jobs->count++], NULL, lent, jobs) == 0);
}

static int32_t hash(void *userdata, const void *bytes, size_t size) {
    uint64_t *sum = userdata;
    for (size_t i = 0; i < size; i++) *sum = (*sum ^ ((const unsigned char *)bytes)[i]) * 0x100000001b3u;
    return 0;
}

static void move(umo_session *avatar) {
    const float point[3] = {0.5f, 1.6f, 2};
    size_t taken = 0;
    CALL(umo_session_set_parameter(avatar, UMO_PARAMETER_GAIN_HANDS, 1.1));
    CALL(umo_session_set_mood(avatar, UMO_MOOD_JOY, 0.3f));
    CALL(umo_session_look_at(avatar, UMO_AXES_GLTF, point, 0.7f));
    CALL(umo_session_play_gesture(avatar, "nod", NULL));
    /* A failing call. */
    STATUS(UMO_STATUS_INVALID_ARGUMENT, umo_session_set_mood(avatar, UMO_MOOD_JOY, NAN));
    for (size_t pushed = 0; pushed < SAMPLES; pushed += taken) {
        size_t rest = SAMPLES - pushed;
        CALL(umo_session_push_audio(avatar, speech + pushed, rest < 3000 ? rest : 3000, &taken));
    }
    CALL(umo_session_finish(avatar));
}

/* Pulls a session's frames; `engine` is polled if `is_polled`. */
static void pull(umo_engine *engine, int is_polled, umo_session *avatar, const umo_model *model, motion *to) {
    umo_frame_layout layout;
    CALL(umo_frame_layout_init(&layout, sizeof layout, model));
    layout.frame_stride = sizeof to->frames[0];
    layout.index = layout.sample = UMO_ABSENT;
    layout.translation = 0;
    layout.rotations = 3 * sizeof(float);
    layout.channels = (3 + 4 * UMO_JOINT_COUNT) * sizeof(float);
    layout.visemes = layout.channels + 52 * sizeof(float);
    for (size_t done = 0, count = 0; done < FRAMES; done += count) {
        uint32_t more = (uint32_t)is_polled;
        while (more) CALL(umo_engine_poll(engine, 1000000, &more));
        CALL(umo_session_pull_frames(avatar, &layout, to->frames[done], (FRAMES - done) * sizeof to->frames[0], &count));
        if (count == 0) usleep(1000);
    }
    CALL(umo_session_sample_pose(avatar, 0.719, &layout, to->pose, sizeof to->pose, NULL));
    umo_clip clip;
    CALL(umo_clip_init(&clip, sizeof clip, model));
    clip.layout = &layout, clip.frames = to->frames, clip.frame_count = FRAMES, clip.figure = NULL;
    umo_output output = {&to->file, hash};
    CALL(umo_clip_write(&clip, UMO_FORMAT_GLB, &output));
}

/* Motion of one kind of engine, created and used in the host's environment. */
static void animate(const umo_model *model, uint32_t mode, uint32_t threads, umo_jobs *jobs, uint32_t voice, motion *to) {
    umo_engine_config config;
    umo_session_config session_config;
    umo_engine *engine = NULL;
    umo_session *avatar = NULL;
    memset(to, 0, sizeof *to);
    CALL(umo_engine_config_init(&config, sizeof config));
    config.mode = mode, config.threads = threads, config.jobs = jobs;
    CALL(umo_engine_new(model, &config, &engine));
    CALL(umo_session_config_init(&session_config, sizeof session_config, model));
    session_config.sample_rate = RATE, session_config.voice = voice;
    CALL(umo_session_new(engine, &session_config, &avatar));
    move(avatar);
    pull(engine, mode == UMO_ENGINE_POLLED, avatar, model, to);
    CALL(umo_session_free(avatar));
    while (umo_engine_free(engine) == UMO_STATUS_BUSY) usleep(1000);
}

static void motion_is_plain(const umo_model *model) {
    job_system system = {.left = host};
    umo_jobs jobs = {&system, submit};
    animate(model, UMO_ENGINE_POLLED, 3, &jobs, UMO_VOICE_DELAYED, &other);
    CHECK(memcmp(&other, &plain, sizeof plain) == 0);
    CHECK(system.count > 0);
    for (int i = 0; i < system.count; i++) CHECK(pthread_join(system.threads[i], NULL) == 0);
    CHECK(system.left == host);
    animate(model, UMO_ENGINE_THREADS, 2, NULL, UMO_VOICE_DELAYED, &other);
    CHECK(memcmp(&other, &plain, sizeof plain) == 0);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    static motion live;
    speak(speech, SAMPLES, 0);
    ordinary = host = get();
    umo_model *model = load_model(argv[1]);
    animate(model, UMO_ENGINE_POLLED, 1, NULL, UMO_VOICE_DELAYED, &plain);
    animate(model, UMO_ENGINE_POLLED, 1, NULL, UMO_VOICE_LIVE, &live);
    motion_is_plain(model);
    for (size_t i = 0; i < sizeof flips / sizeof *flips; i++) {
        set(ordinary ^ flips[i]);
        host = get();
        set(ordinary);
        animate(model, UMO_ENGINE_POLLED, 1, NULL, UMO_VOICE_LIVE, &other);
        CHECK(memcmp(&other, &live, sizeof live) == 0);
    }
    /* Finally all flips at once: a model loaded in that environment, and lent threads that inherit it. */
    umo_model *own = NULL;
    CALL(umo_model_load(UMO_ABI_VERSION, argv[1], NULL, &own));
    motion_is_plain(own);
    CALL(umo_model_free(own));
    host = ordinary;
#if defined(__GLIBC__)
    /* The usual way for hosts to enable traps: in all units of the processor. */
    CHECK(feenableexcept(FE_ALL_EXCEPT) != -1);
    ordinary = host = get();
    motion_is_plain(model);
    CHECK(fegetexcept() == FE_ALL_EXCEPT || fegetexcept() == 0);
#endif
    CHECK(umo_model_free(model) == UMO_STATUS_OK);
    return 0;
}
