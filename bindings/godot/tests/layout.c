/* The structures of umo.h are laid out as src/ffi.rs says, on 64-bit machines. Compiling this is the test. */
#include <stddef.h>
#include <umo.h>

_Static_assert(UMO_ABI_VERSION == 1 && UMO_JOINT_COUNT == 55 && UMO_VISEME_COUNT == 15 && UMO_ERROR_SIZE == 512, "numbers");
_Static_assert(UMO_AXES_GLTF == 0 && UMO_ABSENT == 4294967295u && UMO_MODEL_NOTICE == 3, "numbers");
_Static_assert(UMO_PARAMETER_IDLE == 4 && UMO_PARAMETER_GAIN_FACE == 16 && UMO_PARAMETER_GAIN_HANDS == 17 &&
                   UMO_PARAMETER_GAIN_UPPER == 18 && UMO_PARAMETER_GAIN_LOWER == 19, "numbers");
_Static_assert(UMO_IDLE_HOLD == 0 && UMO_IDLE_REST == 1 && UMO_IDLE_LIVE == 2, "numbers");
_Static_assert(sizeof(umo_engine_config) == 48 && offsetof(umo_engine_config, cores) == 24, "engine config");
_Static_assert(sizeof(umo_frame_layout) == 48 && offsetof(umo_frame_layout, visemes) == 40, "frame layout");
_Static_assert(sizeof(umo_model_info) == 64 && offsetof(umo_model_info, has_notice) == 52, "model info");
_Static_assert(sizeof(umo_session_config) == 64 && offsetof(umo_session_config, seed) == 40, "session config");
_Static_assert(sizeof(umo_sampled) == 24 && offsetof(umo_sampled, newest) == 16, "sampled");
_Static_assert(sizeof(umo_latency) == 64 && offsetof(umo_latency, backlog_max_samples) == 56, "latency");
_Static_assert(sizeof(umo_stats) == 56 && offsetof(umo_stats, silenced) == 48, "stats");
