// Two characters in a scene with the real library: one speaks assets/hello.wav and has the floor, the other turns there.
// Arguments: the model, the recording.
// SPDX-License-Identifier: MIT OR Apache-2.0

#include <chrono>
#include <cmath>
#include <string>
#include <thread>
#include <vector>

#include "Avatar.h"
#include "Expect.h"
#include "Recording.h"
#include "Scene.h"

using namespace umo_unreal;

namespace {

constexpr std::uint32_t rate = 16000;
constexpr float pi = 3.14159265F;

std::shared_ptr<Avatar> character(const std::shared_ptr<Host> &host) {
    Settings settings;
    settings.sample_rate = rate;
    settings.output_latency = 0;
    settings.margin = 0;
    std::string problem;
    auto avatar = Avatar::make(host, settings, problem);
    EXPECT(avatar != nullptr);
    return avatar;
}

/// Turn of neck and head to the right, radians.
double yaw(const Pose &pose) {
    constexpr std::size_t neck = 12, head = 15;
    const auto turn = [&](std::size_t joint) {
        return 2 * std::atan2(pose.rotations[4 * joint + 2], pose.rotations[4 * joint + 3]);
    };
    return turn(neck) + turn(head);
}

/// Mean turn of the listener while the speaker stands at `right` of it.
double turned(const std::shared_ptr<Host> &host, const std::vector<float> &samples, float right) {
    std::string problem;
    auto scene = Scene::make(1, problem);
    EXPECT(scene != nullptr);
    const auto speaker = character(host), listener = character(host);
    const int first = scene->take(), second = scene->take();
    constexpr std::size_t block = rate / 30;
    double now = 0, sum = 0;
    int count = 0;
    std::vector<float> voice(block), silence(block);
    for (std::size_t tick = 0; tick < 90; ++tick) {
        std::copy_n(samples.begin() + static_cast<std::ptrdiff_t>(tick * block), block, voice.begin());
        std::fill(silence.begin(), silence.end(), 0.0F);
        speaker->hear(voice.data(), block, 1, rate, now);
        listener->hear(silence.data(), block, 1, rate, now);
        const double due = std::floor((now - speaker->delay()) * 30) + 2;
        for (const auto &each : {speaker, listener}) {
            for (int i = 0; i < 20000 && static_cast<double>(each->stats().frames) < due; ++i) {
                std::this_thread::sleep_for(std::chrono::microseconds(100));
            }
        }
        EXPECT(scene->follow(first, speaker.get(), {{100, right, 0}, pi, 160}) == UMO_STATUS_OK);
        EXPECT(scene->follow(second, listener.get(), {}) == UMO_STATUS_OK);
        EXPECT(scene->update(1 / 30.0) == UMO_STATUS_OK);
        EXPECT(speaker->show(1 / 30.0, now) == UMO_STATUS_OK);
        EXPECT(listener->show(1 / 30.0, now) == UMO_STATUS_OK);
        now += static_cast<double>(block) / rate;
        if (tick < 65) continue;
        EXPECT(scene->floor() == first);
        sum += yaw(listener->pose());
        ++count;
    }
    EXPECT(scene->info(second).value.role == UMO_ROLE_LISTENING);
    // In any order.
    if (right > 0) scene.reset();
    speaker->close();
    if (scene) EXPECT(scene->follow(first, speaker.get(), {}) == UMO_STATUS_OK && !scene->has(first));
    return sum / count;
}

void people_have_voices_and_slots_are_used_again() {
    std::string problem;
    const auto scene = Scene::make(0, problem);
    const int person = scene->take(), other = scene->take();
    EXPECT(!scene->has(person) && scene->floor() == -1);
    EXPECT(scene->follow_person(person, {}) == UMO_STATUS_OK && scene->has(person));
    EXPECT(scene->follow_person(other, {{100, 0, 0}, pi, 170}) == UMO_STATUS_OK);
    EXPECT(scene->look_at(other, person) == UMO_STATUS_OK && scene->look_freely(other) == UMO_STATUS_OK);
    EXPECT(scene->look_at(other, {0, 0, 100}) == UMO_STATUS_OK);
    EXPECT(scene->look_at(other, other) == UMO_STATUS_INVALID_ARGUMENT && !scene->last_error().empty());
    EXPECT(scene->set_allowed(other, UMO_SCENE_LOOK) == UMO_STATUS_OK);
    std::vector<float> loud(533);
    for (std::size_t i = 0; i < loud.size(); ++i) loud[i] = i % 8 < 4 ? 0.2F : -0.2F;
    for (int i = 0; i < 45; ++i) {
        EXPECT(scene->hear(person, loud.data(), loud.size()) == UMO_STATUS_OK);
        EXPECT(scene->update(1 / 30.0) == UMO_STATUS_OK);
    }
    EXPECT(scene->floor() == person);
    scene->give_back(person);
    EXPECT(scene->update(1 / 30.0) == UMO_STATUS_OK && scene->floor() == -1);
    EXPECT(scene->take() == person && !scene->has(person));
    while (scene->take() >= 0) {}
    EXPECT(scene->follow_person(-1, {}) == UMO_STATUS_INVALID_ARGUMENT);
}

} // namespace

int main(int count, char **arguments) {
    if (count != 3) return EXIT_FAILURE;
    const std::vector<float> samples = recording(arguments[2]);
    EXPECT(samples.size() > 100000);
    people_have_voices_and_slots_are_used_again();
    Hosts hosts;
    std::string problem;
    const auto host = hosts.open(arguments[1], umo::engine::defaults(), problem);
    EXPECT(host != nullptr);
    if (host) {
        const double right = turned(host, samples, 100), left = turned(host, samples, -100);
        EXPECT(right - left > 0.2);
        std::printf("turned by %.2f to the right and %.2f to the left\n", right, -left);
    }
    return verdict("scene");
}
