// SPDX-License-Identifier: MIT OR Apache-2.0

#include "Scene.h"

#include <algorithm>

namespace umo_unreal {

std::unique_ptr<Scene> Scene::make(std::uint64_t seed, std::string &problem) {
    auto made = umo::scene::make(seed);
    if (!made) {
        problem = explain(made.status, umo_last_error());
        return nullptr;
    }
    return std::make_unique<Scene>(std::move(*made));
}

int Scene::take() {
    const auto free = std::find_if(slots_.begin(), slots_.end(), [](const Slot &slot) { return !slot.is_taken; });
    if (free == slots_.end()) return -1;
    *free = {true, 0, nullptr};
    return static_cast<int>(free - slots_.begin());
}

void Scene::give_back(int slot) {
    // Refused if it has left with its session.
    if (has(slot)) (void)!scene_.remove(member(slot));
    if (slot >= 0) slots_[static_cast<std::size_t>(slot)] = {};
}

umo_status Scene::follow(int slot, Avatar *avatar, const Standing &where) {
    umo::session *const session = avatar != nullptr && avatar->session_ ? &avatar->session_ : nullptr;
    return follow(slot, session, session != nullptr, where);
}

umo_status Scene::follow(int slot, umo::session *session, bool is_there, const Standing &where) {
    if (slot < 0) return UMO_STATUS_INVALID_ARGUMENT;
    Slot &own = slots_[static_cast<std::size_t>(slot)];
    const umo_session *const handle = session != nullptr ? session->get() : nullptr;
    if (own.member != 0 && (!is_there || handle != own.session)) {
        (void)!scene_.remove(own.member);
        own = {true, 0, nullptr};
    }
    if (!is_there) return UMO_STATUS_OK;
    const umo_place place = umo::place(where.position, where.yaw, where.eye_height, UMO_AXES_UNREAL);
    if (own.member != 0) return scene_.set_place(own.member, place);
    const auto added = session != nullptr ? scene_.add(*session, place) : scene_.add(place);
    own = {true, added ? *added : 0, handle};
    return added.status;
}

umo_status Scene::look_at(int slot, int other) { return scene_.set_target(member(slot), member(other)); }

umo_status Scene::look_at(int slot, const std::array<float, 3> &point) {
    return scene_.set_target(member(slot), point, UMO_AXES_UNREAL);
}

umo_status Scene::look_freely(int slot) { return scene_.set_target(member(slot), 0); }

umo_status Scene::set_allowed(int slot, std::uint32_t parts) { return scene_.set_allowed(member(slot), parts); }

umo_status Scene::hear(int slot, const float *samples, std::size_t count) {
    return scene_.push_audio(member(slot), samples, count);
}

int Scene::floor() {
    const auto holder = scene_.floor();
    const auto found = std::find_if(slots_.begin(), slots_.end(), [&](const Slot &slot) { return slot.member == *holder; });
    return !holder || *holder == 0 || found == slots_.end() ? -1 : static_cast<int>(found - slots_.begin());
}

std::uint32_t Scene::member(int slot) const { return slot < 0 ? 0 : slots_[static_cast<std::size_t>(slot)].member; }

} // namespace umo_unreal
