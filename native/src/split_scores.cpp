// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/split_scores.h"

#include <cmath>

#include "src/clones.h"

namespace skytree {

SKY_CLONES void pooled_variance_scores(const double* __restrict n1, const double* __restrict q1,
                                       const double* __restrict n2, const double* __restrict q2,
                                       int count, double* __restrict scores) {
  for (int i = 0; i < count; ++i) scores[i] = q1[i] * q1[i] / n1[i] + q2[i] * q2[i] / n2[i];
}

SKY_CLONES void min_variance_scores(const double* __restrict n1, const double* __restrict q1,
                                    const double* __restrict n2, const double* __restrict q2,
                                    int count, double* __restrict scores) {
  for (int i = 0; i < count; ++i)
    scores[i] = -(std::sqrt(n1[i] * q1[i]) + std::sqrt(n2[i] * q2[i]));
}

}  // namespace skytree
