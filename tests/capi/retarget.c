/* A character of the host's: the model's own skeleton, in the axes of an engine, with a fat belly.
 *
 *     retarget MODEL
 */

#include "check.h"

enum { JOINTS = UMO_JOINT_COUNT, SIDES = 24, RINGS = 30, ROUND = SIDES * (RINGS + 1), TRIANGLES = 2 * SIDES * RINGS };
enum { LEFT_SHOULDER = 16, LEFT_ELBOW = 18, LEFT_WRIST = 20 };

typedef struct {
    int32_t parents[JOINTS], joints[JOINTS], vertex_bones[ROUND];
    float offsets[3 * JOINTS], places[3 * JOINTS], rotations[4 * JOINTS], vertices[3 * ROUND];
    uint32_t indices[3 * TRIANGLES];
    const char *names[JOINTS];
    umo_rig rig;
} character;

static umo_model *model;

/* A point of glTF's axes in others. */
static void put_place(uint32_t axes, float x, float y, float z, float *to) {
    const float unreal[3] = {100 * z, -100 * x, 100 * y}, unity[3] = {-x, y, z}, gltf[3] = {x, y, z};
    memcpy(to, axes == UMO_AXES_UNREAL ? unreal : axes == UMO_AXES_UNITY ? unity : gltf, sizeof gltf);
}

static void make(character *to, uint32_t axes) {
    static float gltf[3 * JOINTS];
    OK(umo_rig_init(&to->rig, sizeof to->rig));
    OK(umo_model_get_skeleton(model, UMO_AXES_GLTF, to->parents, gltf, JOINTS));
    for (int joint = 0; joint < JOINTS; joint++) {
        const int parent = to->parents[joint];
        for (int i = 0; i < 3; i++) {
            gltf[3 * joint + i] += parent < 0 ? 0 : gltf[3 * parent + i];
        }
        put_place(axes, gltf[3 * joint], gltf[3 * joint + 1], gltf[3 * joint + 2], &to->places[3 * joint]);
        const float none[4] = {0, 0, 0, 1};
        memcpy(&to->rotations[4 * joint], none, sizeof none);
        to->joints[joint] = joint;
        to->names[joint] = umo_joint_name((uint32_t)joint);
    }
    const float low = gltf[3 * 1 + 1] - 0.05f, high = gltf[3 * LEFT_SHOULDER + 1];
    for (int ring = 0; ring <= RINGS; ring++) {
        for (int side = 0; side < SIDES; side++) {
            const int at = ring * SIDES + side;
            const double turn = 6.28318 * side / SIDES;
            const float y = low + (high - low) * (float)ring / RINGS;
            put_place(axes, 0.3f * (float)sin(turn), y, 0.35f * (float)cos(turn), &to->vertices[3 * at]);
            to->vertex_bones[at] = ring < 6 ? 0 : ring < 15 ? 3 : 9;
            if (ring == RINGS) continue;
            const uint32_t a = (uint32_t)at, b = (uint32_t)(ring * SIDES + (side + 1) % SIDES);
            const uint32_t corners[6] = {a, b, a + SIDES, b, b + SIDES, a + SIDES};
            memcpy(&to->indices[6 * at], corners, sizeof corners);
        }
    }
    to->rig.axes = axes;
    to->rig.bone_count = JOINTS;
    to->rig.parents = to->parents;
    to->rig.joints = to->joints;
    to->rig.places = to->places;
    to->rig.rotations = to->rotations;
    to->rig.vertex_count = ROUND;
    to->rig.index_count = 3 * TRIANGLES;
    to->rig.vertices = to->vertices;
    to->rig.vertex_bones = to->vertex_bones;
    to->rig.indices = to->indices;
}

/* A rotation about glTF's axes, in others. */
static void put_turn(uint32_t axes, double x, double y, double z, float *to) {
    const double angle = sqrt(x * x + y * y + z * z), by = angle > 0 ? sin(angle / 2) / angle : 0;
    const float q[4] = {(float)(x * by), (float)(y * by), (float)(z * by), (float)cos(angle / 2)};
    const float unreal[4] = {-q[2], q[0], -q[1], q[3]}, unity[4] = {q[0], -q[1], -q[2], q[3]};
    memcpy(to, axes == UMO_AXES_UNREAL ? unreal : axes == UMO_AXES_UNITY ? unity : q, sizeof q);
}

/* A left hand before the belly. */
static void pose(uint32_t axes, float *rotations, float *translation) {
    for (int joint = 0; joint < JOINTS; joint++) put_turn(axes, 0, 0, 0, &rotations[4 * joint]);
    put_turn(axes, 0, 0, -1.2, &rotations[4 * LEFT_SHOULDER]);
    put_turn(axes, 0, -1.9, 0, &rotations[4 * LEFT_ELBOW]);
    put_place(axes, 0.1f, 0.02f, -0.2f, translation);
}

static umo_retarget *made(const umo_rig *rig) {
    umo_retarget *retarget = NULL;
    OK(umo_retarget_new(model, rig, &retarget));
    return retarget;
}

/* Angle between two unit quaternions. */
static double apart(const float *a, const float *b) {
    double dot = 0;
    for (int i = 0; i < 4; i++) dot += (double)a[i] * (double)b[i];
    return 2 * acos(fmin(fabs(dot), 1.0));
}

static void poses_are_the_same_in_all_axes(void) {
    static character one;
    static float first[4 * JOINTS];
    for (uint32_t axes = UMO_AXES_GLTF; axes <= UMO_AXES_UNITY; axes++) {
        make(&one, axes);
        float turns[4 * JOINTS], at[3], got[4 * JOINTS], place[3];
        pose(axes, turns, at);
        one.rig.gain = 0;
        umo_retarget *retarget = made(&one.rig);
        OK(umo_retarget_apply(retarget, turns, at, JOINTS, got, place));
        /* The model's own skeleton keeps its pose. */
        for (int joint = 0; joint < JOINTS; joint++) CHECK(apart(&got[4 * joint], &turns[4 * joint]) < 2e-3);
        /* Height goes by the floor. */
        for (int i = 0; i < 3; i++) {
            if (i == (axes == UMO_AXES_UNREAL ? 2 : 1)) continue;
            CHECK(fabsf(place[i] - one.places[i] - at[i]) < (axes == UMO_AXES_UNREAL ? 0.1f : 1e-3f));
        }
        OK(umo_retarget_free(retarget));
        FAILS(INVALID_HANDLE, umo_retarget_apply(retarget, turns, at, JOINTS, got, place));

        one.rig.gain = 1;
        retarget = made(&one.rig);
        OK(umo_retarget_apply(retarget, turns, at, JOINTS, got, NULL));
        CHECK(apart(&got[4 * LEFT_ELBOW], &turns[4 * LEFT_ELBOW]) > 0.1);
        /* The legs stay, and nearly the other arm. */
        CHECK(apart(&got[4 * 1], &turns[4 * 1]) < 2e-3 && apart(&got[4 * 17], &turns[4 * 17]) < 0.06);
        for (int joint = 0; joint < JOINTS; joint++) {
            float same[4];
            /* To glTF's axes: the change is its own inverse for Unity, and given for Unreal. */
            const float *q = &got[4 * joint];
            const float unreal[4] = {q[1], -q[2], -q[0], q[3]}, unity[4] = {q[0], -q[1], -q[2], q[3]};
            memcpy(same, axes == UMO_AXES_UNREAL ? unreal : axes == UMO_AXES_UNITY ? unity : q, sizeof same);
            if (axes == UMO_AXES_GLTF) memcpy(&first[4 * joint], same, sizeof same);
            CHECK(apart(same, &first[4 * joint]) < 5e-3);
        }
        OK(umo_retarget_free(retarget));
    }
}

static void bodies_are_corrected_by_hand(void) {
    static character one;
    make(&one, UMO_AXES_GLTF);
    float turns[4 * JOINTS], at[3], fat[4 * JOINTS], thin[4 * JOINTS], points[4 * JOINTS], people[4 * JOINTS];
    pose(UMO_AXES_GLTF, turns, at);
    umo_retarget *retarget = made(&one.rig);
    OK(umo_retarget_apply(retarget, turns, at, JOINTS, fat, NULL));
    OK(umo_retarget_free(retarget));
    /* The same points, without triangles. */
    one.rig.index_count = 0;
    one.rig.indices = NULL;
    retarget = made(&one.rig);
    OK(umo_retarget_apply(retarget, turns, at, JOINTS, points, NULL));
    CHECK(apart(&fat[4 * LEFT_SHOULDER], &points[4 * LEFT_SHOULDER]) < 0.1);
    OK(umo_retarget_free(retarget));
    one.rig.girths[0] = one.rig.girths[1] = one.rig.girths[2] = 0.6f;
    retarget = made(&one.rig);
    OK(umo_retarget_apply(retarget, turns, at, JOINTS, thin, NULL));
    CHECK(apart(&fat[4 * LEFT_SHOULDER], &thin[4 * LEFT_SHOULDER]) > 0.1);
    OK(umo_retarget_free(retarget));
    /* A body without points is a person's: its own skeleton keeps its pose, nearly. */
    make(&one, UMO_AXES_GLTF);
    one.rig.vertex_count = one.rig.index_count = 0;
    one.rig.vertices = NULL;
    one.rig.vertex_bones = NULL;
    one.rig.indices = NULL;
    retarget = made(&one.rig);
    OK(umo_retarget_apply(retarget, turns, at, JOINTS, people, NULL));
    CHECK(apart(&people[4 * LEFT_SHOULDER], &turns[4 * LEFT_SHOULDER]) < 0.15);
    OK(umo_retarget_free(retarget));
}

/* Correction of the left arm, radians, after it has moved into the belly at this rate. */
static double bent(float rate) {
    static character one;
    make(&one, UMO_AXES_GLTF);
    float turns[4 * JOINTS], at[3], got[4 * JOINTS];
    umo_retarget *retarget = made(&one.rig);
    if (rate > 0) OK(umo_retarget_set_step(retarget, 1 / rate));
    pose(UMO_AXES_GLTF, turns, at);
    for (int i = 0; i <= 20; i++) {
        put_turn(UMO_AXES_GLTF, 0, -1.5 - 0.02 * i, 0, &turns[4 * LEFT_ELBOW]);
        OK(umo_retarget_apply(retarget, turns, at, JOINTS, got, NULL));
    }
    OK(umo_retarget_free(retarget));
    return apart(&got[4 * LEFT_SHOULDER], &turns[4 * LEFT_SHOULDER]);
}

static void corrections_take_their_time_at_any_rate(void) {
    /* 30 a second unless said. */
    CHECK(bent(0) == bent(30));
    /* The same poses in a quarter of the time: the corrections have come less far. */
    CHECK(fabs(bent(120) - bent(30)) > 0.005);
    CHECK(bent(1e4f) == bent(1e3f));
    static character one;
    make(&one, UMO_AXES_GLTF);
    umo_retarget *retarget = made(&one.rig);
    OK(umo_retarget_set_step(retarget, 0)); /* a game that stands still */
    FAILS(INVALID_ARGUMENT, umo_retarget_set_step(retarget, -0.01f));
    FAILS(INVALID_ARGUMENT, umo_retarget_set_step(retarget, NAN));
    CHECK(strstr(umo_last_error(), "seconds"));
    OK(umo_retarget_free(retarget));
    FAILS(INVALID_HANDLE, umo_retarget_set_step(retarget, 0.02f));
    FAILS(INVALID_HANDLE, umo_retarget_set_step(NULL, 0.02f));
}

static void bones_are_found_by_name(void) {
    static character one;
    make(&one, UMO_AXES_UNITY);
    one.rig.joints = NULL;
    one.rig.names = one.names;
    umo_retarget *retarget = made(&one.rig);
    int32_t joints[JOINTS];
    OK(umo_retarget_get_joints(retarget, JOINTS, joints));
    for (int joint = 0; joint < JOINTS; joint++) CHECK(joints[joint] == joint);
    FAILS(NULL_POINTER, umo_retarget_get_joints(retarget, JOINTS, NULL));
    FAILS(INVALID_ARGUMENT, umo_retarget_get_joints(retarget, JOINTS - 1, joints));
    OK(umo_retarget_free(retarget));
    one.names[LEFT_ELBOW] = "tail";
    FAILS(INVALID_ARGUMENT, umo_retarget_new(model, &one.rig, &retarget));
    CHECK(strstr(umo_last_error(), "left_elbow"));
    one.names[LEFT_ELBOW] = NULL;
    FAILS(NULL_POINTER, umo_retarget_new(model, &one.rig, &retarget));
}

static void wrong_characters_are_errors(void) {
    static character one;
    umo_retarget *retarget = NULL;
    make(&one, UMO_AXES_GLTF);
    const umo_rig good = one.rig;
    FAILS(STRUCT_SIZE, umo_rig_init(&one.rig, sizeof one.rig - 1));
    FAILS(NULL_POINTER, umo_rig_init(NULL, sizeof one.rig));
    FAILS(NULL_POINTER, umo_retarget_new(NULL, &good, &retarget));
    FAILS(NULL_POINTER, umo_retarget_new(model, NULL, &retarget));
    FAILS(NULL_POINTER, umo_retarget_new(model, &good, NULL));
#define WRONG(field, value)                                                                                            \
    do {                                                                                                               \
        one.rig = good;                                                                                                \
        one.rig.field = value;                                                                                         \
        CHECK(umo_retarget_new(model, &one.rig, &retarget) < 0 && retarget == NULL);                                   \
    } while (0)
    WRONG(axes, 3);
    WRONG(bone_count, 0);
    WRONG(bone_count, 70000);
    WRONG(bone_count, LEFT_ELBOW);
    WRONG(gain, 1.5f);
    WRONG(gain, -0.1f);
    WRONG(gain, NAN);
    WRONG(girths[4], 11);
    WRONG(index_count, 4);
    WRONG(vertex_count, 2);
    WRONG(parents, NULL);
    WRONG(joints, NULL);
    WRONG(places, NULL);
    WRONG(rotations, NULL);
    WRONG(vertices, NULL);
    WRONG(vertex_bones, NULL);
    WRONG(indices, NULL);
#define SPOILT(array, index, value)                                                                                    \
    do {                                                                                                               \
        make(&one, UMO_AXES_GLTF);                                                                                     \
        one.array[index] = value;                                                                                      \
        FAILS(INVALID_ARGUMENT, umo_retarget_new(model, &one.rig, &retarget));                                         \
    } while (0)
    SPOILT(parents, 5, JOINTS);
    SPOILT(parents, 5, -2);
    SPOILT(parents, 0, 5); /* a circle */
    SPOILT(joints, 5, JOINTS);
    SPOILT(joints, 5, -2);
    SPOILT(joints, 5, 4); /* twice */
    SPOILT(places, 7, NAN);
    SPOILT(rotations, 7, 0);
    SPOILT(rotations, 8, INFINITY);
    SPOILT(vertices, 7, INFINITY);
    SPOILT(vertex_bones, 7, JOINTS);
    SPOILT(vertex_bones, 7, -2);
    SPOILT(indices, 7, ROUND);

    /* A mesh of one point, of no area, and of no bone is a person's. */
    make(&one, UMO_AXES_GLTF);
    memset(one.vertices, 0, sizeof one.vertices);
    OK(umo_retarget_free(made(&one.rig)));
    make(&one, UMO_AXES_GLTF);
    memset(one.vertex_bones, 0xff, sizeof one.vertex_bones);
    umo_retarget *empty = made(&one.rig);
    float turns[4 * JOINTS], at[3], got[4 * JOINTS], place[3];
    pose(UMO_AXES_GLTF, turns, at);
    OK(umo_retarget_apply(empty, turns, at, JOINTS, got, place));
    CHECK(apart(&got[4 * LEFT_SHOULDER], &turns[4 * LEFT_SHOULDER]) < 0.15);
    FAILS(NULL_POINTER, umo_retarget_apply(empty, NULL, at, JOINTS, got, place));
    FAILS(NULL_POINTER, umo_retarget_apply(empty, turns, NULL, JOINTS, got, place));
    FAILS(NULL_POINTER, umo_retarget_apply(empty, turns, at, JOINTS, NULL, place));
    FAILS(INVALID_ARGUMENT, umo_retarget_apply(empty, turns, at, JOINTS + 1, got, place));
    turns[9] = (float)NAN;
    FAILS(INVALID_ARGUMENT, umo_retarget_apply(empty, turns, at, JOINTS, got, place));
    FAILS(INVALID_HANDLE, umo_retarget_free((umo_retarget *)(void *)model));
    OK(umo_retarget_free(empty));
    FAILS(INVALID_HANDLE, umo_retarget_free(empty));
    OK(umo_retarget_free(NULL));
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    model = load_model(argv[1]);
    poses_are_the_same_in_all_axes();
    bodies_are_corrected_by_hand();
    corrections_take_their_time_at_any_rate();
    bones_are_found_by_name();
    wrong_characters_are_errors();
    OK(umo_model_free(model));
    return 0;
}
