// SPDX-License-Identifier: GPL-3.0-or-later
// Which block to split, and where. RANGE, VARIANCE and SSE with the plane of least pooled variance
// are the paper's (Ergun, Kurt and Ozturk, SCCG 2012, section "Kd-tree Construction", equation 1).
// MIN_VARIANCE is ours: it asks what the block's shape costs an estimator.
#pragma once

#include <string>

#include "src/image_statistics.h"

namespace skytree {

enum class SplitCriterion {
  RANGE,         ///< largest minus smallest luminance
  VARIANCE,      ///< mean squared deviation from the block's mean
  SSE,           ///< sum of squared deviations
  MIN_VARIANCE,  ///< what the best split takes from the sum over blocks of sqrt(solid angle *
                 ///< integral of L^2)
  MEDIAN_CUT,    ///< the oldest block, by the rule of median_cut.h
};

struct Split {
  int axis = -1;  // none: the block is a single texel
  int32_t position = 0;
  double score = 0;
  Moments first{}, second{};  // of the children
};

/// Below this share of the block's second moment a difference is rounding of single-precision sums,
/// not variation.
constexpr double kVariationFloor = 2e-6;

/// Sum of squared deviations of a block with these moments; 0 where it is rounding.
double squared_error(const Moments& moments, double solid_angle);

/// MIN_VARIANCE does not look for a plane that would gain at most this much more: what would be
/// found is the map's noise.
constexpr double kGainTolerance = 0.1;

/// Plane with the highest score over both axes, exact to the texel; ties go to x, then to the lower
/// position. The score of RANGE, VARIANCE and SSE is S1^2/n1 + S2^2/n2 (the paper's), of
/// MIN_VARIANCE the negative of sqrt(n1 Q1) + sqrt(n2 Q2), with n the solid angle, S the power, Q
/// the square; there the gain over not splitting is within kGainTolerance of the best.
Split find_split(const ImageStatistics& statistics, const TexelRect& rect, SplitCriterion criterion,
                 CornerSums* known = nullptr);

}  // namespace skytree
