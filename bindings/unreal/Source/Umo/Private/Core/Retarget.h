// The library's pose on a character's own bones: other axes per bone, another pose of rest, other proportions.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "BoneMap.h"

namespace umo_unreal {

/// The library's skeleton in a T, in Unreal's axes: `umo_model_get_skeleton`.
struct SourceSkeleton {
    std::int32_t parents[joint_count] = {};
    /// Centimetres, in the parent's frame.
    float offsets[3 * joint_count] = {};
    /// Where the root is when the body rests, centimetres.
    float rest_translation[3] = {};
};

/// One bone of the result, relative to its parent.
struct Driven {
    int bone = -1;
    Quat rotation;
};

/// Made once for a skeleton, then applied to every pose without allocating.
///
/// The library's joints are all aligned with the body in its T. A bone that points elsewhere at rest, as arms do in the
/// mannequin's A, is first turned to where the T has it by the shortest turn, limb by limb from the body outwards; the
/// joint's turn comes on top. Spine, neck, collars, head and feet keep the character's own posture.
class Retarget {
public:
    /// False where the skeleton cannot be driven: `problem` says why, and nothing is driven.
    bool build(const std::vector<Bone> &bones, const SourceSkeleton &source, const std::vector<Override> &overrides,
               std::string &problem);

    /// `rotations` are the frame's 55 quaternions x y z w, `translation` its place of the root in centimetres. Where
    /// `moves` is false the body stays over its place and only goes up and down.
    void apply(const float *rotations, const float *translation, bool moves);

    /// The bones that `apply` turned, by rising index.
    const std::vector<Driven> &driven() const { return driven_; }
    /// Index of the pelvis bone, -1 before a `build` that worked, and where it is in its parent.
    int pelvis() const { return pelvis_; }
    Vec3 pelvis_translation() const { return pelvis_translation_; }

private:
    struct Link {
        int parent = -1;
        int joint = -1;
        Quat rest;       // local
        Quat aligned;    // of the whole bone in the T, in the component's frame
        Quat turned;     // scratch: of the whole bone in this pose
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
};

} // namespace umo_unreal
