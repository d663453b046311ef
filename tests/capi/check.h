/* Shared by the C tests: a check that reports its location, a model, an engine, speech. */

#ifndef CHECK_H
#define CHECK_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "umo.h"

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: %s (%s)\n", __FILE__, __LINE__, #condition, umo_last_error());                     \
            exit(1);                                                                                                   \
        }                                                                                                              \
    } while (0)

#define OK(call) CHECK((call) == UMO_STATUS_OK)
#define FAILS(status, call) CHECK((call) == UMO_STATUS_##status)

/* Speech-like audio: a voice that comes and goes. */
static inline void speak(float *samples, size_t count, size_t start) {
    for (size_t i = 0; i < count; i++) {
        double t = (double)(start + i) / 16000.0;
        samples[i] = (float)(0.3 * sin(6.283 * 140.0 * t + 3.0 * sin(6.283 * 4.0 * t)) * (0.6 + 0.4 * sin(6.283 * 1.3 * t)));
    }
}

static inline umo_model *load_model(const char *path) {
    umo_model *model = NULL;
    OK(umo_model_load(UMO_ABI_VERSION, path, NULL, &model));
    return model;
}

static inline umo_engine *polled_engine(umo_model *model) {
    umo_engine_config config;
    umo_engine *engine = NULL;
    OK(umo_engine_config_init(&config, sizeof config));
    config.mode = UMO_ENGINE_POLLED;
    config.threads = 1;
    OK(umo_engine_new(model, &config, &engine));
    return engine;
}

static inline void compute(umo_engine *engine) {
    uint32_t more = 1;
    while (more) OK(umo_engine_poll(engine, 1000000, &more));
}

#endif
