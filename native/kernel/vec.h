// SPDX-License-Identifier: GPL-3.0-or-later
// Three-component vectors and 3x3 matrices for host and device.
#pragma once

#include <math.h>

#include "kernel/config.h"
#include "kernel/minmax.h"

namespace skytree {

struct Vec2 {
  float x, y;
};

struct Vec3 {
  float x, y, z;
};

SKY_HD Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
SKY_HD Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
SKY_HD Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
SKY_HD Vec3 operator*(Vec3 a, Vec3 b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
SKY_HD Vec3 operator*(Vec3 a, float s) { return {a.x * s, a.y * s, a.z * s}; }
SKY_HD Vec3 operator*(float s, Vec3 a) { return a * s; }
SKY_HD Vec3& operator+=(Vec3& a, Vec3 b) { return a = a + b; }
SKY_HD Vec3& operator*=(Vec3& a, Vec3 b) { return a = a * b; }
SKY_HD Vec3& operator*=(Vec3& a, float s) { return a = a * s; }

SKY_HD float dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
SKY_HD Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
SKY_HD float length(Vec3 a) { return sqrtf(dot(a, a)); }
SKY_HD Vec3 normalize(Vec3 a) { return a * (1.0f / length(a)); }

/// Rec. 709 luminance of linear RGB; the scalar that build statistics and importance use.
SKY_HD float luminance(Vec3 rgb) { return 0.2126f * rgb.x + 0.7152f * rgb.y + 0.0722f * rgb.z; }
SKY_HD float max_component(Vec3 a) { return maxf(a.x, maxf(a.y, a.z)); }
SKY_HD float clampf(float x, float lo, float hi) { return minf(maxf(x, lo), hi); }

/// Row-major: row[i] dotted with a column vector.
struct Mat3 {
  Vec3 row[3];
};

SKY_HD Mat3 identity3() { return {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}; }
SKY_HD Vec3 operator*(const Mat3& m, Vec3 v) {
  return {dot(m.row[0], v), dot(m.row[1], v), dot(m.row[2], v)};
}
SKY_HD Vec3 transpose_mul(const Mat3& m, Vec3 v) {
  return m.row[0] * v.x + m.row[1] * v.y + m.row[2] * v.z;
}

/// Orthonormal basis around a unit normal, without a branch that could divide by zero.
/// Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
SKY_HD void orthonormal_basis(Vec3 n, Vec3* tangent, Vec3* bitangent) {
  const float sign = n.z < 0.0f ? -1.0f : 1.0f;
  const float a = -1.0f / (sign + n.z);
  const float b = n.x * n.y * a;
  *tangent = {1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x};
  *bitangent = {b, sign + n.y * n.y * a, -n.y};
}

}  // namespace skytree
