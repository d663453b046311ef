// A recording for the tests.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <vector>

/// The samples of a 16-bit mono recording of 16 kHz with a header of 44 bytes, as the file in assets/ is.
inline std::vector<float> recording(const char *path) {
    std::ifstream file(path, std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
    std::vector<float> samples;
    if (bytes.size() < 44 || std::memcmp(bytes.data() + 36, "data", 4) != 0) return samples;
    for (std::size_t i = 44; i + 1 < bytes.size(); i += 2) {
        std::int16_t value = 0;
        std::memcpy(&value, bytes.data() + i, 2);
        samples.push_back(static_cast<float>(value) / 32768);
    }
    return samples;
}
