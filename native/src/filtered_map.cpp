// SPDX-License-Identifier: GPL-3.0-or-later
// Each level is the mean of the one below, weighted by the exact solid angle of what two texels
// have in common, so that the power of the map stays the same at every level.
#include "src/filtered_map.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "src/stopwatch.h"

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;

struct SourceRow {
  const float* texels;
  int count;
};

/// Texels in a row of a level, about as long as they are high.
int row_texels(int row, int height) {
  if (height == 1) return 1;
  const double sine = std::sin(kPiDouble * (row + 0.5) / height);
  return std::max(3, (int)std::lround(2 * height * sine));
}

/// Adds weight * row to the sums of `count` texels (and the weights), by how much of each texel a
/// source texel covers.
void add_row(const SourceRow& row, double weight, int count, std::vector<double>* sums) {
  const double scale = (double)count / row.count;
  for (int x = 0; x < row.count; ++x) {
    const float* t = row.texels + 3 * (int64_t)x;
    const double lo = x * scale, hi = (x + 1) * scale;
    for (int i = (int)lo; i < count && i < hi; ++i) {
      const double share = (std::min(hi, i + 1.0) - std::max(lo, (double)i)) * weight;
      if (!(share > 0)) continue;
      double* sum = sums->data() + 4 * (size_t)i;
      for (int c = 0; c < 3; ++c) sum[c] += share * t[c];
      sum[3] += share;
    }
  }
}

}  // namespace

template <typename Source>
void FilteredMap::add_level(int height, int source_height, const Source& source) {
  FilteredLevel level = {};
  level.first_row = (int32_t)rows_.size();
  level.height = height;
  for (int row = 0; row < height; ++row) {
    const int count = row_texels(row, height);
    std::vector<double> sums(4 * (size_t)count);
    const double top = (double)row / height, bottom = (row + 1.0) / height;
    const int first = (int)(top * source_height);
    for (int y = first; y < source_height && y < bottom * source_height; ++y) {
      const double lo = std::max(top, (double)y / source_height);
      const double hi = std::min(bottom, (y + 1.0) / source_height);
      const double weight = std::cos(kPiDouble * lo) - std::cos(kPiDouble * hi);
      if (hi > lo && weight > 0) add_row(source(y), weight, count, &sums);
    }
    rows_.push_back({(int32_t)(texels_.size() / 3), count});
    double mean[3] = {};
    for (int i = 0; i < count; ++i) {
      for (int c = 0; c < 3; ++c) {
        const double value = sums[4 * (size_t)i + c] / sums[4 * (size_t)i + 3];
        texels_.push_back((float)value);
        mean[c] += value / count;
      }
    }
    const Vec3 pole = {(float)mean[0], (float)mean[1], (float)mean[2]};
    if (row == 0) level.poles[0] = pole;
    if (row == height - 1) level.poles[1] = pole;
  }
  levels_.push_back(level);
}

FilteredMap::FilteredMap(const LatLongImage& image, const FilterConfig& config) : config_(config) {
  const Stopwatch stopwatch;
  check_image(image);
  if (config.samples < 1) {
    throw std::invalid_argument("samples is " + std::to_string(config.samples) +
                                "; it must be at least 1");
  }
  if (!(config.overlap > 0.0 && config.overlap < INFINITY)) {
    throw std::invalid_argument("overlap is " + std::to_string(config.overlap) +
                                "; it must be above 0");
  }
  // What a map of square texels with as many of them would have.
  const int size = std::max(1, (int)std::lround(std::sqrt(0.5 * image.width * image.height)));
  std::vector<float> clean(3 * (size_t)image.width);
  add_level(std::max(1, size / 2), image.height, [&](int y) {
    const float* row = image.texels + 3 * (int64_t)y * image.width;
    for (size_t i = 0; i < clean.size(); ++i) clean[i] = usable_radiance(row[i]);
    return SourceRow{clean.data(), image.width};
  });
  while (levels_.back().height > 1) {
    const FilteredLevel below = levels_.back();
    add_level(below.height / 2, below.height, [&](int y) {
      const FilteredRow row = rows_[below.first_row + y];
      return SourceRow{texels_.data() + 3 * (int64_t)row.first, row.count};
    });
  }
  bad_texels_ = count_bad_texels(image);
  // Level l is right where a texel of it covers K / (N pdf).
  const double texel = (kPiDouble / size) * (kPiDouble / size);
  level_offset_ = (float)(0.5 * std::log2(config.overlap / (config.samples * texel)));
  build_seconds_ = stopwatch.seconds();
}

EnvSamplerView FilteredMap::view() const {
  EnvSamplerView view;
  view.type = EnvSamplerType::FILTERED;
  view.filtered = {texels_.data(),        rows_.data(),
                   levels_.data(),        (int32_t)(texels_.size() / 3),
                   (int32_t)rows_.size(), (int32_t)levels_.size(),
                   level_offset_};
  return view;
}

size_t FilteredMap::nbytes() const {
  return texels_.size() * sizeof(float) + rows_.size() * sizeof(FilteredRow) +
         levels_.size() * sizeof(FilteredLevel);
}

}  // namespace skytree
