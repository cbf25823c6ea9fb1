// SPDX-License-Identifier: GPL-3.0-or-later
// The one-parameter model of sorted block probabilities: Ergun, Kurt and Ozturk, "Real-time Kd-tree
// Based Importance Sampling of Environment Maps", SCCG 2012, equations 2 and 3.
//
//   p(x) = 1 / (log(1 + n/alpha) (alpha + x)),  0 <= x <= n
//
// Deviation: the paper evaluates p at the continuous x that was drawn. That is no density of a
// direction (two draws of the same direction would disagree), so multiple importance sampling
// cannot use it. The probability of block i here is p integrated over [i, i+1], with which floor(x)
// is drawn exactly.
#pragma once

#include "kernel/math.h"

namespace skytree {

struct RankModel {
  float alpha;
  float log_range;  // log(1 + n/alpha)
  int32_t count;    // n >= 1
};

/// Inverse of the model's distribution function, truncated to a rank in [0, n).
SKY_HD int32_t sample_rank(const RankModel& model, float u) {
  const float x = model.alpha * sky_expm1(u * model.log_range);
  return (int32_t)minf(x, (float)(model.count - 1));
}

/// Probability of a rank.
SKY_HD float rank_probability(const RankModel& model, int32_t rank) {
  return sky_log1p(1.0f / (model.alpha + (float)rank)) / model.log_range;
}

}  // namespace skytree
