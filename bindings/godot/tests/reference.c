/* Writes the frames of a WAV file (16 bits, one channel) through the C interface: raw floats, one frame after the
 * other, each translation, rotations, channels, visemes; and their take. reference MODEL WAV OUT TAKE; prints frames
 * and floats per frame. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <umo.h>

static void check(umo_status status) {
    if (status == UMO_STATUS_OK) return;
    fprintf(stderr, "%s: %s\n", umo_status_message(status), umo_last_error());
    exit(1);
}

int main(int argc, char **argv) {
    if (argc != 5) return 2;
    FILE *file = fopen(argv[2], "rb");
    unsigned char head[44];
    if (!file || fread(head, 1, 44, file) != 44 || memcmp(head + 36, "data", 4)) return 1;
    static int16_t samples[1 << 20];
    size_t count = fread(samples, 2, 1 << 20, file), at = 0, frames = 0;
    fclose(file);

    umo_model *model;
    umo_engine *engine;
    umo_session *session;
    umo_session_config config;
    umo_frame_layout layout;
    umo_model_info info = {.struct_size = sizeof info};
    check(umo_model_load(UMO_ABI_VERSION, argv[1], NULL, &model));
    check(umo_model_get_info(model, &info));
    check(umo_engine_new(model, NULL, &engine));
    check(umo_session_config_init(&config, sizeof config, model));
    memcpy(&config.sample_rate, head + 24, 4);
    /* The node's default, which is for live use. */
    config.target = 1;
    config.take_bytes = 1 << 20;
    check(umo_session_new(engine, &config, &session));
    /* Layers follow the clock while there are no frames: off where poses are compared. */
    for (uint32_t layer = UMO_PARAMETER_LAYER_GAZE; layer <= UMO_PARAMETER_LAYER_BODY; layer++) {
        check(umo_session_set_parameter(session, layer, 0));
    }
    check(umo_frame_layout_init(&layout, sizeof layout, model));
    layout.index = layout.sample = UMO_ABSENT;
    layout.translation = 0;
    layout.rotations = 12;
    layout.channels = 12 + 16 * UMO_JOINT_COUNT;
    layout.visemes = layout.channels + 4 * info.channels;
    layout.frame_stride = layout.visemes + 4 * UMO_VISEME_COUNT;

    FILE *out = fopen(argv[3], "wb");
    char *frame = malloc(layout.frame_stride);
    const size_t all = count * info.frame_rate / config.sample_rate;
    while (frames < all) {
        size_t taken = 0, pulled = 0;
        if (at < count) {
            check(umo_session_push_audio_i16(session, samples + at, count - at, &taken));
            if ((at += taken) == count) check(umo_session_finish(session));
        }
        check(umo_session_pull_frames(session, &layout, frame, layout.frame_stride, &pulled));
        if (pulled && fwrite(frame, layout.frame_stride, 1, out) != 1) return 1;
        frames += pulled;
        if (!pulled) nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
    fclose(out);
    free(frame);
    size_t size = 0;
    check(umo_session_take_size(session, &size));
    char *take = malloc(size);
    check(umo_session_take(session, take, size, &size));
    out = fopen(argv[4], "wb");
    if (!out || fwrite(take, size, 1, out) != 1) return 1;
    fclose(out);
    free(take);
    check(umo_session_free(session));
    check(umo_engine_free(engine));
    check(umo_model_free(model));
    printf("%zu %zu\n", frames, (size_t)layout.frame_stride / 4);
    return 0;
}
