// Minimal test macros.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <cmath>
#include <cstdio>
#include <cstdlib>

inline int failures = 0;

#define EXPECT(what)                                                                                                   \
    do {                                                                                                               \
        if (!(what)) {                                                                                                 \
            std::fprintf(stderr, "%s:%d: %s\n", __FILE__, __LINE__, #what);                                            \
            ++failures;                                                                                                \
        }                                                                                                              \
    } while (false)

#define EXPECT_NEAR(a, b, tolerance)                                                                                   \
    do {                                                                                                               \
        const double found_ = (a), wanted_ = (b);                                                                      \
        if (!(std::fabs(found_ - wanted_) <= (tolerance))) {                                                           \
            std::fprintf(stderr, "%s:%d: %s is %.9g, not %.9g\n", __FILE__, __LINE__, #a, found_, wanted_);            \
            ++failures;                                                                                                \
        }                                                                                                              \
    } while (false)

/// Return value of main.
inline int verdict(const char *name) {
    std::printf("%s: %s\n", name, failures == 0 ? "ok" : "FAILED");
    return failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
