// The mannequin bone that each of the library's 55 joints drives.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "Rotation.h"

namespace umo_unreal {

constexpr std::size_t joint_count = 55;

/// A bone of the character at rest, relative to its parent; centimetres. Parents come before children; -1 means no
/// parent.
struct Bone {
    std::string name;
    int parent = -1;
    Quat rotation;
    Vec3 translation;
};

/// A joint that drives a bone with a non-mannequin name. An empty `bone` leaves the joint out.
struct Override {
    std::string joint;
    std::string bone;
};

/// Index of the bone that each joint drives, or -1.
using BoneMap = std::array<int, joint_count>;

/// The mannequin's bone name for a joint; "" for jaw and eyes, which face curves move. A skeleton with `spine_05` has
/// the five spine bones of Manny, Quinn and MetaHuman, any other the three of the UE4 mannequin.
const char *mannequin_bone(std::size_t joint, bool has_five_spine_bones);

/// Maps the joints to a skeleton. Names are compared case-insensitively, like FName. If an override names an unknown
/// joint, `problem` says so and the map must not be used.
bool map_bones(const std::vector<Bone> &bones, const std::vector<Override> &overrides, BoneMap &map,
               std::string &problem);

} // namespace umo_unreal
