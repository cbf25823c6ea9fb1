// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/texel_weights.h"

#include <algorithm>
#include <utility>

namespace skytree {

TexelWeightRows::TexelWeightRows(const LatLongImage& image)
    : image_(image),
      above_(image.width),
      centre_(image.width),
      below_(image.width),
      column_(image.width + 2),
      weights_(image.width) {}

void TexelWeightRows::load(int y, std::vector<float>& row) {
  luminance_row(image_, y, row.data(), &bad_);
}

const float* TexelWeightRows::next() {
  const int width = image_.width;
  if (y_ == 0) {
    load(0, centre_);
    above_ = centre_;
  } else {
    above_.swap(centre_);
    centre_.swap(below_);
  }
  if (y_ + 1 < image_.height) {
    load(y_ + 1, below_);
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

}  // namespace skytree
