/* Frames as files: `clip MODEL FOLDER`. The contents of the files are tested in their writer's crate; here, that frames
 * of any layout and axes can be written, that a failed write leaves nothing behind, and that invalid input is refused. */

#include "check.h"

enum { FRAMES = 45, SAMPLES = 24000 };

typedef struct {
    unsigned char *bytes;
    size_t size;
    /* Number of bytes after which the callback stops. */
    size_t limit;
} buffer;

static int32_t take(void *userdata, const void *bytes, size_t size) {
    buffer *all = userdata;
    if (all->size + size > all->limit) return 7;
    all->bytes = realloc(all->bytes, all->size + size);
    CHECK(all->bytes && size > 0);
    memcpy(all->bytes + all->size, bytes, size);
    all->size += size;
    return 0;
}

static buffer written(const umo_clip *clip, uint32_t format) {
    buffer all = {.limit = SIZE_MAX};
    umo_output output = {.userdata = &all, .write = take};
    OK(umo_clip_write(clip, format, &output));
    uint32_t size;
    CHECK(all.size > 20 && memcmp(all.bytes, "glTF", 4) == 0);
    memcpy(&size, all.bytes + 8, sizeof size);
    CHECK(size == all.size);
    return all;
}

static int holds(const buffer *all, const char *text) {
    size_t length = strlen(text);
    for (size_t i = 0; i + length <= all->size; i++) {
        if (memcmp(all->bytes + i, text, length) == 0) return 1;
    }
    return 0;
}

static int same(const buffer *a, const buffer *b) { return a->size == b->size && memcmp(a->bytes, b->bytes, a->size) == 0; }

static buffer read_file(const char *path) {
    buffer all = {0};
    FILE *file = fopen(path, "rb");
    CHECK(file && fseek(file, 0, SEEK_END) == 0);
    all.size = (size_t)ftell(file);
    rewind(file);
    all.bytes = malloc(all.size);
    CHECK(all.bytes && fread(all.bytes, 1, all.size, file) == all.size);
    fclose(file);
    return all;
}

/* Frames of a voice in any layout, the same number each time. */
static void animate(umo_model *model, const umo_frame_layout *layout, void *frames, size_t size) {
    static float samples[SAMPLES];
    umo_engine *engine = polled_engine(model);
    umo_session *avatar = NULL;
    size_t count = 0;
    speak(samples, SAMPLES, 0);
    OK(umo_session_new(engine, NULL, &avatar));
    OK(umo_session_push_audio(avatar, samples, SAMPLES, NULL));
    OK(umo_session_finish(avatar));
    compute(engine);
    OK(umo_session_pull_frames(avatar, layout, frames, size, &count));
    CHECK(count == FRAMES);
    OK(umo_session_free(avatar));
    OK(umo_engine_free(engine));
}

/* A host's own structure, in Unity's axes: only signs differ, so the file is the same. */
typedef struct {
    float face[52][2];
    float root[3];
    float bones[UMO_JOINT_COUNT][5];
} pose;

static umo_clip in_other_axes(umo_model *model, umo_frame_layout *layout) {
    static pose poses[FRAMES];
    umo_clip clip;
    OK(umo_frame_layout_init(layout, sizeof *layout, model));
    layout->axes = UMO_AXES_UNITY;
    layout->frame_stride = sizeof(pose);
    layout->index = layout->sample = layout->visemes = UMO_ABSENT;
    layout->channels = offsetof(pose, face);
    layout->channel_stride = 2 * sizeof(float);
    layout->translation = offsetof(pose, root);
    layout->rotations = offsetof(pose, bones);
    layout->rotation_stride = 5 * sizeof(float);
    animate(model, layout, poses, sizeof poses);
    OK(umo_clip_init(&clip, sizeof clip, model));
    clip.layout = layout;
    clip.frames = poses;
    clip.frame_count = FRAMES;
    return clip;
}

static void refused(const umo_clip *good, umo_model *model) {
    umo_clip clip;
    buffer all = {.limit = SIZE_MAX};
    umo_output output = {.userdata = &all, .write = take}, nowhere = {0};
    FAILS(NULL_POINTER, umo_clip_init(NULL, sizeof clip, model));
    FAILS(NULL_POINTER, umo_clip_init(&clip, sizeof clip, NULL));
    FAILS(STRUCT_SIZE, umo_clip_init(&clip, sizeof clip - 1, model));
    FAILS(NULL_POINTER, umo_clip_write(NULL, UMO_FORMAT_GLB, &output));
    FAILS(NULL_POINTER, umo_clip_write(good, UMO_FORMAT_GLB, NULL));
    FAILS(NULL_POINTER, umo_clip_write(good, UMO_FORMAT_GLB, &nowhere));
    FAILS(NULL_POINTER, umo_clip_write_file(good, UMO_FORMAT_GLB, NULL));
    FAILS(INVALID_ARGUMENT, umo_clip_write(good, 0, &output));
    FAILS(INVALID_ARGUMENT, umo_clip_write(good, 3, &output));
#define WITH(status, change, text)                                                                                     \
    clip = *good;                                                                                                      \
    change;                                                                                                            \
    FAILS(status, umo_clip_write(&clip, UMO_FORMAT_GLB, &output));                                                     \
    CHECK(strstr(umo_last_error(), text))
    WITH(STRUCT_SIZE, clip.struct_size = 8, "struct_size");
    WITH(INVALID_ARGUMENT, clip.is_arkit = 2, "is_arkit");
    WITH(INVALID_ARGUMENT, clip.reserved = 1, "reserved");
    WITH(INVALID_ARGUMENT, clip.frame_count = 0, "0 frames");
    WITH(INVALID_ARGUMENT, clip.frame_count = UINT32_MAX, "4294967295 frames");
    WITH(INVALID_ARGUMENT, clip.channel_count = 1025, "1025 channels");
    WITH(INVALID_ARGUMENT, clip.channel_count = UINT32_MAX, "4294967295 channels");
    WITH(INVALID_ARGUMENT, clip.rate = 0, "rate");
    WITH(INVALID_ARGUMENT, clip.rate = NAN, "rate");
    WITH(INVALID_ARGUMENT, clip.figure = "zoe", "alex, bea, carl, dina");
    WITH(NULL_POINTER, clip.channels = NULL, "channels");
    WITH(NULL_POINTER, clip.parents = NULL, "parents");
    WITH(NULL_POINTER, clip.offsets = NULL, "offsets");
    WITH(NULL_POINTER, clip.layout = NULL, "layout");
    WITH(NULL_POINTER, clip.frames = NULL, "frames");
    int32_t parents[UMO_JOINT_COUNT];
    memcpy(parents, good->parents, sizeof parents);
    parents[4] = 9;
    WITH(INVALID_ARGUMENT, clip.parents = parents, "parent");
    umo_frame_layout layout = *good->layout;
    layout.rotations = UMO_ABSENT;
    WITH(INVALID_ARGUMENT, clip.layout = &layout, "rotations");
    layout = *good->layout;
    layout.channels = UMO_ABSENT;
    WITH(INVALID_ARGUMENT, clip.layout = &layout, "channels");
    layout = *good->layout;
    layout.frame_stride = 100;
    WITH(INVALID_ARGUMENT, clip.layout = &layout, "frame_stride");
    unsigned char *frames = malloc((size_t)FRAMES * good->layout->frame_stride);
    CHECK(frames);
    memcpy(frames, good->frames, (size_t)FRAMES * good->layout->frame_stride);
    const float nan = NAN;
    memcpy(frames + 9 * good->layout->frame_stride + good->layout->channels, &nan, sizeof nan);
    WITH(INVALID_ARGUMENT, clip.frames = frames, "not finite");
    free(frames);
    CHECK(all.size == 0);
    /* One face channel fewer than the model's. */
    clip = *good;
    clip.channel_count = 0;
    OK(umo_clip_write(&clip, UMO_FORMAT_GLB, &output));
    free(all.bytes);
}

static void files(const umo_clip *clip, const char *folder, const buffer *glb) {
    char path[4096], gone[4096];
    /* UTF-8 on every system. */
    snprintf(path, sizeof path, "%s/B\xc3\xa4r \xe6\x97\xa5.glb", folder);
    OK(umo_clip_write_file(clip, UMO_FORMAT_GLB, path));
    buffer found = read_file(path);
    CHECK(same(&found, glb));
    free(found.bytes);
    /* A failed write leaves an existing file unchanged. */
    umo_clip wrong = *clip;
    wrong.rate = -1;
    FAILS(INVALID_ARGUMENT, umo_clip_write_file(&wrong, UMO_FORMAT_GLB, path));
    found = read_file(path);
    CHECK(same(&found, glb));
    free(found.bytes);
    CHECK(remove(path) == 0);
    snprintf(gone, sizeof gone, "%s/none/motion.glb", folder);
    FAILS(IO, umo_clip_write_file(clip, UMO_FORMAT_GLB, gone));
    CHECK(strstr(umo_last_error(), "none/motion.glb"));
    FAILS(IO, umo_clip_write_file(clip, UMO_FORMAT_GLB, folder));
    FAILS(INVALID_ARGUMENT, umo_clip_write_file(clip, UMO_FORMAT_GLB, "\xff.glb"));
}

int main(int argc, char **argv) {
    CHECK(argc == 3);
    umo_model *model = load_model(argv[1]);
    umo_frame_layout layout, other;
    OK(umo_frame_layout_init(&layout, sizeof layout, model));
    size_t size = (size_t)FRAMES * layout.frame_stride;
    void *frames = malloc(size);
    CHECK(frames);
    animate(model, &layout, frames, size);
    umo_clip clip;
    OK(umo_clip_init(&clip, sizeof clip, model));
    CHECK(clip.is_arkit == 1 && clip.channel_count == 52 && clip.rate == 30 && strcmp(clip.channels[17], "jawOpen") == 0);
    CHECK(clip.parents[0] == -1 && strcmp(clip.figure, "alex") == 0);
    clip.layout = &layout;
    clip.frames = frames;
    clip.frame_count = FRAMES;

    buffer glb = written(&clip, UMO_FORMAT_GLB), again = written(&clip, UMO_FORMAT_GLB);
    CHECK(same(&glb, &again) && holds(&glb, "jawOpen") && holds(&glb, "left_elbow") && holds(&glb, "\"meshes\""));
    free(again.bytes);
    umo_clip unity = in_other_axes(model, &other);
    again = written(&unity, UMO_FORMAT_GLB);
    CHECK(same(&glb, &again));
    free(again.bytes);

    clip.figure = NULL;
    again = written(&clip, UMO_FORMAT_GLB);
    CHECK(again.size < glb.size && holds(&again, "left_elbow") && !holds(&again, "\"meshes\""));
    free(again.bytes);
    again = written(&clip, UMO_FORMAT_VRMA);
    CHECK(holds(&again, "VRMC_vrm_animation") && holds(&again, "leftLowerArm"));
    free(again.bytes);
    uint32_t figures = 0;
    while ((clip.figure = umo_figure_name(figures))) {
        again = written(&clip, UMO_FORMAT_GLB);
        CHECK(same(&glb, &again) == (figures == 0));
        free(again.bytes);
        figures++;
    }
    CHECK(figures == 4 && umo_figure_name(UINT32_MAX) == NULL);

    clip.figure = umo_figure_name(0);
    refused(&clip, model);
    for (size_t limit = 0; limit < glb.size; limit += glb.size / 2 + 1) {
        buffer part = {.limit = limit};
        umo_output output = {.userdata = &part, .write = take};
        FAILS(IO, umo_clip_write(&clip, UMO_FORMAT_GLB, &output));
        CHECK(part.size <= limit && strstr(umo_last_error(), "returned 7"));
        free(part.bytes);
    }
    files(&clip, argv[2], &glb);

    /* The names filled in by the model equal the model's; a clip without a model works as well. */
    char names[52][32];
    const char *pointers[52];
    int32_t parents[UMO_JOINT_COUNT];
    float offsets[3 * UMO_JOINT_COUNT];
    for (int i = 0; i < 52; i++) {
        snprintf(names[i], sizeof names[i], "%s", clip.channels[i]);
        pointers[i] = names[i];
    }
    OK(umo_model_get_skeleton(model, UMO_AXES_GLTF, parents, offsets, UMO_JOINT_COUNT));
    OK(umo_model_free(model));
    clip.channels = pointers;
    clip.parents = parents;
    clip.offsets = offsets;
    again = written(&clip, UMO_FORMAT_GLB);
    CHECK(same(&glb, &again));
    free(again.bytes);
    free(glb.bytes);
    free(frames);
    return 0;
}
