// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/luminance_plane.h"

#include <algorithm>

namespace skytree {

LuminancePlane::LuminancePlane(const LatLongImage& image, ThreadTeam& team,
                               const std::function<void(double)>& keep_going)
    : width_(image.width), height_(image.height) {
  // An odd number of cache lines: columns of a map whose width is a power of two would meet in one
  // cache set.
  stride_ = ((width_ + 2 + kSlack + 15) / 16 | 1) * 16;
  values_ = LargeArray<float>((size_t)(stride_ * height_));
  std::vector<BadTexels> bad(team.size());
  team.run_chunks(height_, 16, [&](int worker, int first, int last) {
    if (worker == 0) keep_going((double)first / height_);
    for (int y = first; y < last; ++y) {
      float* row = values_.data() + y * stride_ + 1;
      luminance_row(image, y, row, &bad[worker]);
      row[-1] = row[width_ - 1];
      row[width_] = row[0];
      std::fill(row + width_ + 1, row - 1 + stride_, 0.0f);
    }
  });
  for (const BadTexels& part : bad) bad_ += part;
}

}  // namespace skytree
