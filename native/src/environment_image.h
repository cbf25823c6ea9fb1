// SPDX-License-Identifier: GPL-3.0-or-later
// A lat-long map as the builders read it: luminance by rows, bad values found and kept out,
// geometry of rows.
#pragma once

#include <cfloat>
#include <cstdint>
#include <string>
#include <vector>

#include "kernel/inversion.h"
#include "kernel/latlong.h"

namespace skytree {

/// Texels with a component that is NaN, infinite or negative; a texel counts once, under the first
/// that applies.
struct BadTexels {
  int64_t nan = 0, infinite = 0, negative = 0;

  BadTexels& operator+=(const BadTexels& other) {
    nan += other.nan;
    infinite += other.infinite;
    negative += other.negative;
    return *this;
  }
  int64_t total() const { return nan + infinite + negative; }
  /// One sentence for the user, or "" if there are none.
  std::string message() const;
};

/// Throws std::invalid_argument unless the image has texels and a size that the tables can address
/// (1x1 to 65535x65535).
void check_image(const LatLongImage& image);

constexpr float kLargestLuminance = 1e18f;

inline float raw_luminance(const float* rgb) {
  return 0.2126f * rgb[0] + 0.7152f * rgb[1] + 0.0722f * rgb[2];
}

/// A NaN or infinite component makes the luminance NaN or infinite, so that two comparisons find
/// every bad texel.
inline bool is_good_texel(const float* rgb) {
  const float rg = rgb[0] < rgb[1] ? rgb[0] : rgb[1];
  const float darkest = rg < rgb[2] ? rg : rgb[2];
  return (raw_luminance(rgb) <= FLT_MAX) & (darkest >= 0.0f);
}

/// A component as renders show it: 0 if it is NaN, infinite or negative. The texel's others count:
/// a saturated sun's blue lies just below zero in many maps, and a density that takes the whole
/// texel for black would leave the sun to chance.
inline float usable_radiance(float component) {
  return (component >= 0.0f) & (component <= FLT_MAX) ? component : 0.0f;
}

/// Luminance of one RGB texel as renders show it, capped so that its square stays finite.
inline float texel_luminance(const float* rgb) {
  const float shown[3] = {usable_radiance(rgb[0]), usable_radiance(rgb[1]),
                          usable_radiance(rgb[2])};
  const float l = raw_luminance(shown);
  return l < kLargestLuminance ? l : kLargestLuminance;
}

/// texel_luminance of row y into out[0, width). Bad texels are counted.
void luminance_row(const LatLongImage& image, int y, float* out, BadTexels* bad);

/// Counts bad texels of the whole image.
BadTexels count_bad_texels(const LatLongImage& image);

/// Solid angle in steradians of one texel in each of `height` rows.
std::vector<double> row_solid_angles(int width, int height);

/// sin^2(theta/2) for the border above row y, exact at both ends.
double height_from_north(int y, int height);

/// Points strictly between the borders above rows y0 and y1: h = h_start + h_slope * s for s in
/// [0,1), with a distance to the borders that float rounding of a direction cannot cross. See
/// kernel/kdtree.h.
void set_height_warp(int y0, int y1, int height, float* h_start, float* h_slope);

std::vector<RowWarp> make_row_warps(int width, int height);

}  // namespace skytree
