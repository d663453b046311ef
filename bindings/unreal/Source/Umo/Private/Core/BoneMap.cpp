// SPDX-License-Identifier: MIT OR Apache-2.0

#include "BoneMap.h"

#include "umo.h"

namespace umo_unreal {

namespace {

static_assert(joint_count == UMO_JOINT_COUNT, "a bone for every joint");

/// In the library's joint order. Of five spine bones, the first, the middle one, and the one that carries neck and
/// collars are driven, since they lie where the joints do.
constexpr const char *five_spine_bones[joint_count] = {
    "pelvis",      "thigh_l",     "thigh_r",     "spine_01",    "calf_l",      "calf_r",      "spine_03",
    "foot_l",      "foot_r",      "spine_05",    "ball_l",      "ball_r",      "neck_01",     "clavicle_l",
    "clavicle_r",  "head",        "upperarm_l",  "upperarm_r",  "lowerarm_l",  "lowerarm_r",  "hand_l",
    "hand_r",      "",            "",            "",            "index_01_l",  "index_02_l",  "index_03_l",
    "middle_01_l", "middle_02_l", "middle_03_l", "pinky_01_l",  "pinky_02_l",  "pinky_03_l",  "ring_01_l",
    "ring_02_l",   "ring_03_l",   "thumb_01_l",  "thumb_02_l",  "thumb_03_l",  "index_01_r",  "index_02_r",
    "index_03_r",  "middle_01_r", "middle_02_r", "middle_03_r", "pinky_01_r",  "pinky_02_r",  "pinky_03_r",
    "ring_01_r",   "ring_02_r",   "ring_03_r",   "thumb_01_r",  "thumb_02_r",  "thumb_03_r",
};

constexpr std::size_t spine2 = 6;
constexpr std::size_t spine3 = 9;

char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

bool same_name(const std::string &a, const std::string &b) {
    if (a.size() != b.size()) return false;
    for (std::size_t i = 0; i < a.size(); ++i) {
        if (lower(a[i]) != lower(b[i])) return false;
    }
    return true;
}

int find_bone(const std::vector<Bone> &bones, const std::string &name) {
    if (name.empty()) return -1;
    for (std::size_t i = 0; i < bones.size(); ++i) {
        if (same_name(bones[i].name, name)) return static_cast<int>(i);
    }
    return -1;
}

} // namespace

const char *mannequin_bone(std::size_t joint, bool has_five_spine_bones) {
    if (joint >= joint_count) return "";
    if (!has_five_spine_bones && joint == spine2) return "spine_02";
    if (!has_five_spine_bones && joint == spine3) return "spine_03";
    return five_spine_bones[joint];
}

bool map_bones(const std::vector<Bone> &bones, const std::vector<Override> &overrides, BoneMap &map,
               std::string &problem) {
    const bool five = find_bone(bones, "spine_05") >= 0;
    for (std::size_t joint = 0; joint < joint_count; ++joint) {
        map[joint] = find_bone(bones, mannequin_bone(joint, five));
    }
    for (const Override &given : overrides) {
        std::size_t joint = 0;
        while (joint < joint_count && !same_name(umo_joint_name(static_cast<std::uint32_t>(joint)), given.joint)) ++joint;
        if (joint == joint_count) {
            problem = "bone override: unknown joint `" + given.joint + "`";
            return false;
        }
        map[joint] = find_bone(bones, given.bone);
        if (map[joint] < 0 && !given.bone.empty()) {
            problem = "bone override: the skeleton has no bone `" + given.bone + "` for joint `" + given.joint + "`";
            return false;
        }
    }
    return true;
}

} // namespace umo_unreal
