// Characters that know each other, and people with microphones: a library scene whose members stand in slots.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>

#include "Avatar.h"
#include "umo.hpp"

namespace umo_unreal {

/// Where a member stands: centimetres, X forward, Y to the right, Z up.
struct Standing {
    /// On the floor.
    std::array<float, 3> position{};
    /// Turn to the right about Z, radians.
    float yaw = 0;
    /// Above the position.
    float eye_height = 160;
};

/// One thread, the game's. Calls but `make` neither allocate nor wait.
class Scene {
public:
    /// Null on failure: `problem` says why.
    static std::unique_ptr<Scene> make(std::uint64_t seed, std::string &problem);
    explicit Scene(umo::scene scene) : scene_(std::move(scene)) {}

    /// Takes a slot for a member, which joins with `follow`; below 0 if all are taken.
    int take();
    /// The member of a slot leaves; the slot is free.
    void give_back(int slot);
    /// An avatar's member joins, moves, or leaves with its session; if it has another one by now, it joins anew.
    umo_status follow(int slot, Avatar *avatar, const Standing &where);
    /// The same for a person.
    umo_status follow_person(int slot, const Standing &where) { return follow(slot, nullptr, true, where); }

    /// Looks at another slot's member, whatever is said. Until `look_freely`, or until it joins anew.
    umo_status look_at(int slot, int other);
    umo_status look_at(int slot, const std::array<float, 3> &point);
    umo_status look_freely(int slot);
    /// The parts that the scene plays of it: a sum of `UMO_SCENE_…`.
    umo_status set_allowed(int slot, std::uint32_t parts);
    /// A person's voice: any rate, full scale 1.
    umo_status hear(int slot, const float *samples, std::size_t count);
    /// Once per tick, before the avatars show their poses.
    umo_status update(double seconds) { return scene_.update(seconds); }
    /// The slot that has the floor; below 0 for nobody.
    int floor();
    umo::result<umo_member> info(int slot) { return scene_.member(member(slot)); }
    /// Whether the member of a slot is in the scene.
    bool has(int slot) const { return member(slot) != 0; }
    std::string last_error() const { return scene_.last_error(); }

private:
    struct Slot {
        bool is_taken = false;
        /// 0 while it is not in the scene.
        std::uint32_t member = 0;
        const umo_session *session = nullptr;
    };

    umo_status follow(int slot, umo::session *session, bool is_there, const Standing &where);
    std::uint32_t member(int slot) const;

    umo::scene scene_;
    std::array<Slot, UMO_SCENE_MEMBER_COUNT> slots_{};
};

} // namespace umo_unreal
