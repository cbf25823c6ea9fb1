// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/camera_setup.h"

#include <cmath>
#include <stdexcept>
#include <utility>

namespace skytree {
namespace {

/// Gauss-Jordan elimination with partial pivoting.
Matrix4 inverse(Matrix4 m) {
  Matrix4 out = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (int column = 0; column < 4; ++column) {
    int pivot = column;
    for (int row = column + 1; row < 4; ++row) {
      if (std::fabs(m[4 * row + column]) > std::fabs(m[4 * pivot + column])) pivot = row;
    }
    const double scale = m[4 * pivot + column];
    if (!(std::fabs(scale) > 1e-300)) throw std::invalid_argument("camera: the matrix is singular");
    for (int k = 0; k < 4; ++k) {
      std::swap(m[4 * pivot + k], m[4 * column + k]);
      std::swap(out[4 * pivot + k], out[4 * column + k]);
      m[4 * column + k] /= scale;
      out[4 * column + k] /= scale;
    }
    for (int row = 0; row < 4; ++row) {
      if (row == column) continue;
      const double factor = m[4 * row + column];
      for (int k = 0; k < 4; ++k) {
        m[4 * row + k] -= factor * m[4 * column + k];
        out[4 * row + k] -= factor * out[4 * column + k];
      }
    }
  }
  return out;
}

struct Point {
  double x, y, z;
  Vec3 vec() const { return {float(x), float(y), float(z)}; }
};
Point operator-(Point a, Point b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Point half(Point a, Point b) { return {0.5 * (a.x + b.x), 0.5 * (a.y + b.y), 0.5 * (a.z + b.z)}; }
double norm(Point a) { return std::sqrt(a.x * a.x + a.y * a.y + a.z * a.z); }

Point transform(const Matrix4& m, double x, double y, double z) {
  double out[4];
  for (int row = 0; row < 4; ++row) {
    out[row] = m[4 * row] * x + m[4 * row + 1] * y + m[4 * row + 2] * z + m[4 * row + 3];
  }
  return {out[0] / out[3], out[1] / out[3], out[2] / out[3]};
}

}  // namespace

CameraView make_camera(const Matrix4& camera_to_world, const Matrix4& projection) {
  for (int i = 0; i < 16; ++i) {
    if (!std::isfinite(camera_to_world[i]) || !std::isfinite(projection[i])) {
      throw std::invalid_argument("camera: a matrix entry is not finite");
    }
  }
  inverse(camera_to_world);  // throws where a scale of zero would squash all rays
  const Matrix4 unproject = inverse(projection);
  auto at = [&](double x, double y, double depth) {
    const Point p = transform(unproject, x, y, depth);
    return transform(camera_to_world, p.x, p.y, p.z);
  };
  const Point near_left = at(-1, 0, -1), near_right = at(1, 0, -1);
  const Point near_low = at(0, -1, -1), near_high = at(0, 1, -1);
  const Point far_left = at(-1, 0, 1), far_right = at(1, 0, 1);
  const Point far_low = at(0, -1, 1), far_high = at(0, 1, 1);
  const Point near_center = half(near_left, near_right), far_center = half(far_left, far_right);
  const double size =
      norm(far_right - far_left) + norm(far_high - far_low) + norm(far_center - near_center);
  const double tilt = norm(near_center - at(0, 0, -1)) + norm(far_center - at(0, 0, 1));
  if (!(tilt < 1e-4 * size)) {
    throw std::invalid_argument("camera: the projection is neither perspective nor orthographic");
  }
  CameraView camera;
  camera.near_center = near_center.vec();
  camera.near_dx = half(near_right, {-near_left.x, -near_left.y, -near_left.z}).vec();
  camera.near_dy = half(near_high, {-near_low.x, -near_low.y, -near_low.z}).vec();
  const Point span_right = far_right - near_right, span_left = far_left - near_left;
  const Point span_high = far_high - near_high, span_low = far_low - near_low;
  camera.span_center = half(span_right, span_left).vec();
  camera.span_dx = half(span_right, {-span_left.x, -span_left.y, -span_left.z}).vec();
  camera.span_dy = half(span_high, {-span_low.x, -span_low.y, -span_low.z}).vec();
  camera.width = camera.height = 1.0f;
  return camera;
}

}  // namespace skytree
