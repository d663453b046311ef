/* Each allocation of a call fails in turn, alone and together with all later ones: the call either succeeds or returns
 * OUT_OF_MEMORY, leaks nothing, and succeeds when repeated. The program's malloc (glibc) refuses allocations of the
 * library on any thread. `refused_memory MODEL SALUTE FOLDER [NAME]`: all calls, or those of a name. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *memory, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);
extern void __libc_free(void *memory);

enum { PLACES = 1 << 17, FRAMES = 45, NEVER = INT_MIN, ANY = 1 << 30 };

/* Address range of the library's code. */
static char *code_start, *code_end;
/* Blocks that the library holds. */
static void *places[PLACES];
static atomic_long held, calls, left = NEVER;
static atomic_int all_fail;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static size_t place_of(const void *piece) {
    size_t at = (size_t)((uintptr_t)piece / 16 * 0x9e3779b97f4a7c15u >> 47);
    while (places[at] && places[at] != piece) at = (at + 1) % PLACES;
    return at;
}

static void *keep(void *piece) {
    if (!piece) return NULL;
    pthread_mutex_lock(&lock);
    CHECK(atomic_fetch_add(&held, 1) < PLACES / 2);
    places[place_of(piece)] = piece;
    pthread_mutex_unlock(&lock);
    return piece;
}

static void forget(void *piece) {
    if (!piece || atomic_load(&held) == 0) return;
    pthread_mutex_lock(&lock);
    size_t at = place_of(piece);
    if (places[at]) {
        atomic_fetch_sub(&held, 1);
        /* Entries behind it may have hashed to this slot. */
        for (places[at] = NULL; places[at = (at + 1) % PLACES];) {
            void *moved = places[at];
            places[at] = NULL;
            places[place_of(moved)] = moved;
        }
    }
    pthread_mutex_unlock(&lock);
}

static int is_library(void *caller) { return (char *)caller >= code_start && (char *)caller < code_end; }

static int refuses(void *caller) {
    if (!is_library(caller)) return 0;
    atomic_fetch_add(&calls, 1);
    long before = atomic_load(&left);
    if (before == NEVER) return 0;
    before = atomic_fetch_sub(&left, 1);
    return before == 0 || (before < 0 && atomic_load(&all_fail));
}

#define CALLER __builtin_return_address(0)
#define GIVE(piece)                                                                                                    \
    void *caller = CALLER;                                                                                             \
    if (refuses(caller)) return NULL;                                                                                  \
    void *given = (piece);                                                                                             \
    return is_library(caller) ? keep(given) : given

void *malloc(size_t size) { GIVE(__libc_malloc(size)); }
void *calloc(size_t count, size_t size) { GIVE(__libc_calloc(count, size)); }
void *aligned_alloc(size_t alignment, size_t size) { GIVE(__libc_memalign(alignment, size)); }
int posix_memalign(void **memory, size_t alignment, size_t size) {
    if (refuses(CALLER)) return 12;
    *memory = __libc_memalign(alignment, size);
    if (is_library(CALLER)) keep(*memory);
    return *memory ? 0 : 12;
}
void *realloc(void *memory, size_t size) {
    if (refuses(CALLER)) return NULL;
    forget(memory);
    void *moved = __libc_realloc(memory, size);
    if (is_library(CALLER)) keep(moved);
    return moved;
}
void free(void *memory) {
    forget(memory);
    __libc_free(memory);
}

static const char *model_path, *folder;
static umo_model *model;
static umo_engine *engine;
static umo_clip clip;
static char salute[8192], frames[1 << 18];
static size_t salute_size;

static umo_status load(void) {
    umo_model *made = NULL;
    umo_status status = umo_model_load(UMO_ABI_VERSION, model_path, NULL, &made);
    CHECK((made != NULL) == (status == UMO_STATUS_OK));
    OK(umo_model_free(made));
    return status;
}

static umo_status engine_of(uint32_t mode, uint32_t threads) {
    umo_engine_config config;
    umo_engine *made = NULL;
    OK(umo_engine_config_init(&config, sizeof config));
    config.mode = mode;
    config.threads = threads;
    umo_status status = umo_engine_new(model, &config, &made);
    CHECK((made != NULL) == (status == UMO_STATUS_OK));
    OK(umo_engine_free(made));
    return status;
}

static umo_status polled(void) { return engine_of(UMO_ENGINE_POLLED, 1); }
static umo_status threaded(void) { return engine_of(UMO_ENGINE_THREADS, 2); }

/* The first session of a rate creates its filter. */
static umo_status session(void) {
    umo_session_config config;
    umo_session *made = NULL;
    umo_status status = umo_session_config_init(&config, sizeof config, model);
    if (status != UMO_STATUS_OK) return status;
    config.sample_rate = 44100;
    config.packets = UMO_PACKETS_BESIDE_FRAMES;
    status = umo_session_new(engine, &config, &made);
    CHECK((made != NULL) == (status == UMO_STATUS_OK));
    OK(umo_session_free(made));
    /* Another rate, so that the filter is created again. */
    config.sample_rate = 32000;
    if (status == UMO_STATUS_OK) status = umo_session_memory(engine, &config, NULL, NULL);
    return status;
}

static umo_status decoder(void) {
    umo_session *made = NULL;
    umo_status status = umo_decoder_new(model, NULL, &made);
    CHECK((made != NULL) == (status == UMO_STATUS_OK));
    OK(umo_session_free(made));
    return status;
}

static umo_status gesture(void) {
    static float rotations[31 * UMO_JOINT_COUNT][4];
    umo_gesture_clip given;
    for (size_t i = 0; i < 31 * UMO_JOINT_COUNT; i++) rotations[i][3] = 1;
    OK(umo_gesture_clip_init(&given, sizeof given));
    given.frame_count = 31;
    given.rotations = rotations[0];
    return umo_engine_add_gesture(engine, "own", &given);
}

static umo_status character(void) {
    return umo_engine_add_gesture_memory(engine, "salute", salute, salute_size, NULL, UMO_GESTURE_RIGHT_ARM, -1);
}

static umo_status prompt(void) {
    uint32_t ids[128];
    size_t count = 0;
    return umo_model_encode_text(model, "a person waves, and points at the door", 38, ids, 128, &count);
}

static int32_t ignore(void *userdata, const void *bytes, size_t size) {
    (void)userdata, (void)bytes, (void)size;
    return 0;
}

static umo_status written(uint32_t format, const char *figure) {
    umo_output output = {.write = ignore};
    umo_clip wanted = clip;
    wanted.figure = figure;
    return umo_clip_write(&wanted, format, &output);
}

static umo_status bones(void) { return written(UMO_FORMAT_GLB, NULL); }
static umo_status figure(void) { return written(UMO_FORMAT_GLB, "alex"); }
static umo_status vrma(void) { return written(UMO_FORMAT_VRMA, NULL); }

static umo_status file(void) {
    char path[4096];
    snprintf(path, sizeof path, "%s/clip.glb", folder);
    remove(path);
    umo_clip wanted = clip;
    wanted.figure = NULL;
    umo_status status = umo_clip_write_file(&wanted, UMO_FORMAT_GLB, path);
    FILE *there = fopen(path, "rb");
    CHECK((there != NULL) == (status == UMO_STATUS_OK));
    if (there) fclose(there);
    return status;
}

/* A call and its properties. */
typedef struct {
    const char *name;
    umo_status (*call)(void);
    /* Maximum number of allocations tried, evenly spread. */
    long most;
    /* Number of threads that it starts. */
    long threads;
    /* 2, or 1 to fail single allocations only. */
    int modes;
} subject;

/* Refuses one allocation of a call: the call succeeds or returns OUT_OF_MEMORY; then it succeeds, and nothing leaks.
 * For calls that start threads, blocks that threads free later do not count. */
static umo_status refuse(const subject *of, long number, int *reached) {
    long had = atomic_load(&held);
    atomic_store(&left, number);
    umo_status status = of->call();
    *reached = atomic_exchange(&left, NEVER) < 0;
    if (status != UMO_STATUS_OK && status != UMO_STATUS_OUT_OF_MEMORY) {
        fprintf(stderr, "%s, allocation %ld: %d (%s)\n", of->name, number, status, umo_last_error());
        exit(1);
    }
    CHECK(status == UMO_STATUS_OK || (*reached && strstr(umo_last_error(), "memory")));
    OK(of->call());
    if (atomic_load(&held) > had + 32 * of->threads) {
        fprintf(stderr, "%s, allocation %ld: %ld blocks leaked\n", of->name, number, atomic_load(&held) - had);
        exit(1);
    }
    return status;
}

/* As `refuse`, in a child process. Rust's standard library makes its own allocation for each thread that parks, and
 * aborts the process if it fails: -1. */
static umo_status refuse_in_child(const subject *of, long number, int *reached) {
    int status = 0;
    pid_t child = fork();
    CHECK(child >= 0);
    if (child == 0) {
        close(2);
        umo_status found = refuse(of, number, reached);
        _exit(10 + 2 * (found == UMO_STATUS_OK) + *reached);
    }
    CHECK(waitpid(child, &status, 0) == child);
    *reached = 1;
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT) return -1;
    CHECK(WIFEXITED(status) && WEXITSTATUS(status) >= 10 && WEXITSTATUS(status) <= 13);
    *reached = WEXITSTATUS(status) % 2;
    return WEXITSTATUS(status) < 12 ? UMO_STATUS_OUT_OF_MEMORY : UMO_STATUS_OK;
}

static void fail_each(subject of) {
    const long most = of.most, threads = of.threads;
    OK(of.call());
    long before = atomic_load(&calls), tried = 0, refused = 0, died = 0;
    OK(of.call());
    long count = atomic_load(&calls) - before;
    CHECK(count > 0);
    for (int all = 0; all < of.modes; all++) {
        atomic_store(&all_fail, all);
        for (long i = 0; i < (count < most ? count : most); i++) {
            long number = count < most ? i : i * count / most;
            int reached = 0;
            umo_status status = (threads ? refuse_in_child : refuse)(&of, number, &reached);
            tried += reached;
            refused += status == UMO_STATUS_OUT_OF_MEMORY;
            died += status == -1;
        }
    }
    OK(of.call());
    fprintf(stderr, "%s: %ld allocations, %ld refused, %ld calls failed, %ld processes ended\n", of.name, count, tried, refused, died);
    /* A block that cannot grow in place may be reallocated. */
    CHECK(2 * refused >= tried && died <= 8 * threads);
}

static void animate(void) {
    static umo_frame_layout layout;
    static float samples[24000];
    umo_session *avatar = NULL;
    size_t count = 0;
    speak(samples, 24000, 0);
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_push_audio(avatar, samples, 24000, NULL));
    OK(umo_session_finish(avatar));
    compute(engine);
    OK(umo_session_pull_frames(avatar, &layout, frames, sizeof frames, &count));
    OK(umo_session_free(avatar));
    OK(umo_clip_init(&clip, sizeof clip, model));
    clip.layout = &layout;
    clip.frames = frames;
    clip.frame_count = (uint32_t)count;
    CHECK(count == FRAMES);
}

/* Finds the library's range: from its first function to the end of its code, according to the process's memory map. */
static void find_library(void) {
    Dl_info found;
    union {
        const char *(*function)(void);
        void *pointer;
    } version = {umo_version};
    char line[4096], path[4096];
    unsigned long start, end;
    CHECK(dladdr(version.pointer, &found) && realpath(found.dli_fname, path));
    FILE *maps = fopen("/proc/self/maps", "r");
    CHECK(maps);
    while (fgets(line, sizeof line, maps)) {
        if (!strstr(line, path) || sscanf(line, "%lx-%lx", &start, &end) != 2) continue;
        if (!code_start) code_start = (char *)start;
        code_end = (char *)end;
    }
    fclose(maps);
    CHECK(code_start && (char *)version.pointer > code_start && (char *)version.pointer < code_end);
}

int main(int argc, char **argv) {
    CHECK(argc >= 4);
    model_path = argv[1];
    folder = argv[3];
    find_library();
    FILE *read = fopen(argv[2], "rb");
    CHECK(read && (salute_size = fread(salute, 1, sizeof salute, read)) > 1000 && fclose(read) == 0);
    /* The first call makes the once-per-process allocations; it must also fail cleanly without memory. */
    atomic_store(&left, 0);
    atomic_store(&all_fail, 1);
    umo_status first = load();
    atomic_store(&left, NEVER);
    CHECK(first == UMO_STATUS_OUT_OF_MEMORY);
    model = load_model(model_path);
    engine = polled_engine(model);
    animate();

    const subject subjects[] = {
        {"load", load, 100, sysconf(_SC_NPROCESSORS_ONLN), 2},
        {"polled engine", polled, 200, 0, 2},
        {"engine with threads", threaded, 60, 2, 2},
        {"session", session, ANY, 0, 2},
        {"decoder", decoder, 300, 0, 2},
        {"gesture", gesture, ANY, 0, 2},
        {"character", character, 300, 0, 2},
        {"prompt", prompt, ANY, 0, 2},
        {"clip of bones", bones, 200, 0, 2},
        {"clip for VRM", vrma, 200, 0, 2},
        {"clip in a file", file, 100, 0, 2},
        /* Its many lists exceed the reserve. */
        {"clip of a figure", figure, 4, 1, 1},
    };
    for (size_t i = 0; i < sizeof subjects / sizeof *subjects; i++)
        if (argc == 4 || strstr(subjects[i].name, argv[4])) fail_each(subjects[i]);
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    return 0;
}
