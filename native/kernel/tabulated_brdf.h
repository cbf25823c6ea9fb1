// SPDX-License-Identifier: GPL-3.0-or-later
// A tabulated BRDF: its interpolated value, and directions drawn from a kd-tree over (view, half
// vector), in the local frame (z = shading normal).
//
// Table: S. Rusinkiewicz, "A New Change of Variables for Efficient BRDF Representation", EGWR 1998,
// with the spacing of W. Matusik et al., "A Data-Driven Reflectance Model", SIGGRAPH 2003 (the MERL
// files). The azimuth of the difference vector is kept modulo pi, so that swapping the two
// directions reads the very same cells: every table is reciprocal.
//
// Sampling: Ergun, Kurt and Ozturk, SCCG 2012, in three or four dimensions (kernel/nd_kdtree.h).
// The condition is the view direction; half vectors are drawn, because a lobe seen as a function of
// the half vector hardly moves with the view. Blocks are uniform in the solid angle of the half
// vector, so that the density towards the light is that over 4 (o.h).
#pragma once

#include "kernel/nd_kdtree.h"
#include "kernel/vec.h"

namespace skytree {

/// Values at the middles of the cells; outermost axis first, channels innermost.
struct BrdfTableView {
  const float* values;
  int32_t half_theta;  // uniform in sqrt(theta_h)
  int32_t half_phi;    // over 2 pi; 1: isotropic
  int32_t diff_theta;  // uniform in theta_d
  int32_t diff_phi;    // over pi
  int32_t channels;    // 1 or 3
  /// Half vectors are divided by it in x and y before their angles are taken, so that a lobe of
  /// that elongation is round in the table and in the tree; (1, 1) for a measured one.
  Vec2 stretch;
};

struct TabulatedBrdfView {
  BrdfTableView table;
  NdKdTreeView tree;  // isotropic: (view height | s, |phi| from the view), else (view height, view
                      // azimuth | s, phi), s = 1 - cos(theta) of the stretched half vector
};

/// The stretched half vector, and what its solid angle is multiplied by on the way to the true one.
struct StretchedHalf {
  Vec3 h;
  float solid_angle;
};

SKY_HD StretchedHalf stretch_half(const BrdfTableView& table, Vec3 h) {
  const Vec3 v = {h.x / table.stretch.x, h.y / table.stretch.y, h.z};
  const float norm = length(v);
  return {v * (1.0f / norm), table.stretch.x * table.stretch.y * norm * norm * norm};
}

/// Azimuth in turns, [0,1).
SKY_HD float azimuth_turns(float x, float y) {
  const float turns = sky_atan2(y, x) * kInvTwoPi;
  return minf(turns < 0.0f ? turns + 1.0f : turns, kOneMinusEpsilon);
}

namespace detail {

/// Two cells and how far the position, in cells, lies towards the second.
struct CellPair {
  int32_t first, second;
  float fraction;
};

SKY_HD CellPair cell_pair(float position, int32_t count, bool periodic) {
  const float x = position - 0.5f;
  const float floored = floorf(x);
  int32_t first = static_cast<int32_t>(floored), second = first + 1;
  if (periodic) {
    first = first < 0 ? count - 1 : first;
    second = second >= count ? 0 : second;
  } else {
    first = first < 0 ? 0 : first;
    second = second >= count ? count - 1 : second;
  }
  first = first >= count ? count - 1 : first;
  return {first, second, x - floored};
}

}  // namespace detail

/// The BRDF, without cosine. Both directions above the surface.
SKY_HD Vec3 brdf_table_value(const BrdfTableView& table, Vec3 o, Vec3 i) {
  const Vec3 h = normalize(o + i);
  const float radius = sqrtf(h.x * h.x + h.y * h.y);
  const Vec2 axis = radius > 1e-12f ? Vec2{h.x / radius, h.y / radius} : Vec2{1.0f, 0.0f};
  const Vec3 along = {axis.x * h.z, axis.y * h.z, -radius};
  const float dx = dot(i, along), dy = i.y * axis.x - i.x * axis.y;
  const float theta_d = sky_atan2(sqrtf(dx * dx + dy * dy), dot(i, h));
  const float phi_d = sky_atan2(dy, dx) * kInvPi;
  const Vec3 s = stretch_half(table, h).h;
  const float theta_h = sky_atan2(sqrtf(s.x * s.x + s.y * s.y), s.z);
  constexpr float kTwoOverPi = 0.636619772f;
  const detail::CellPair cells[4] = {
      detail::cell_pair(sqrtf(theta_h * kTwoOverPi) * static_cast<float>(table.half_theta),
                        table.half_theta, false),
      detail::cell_pair(azimuth_turns(s.x, s.y) * static_cast<float>(table.half_phi),
                        table.half_phi, true),
      detail::cell_pair(theta_d * kTwoOverPi * static_cast<float>(table.diff_theta),
                        table.diff_theta, false),
      detail::cell_pair((phi_d < 0.0f ? phi_d + 1.0f : phi_d) * static_cast<float>(table.diff_phi),
                        table.diff_phi, true)};
  Vec3 sum = {0, 0, 0};
  for (int corner = 0; corner < 16; ++corner) {
    const bool b0 = corner & 8, b1 = corner & 4, b2 = corner & 2, b3 = corner & 1;
    if (b1 && table.half_phi == 1) continue;
    const float w1 = table.half_phi == 1 ? 1.0f : b1 ? cells[1].fraction : 1.0f - cells[1].fraction;
    const float weight = (b0 ? cells[0].fraction : 1.0f - cells[0].fraction) * w1 *
                         (b2 ? cells[2].fraction : 1.0f - cells[2].fraction) *
                         (b3 ? cells[3].fraction : 1.0f - cells[3].fraction);
    const int32_t c0 = b0 ? cells[0].second : cells[0].first;
    const int32_t c1 = b1 ? cells[1].second : cells[1].first;
    const int32_t c2 = b2 ? cells[2].second : cells[2].first;
    const int32_t c3 = b3 ? cells[3].second : cells[3].first;
    const float* value =
        table.values +
        ((c0 * table.half_phi + c1) * table.diff_theta + c2) * table.diff_phi * table.channels +
        c3 * table.channels;
    if (table.channels == 1) {
      sum.x += weight * value[0];
    } else {
      sum += weight * Vec3{value[0], value[1], value[2]};
    }
  }
  return table.channels == 1 ? Vec3{sum.x, sum.x, sum.x} : sum;
}

/// Unit vector in the plane of the surface towards the view; isotropic tables measure azimuths from
/// it.
SKY_HD Vec2 view_azimuth(Vec3 o) {
  const float radius = sqrtf(o.x * o.x + o.y * o.y);
  return radius > 1e-12f ? Vec2{o.x / radius, o.y / radius} : Vec2{1.0f, 0.0f};
}

SKY_HD const NdSlice& brdf_slice(const TabulatedBrdfView& brdf, Vec3 o) {
  NdPoint condition = {};
  condition.x[0] = minf(o.z, 1.0f);
  if (brdf.table.half_phi > 1) condition.x[1] = azimuth_turns(o.x, o.y);
  return nd_slice(brdf.tree, condition);
}

/// Solid angle of i that a unit of the tree's free dimensions covers there.
SKY_HD float brdf_jacobian(const StretchedHalf& stretched, float cos_half) {
  return stretched.solid_angle * (4.0f * kTwoPi) * cos_half;
}

/// Density of i, per steradian. Both directions above the surface.
SKY_HD float brdf_pdf(const TabulatedBrdfView& brdf, Vec3 o, Vec3 i) {
  const Vec3 h = normalize(o + i);
  const StretchedHalf stretched = stretch_half(brdf.table, h);
  const Vec3 s = stretched.h;
  NdPoint point = {};
  point.x[0] = minf((s.x * s.x + s.y * s.y) / (1.0f + s.z), 1.0f);
  if (brdf.table.half_phi > 1) {
    point.x[1] = azimuth_turns(s.x, s.y);
  } else {
    const Vec2 view = view_azimuth(o);
    point.x[1] =
        sky_atan2(fabsf(s.y * view.x - s.x * view.y), s.x * view.x + s.y * view.y) * kInvPi;
  }
  return nd_pdf(brdf.tree, brdf_slice(brdf, o), point) / brdf_jacobian(stretched, dot(o, h));
}

/// The half vector at a point of the tree's free dimensions; `mirrored` on the other side of the
/// plane of incidence, isotropic tables only.
SKY_HD Vec3 brdf_half_vector(const BrdfTableView& table, Vec3 o, const NdPoint& point,
                             bool mirrored) {
  const bool isotropic = table.half_phi == 1;
  float sine, cosine;
  sky_sincos_turns(isotropic ? 0.5f * point.x[1] : point.x[1], &sine, &cosine);
  const float s = point.x[0];
  const float radius = sqrtf(s * (2.0f - s));
  Vec2 v = {radius * cosine, radius * (mirrored ? -sine : sine)};
  if (isotropic) {
    const Vec2 view = view_azimuth(o);
    v = {v.x * view.x - v.y * view.y, v.x * view.y + v.y * view.x};
  }
  return normalize({v.x * table.stretch.x, v.y * table.stretch.y, 1.0f - s});
}

/// A direction drawn for the view o; it may lie below the surface.
SKY_HD Vec3 brdf_sample(const TabulatedBrdfView& brdf, Vec3 o, Vec2 u) {
  NdPoint numbers = {};
  numbers.x[0] = u.x;
  numbers.x[1] = u.y;
  bool mirrored = false;
  if (brdf.table.half_phi == 1) {  // folded, so that neighbouring numbers stay neighbours
    mirrored = u.y >= 0.5f;
    numbers.x[1] = minf(mirrored ? 2.0f - 2.0f * u.y : 2.0f * u.y, kOneMinusEpsilon);
  }
  const NdSample sample = nd_sample(brdf.tree, brdf_slice(brdf, o), numbers);
  const Vec3 h = brdf_half_vector(brdf.table, o, sample.point, mirrored);
  return normalize(h * (2.0f * dot(o, h)) - o);
}

}  // namespace skytree
