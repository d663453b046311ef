// Which of the mannequin's bones each of the library's 55 joints moves.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "Rotation.h"

namespace umo_unreal {

constexpr std::size_t joint_count = 55;

/// A bone of the character at rest, relative to its parent; centimetres. Parents come before children, -1 is none.
struct Bone {
    std::string name;
    int parent = -1;
    Quat rotation;
    Vec3 translation;
};

/// A joint that moves another bone than the mannequin's: `bone` empty leaves it out.
struct Override {
    std::string joint;
    std::string bone;
};

/// For each joint the index of the bone that it moves, or -1.
using BoneMap = std::array<int, joint_count>;

/// The name that the mannequin has for a joint's bone, "" for none (jaw and eyes, which face curves move). A skeleton with
/// `spine_05` has the five spine bones of Manny, Quinn and MetaHuman, any other the three of the UE4 mannequin.
const char *mannequin_bone(std::size_t joint, bool has_five_spine_bones);

/// The map for a skeleton. Names are compared without regard to case, as FName compares them. An override that names no
/// joint is reported in `problem` and the map is not to be used.
bool map_bones(const std::vector<Bone> &bones, const std::vector<Override> &overrides, BoneMap &map,
               std::string &problem);

} // namespace umo_unreal
