/* Lifecycle of the library: loaded twice, unloaded, forked (except on Windows), objects created and freed a thousand
   times. `lifecycle LIBRARY COPY MODEL` */

#define _GNU_SOURCE
#ifdef _WIN32
#define UMO_API
#include <windows.h>
#else
#include <dlfcn.h>
#include <sys/wait.h>
#include <unistd.h>
#endif

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umo.h"

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #condition);                                            \
            exit(1);                                                                                                   \
        }                                                                                                              \
    } while (0)

/* Functions of one copy of the library. */
typedef struct {
    void *library;
    umo_status (*model_load)(uint32_t, const char *, const umo_model_config *, umo_model **);
    umo_status (*model_free)(umo_model *);
    umo_status (*engine_new)(const umo_model *, const umo_engine_config *, umo_engine **);
    umo_status (*engine_free)(umo_engine *);
    umo_status (*session_new)(umo_engine *, const umo_session_config *, umo_session **);
    umo_status (*session_free)(umo_session *);
    umo_status (*push)(umo_session *, const float *, size_t, size_t *);
    umo_status (*finish)(umo_session *);
    umo_status (*ready)(umo_session *, size_t *);
} functions;

#ifdef _WIN32
static void *load(const char *path) { return LoadLibraryA(path); }
static void *find(void *library, const char *name) {
    union {
        FARPROC function;
        void *pointer;
    } found = {GetProcAddress(library, name)};
    return found.pointer;
}
static int unload(void *library) { return FreeLibrary(library) ? 0 : -1; }
static void pause_ms(unsigned ms) { Sleep(ms); }
#else
static void *load(const char *path) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) fprintf(stderr, "%s\n", dlerror());
    return library;
}
static void *find(void *library, const char *name) { return dlsym(library, name); }
static int unload(void *library) { return dlclose(library); }
static void pause_ms(unsigned ms) { usleep(1000 * ms); }
#endif

static functions open_library(const char *path) {
    functions f;
    f.library = load(path);
    CHECK(f.library);
#define GET(field, name) CHECK((*(void **)(&f.field) = find(f.library, name)))
    GET(model_load, "umo_model_load");
    GET(model_free, "umo_model_free");
    GET(engine_new, "umo_engine_new");
    GET(engine_free, "umo_engine_free");
    GET(session_new, "umo_session_new");
    GET(session_free, "umo_session_free");
    GET(push, "umo_session_push_audio");
    GET(finish, "umo_session_finish");
    GET(ready, "umo_session_ready_frames");
    return f;
}

/* Whether any part of a file is mapped into this process. */
static int is_mapped(const char *path) {
    int found = 0;
#ifdef __linux__
    char line[4096];
    FILE *maps = fopen("/proc/self/maps", "r");
    CHECK(maps);
    while (fgets(line, sizeof line, maps)) found |= strstr(line, path) != NULL;
    fclose(maps);
#else
    (void)path;
#endif
    return found;
}

static float speech[16000];

/* A second of speech through a library, from set-up to tear-down. */
static void talk(const functions *f, const char *path) {
    umo_model *model = NULL;
    umo_engine *engine = NULL;
    umo_session *avatar = NULL;
    CHECK(f->model_load(UMO_ABI_VERSION, "/no/such/file", NULL, &model) == UMO_STATUS_IO);
    CHECK(f->engine_new(model, NULL, &engine) == UMO_STATUS_NULL_POINTER);
    CHECK(f->session_new(engine, NULL, &avatar) == UMO_STATUS_NULL_POINTER);
    CHECK(f->model_load(UMO_ABI_VERSION, path, NULL, &model) == UMO_STATUS_OK);
    CHECK(f->engine_new(model, NULL, &engine) == UMO_STATUS_OK);
    CHECK(f->session_new(engine, NULL, &avatar) == UMO_STATUS_OK);
    CHECK(f->push(avatar, speech, 16000, NULL) == UMO_STATUS_OK && f->finish(avatar) == UMO_STATUS_OK);
    for (size_t ready = 0; ready < 30;) {
        CHECK(f->ready(avatar, &ready) == UMO_STATUS_OK);
        pause_ms(1);
    }
    CHECK(f->session_free(avatar) == UMO_STATUS_OK);
    CHECK(f->engine_free(engine) == UMO_STATUS_OK);
    CHECK(f->model_free(model) == UMO_STATUS_OK);
}

int main(int argc, char **argv) {
    CHECK(argc == 4);
    for (size_t i = 0; i < 16000; i++) speech[i] = 0.2f * sinf((float)i * 0.05f);

    /* Two copies at once are independent. */
    functions first = open_library(argv[1]), second = open_library(argv[2]);
    CHECK(first.model_load != second.model_load);
    talk(&first, argv[3]);
    talk(&second, argv[3]);
    umo_model *model = NULL;
    CHECK(first.model_load(UMO_ABI_VERSION, argv[3], NULL, &model) == UMO_STATUS_OK);
    CHECK(second.model_free(model) == UMO_STATUS_INVALID_HANDLE);

    /* A child of a program with an engine can free what it inherited and start again. */
    umo_engine *engine = NULL;
    umo_session *avatar = NULL;
    CHECK(first.engine_new(model, NULL, &engine) == UMO_STATUS_OK);
    CHECK(first.session_new(engine, NULL, &avatar) == UMO_STATUS_OK);
#ifndef _WIN32
    pid_t child = fork();
    CHECK(child >= 0);
    if (child == 0) {
        CHECK(first.push(avatar, speech, 16000, NULL) == UMO_STATUS_OK);
        CHECK(first.session_free(avatar) == UMO_STATUS_OK);
        CHECK(first.engine_free(engine) == UMO_STATUS_OK);
        CHECK(first.model_free(model) == UMO_STATUS_OK);
        talk(&first, argv[3]);
        _exit(0);
    }
    int status = 1;
    CHECK(waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0);
#endif
    CHECK(first.push(avatar, speech, 16000, NULL) == UMO_STATUS_OK);

    /* Created and freed, idle and in the middle of a chunk. */
    for (int i = 0; i < 1000; i++) {
        umo_session *one = NULL;
        CHECK(first.session_new(engine, NULL, &one) == UMO_STATUS_OK);
        if (i % 3 == 0) CHECK(first.push(one, speech, 16000, NULL) == UMO_STATUS_OK);
        CHECK(first.session_free(one) == UMO_STATUS_OK);
    }
    CHECK(first.session_free(avatar) == UMO_STATUS_OK);
    CHECK(first.engine_free(engine) == UMO_STATUS_OK);
    CHECK(first.model_free(model) == UMO_STATUS_OK);

    /* Unloaded while idle, and loaded again. */
    for (int i = 0; i < 5; i++) {
        CHECK(unload(second.library) == 0 && !is_mapped(argv[2]));
        second = open_library(argv[2]);
        talk(&second, argv[3]);
    }
    CHECK(unload(second.library) == 0);
    CHECK(unload(first.library) == 0 && !is_mapped(argv[1]));
    return 0;
}
