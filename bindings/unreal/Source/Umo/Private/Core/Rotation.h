// Positions and rotations in Unreal's axes. No engine types, so that tests do not need the engine.
// SPDX-License-Identifier: MIT OR Apache-2.0

#pragma once

#include <cmath>

namespace umo_unreal {

struct Vec3 {
    double x = 0, y = 0, z = 0;
};

inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(double s, Vec3 v) { return {s * v.x, s * v.y, s * v.z}; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double length(Vec3 v) { return std::sqrt(dot(v, v)); }

/// A unit quaternion, multiplied like FQuat: `a * b` applies `b` first.
struct Quat {
    double x = 0, y = 0, z = 0, w = 1;
};

inline Quat operator*(Quat a, Quat b) {
    return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}
inline Quat inverse(Quat q) { return {-q.x, -q.y, -q.z, q.w}; }
inline Quat unit(Quat q) {
    const double n = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
    return n > 0 ? Quat{q.x / n, q.y / n, q.z / n, q.w / n} : Quat{};
}
inline Vec3 rotate(Quat q, Vec3 v) {
    const Vec3 axis{q.x, q.y, q.z};
    const Vec3 t = 2.0 * cross(axis, v);
    return v + q.w * t + cross(axis, t);
}

/// The shortest rotation from the direction of `from` to that of `to`; the identity if either has zero length.
inline Quat arc(Vec3 from, Vec3 to) {
    const double lengths = length(from) * length(to);
    if (lengths < 1e-9) return {};
    const double cosine = dot(from, to) / lengths;
    if (cosine < -1.0 + 1e-9) {
        // Half a turn about a perpendicular axis, chosen far from `from`.
        const Vec3 other = std::fabs(from.x) < 0.6 * length(from) ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
        const Vec3 axis = cross(from, other);
        const double n = length(axis);
        return {axis.x / n, axis.y / n, axis.z / n, 0};
    }
    const Vec3 axis = cross(from, to);
    return unit({axis.x / lengths, axis.y / lengths, axis.z / lengths, 1.0 + cosine});
}

} // namespace umo_unreal
