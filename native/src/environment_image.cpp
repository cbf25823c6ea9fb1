// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/environment_image.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <stdexcept>

#include "src/clones.h"

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;

void count_bad_row(const float* texels, int width, BadTexels* bad) {
  for (int x = 0; x < width; ++x) {
    const float* t = texels + 3 * (int64_t)x;
    if (std::isnan(t[0]) || std::isnan(t[1]) || std::isnan(t[2])) {
      ++bad->nan;
    } else if (std::isinf(t[0]) || std::isinf(t[1]) || std::isinf(t[2])) {
      ++bad->infinite;
    } else if (t[0] < 0 || t[1] < 0 || t[2] < 0) {
      ++bad->negative;
    }
  }
}

}  // namespace

std::string BadTexels::message() const {
  if (total() == 0) return "";
  std::string kinds;
  const auto add = [&](int64_t count, const char* kind) {
    if (count == 0) return;
    if (!kinds.empty()) kinds += ", ";
    kinds += std::to_string(count) + " " + kind;
  };
  add(nan, "NaN");
  add(infinite, "infinite");
  add(negative, "negative");
  return "environment map has " + std::to_string(total()) +
         (total() == 1 ? " bad texel (" : " bad texels (") + kinds + "); such values count as 0";
}

void check_image(const LatLongImage& image) {
  if (image.width < 1 || image.height < 1 || image.texels == nullptr) {
    throw std::invalid_argument("environment map is empty (" + std::to_string(image.width) + " x " +
                                std::to_string(image.height) +
                                " texels); it needs at least one texel");
  }
  if (image.width > 65535 || image.height > 65535) {
    throw std::invalid_argument("environment map of " + std::to_string(image.width) + " x " +
                                std::to_string(image.height) +
                                " texels is too large; scale it down to at most 65535 a side");
  }
}

namespace {

/// Whether a bad texel was met.
SKY_CLONES bool read_luminance(const float* __restrict rgb, int count, float* __restrict out) {
  int bad = 0;
  for (int i = 0; i < count; ++i) {
    bad |= !is_good_texel(rgb + 3 * i);
    out[i] = texel_luminance(rgb + 3 * i);
  }
  return bad;
}

}  // namespace

void luminance_row(const LatLongImage& image, int y, float* out, BadTexels* bad) {
  const float* texels = image.texels + 3 * (int64_t)y * image.width;
  if (read_luminance(texels, image.width, out)) count_bad_row(texels, image.width, bad);
}

BadTexels count_bad_texels(const LatLongImage& image) {
  BadTexels bad;
  for (int y = 0; y < image.height; ++y) {
    count_bad_row(image.texels + 3 * (int64_t)y * image.width, image.width, &bad);
  }
  return bad;
}

double height_from_north(int y, int height) {
  if (2 * y > height) return 1.0 - height_from_north(height - y, height);
  const double s = std::sin(0.5 * kPiDouble * y / height);
  return s * s;
}

std::vector<double> row_solid_angles(int width, int height) {
  std::vector<double> solid_angles(height);
  for (int y = 0; y < height; ++y) {
    // The mirrored row, as the difference of heights near 1 would lose the digits.
    const int north = std::min(y, height - 1 - y);
    const double rise = height_from_north(north + 1, height) - height_from_north(north, height);
    solid_angles[y] = 4.0 * kPiDouble * rise / width;
  }
  return solid_angles;
}

void set_height_warp(int y0, int y1, int height, float* h_start, float* h_slope) {
  // Rounding moves h by a few ulp, which matters where rows are high; where they are low (near the
  // poles) the border's own distance to the pole is what must not be reached.
  constexpr double kRelativeInset = 8e-7;
  constexpr double kRowInset = 5e-4;
  const bool southern = height - y1 < y0;
  const double near = southern ? height - y1 : y0;
  const double far = southern ? height - y0 : y1;
  const auto h = [&](double row) {
    const double s = std::sin(0.5 * kPiDouble * row / height);
    return s * s;
  };
  const double low = std::max(h(near + kRowInset), h(near) * (1.0 + kRelativeInset));
  const double high = std::min(h(far - kRowInset), h(far) * (1.0 - kRelativeInset));
  *h_start = (float)(southern ? high : low);
  *h_slope = (float)(southern ? low - high : high - low);
}

std::vector<RowWarp> make_row_warps(int width, int height) {
  const std::vector<double> solid_angles = row_solid_angles(width, height);
  std::vector<RowWarp> rows(height);
  for (int y = 0; y < height; ++y) {
    set_height_warp(y, y + 1, height, &rows[y].h_start, &rows[y].h_slope);
    rows[y].inv_solid_angle = (float)(1.0 / solid_angles[y]);
  }
  return rows;
}

}  // namespace skytree
