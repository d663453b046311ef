/* Nothing is allocated between creating a session and freeing it: this program's malloc counts (glibc). */

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <threads.h>

#include "check.h"

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *memory, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);
extern void __libc_free(void *memory);

/* Calls, and blocks not freed. */
static atomic_size_t calls, held;

void *malloc(size_t size) {
    atomic_fetch_add(&calls, 1);
    atomic_fetch_add(&held, 1);
    return __libc_malloc(size);
}
void *calloc(size_t count, size_t size) {
    atomic_fetch_add(&calls, 1);
    atomic_fetch_add(&held, 1);
    return __libc_calloc(count, size);
}
void *realloc(void *memory, size_t size) {
    atomic_fetch_add(&calls, 1);
    if (!memory) atomic_fetch_add(&held, 1);
    return __libc_realloc(memory, size);
}
void *aligned_alloc(size_t alignment, size_t size) {
    atomic_fetch_add(&calls, 1);
    atomic_fetch_add(&held, 1);
    return __libc_memalign(alignment, size);
}
int posix_memalign(void **memory, size_t alignment, size_t size) {
    atomic_fetch_add(&calls, 1);
    atomic_fetch_add(&held, 1);
    *memory = __libc_memalign(alignment, size);
    return *memory ? 0 : 12;
}
void free(void *memory) {
    if (memory) {
        atomic_fetch_add(&calls, 1);
        atomic_fetch_sub(&held, 1);
    }
    __libc_free(memory);
}

enum { SAMPLES = 16000 * 20 };

static umo_model *model;
static umo_session *avatar;
static float speech[SAMPLES];
static char frames[1 << 20];
static atomic_int ready;

/* The audio thread: its first calls too, valid and invalid ones. */
static void *audio(void *argument) {
    (void)argument;
    atomic_store(&ready, 1);
    while (atomic_load(&ready) != 2) sched_yield();
    size_t taken = 0;
    for (size_t pushed = 0; pushed < SAMPLES; pushed += taken) {
        OK(umo_session_push_audio(avatar, speech + pushed, 160, &taken));
        if (taken == 0) sched_yield();
        size_t none = 0;
        if (pushed % 16000 == 0) FAILS(INVALID_ARGUMENT, umo_session_push_audio(avatar, speech, SIZE_MAX, &none));
    }
    OK(umo_session_finish(avatar));
    FAILS(FINISHED, umo_session_push_audio(avatar, speech, 160, &taken));
    atomic_store(&ready, 3);
    while (atomic_load(&ready) != 4) sched_yield();
    return NULL;
}

/* The host's allocator: one block at a time, aligned to a cache line. */
static _Alignas(64) char room[8 << 20];
static int taken_room;

static void *take_room(void *userdata, size_t size, size_t alignment) {
    (void)userdata;
    CHECK(size <= sizeof room && 64 % alignment == 0 && !taken_room);
    taken_room = 1;
    return room;
}

static void give_room(void *userdata, void *memory, size_t size, size_t alignment) {
    (void)userdata, (void)size, (void)alignment;
    CHECK(memory == room && taken_room);
    taken_room = 0;
}

/* Waits until nothing is allocated any more: the engine's threads do so as they start. */
static void threads_start(void) {
    size_t before;
    do {
        before = atomic_load(&calls);
        thrd_sleep(&(struct timespec){.tv_nsec = 500000000}, NULL);
    } while (atomic_load(&calls) != before);
}

/* Sessions take all their memory from the host. The system allocator provides a rate's filter, once, and temporarily
 * two small blocks for reading the configuration. */
static void sessions_allocate_nothing(umo_engine *engine) {
    static const uint32_t rates[] = {16000, 48000, 44100};
    umo_allocator allocator = {NULL, take_room, give_room};
    for (uint32_t voice = UMO_VOICE_DELAYED; voice <= UMO_VOICE_MOUTH; voice++) {
        for (int i = 0; i < 3; i++) {
            umo_session_config config;
            umo_session *session = NULL;
            size_t size = 0;
            OK(umo_session_config_init(&config, sizeof config, model));
            config.sample_rate = rates[i];
            config.voice = voice;
            config.allocator = &allocator;
            umo_status known = umo_session_memory(engine, &config, &size, NULL);
            CHECK(known == UMO_STATUS_OK || voice != UMO_VOICE_DELAYED); /* not every model has a live mouth */
            if (known != UMO_STATUS_OK) return;
            size_t before = atomic_load(&calls), had = atomic_load(&held);
            OK(umo_session_memory(engine, &config, &size, NULL));
            CHECK(atomic_load(&held) == had && atomic_load(&calls) - before <= 4);
            OK(umo_session_new(engine, &config, &session));
            CHECK(taken_room && atomic_load(&held) == had && atomic_load(&calls) - before <= 8);
            before = atomic_load(&calls);
            OK(umo_session_free(session));
            CHECK(!taken_room && atomic_load(&calls) == before);
        }
    }
}

/* A character with a person's volume: the model's own skeleton. */
static umo_retarget *made_character(void) {
    static int32_t parents[UMO_JOINT_COUNT], joints[UMO_JOINT_COUNT];
    static float places[UMO_JOINT_COUNT][3], rotations[UMO_JOINT_COUNT][4];
    umo_rig rig;
    umo_retarget *character = NULL;
    OK(umo_model_get_skeleton(model, UMO_AXES_GLTF, parents, places[0], UMO_JOINT_COUNT));
    for (int joint = 0; joint < UMO_JOINT_COUNT; joint++) {
        for (int i = 0; i < 3 && parents[joint] >= 0; i++) places[joint][i] += places[parents[joint]][i];
        rotations[joint][3] = 1;
        joints[joint] = joint;
    }
    OK(umo_rig_init(&rig, sizeof rig));
    rig.bone_count = UMO_JOINT_COUNT;
    rig.parents = parents;
    rig.joints = joints;
    rig.places = places[0];
    rig.rotations = rotations[0];
    OK(umo_retarget_new(model, &rig, &character));
    return character;
}

static size_t pull(const umo_frame_layout *layout) {
    size_t count = 0;
    OK(umo_session_pull_frames(avatar, layout, frames, sizeof frames, &count));
    if (count == 0) sched_yield();
    return count;
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    speak(speech, SAMPLES, 0);
    size_t before = atomic_load(&calls);
    void *volatile something = malloc(10);
    free(something);
    CHECK(atomic_load(&calls) == before + 2); /* the counter counts */

    umo_engine *engine = NULL;
    umo_frame_layout layout;
    model = load_model(argv[1]);
    CHECK(atomic_load(&calls) > before + 100); /* the library's calls too */
    OK(umo_engine_new(model, NULL, &engine));
    threads_start();
    sessions_allocate_nothing(engine);
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    uint32_t ids[128];
    size_t id_count = 0;
    umo_status encoded = umo_model_encode_text(model, "a person waves", 14, ids, 128, &id_count);
    CHECK(encoded == UMO_STATUS_OK || encoded == UMO_STATUS_UNSUPPORTED);
    umo_retarget *character = made_character();
    pthread_t thread;
    CHECK(pthread_create(&thread, NULL, audio, NULL) == 0);
    while (atomic_load(&ready) != 1) sched_yield();

    before = atomic_load(&calls);
    atomic_store(&ready, 2);
    size_t shown = 0;
    umo_latency latency = {.struct_size = sizeof latency};
    umo_stats stats = {.struct_size = sizeof stats};
    char text[UMO_ERROR_SIZE];
    double value;
    while (shown < 20 * 30) {
        shown += pull(&layout);
        OK(umo_session_set_parameter(avatar, UMO_PARAMETER_GAIN_HANDS, 0.5));
        OK(umo_session_get_parameter(avatar, UMO_PARAMETER_TEMPERATURE, &value));
        OK(umo_session_set_prompt_ids(avatar, ids, id_count));
        OK(umo_session_set_seed(avatar, shown));
        const float place[3] = {(float)(shown % 3), 1.5f, 2};
        OK(umo_session_look_at(avatar, UMO_AXES_GLTF, place, 1));
        FAILS(INVALID_ARGUMENT, umo_session_look_at(avatar, UMO_AXES_GLTF, place, 2));
        OK(umo_session_set_mood(avatar, (uint32_t)shown % 7, 0.5f));
        umo_status hinted = umo_session_hint_lips(avatar, (uint32_t)shown % 3, (double)shown / 30, 0.1);
        CHECK(hinted == UMO_STATUS_OK || hinted == UMO_STATUS_BUSY);
        umo_status said = umo_session_hint_words(avatar, "Hello, no!", (double)shown / 30, (double)shown / 30 + 0.5);
        CHECK(said == UMO_STATUS_OK || said == UMO_STATUS_BUSY);
        OK(umo_session_set_parameter(avatar, UMO_PARAMETER_ATTENTION, (double)(shown % 5)));
        OK(umo_session_push_other_audio(avatar, speech, 533));
        umo_status played = umo_session_play_gesture(avatar, "wave", NULL);
        CHECK(played == UMO_STATUS_OK || played == UMO_STATUS_BUSY); /* eight wait */
        FAILS(INVALID_ARGUMENT, umo_session_play_gesture(avatar, "no such gesture", NULL));
        OK(umo_session_latency(avatar, &latency));
        OK(umo_session_stats(avatar, &stats));
        FAILS(INVALID_ARGUMENT, umo_session_set_parameter(avatar, 1000, 0));
        static float bones[4 * UMO_JOINT_COUNT];
        const char *frame = frames;
        OK(umo_retarget_set_step(character, 1 / 60.0f));
        OK(umo_retarget_apply(character, (const float *)(const void *)(frame + layout.rotations),
                              (const float *)(const void *)(frame + layout.translation), UMO_JOINT_COUNT, bones, NULL));
        umo_status asked = umo_session_last_error(avatar, text, sizeof text, NULL);
        CHECK(asked == UMO_STATUS_OK || asked == UMO_STATUS_BUSY); /* the audio thread is just failing */
        /* A past time takes no frame. */
        if (shown > 0) OK(umo_session_sample_pose(avatar, 0, &layout, frames, sizeof frames, NULL));
    }
    while (atomic_load(&ready) != 3) sched_yield();
    OK(umo_session_interrupt(avatar, 200));
    OK(umo_session_reset(avatar));
    size_t taken = 0;
    OK(umo_session_push_audio(avatar, speech, 32000, &taken));
    OK(umo_session_finish(avatar));
    for (shown = 0; shown < 60;) shown += pull(&layout);
    CHECK(atomic_load(&calls) == before);

    atomic_store(&ready, 4);
    CHECK(pthread_join(thread, NULL) == 0);
    OK(umo_retarget_free(character));
    OK(umo_session_free(avatar));
    OK(umo_engine_free(engine));
    OK(umo_model_free(model));
    return 0;
}
