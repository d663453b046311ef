/* Checks that the structures of umo.h have the layout that src/ffi.rs declares, on 64-bit machines. Compiling this
   is the test. */
#include <stddef.h>
#include <umo.h>

_Static_assert(UMO_ABI_VERSION == 1 && UMO_STATUS_BUSY == -11 && UMO_JOINT_COUNT == 55 && UMO_VISEME_COUNT == 15 && UMO_ERROR_SIZE == 512, "numbers");
_Static_assert(UMO_AXES_GLTF == 0 && UMO_ABSENT == 4294967295u && UMO_MODEL_NOTICE == 3, "numbers");
_Static_assert(UMO_PARAMETER_IDLE == 4 && UMO_PARAMETER_GAIN_FACE == 16 && UMO_PARAMETER_GAIN_HANDS == 17 &&
                   UMO_PARAMETER_GAIN_UPPER == 18 && UMO_PARAMETER_GAIN_LOWER == 19, "numbers");
_Static_assert(UMO_PARAMETER_ATTENTION == 5 && UMO_PARAMETER_OUTPUT_DELAY == 6 && UMO_PARAMETER_LAYER_GAZE == 32 && UMO_PARAMETER_LAYER_IDLE == 33 &&
                   UMO_PARAMETER_LAYER_ASYMMETRY == 34 && UMO_PARAMETER_LAYER_NODS == 35 &&
                   UMO_PARAMETER_LAYER_MOOD == 36 && UMO_PARAMETER_LAYER_FEET == 37, "numbers");
_Static_assert(UMO_ATTENTION_AUTO == 0 && UMO_ATTENTION_IDLE == 1 && UMO_ATTENTION_LISTENING == 2 &&
                   UMO_ATTENTION_THINKING == 3 && UMO_ATTENTION_SPEAKING == 4, "numbers");
_Static_assert(UMO_MOOD_NEUTRAL == 0 && UMO_MOOD_JOY == 1 && UMO_MOOD_SAD == 2 && UMO_MOOD_ANGRY == 3 &&
                   UMO_MOOD_SURPRISED == 4 && UMO_MOOD_DISGUSTED == 5 && UMO_MOOD_AFRAID == 6, "numbers");
_Static_assert(UMO_VOICE_DELAYED == 0 && UMO_VOICE_LIVE == 1, "numbers");
_Static_assert(UMO_SIDE_AUTO == 0 && UMO_SIDE_LEFT == 1 && UMO_SIDE_RIGHT == 2 && UMO_SIDE_BOTH == 3, "numbers");
_Static_assert(UMO_IDLE_HOLD == 0 && UMO_IDLE_REST == 1 && UMO_IDLE_LIVE == 2, "numbers");
_Static_assert(sizeof(umo_engine_config) == 56 && offsetof(umo_engine_config, priority) == 48, "engine config");
_Static_assert(sizeof(umo_frame_layout) == 48 && offsetof(umo_frame_layout, visemes) == 40, "frame layout");
_Static_assert(sizeof(umo_model_info) == 72 && offsetof(umo_model_info, has_mouth) == 64, "model info");
_Static_assert(sizeof(umo_session_config) == 88 && offsetof(umo_session_config, horizon) == 72, "session config");
_Static_assert(sizeof(umo_gesture_options) == 48 && offsetof(umo_gesture_options, target) == 32, "gesture options");
_Static_assert(sizeof(umo_sampled) == 24 && offsetof(umo_sampled, newest) == 16, "sampled");
_Static_assert(sizeof(umo_latency) == 72 && offsetof(umo_latency, mouth_samples) == 64, "latency");
_Static_assert(sizeof(umo_stats) == 64 && offsetof(umo_stats, held_chunks) == 56, "stats");
