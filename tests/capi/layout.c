/* Structure sizes and offsets on a 64-bit machine, printed for comparison with the bindings. */

#include "check.h"

#define FIELD(type, field, at) _Static_assert(offsetof(type, field) == (at), #type "." #field)
#define SIZE(type, bytes) _Static_assert(sizeof(type) == (bytes), #type)

#if UINTPTR_MAX == UINT64_MAX
SIZE(umo_model_config, 24);
FIELD(umo_model_config, isa, 8);
FIELD(umo_model_config, log, 16);
SIZE(umo_model_info, 72);
FIELD(umo_model_info, keyframe_stride, 24);
FIELD(umo_model_info, file_size, 56);
FIELD(umo_model_info, has_mouth, 64);
SIZE(umo_engine_config, 56);
FIELD(umo_engine_config, cores, 24);
FIELD(umo_engine_config, jobs, 32);
FIELD(umo_engine_config, log, 40);
FIELD(umo_engine_config, priority, 48);
FIELD(umo_engine_config, gather_ms, 52);
SIZE(umo_session_config, 88);
FIELD(umo_session_config, voice, 36);
FIELD(umo_session_config, seed, 40);
FIELD(umo_session_config, template_name, 48);
FIELD(umo_session_config, allocator, 56);
FIELD(umo_session_config, smoothing, 64);
FIELD(umo_session_config, guidance, 68);
FIELD(umo_session_config, horizon, 72);
FIELD(umo_session_config, packets, 76);
FIELD(umo_session_config, packet_history, 80);
FIELD(umo_session_config, patience, 84);
SIZE(umo_frame_layout, 48);
FIELD(umo_frame_layout, rotations, 24);
FIELD(umo_frame_layout, visemes, 40);
SIZE(umo_parameter_info, 40);
FIELD(umo_parameter_info, minimum, 16);
FIELD(umo_parameter_info, name, 32);
SIZE(umo_latency, 72);
FIELD(umo_latency, algorithmic_samples, 8);
FIELD(umo_latency, compute_max, 40);
FIELD(umo_latency, backlog_samples, 48);
FIELD(umo_latency, backlog_max_samples, 56);
FIELD(umo_latency, mouth_samples, 64);
SIZE(umo_stats, 64);
FIELD(umo_stats, chunks, 8);
FIELD(umo_stats, silenced, 48);
FIELD(umo_stats, held_chunks, 56);
SIZE(umo_sampled, 24);
FIELD(umo_sampled, oldest, 8);
SIZE(umo_gesture_options, 48);
FIELD(umo_gesture_options, has_target, 12);
FIELD(umo_gesture_options, at, 16);
FIELD(umo_gesture_options, target, 32);
SIZE(umo_gesture_clip, 32);
FIELD(umo_gesture_clip, parts, 8);
FIELD(umo_gesture_clip, rate, 16);
FIELD(umo_gesture_clip, rotations, 24);
SIZE(umo_clip, 72);
FIELD(umo_clip, frame_count, 12);
FIELD(umo_clip, rate, 16);
FIELD(umo_clip, channels, 24);
FIELD(umo_clip, layout, 48);
FIELD(umo_clip, figure, 64);
SIZE(umo_output, 16);
SIZE(umo_allocator, 24);
SIZE(umo_jobs, 16);
SIZE(umo_log, 16);
#endif

/* Structures of later versions, larger than this library knows, and structures smaller than any version. */
static void structures_grow(umo_model *model) {
    struct {
        umo_model_config known;
        uint64_t later[4];
    } config;
    OK(umo_model_config_init(&config.known, sizeof config));
    CHECK(config.known.struct_size == sizeof config && config.later[3] == 0);
    umo_model *again = NULL;
    FAILS(IO, umo_model_load(UMO_ABI_VERSION, "no such file", &config.known, &again));
    config.later[2] = 1;
    FAILS(STRUCT_SIZE, umo_model_load(UMO_ABI_VERSION, "no such file", &config.known, &again));
    FAILS(STRUCT_SIZE, umo_model_config_init(&config.known, sizeof config.known - 1));
    FAILS(STRUCT_SIZE, umo_model_config_init(&config.known, (size_t)-1));

    struct {
        umo_model_info known;
        uint64_t later[4];
    } info;
    memset(&info, 0x55, sizeof info);
    info.known.struct_size = sizeof info;
    OK(umo_model_get_info(model, &info.known));
    CHECK(info.known.struct_size == sizeof info && info.known.joints == UMO_JOINT_COUNT);
    CHECK(info.later[0] == 0x5555555555555555u);
    info.known.struct_size = 8;
    FAILS(STRUCT_SIZE, umo_model_get_info(model, &info.known));
    info.known.struct_size = 0;
    FAILS(STRUCT_SIZE, umo_model_get_info(model, &info.known));
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    CHECK(umo_abi_version() == UMO_ABI_VERSION);
    umo_model *model = load_model(argv[1]);
    structures_grow(model);
    OK(umo_model_free(model));
    return 0;
}
