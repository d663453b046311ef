// The pose on a skeleton like the mannequin's: A-pose at rest, bones along their own X, facing +Y.
// SPDX-License-Identifier: MIT OR Apache-2.0

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "Expect.h"
#include "Retarget.h"
#include "umo.h"

using namespace umo_unreal;

namespace {

constexpr double half_pi = 1.57079632679489661923;

Quat about(Vec3 axis, double angle) {
    const double s = std::sin(angle / 2) / length(axis);
    return {axis.x * s, axis.y * s, axis.z * s, std::cos(angle / 2)};
}

struct Skeleton {
    std::vector<Bone> bones;

    /// Adds a bone at a component-space position with component-space rotation `turn`.
    int add(const char *name, int parent, Vec3 place, Quat turn) {
        const Quat from = parent < 0 ? Quat{} : turns[static_cast<std::size_t>(parent)];
        const Vec3 at = parent < 0 ? Vec3{} : places[static_cast<std::size_t>(parent)];
        bones.push_back({name, parent, inverse(from) * turn, rotate(inverse(from), place - at)});
        places.push_back(place);
        turns.push_back(turn);
        return static_cast<int>(bones.size()) - 1;
    }
    int find(const std::string &name) const {
        for (std::size_t i = 0; i < bones.size(); ++i) {
            if (bones[i].name == name) return static_cast<int>(i);
        }
        return -1;
    }

    std::vector<Vec3> places;
    std::vector<Quat> turns;
};

/// Rotation of a bone whose own X points along `direction`, with an additional roll as in the mannequin.
Quat along(Vec3 direction) { return arc({1, 0, 0}, direction) * about({1, 0, 0}, 0.7); }

/// Twice as large as the library's body below, in an A-pose: arms 45 degrees down, elbows 10 degrees forward, legs
/// apart.
Skeleton mannequin() {
    Skeleton s;
    const int root = s.add("root", -1, {0, 0, 0}, about({1, 0, 0}, -half_pi));
    const int pelvis = s.add("pelvis", root, {0, 0, 180}, along({0, 0, 1}));
    int spine = pelvis;
    for (int i = 1; i <= 5; ++i) {
        const std::string name = "spine_0" + std::to_string(i);
        spine = s.add(name.c_str(), spine, {0, 0, 180.0 + 15 * i}, along({0, 0.1, 1}));
    }
    const int neck = s.add("neck_01", spine, {0, 0, 280}, along({0, 0.2, 1}));
    s.add("Head", neck, {0, 0, 300}, along({0, 0, 1}));
    // Facing +Y in left-handed axes, the left side is towards +X.
    for (const double side : {1.0, -1.0}) {
        const std::string tail = side > 0 ? "_l" : "_r";
        const auto name = [&](const char *bone) { return bone + tail; };
        const Vec3 down{side, 0, -1};
        const int clavicle = s.add(name("clavicle").c_str(), spine, {side * 5, 0, 265}, along({side, 0, 0}));
        const Vec3 shoulder{side * 30, 0, 265}, elbow = shoulder + 40.0 * down;
        const int upper = s.add(name("upperarm").c_str(), clavicle, shoulder, along(down));
        s.add(name("upperarm_twist_01").c_str(), upper, shoulder + 20.0 * down, along(down));
        const Vec3 forward{side * 0.9, 0.25, -0.9}, hand = elbow + 40.0 * forward;
        const int lower = s.add(name("lowerarm").c_str(), upper, elbow, along(forward));
        const int wrist = s.add(name("hand").c_str(), lower, hand, along(down));
        const int middle = s.add(name("middle_01").c_str(), wrist, hand + 10.0 * down, along(down));
        const Vec3 bent{side, -0.5, -2};
        const int second = s.add(name("middle_02").c_str(), middle, hand + 14.0 * down, along(bent));
        s.add(name("middle_03").c_str(), second, hand + 14.0 * down + 3.0 * bent, along({0, -1, -2}));
        const Vec3 hip{side * 15, 0, 175}, knee{side * 20, 0, 95}, ankle{side * 25, -2, 15};
        const int thigh = s.add(name("thigh").c_str(), pelvis, hip, along(knee - hip));
        const int calf = s.add(name("calf").c_str(), thigh, knee, along(ankle - knee));
        const int foot = s.add(name("foot").c_str(), calf, ankle, along({0, 1, -0.5}));
        s.add(name("ball").c_str(), foot, ankle + Vec3{0, 20, -12}, along({0, 1, 0}));
    }
    return s;
}

/// A body of straight limbs, facing +X with its right hand towards +Y.
SourceSkeleton body() {
    SourceSkeleton source;
    const std::int32_t parents[joint_count] = {-1, 0,  0,  0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  9,  9,  12, 13, 14, 16,
                                               17, 18, 19, 15, 15, 15, 20, 25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 20,
                                               37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53};
    std::memcpy(source.parents, parents, sizeof parents);
    const auto put = [&](int joint, float x, float y, float z) {
        source.offsets[3 * joint] = x;
        source.offsets[3 * joint + 1] = y;
        source.offsets[3 * joint + 2] = z;
    };
    const int left[] = {1, 4, 7, 10, 13, 16, 18, 20, 25, 28, 31, 34, 37};
    const int right[] = {2, 5, 8, 11, 14, 17, 19, 21, 40, 43, 46, 49, 52};
    for (const int *side : {left, right}) {
        const float out = side == left ? -1.0F : 1.0F;
        put(side[0], 0, 8 * out, -5);
        put(side[1], 0, 0, -40);
        put(side[2], 0, 0, -40);
        put(side[3], 12, 0, -5);
        put(side[4], 0, 3 * out, 10);
        put(side[5], 0, 12 * out, 0);
        put(side[6], 0, 25 * out, 0);
        put(side[7], 0, 25 * out, 0);
        for (int finger = 8; finger < 13; ++finger) {
            put(side[finger], static_cast<float>(10 - finger), 9 * out, 0);
            put(side[finger] + 1, 0, 3 * out, 0);
            put(side[finger] + 2, 0, 2 * out, 0);
        }
    }
    for (const int joint : {3, 6, 9, 12, 15}) put(joint, 0, 0, 10);
    source.rest_translation[2] = 90;
    return source;
}

struct Frame {
    float rotations[4 * joint_count] = {};
    float translation[3] = {0, 0, 90};

    Frame() {
        for (std::size_t joint = 0; joint < joint_count; ++joint) rotations[4 * joint + 3] = 1;
    }
    void turn(std::size_t joint, Quat q) {
        float *to = rotations + 4 * joint;
        to[0] = static_cast<float>(q.x);
        to[1] = static_cast<float>(q.y);
        to[2] = static_cast<float>(q.z);
        to[3] = static_cast<float>(q.w);
    }
};

/// Component-space positions and rotations of the bones; driven ones as computed by `retarget`.
struct Posed {
    std::vector<Vec3> places;
    std::vector<Quat> turns;

    Posed(const Skeleton &skeleton, const Retarget &retarget)
        : places(skeleton.bones.size()), turns(skeleton.bones.size()) {
        for (std::size_t i = 0; i < skeleton.bones.size(); ++i) {
            const Bone &bone = skeleton.bones[i];
            Quat rotation = bone.rotation;
            for (const Driven &driven : retarget.driven()) {
                if (driven.bone == static_cast<int>(i)) rotation = driven.rotation;
            }
            const Vec3 at = retarget.pelvis() == static_cast<int>(i) ? retarget.pelvis_translation() : bone.translation;
            const Quat from = bone.parent < 0 ? Quat{} : turns[static_cast<std::size_t>(bone.parent)];
            turns[i] = from * rotation;
            places[i] = (bone.parent < 0 ? Vec3{} : places[static_cast<std::size_t>(bone.parent)]) + rotate(from, at);
        }
    }
};

void expect_near(Vec3 found, Vec3 wanted, double tolerance, int line) {
    if (length(found - wanted) <= tolerance) return;
    std::fprintf(stderr, "line %d: (%g, %g, %g), not (%g, %g, %g)\n", line, found.x, found.y, found.z, wanted.x, wanted.y,
                 wanted.z);
    ++failures;
}
#define EXPECT_PLACE(found, wanted) expect_near(found, wanted, 2e-4, __LINE__)

Vec3 direction(const Skeleton &skeleton, const Posed &posed, const char *from, const char *to) {
    const Vec3 v = posed.places[static_cast<std::size_t>(skeleton.find(to))] -
                   posed.places[static_cast<std::size_t>(skeleton.find(from))];
    return (1 / length(v)) * v;
}

void an_a_pose_becomes_the_t() {
    const Skeleton skeleton = mannequin();
    Retarget retarget;
    std::string problem;
    EXPECT(retarget.build(skeleton.bones, body(), {}, problem));
    Frame frame;
    retarget.apply(frame.rotations, frame.translation, true);
    const Posed posed(skeleton, retarget);
    for (const char *side : {"_l", "_r"}) {
        const Vec3 out{side[1] == 'l' ? 1.0 : -1.0, 0, 0};
        const auto name = [&](const char *bone) { return bone + std::string(side); };
        const auto way = [&](const char *a, const char *b) {
            return direction(skeleton, posed, name(a).c_str(), name(b).c_str());
        };
        EXPECT_PLACE(way("upperarm", "lowerarm"), out);
        EXPECT_PLACE(way("lowerarm", "hand"), out);
        // The body's middle finger starts 1 cm ahead of the wrist, which is +Y here, and 9 cm out.
        EXPECT_PLACE(way("hand", "middle_01"), (1 / std::sqrt(82.0)) * (9.0 * out + Vec3{0, 1, 0}));
        EXPECT_PLACE(way("middle_01", "middle_02"), out);
        EXPECT_PLACE(way("middle_02", "middle_03"), out);
        // A fingertip has no direction: it follows the bone before.
        const int tip = skeleton.find(name("middle_03"));
        for (const Driven &driven : retarget.driven()) {
            if (driven.bone != tip) continue;
            const Quat turn = inverse(skeleton.bones[static_cast<std::size_t>(tip)].rotation) * driven.rotation;
            EXPECT_NEAR(std::fabs(turn.w), 1, 1e-9);
        }
        EXPECT_PLACE(way("thigh", "calf"), (Vec3{0, 0, -1}));
        EXPECT_PLACE(way("calf", "foot"), (Vec3{0, 0, -1}));
        // Feet, shoulders and spine keep the character's own rest, whatever the legs do.
        const Vec3 sole{0, 20, -12};
        EXPECT_PLACE(way("foot", "ball"), (1 / length(sole)) * sole);
    }
    for (const char *kept : {"pelvis", "spine_01", "spine_02", "spine_05", "neck_01", "Head", "clavicle_l", "foot_r"}) {
        const auto i = static_cast<std::size_t>(skeleton.find(kept));
        const Quat turn = inverse(skeleton.turns[i]) * posed.turns[i];
        EXPECT_NEAR(std::fabs(turn.w), 1, 1e-12);
    }
    // The twist bone belongs to no joint: it follows its arm.
    for (const Driven &driven : retarget.driven()) EXPECT(driven.bone != skeleton.find("upperarm_twist_01"));
    EXPECT_PLACE(direction(skeleton, posed, "upperarm_l", "upperarm_twist_01_l"), (Vec3{1, 0, 0}));
}

void turns_are_those_of_the_body() {
    const Skeleton skeleton = mannequin();
    Retarget retarget;
    std::string problem;
    EXPECT(retarget.build(skeleton.bones, body(), {}, problem));
    Frame frame;
    // The left forearm points along -Y, the body's left, in the T-pose. A quarter turn about Z takes -Y to +X: forward.
    // Forward is +Y here.
    frame.turn(18, about({0, 0, 1}, half_pi));
    // The right arm points along +Y. A quarter turn about X takes +Y to +Z: up, the forearm with it.
    frame.turn(17, about({1, 0, 0}, half_pi));
    // The left thigh points down. A quarter turn about Y takes -Z to -X: back, -Y here; the knee turns the shin down
    // again.
    frame.turn(1, about({0, 1, 0}, half_pi));
    frame.turn(4, about({0, 1, 0}, -half_pi));
    retarget.apply(frame.rotations, frame.translation, true);
    const Posed posed(skeleton, retarget);
    EXPECT_PLACE(direction(skeleton, posed, "upperarm_l", "lowerarm_l"), (Vec3{1, 0, 0}));
    EXPECT_PLACE(direction(skeleton, posed, "lowerarm_l", "hand_l"), (Vec3{0, 1, 0}));
    EXPECT_PLACE(direction(skeleton, posed, "upperarm_r", "lowerarm_r"), (Vec3{0, 0, 1}));
    EXPECT_PLACE(direction(skeleton, posed, "lowerarm_r", "hand_r"), (Vec3{0, 0, 1}));
    EXPECT_PLACE(direction(skeleton, posed, "thigh_l", "calf_l"), (Vec3{0, -1, 0}));
    EXPECT_PLACE(direction(skeleton, posed, "calf_l", "foot_l"), (Vec3{0, 0, -1}));
    // The foot is level again: hip and knee cancel.
    const Vec3 sole{0, 20, -12};
    EXPECT_PLACE(direction(skeleton, posed, "foot_l", "ball_l"), (1 / length(sole)) * sole);
    // The whole body turns a quarter about Z: forward, +Y here, becomes -X, and the left thigh, which pointed back, +X.
    frame.turn(0, about({0, 0, 1}, half_pi));
    retarget.apply(frame.rotations, frame.translation, true);
    EXPECT_PLACE(direction(skeleton, Posed(skeleton, retarget), "thigh_l", "calf_l"), (Vec3{1, 0, 0}));
}

void the_pelvis_moves_by_the_length_of_the_legs() {
    const Skeleton skeleton = mannequin();
    const SourceSkeleton source = body();
    Retarget retarget;
    std::string problem;
    EXPECT(retarget.build(skeleton.bones, source, {}, problem));
    // Thigh and shin: sqrt(5^2 + 80^2) and sqrt(5^2 + 2^2 + 80^2), of the body's 80.
    const double scale = (std::sqrt(6425.0) + std::sqrt(6429.0)) / 80;
    Frame frame;
    frame.translation[0] = 10;
    frame.translation[1] = 4;
    frame.translation[2] = 87;
    retarget.apply(frame.rotations, frame.translation, true);
    const auto pelvis = static_cast<std::size_t>(retarget.pelvis());
    // 10 forward are +Y, 4 to the right are -X.
    EXPECT_PLACE(Posed(skeleton, retarget).places[pelvis], (Vec3{-4 * scale, 10 * scale, 180 - 3 * scale}));
    retarget.apply(frame.rotations, frame.translation, false);
    EXPECT_PLACE(Posed(skeleton, retarget).places[pelvis], (Vec3{0, 0, 180 - 3 * scale}));
}

void a_skeleton_like_the_library_s_takes_its_rotations_as_they_are() {
    const SourceSkeleton source = body();
    Skeleton same;
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        const char *bone = mannequin_bone(joint, false);
        const float *at = source.offsets + 3 * joint;
        same.bones.push_back({*bone != 0 ? bone : umo_joint_name(static_cast<std::uint32_t>(joint)), source.parents[joint],
                              Quat{}, {at[0], at[1], joint == 0 ? 90 : at[2]}});
    }
    Retarget retarget;
    std::string problem;
    EXPECT(retarget.build(same.bones, source, {{"jaw", "jaw"}, {"left_eye", "LEFT_EYE"}}, problem));
    EXPECT(retarget.driven().size() == joint_count - 1);
    Frame frame;
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        const double n = static_cast<double>(joint);
        frame.turn(joint, about({std::sin(n), std::cos(n), 0.3}, 0.1 + 0.02 * n));
    }
    retarget.apply(frame.rotations, frame.translation, true);
    for (const Driven &driven : retarget.driven()) {
        const float *q = frame.rotations + 4 * driven.bone;
        const Quat &r = driven.rotation;
        EXPECT_NEAR(std::fabs(q[0] * r.x + q[1] * r.y + q[2] * r.z + q[3] * r.w), 1, 1e-6);
    }
}

void maps_name_real_joints_and_bones() {
    const Skeleton skeleton = mannequin();
    BoneMap map{};
    std::string problem;
    EXPECT(map_bones(skeleton.bones, {}, map, problem));
    // Five spine bones: every second, and the one that carries the neck. Case does not matter.
    EXPECT(map[3] == skeleton.find("spine_01") && map[6] == skeleton.find("spine_03"));
    EXPECT(map[9] == skeleton.find("spine_05") && map[15] == skeleton.find("Head"));
    EXPECT(map[22] == -1 && map[25] == -1);
    EXPECT(std::string(mannequin_bone(9, false)) == "spine_03" && std::string(mannequin_bone(6, false)) == "spine_02");
    EXPECT(std::string(mannequin_bone(joint_count, true)).empty());
    // Sides and fingers belong to the joints of those names.
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        const std::string name = umo_joint_name(static_cast<std::uint32_t>(joint)), bone = mannequin_bone(joint, true);
        if (bone.empty()) continue;
        EXPECT((name.find("left_") == 0) == (bone.size() > 2 && bone.substr(bone.size() - 2) == "_l"));
        EXPECT((name.find("right_") == 0) == (bone.size() > 2 && bone.substr(bone.size() - 2) == "_r"));
        for (const char *finger : {"index", "middle", "pinky", "ring", "thumb"}) {
            for (const char number : {'1', '2', '3'}) {
                const bool is_joint = name.find(std::string(finger) + number) != std::string::npos;
                EXPECT(is_joint == (bone.find(std::string(finger) + "_0" + number) == 0));
            }
        }
    }
}

void what_cannot_be_driven_is_named() {
    const Skeleton skeleton = mannequin();
    Retarget retarget;
    std::string problem;
    EXPECT(!retarget.build({}, body(), {}, problem) && problem.find("pelvis") != std::string::npos);
    EXPECT(!retarget.build(skeleton.bones, body(), {{"left_wing", "hand_l"}}, problem));
    EXPECT(problem.find("left_wing") != std::string::npos);
    EXPECT(!retarget.build(skeleton.bones, body(), {{"jaw", "no_bone"}}, problem));
    EXPECT(problem.find("no_bone") != std::string::npos);
    EXPECT(retarget.driven().empty() && retarget.pelvis() == -1);
    Frame frame;
    retarget.apply(frame.rotations, frame.translation, true);
    // An override may leave a joint out.
    EXPECT(retarget.build(skeleton.bones, body(), {{"head", ""}}, problem));
    for (const Driven &driven : retarget.driven()) EXPECT(driven.bone != skeleton.find("Head"));
}

void half_turns_have_an_axis() {
    for (const Vec3 v : {Vec3{1, 0, 0}, Vec3{0, 2, 0}, Vec3{0, 0, 3}, Vec3{1, 1, 1}}) {
        EXPECT_PLACE(rotate(arc(v, -1.0 * v), v), -1.0 * v);
        const Vec3 to{0.3, -1, 2};
        EXPECT_PLACE(rotate(arc(v, to), v), (length(v) / length(to)) * to);
    }
    EXPECT_NEAR(arc({0, 0, 0}, {1, 0, 0}).w, 1, 0);
}

/// Least horizontal distance of the left hand from the pelvis' axis while the arm swings before the belly.
double closest(Retarget &retarget, const Skeleton &skeleton) {
    double least = 1e9;
    for (int step = 0; step <= 20; ++step) {
        Frame frame;
        // In the library's body the left arm points to -Y: down by 70 degrees, then the forearm before the belly.
        frame.turn(16, about({1, 0, 0}, 1.2));
        frame.turn(18, about({0, 0, 1}, 0.1 * step));
        retarget.apply(frame.rotations, frame.translation, true);
        const Posed posed(skeleton, retarget);
        const Vec3 hand = posed.places[static_cast<std::size_t>(skeleton.find("hand_l"))];
        least = std::min(least, std::hypot(hand.x, hand.y));
    }
    return least;
}

void arms_keep_out_of_a_wide_body(const char *path) {
    auto model = umo::model::load(path);
    EXPECT(model);
    SourceSkeleton source;
    EXPECT(umo_model_get_skeleton(model->get(), UMO_AXES_UNREAL, source.parents, source.offsets, joint_count) == UMO_STATUS_OK);
    source.rest_translation[2] = 90;
    const Skeleton skeleton = mannequin();
    Surface surface;
    for (int ring = 0; ring <= 30; ++ring) {
        for (int side = 0; side < 24; ++side) {
            const double turn = half_pi * side / 6, height = 160 + 4 * ring;
            surface.vertices.push_back(static_cast<float>(60 * std::sin(turn)));
            surface.vertices.push_back(static_cast<float>(60 * std::cos(turn)));
            surface.vertices.push_back(static_cast<float>(height));
            surface.bones.push_back(skeleton.find(ring < 5 ? "pelvis" : ring < 14 ? "spine_03" : "spine_05"));
        }
    }
    Retarget retarget;
    std::string problem;
    EXPECT(!retarget.set_volume(skeleton.bones, surface, 1, problem));
    EXPECT(retarget.build(skeleton.bones, source, {}, problem));
    const double before = closest(retarget, skeleton);
    // Without the model there is no retargeter, and the bones go on as before.
    EXPECT(!retarget.set_volume(skeleton.bones, surface, 1, problem) && !problem.empty());
    EXPECT_NEAR(closest(retarget, skeleton), before, 1e-9);
    source.model = model->get();
    EXPECT(retarget.build(skeleton.bones, source, {}, problem));
    EXPECT(retarget.set_volume(skeleton.bones, surface, 1, problem));
    const double after = closest(retarget, skeleton);
    EXPECT(before < 65 && after > before + 10);
    for (const Driven &driven : retarget.driven()) EXPECT(std::isfinite(driven.rotation.w));
    surface.bones[3] = 999;
    EXPECT(!retarget.set_volume(skeleton.bones, surface, 1, problem) && problem.find("999") != std::string::npos);
}

/// The wrapper of C++, on the library's own skeleton.
void a_rig_is_made_of_named_bones(const char *path) {
    auto model = umo::model::load(path);
    SourceSkeleton source;
    EXPECT(umo_model_get_skeleton(model->get(), UMO_AXES_UNREAL, source.parents, source.offsets, joint_count) == UMO_STATUS_OK);
    std::vector<const char *> names;
    std::vector<float> rotations;
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        names.push_back(umo_joint_name(static_cast<std::uint32_t>(joint)));
        rotations.insert(rotations.end(), {0, 0, 0, 1});
        for (std::size_t i = 0; i < 3 && source.parents[joint] >= 0; ++i) {
            source.offsets[3 * joint + i] += source.offsets[3 * static_cast<std::size_t>(source.parents[joint]) + i];
        }
    }
    umo_rig rig = umo::retarget::defaults();
    EXPECT(!umo::retarget::make(*model, rig));
    rig.axes = UMO_AXES_UNREAL;
    rig.bone_count = joint_count;
    rig.names = names.data();
    rig.parents = source.parents;
    rig.places = source.offsets;
    rig.rotations = rotations.data();
    auto made = umo::retarget::make(*model, rig);
    EXPECT(made && made->bones() == joint_count && made->joints()[18] == 18);
    const Frame frame;
    std::vector<float> turned(rotations.size());
    EXPECT(made->apply(frame.rotations, frame.translation, turned.data()) == UMO_STATUS_OK);
    EXPECT_NEAR(turned[4 * 18 + 3], 1, 0.02);
}

} // namespace

int main(int argc, char **argv) {
    EXPECT(argc == 2);
    arms_keep_out_of_a_wide_body(argv[1]);
    a_rig_is_made_of_named_bones(argv[1]);
    an_a_pose_becomes_the_t();
    turns_are_those_of_the_body();
    the_pelvis_moves_by_the_length_of_the_legs();
    a_skeleton_like_the_library_s_takes_its_rotations_as_they_are();
    maps_name_real_joints_and_bones();
    what_cannot_be_driven_is_named();
    half_turns_have_an_axis();
    return verdict("retarget");
}
