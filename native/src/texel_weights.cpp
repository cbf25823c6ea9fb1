// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/texel_weights.h"

#include <algorithm>

namespace skytree {

TexelWeightRows::TexelWeightRows(const LatLongImage& image, int first)
    : image_(image),
      y_(first),
      above_(image.width),
      centre_(image.width),
      below_(image.width),
      column_(image.width + 2),
      weights_(image.width) {
  BadTexels not_ours;
  luminance_row(image, std::max(first - 1, 0), centre_.data(), &not_ours);
  luminance_row(image, first, below_.data(), &bad_below_);
}

const float* TexelWeightRows::next() {
  const int width = image_.width;
  above_.swap(centre_);
  centre_.swap(below_);
  bad_ += bad_below_;
  bad_below_ = {};
  if (y_ + 1 < image_.height) {
    luminance_row(image_, y_ + 1, below_.data(), &bad_below_);
  } else {
    below_ = centre_;
  }
  float* __restrict column = column_.data();
  const float* a = above_.data();
  const float* b = centre_.data();
  const float* c = below_.data();
  for (int x = 0; x < width; ++x) column[x + 1] = (a[x] + c[x]) + 6.0f * b[x];
  column[0] = column[width];
  column[width + 1] = column[1];
  float* __restrict weights = weights_.data();
  for (int x = 0; x < width; ++x) {
    weights[x] = ((column[x] + column[x + 2]) + 6.0f * column[x + 1]) * (1.0f / 64.0f);
  }
  ++y_;
  return weights;
}

BadTexels for_texel_weights(const LatLongImage& image, ThreadTeam& team,
                            const std::function<void(int, int, const float*)>& use) {
  constexpr int kRows = 64;  // the row above and the one below are read twice
  std::vector<BadTexels> parts(team.size());
  team.run_chunks(image.height, kRows, [&](int worker, int first, int last) {
    TexelWeightRows rows(image, first);
    for (int y = first; y < last; ++y) use(worker, y, rows.next());
    parts[worker] += rows.bad_texels();
  });
  BadTexels bad;
  for (const BadTexels& part : parts) bad += part;
  return bad;
}

}  // namespace skytree
