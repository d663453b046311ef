// An exception in a host's callback stops the call that invoked it: `throws MODEL`.
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

#include "umo.hpp"

#define CHECK(condition) ((condition) ? (void)0 : fail(#condition, __LINE__))

static void fail(const char *what, int line) {
    std::fprintf(stderr, "throws.cpp:%d: %s (%s)\n", line, what, umo_last_error());
    std::exit(1);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    auto model = umo::model::load(argv[1]);
    CHECK(model);
    umo::frames frames(*model, 2);
    const umo_frame_layout &layout = frames.layout();
    for (std::size_t frame = 0; frame < 2; frame++) {
        for (std::size_t joint = 0; joint < UMO_JOINT_COUNT; joint++) {
            const float identity[4] = {0, 0, 0, 1};
            auto *pose = static_cast<unsigned char *>(frames.data()) + frame * layout.frame_stride + layout.rotations;
            std::memcpy(pose + joint * layout.rotation_stride, identity, sizeof identity);
        }
    }
    const umo_clip clip = umo::clip(*model, frames, 2, nullptr);
    std::size_t pieces = 0, bytes = 0;
    const auto count = [&](const void *, std::size_t size) { return ++pieces, bytes += size, true; };
    CHECK(umo::write(clip, UMO_FORMAT_GLB, count) == UMO_STATUS_OK && pieces > 0 && bytes > 1000);
    const auto stop = [](const void *, std::size_t) { return false; };
    CHECK(umo::write(clip, UMO_FORMAT_GLB, stop) == UMO_STATUS_IO);
    const auto fails = [](const void *, std::size_t) -> bool { throw std::runtime_error("no room"); };
    CHECK(umo::write(clip, UMO_FORMAT_GLB, fails) == UMO_STATUS_IO);
    CHECK(umo::write(clip, UMO_FORMAT_GLB, count) == UMO_STATUS_OK);
    return 0;
}
