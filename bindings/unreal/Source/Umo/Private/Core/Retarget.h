// Transfers the library's pose to a character's bones, which have other axes, another rest pose and other proportions.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "BoneMap.h"
#include "umo.hpp"

namespace umo_unreal {

/// The library's skeleton in a T-pose, in Unreal's axes: `umo_model_get_skeleton`.
struct SourceSkeleton {
    std::int32_t parents[joint_count] = {};
    /// Centimetres, in the parent's frame.
    float offsets[3 * joint_count] = {};
    /// Rest position of the root, centimetres.
    float rest_translation[3] = {};
    /// The model that it is of; a handle, which may have been freed.
    const umo_model *model = nullptr;
};

/// A character's mesh at rest, in the component's space.
struct Surface {
    /// Three values for each point, centimetres.
    std::vector<float> vertices;
    /// Bone that has at least half of each point's weight, or -1.
    std::vector<std::int32_t> bones;
    /// Points of the triangles.
    std::vector<std::uint32_t> indices;
};

/// One bone of the result, relative to its parent.
struct Driven {
    int bone = -1;
    Quat rotation;
};

/// Built once per skeleton, then applied to each pose without allocating.
///
/// In the library's T-pose all joints are aligned with the body. A bone with another direction at rest, such as the
/// arms in the mannequin's A-pose, is first rotated to its T-pose direction by the shortest rotation, limb by limb from
/// the body outwards; the joint's rotation is applied on top. Spine, neck, collars, head and feet keep the character's
/// own posture.
class Retarget {
public:
    /// False if the skeleton cannot be driven: `problem` says why, and nothing is driven.
    bool build(const std::vector<Bone> &bones, const SourceSkeleton &source, const std::vector<Override> &overrides,
               std::string &problem);

    /// After `build`: leaves the bones to the library's retargeter, with which arms keep out of the body that the surface
    /// shows, by `gain`, 0 to 1. False if it cannot: `problem` says why, and the bones are rotated as without.
    bool set_volume(const std::vector<Bone> &bones, const Surface &surface, float gain, std::string &problem);

    /// `rotations` are the frame's 55 quaternions x y z w, `translation` its root position in centimetres. If `moves`
    /// is false the body stays in place and only moves up and down. `seconds`: since the last pose.
    void apply(const float *rotations, const float *translation, bool moves, float seconds = 1.0f / 30.0f);

    /// The bones that `apply` rotated, by rising index.
    const std::vector<Driven> &driven() const { return driven_; }
    /// Index of the pelvis bone (-1 before a successful `build`) and its position in its parent.
    int pelvis() const { return pelvis_; }
    Vec3 pelvis_translation() const { return pelvis_translation_; }

private:
    struct Link {
        int parent = -1;
        int joint = -1;
        Quat rest;       // local
        Quat aligned;    // component-space rotation in the T-pose
        Quat turned;     // scratch: component-space rotation in this pose
        int result = -1; // in driven_
    };

    void correct(const std::vector<Vec3> &places, const std::vector<Quat> &turns, const BoneMap &map);

    std::vector<Link> links_;
    std::vector<Driven> driven_;
    SourceSkeleton source_;
    Quat facing_;
    double scale_ = 1;
    int pelvis_ = -1;
    Vec3 pelvis_rest_;          // in the component's frame
    Vec3 pelvis_parent_place_;  // in the component's frame
    Quat pelvis_parent_turn_;
    Vec3 pelvis_translation_;
    Quat joint_turns_[joint_count];
    umo::retarget volume_;
    std::vector<float> turned_; // of all bones, by `volume_`
};

} // namespace umo_unreal
