// SPDX-License-Identifier: MIT OR Apache-2.0

#include "Retarget.h"

namespace umo_unreal {

namespace {

constexpr std::size_t left_hip = 1, right_hip = 2, left_knee = 4, left_ankle = 7;
constexpr std::size_t left_wrist = 20, right_wrist = 21, first_finger = 25, fingers = 30;

/// Joint that a limb's bone points to; -1 for joints that keep the character's posture, -2 for finger tips, which
/// follow the bone before.
int tip_of(std::size_t joint) {
    switch (joint) {
    case 1: case 2: case 4: case 5: return static_cast<int>(joint) + 3;     // hips, knees
    case 16: case 17: case 18: case 19: return static_cast<int>(joint) + 2; // shoulders, elbows
    case left_wrist: return 28;                                             // the middle finger's first joint
    case right_wrist: return 43;
    default: break;
    }
    if (joint < first_finger || joint >= first_finger + fingers) return -1;
    return (joint - first_finger) % 3 == 2 ? -2 : static_cast<int>(joint) + 1;
}

Vec3 source_offset(const SourceSkeleton &source, std::size_t joint) {
    return {source.offsets[3 * joint], source.offsets[3 * joint + 1], source.offsets[3 * joint + 2]};
}

} // namespace

bool Retarget::build(const std::vector<Bone> &bones, const SourceSkeleton &source,
                     const std::vector<Override> &overrides, std::string &problem) {
    links_.clear();
    driven_.clear();
    volume_.reset();
    pelvis_ = -1;
    BoneMap map{};
    if (!map_bones(bones, overrides, map, problem)) return false;
    for (const std::size_t joint : {std::size_t{0}, left_hip, right_hip, left_knee, left_ankle}) {
        if (map[joint] < 0) {
            problem = std::string("the skeleton has no bone `") + mannequin_bone(joint, false) +
                      "`: name it in the bone overrides";
            return false;
        }
    }
    source_ = source;

    std::vector<Vec3> places(bones.size());
    std::vector<Quat> turns(bones.size());
    for (std::size_t i = 0; i < bones.size(); ++i) {
        const int parent = bones[i].parent;
        if (parent >= static_cast<int>(i)) {
            problem = "bone `" + bones[i].name + "` is listed before its parent";
            return false;
        }
        const Quat from = parent < 0 ? Quat{} : turns[static_cast<std::size_t>(parent)];
        const Vec3 at = parent < 0 ? Vec3{} : places[static_cast<std::size_t>(parent)];
        turns[i] = unit(from * bones[i].rotation);
        places[i] = at + rotate(from, bones[i].translation);
    }
    const auto place = [&](std::size_t joint) { return places[static_cast<std::size_t>(map[joint])]; };

    // The library faces +X with its right hand towards +Y; meshes mostly face +Y. The hips determine which.
    const Vec3 right = place(right_hip) - place(left_hip);
    const double yaw = std::atan2(right.y, right.x) - std::acos(0.0);
    facing_ = {0, 0, std::sin(yaw / 2), std::cos(yaw / 2)};

    const double leg = length(place(left_knee) - place(left_hip)) + length(place(left_ankle) - place(left_knee));
    const double source_leg = length(source_offset(source, left_knee)) + length(source_offset(source, left_ankle));
    scale_ = source_leg > 0 ? leg / source_leg : 1;

    pelvis_ = map[0];
    const auto pelvis = static_cast<std::size_t>(pelvis_);
    pelvis_rest_ = places[pelvis];
    const int above = bones[pelvis].parent;
    pelvis_parent_turn_ = above < 0 ? Quat{} : turns[static_cast<std::size_t>(above)];
    pelvis_parent_place_ = above < 0 ? Vec3{} : places[static_cast<std::size_t>(above)];
    pelvis_translation_ = bones[pelvis].translation;

    links_.resize(bones.size());
    for (std::size_t i = 0; i < bones.size(); ++i) {
        links_[i].parent = bones[i].parent;
        links_[i].rest = unit(bones[i].rotation);
        links_[i].turned = turns[i];
    }
    correct(places, turns, map);
    for (std::size_t i = 0; i < links_.size(); ++i) {
        if (links_[i].joint < 0) continue;
        links_[i].result = static_cast<int>(driven_.size());
        driven_.push_back({static_cast<int>(i), links_[i].rest});
    }
    return true;
}

/// Rotates each limb's bone to its direction in the T-pose, the limb's inner bones first.
void Retarget::correct(const std::vector<Vec3> &places, const std::vector<Quat> &turns, const BoneMap &map) {
    Quat corrections[joint_count];
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        const int tip = tip_of(joint);
        if (tip != -1) {
            // Parents have lower indices; joints outside the limbs are not corrected.
            corrections[joint] = corrections[source_.parents[joint]];
        }
        if (tip >= 0 && map[joint] >= 0 && map[static_cast<std::size_t>(tip)] >= 0) {
            const Vec3 bone = places[static_cast<std::size_t>(map[static_cast<std::size_t>(tip)])] -
                              places[static_cast<std::size_t>(map[joint])];
            // Every tip is a child of its joint, so its offset is the limb.
            const Vec3 limb = rotate(facing_, source_offset(source_, static_cast<std::size_t>(tip)));
            corrections[joint] = arc(rotate(corrections[joint], bone), limb) * corrections[joint];
        }
        if (map[joint] < 0) continue;
        Link &link = links_[static_cast<std::size_t>(map[joint])];
        link.joint = static_cast<int>(joint);
        link.aligned = unit(corrections[joint] * turns[static_cast<std::size_t>(map[joint])]);
    }
}

bool Retarget::set_volume(const std::vector<Bone> &bones, const Surface &surface, float gain, std::string &problem) {
    volume_.reset();
    if (pelvis_ < 0 || bones.size() != links_.size()) return false;
    std::vector<std::int32_t> parents, joints;
    std::vector<float> places, turns;
    std::vector<Vec3> at;
    std::vector<Quat> turned;
    for (std::size_t i = 0; i < bones.size(); ++i) {
        const int parent = bones[i].parent;
        const Quat from = parent < 0 ? Quat{} : turned[static_cast<std::size_t>(parent)];
        const Vec3 above = parent < 0 ? Vec3{} : at[static_cast<std::size_t>(parent)];
        turned.push_back(unit(from * bones[i].rotation));
        at.push_back(above + rotate(from, bones[i].translation));
        parents.push_back(parent);
        joints.push_back(links_[i].joint);
        for (const double x : {at[i].x, at[i].y, at[i].z}) places.push_back(static_cast<float>(x));
        const Quat &q = turned[i];
        for (const double x : {q.x, q.y, q.z, q.w}) turns.push_back(static_cast<float>(x));
    }
    umo_rig rig = umo::retarget::defaults();
    rig.axes = UMO_AXES_UNREAL;
    rig.gain = gain;
    rig.bone_count = static_cast<std::uint32_t>(bones.size());
    rig.vertex_count = static_cast<std::uint32_t>(surface.bones.size());
    rig.index_count = static_cast<std::uint32_t>(surface.indices.size());
    rig.parents = parents.data();
    rig.joints = joints.data();
    rig.places = places.data();
    rig.rotations = turns.data();
    rig.vertices = surface.vertices.data();
    rig.vertex_bones = surface.bones.data();
    rig.indices = surface.indices.data();
    umo_retarget *made = nullptr;
    if (umo_retarget_new(source_.model, &rig, &made) != UMO_STATUS_OK) {
        problem = umo_last_error();
        return false;
    }
    volume_ = umo::retarget(made, rig.bone_count);
    turned_.resize(4 * bones.size());
    return true;
}

void Retarget::apply(const float *rotations, const float *translation, bool moves, float seconds) {
    if (pelvis_ < 0) return;
    if (volume_) {
        const float *rest = source_.rest_translation;
        const float at[3] = {moves ? translation[0] : rest[0], moves ? translation[1] : rest[1], translation[2]};
        float place[3] = {};
        if (volume_.set_step(seconds) != UMO_STATUS_OK) return;
        if (volume_.apply(rotations, at, turned_.data(), place) != UMO_STATUS_OK) return;
        for (Driven &driven : driven_) {
            const float *q = &turned_[4 * static_cast<std::size_t>(driven.bone)];
            driven.rotation = {q[0], q[1], q[2], q[3]};
        }
        const Vec3 to = Vec3{place[0], place[1], place[2]} - pelvis_parent_place_;
        pelvis_translation_ = rotate(inverse(pelvis_parent_turn_), to);
        return;
    }
    const Quat back = inverse(facing_);
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        const float *q = rotations + 4 * joint;
        const Quat local{q[0], q[1], q[2], q[3]};
        const std::int32_t parent = source_.parents[joint];
        joint_turns_[joint] = parent < 0 ? local : joint_turns_[parent] * local;
    }
    for (Link &link : links_) {
        const Quat from = link.parent < 0 ? Quat{} : links_[static_cast<std::size_t>(link.parent)].turned;
        if (link.joint < 0) {
            link.turned = from * link.rest;
            continue;
        }
        link.turned = unit(facing_ * joint_turns_[link.joint] * back * link.aligned);
        driven_[static_cast<std::size_t>(link.result)].rotation = unit(inverse(from) * link.turned);
    }
    Vec3 moved{moves ? translation[0] - source_.rest_translation[0] : 0.0,
               moves ? translation[1] - source_.rest_translation[1] : 0.0,
               static_cast<double>(translation[2]) - source_.rest_translation[2]};
    const Vec3 at = pelvis_rest_ + scale_ * rotate(facing_, moved);
    pelvis_translation_ = rotate(inverse(pelvis_parent_turn_), at - pelvis_parent_place_);
}

} // namespace umo_unreal
