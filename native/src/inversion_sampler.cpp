// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/inversion_sampler.h"

#include <algorithm>
#include <numeric>

#include "src/stopwatch.h"
#include "src/texel_weights.h"

namespace skytree {
namespace {

constexpr float kUnits = 16777216.0f;  // 2^24
constexpr float kUnit = 1.0f / kUnits;

/// sums[i] = weight of the first i+1 texels -> cdf with cdf[0] = 0, cdf[count] = 1, in multiples of
/// 2^-24 that rise by at least one a texel. All weights 0: even steps.
template <typename Sum>
void quantize_cdf(const Sum* __restrict sums, int count, float* __restrict cdf) {
  const Sum total = sums[count - 1];
  const Sum scale = total > 0 ? (Sum)(kUnits - (float)count) / total : 0;
  const Sum even = total > 0 ? 1 : (Sum)kUnits / (Sum)count;
  cdf[0] = 0.0f;
  for (int i = 0; i < count; ++i) {
    cdf[i + 1] = (float)((int32_t)(sums[i] * scale) + (int32_t)((Sum)(i + 1) * even)) * kUnit;
  }
  cdf[count] = 1.0f;
}

/// guide[k] = the i whose interval contains k / count.
void make_guide(const float* cdf, int count, uint16_t* guide) {
  const float inverse = 1.0f / (float)count;
  int i = 0;
  for (int k = 0; k < count; ++k) {
    while (cdf[i + 1] <= (float)k * inverse) ++i;
    guide[k] = (uint16_t)i;
  }
}

}  // namespace

InversionSampler::InversionSampler(const LatLongImage& image, bool guided, int threads)
    : width_(image.width), height_(image.height) {
  const Stopwatch stopwatch;
  check_image(image);
  const int width = width_, height = height_;
  const int64_t texels = (int64_t)width * height;
  conditional_ = LargeArray<float>(texels + height);
  if (guided) {
    marginal_guide_.resize(height);
    conditional_guide_ = LargeArray<uint16_t>(texels);
  }
  rows_ = make_row_warps(width, height);
  const std::vector<double> solid_angles = row_solid_angles(width, height);

  ThreadTeam team(threads);
  std::vector<std::vector<double>> scratch(team.size(), std::vector<double>(width));
  std::vector<double> row_sums(height);
  bad_texels_ = for_texel_weights(image, team, [&](int worker, int y, const float* weights) {
    std::vector<double>& sums = scratch[worker];
    double sum = 0;
    for (int x = 0; x < width; ++x) sums[x] = sum += weights[x];
    row_sums[y] = sum * solid_angles[y];
    float* cdf = conditional_.data() + (int64_t)y * (width + 1);
    quantize_cdf(sums.data(), width, cdf);
    if (guided) make_guide(cdf, width, conditional_guide_.data() + (int64_t)y * width);
  });
  std::partial_sum(row_sums.begin(), row_sums.end(), row_sums.begin());
  const double total = row_sums.back();
  if (total <= 0) {  // black: by solid angle
    double sum = 0;
    for (int y = 0; y < height; ++y) row_sums[y] = sum += solid_angles[y];
  }
  marginal_.resize(height + 1);
  quantize_cdf(row_sums.data(), height, marginal_.data());
  if (guided) make_guide(marginal_.data(), height, marginal_guide_.data());
  build_seconds_ = stopwatch.seconds();
}

EnvSamplerView InversionSampler::view() const {
  EnvSamplerView view;
  view.type = !conditional_guide_.empty() ? EnvSamplerType::INVERSION_GUIDED
                                          : EnvSamplerType::INVERSION_BINARY;
  view.inversion = {marginal_.data(),
                    conditional_.data(),
                    rows_.data(),
                    marginal_guide_.data(),
                    conditional_guide_.data(),
                    width_,
                    height_};
  return view;
}

size_t InversionSampler::nbytes() const {
  return marginal_.size() * sizeof(float) + conditional_.nbytes() + rows_.size() * sizeof(RowWarp) +
         marginal_guide_.size() * sizeof(uint16_t) + conditional_guide_.nbytes();
}

}  // namespace skytree
