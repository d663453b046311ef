/* Address space limits from nothing to plenty in small steps: loading a model, creating engines and sessions and
 * streaming either succeed or return OUT_OF_MEMORY; the process never aborts. */

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

/* An engine's own threads reserve a heap each, whose location, and so what is refused, varies from run to run. */
enum { STEP = 2 << 20, STEPS = 240 };

/* Result of a child: its exit code. */
enum { DONE = 10, NO_MODEL, NO_ENGINE, NO_SESSION, OUTCOMES };

/* Address space of this process in bytes. */
static size_t address_space(void) {
    size_t pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    CHECK(file != NULL && fscanf(file, "%zu", &pages) == 1);
    fclose(file);
    return pages * (size_t)sysconf(_SC_PAGESIZE);
}

static int refused(umo_status status, int outcome) {
    CHECK(status == UMO_STATUS_OUT_OF_MEMORY);
    CHECK(strstr(umo_last_error(), "memory") != NULL);
    return outcome;
}

/* A polling thread needs 1 MiB of stack, which the system commits on use. */
static void have_stack(void) {
    volatile char stack[1 << 20];
    for (size_t at = 0; at < sizeof stack; at += 1024)
        stack[at] = 0;
}

static int live(const char *path, size_t limit, int own_threads) {
    struct rlimit most = {limit, limit};
    umo_model *model = NULL;
    umo_engine *engine = NULL;
    umo_session *session = NULL;
    umo_engine_config config;
    static float samples[16000];
    umo_status status;

    have_stack();
    CHECK(setrlimit(RLIMIT_AS, &most) == 0);
    status = umo_model_load(UMO_ABI_VERSION, path, NULL, &model);
    if (status != UMO_STATUS_OK)
        return refused(status, NO_MODEL);
    OK(umo_engine_config_init(&config, sizeof config));
    config.mode = own_threads ? UMO_ENGINE_THREADS : UMO_ENGINE_POLLED;
    config.threads = 2;
    status = umo_engine_new(model, &config, &engine);
    if (status != UMO_STATUS_OK)
        return refused(status, NO_ENGINE);
    status = umo_session_new(engine, NULL, &session);
    if (status != UMO_STATUS_OK)
        return refused(status, NO_SESSION);
    speak(samples, 16000, 0);
    OK(umo_session_push_audio(session, samples, 16000, NULL));
    OK(umo_session_finish(session));
    if (!own_threads) {
        uint32_t more = 1;
        while (more)
            OK(umo_engine_poll(engine, 1000000, &more));
    }
    OK(umo_session_free(session));
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    return DONE;
}

int main(int count, char **arguments) {
    CHECK(count == 2);
    for (int own_threads = 0; own_threads < 2; own_threads++) {
        int seen[OUTCOMES] = {0};
        /* With threads, the limits lie between those without. */
        size_t start = address_space() + (own_threads ? STEP / 2 : 0);
        for (int step = 0; step < STEPS && seen[DONE] < 3; step++) {
            int status = 0;
            pid_t child = fork();
            CHECK(child >= 0);
            if (child == 0)
                _exit(live(arguments[1], start + (size_t)step * STEP, own_threads));
            CHECK(waitpid(child, &status, 0) == child);
            if (!WIFEXITED(status) || WEXITSTATUS(status) < DONE || WEXITSTATUS(status) >= OUTCOMES) {
                fprintf(stderr, "with %d KiB more the process ended with %x\n", step * (STEP >> 10), (unsigned)status);
                return 1;
            }
            seen[WEXITSTATUS(status)]++;
        }
        fprintf(stderr, "refused: %d models, %d engines, %d sessions; done: %d\n", seen[NO_MODEL], seen[NO_ENGINE],
                seen[NO_SESSION], seen[DONE]);
        /* Loading may temporarily need more than engine and session keep: then those are never refused. */
        CHECK(seen[NO_MODEL] > 0 && seen[DONE] > 0);
    }
    return 0;
}
