// Animates two seconds of a tone; exits with 0 if the frames are as expected.
//
// SPDX-License-Identifier: MIT OR Apache-2.0
//
// SPDX-License-Identifier: MIT OR Apache-2.0
#include <cmath>
#include <cstdio>
#include <umo.hpp>

int main(int argc, char **argv) {
    auto model = umo::model::load(argc > 1 ? argv[1] : MODEL);
    if (!model) return std::fprintf(stderr, "%s: %s\n", model.message(), umo_last_error()), 1;
    auto config = umo::engine::defaults();
    config.mode = UMO_ENGINE_POLLED;
    auto engine = umo::engine::make(*model, &config);
    if (!engine) return std::fprintf(stderr, "%s: %s\n", engine.message(), umo_last_error()), 1;
    auto session = umo::session::make(*engine);
    if (!session) return std::fprintf(stderr, "%s: %s\n", session.message(), umo_last_error()), 1;

    std::vector<float> tone(2 * model->info().sample_rate);
    for (std::size_t i = 0; i < tone.size(); ++i) tone[i] = 0.3f * std::sin(0.05f * static_cast<float>(i));
    if (session->push_audio(tone.data(), tone.size()).value != tone.size() || session->finish() != UMO_STATUS_OK) return 1;
    if (engine->poll(UINT32_MAX).status != UMO_STATUS_OK) return 1;
    umo::frames frames(*model, 100);
    const auto pulled = session->pull(frames);
    for (std::size_t i = 0; i < pulled.value; ++i) {
        const float *q = frames[i].rotation(0);
        if (std::fabs(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] - 1.0f) > 1e-4f) return 1;
    }
    std::printf("umo %s: %zu frames\n", umo_version(), pulled.value);
    return pulled.value == 60 ? 0 : 1;
}
