// SPDX-License-Identifier: GPL-3.0-or-later
// Fit of the rank model's alpha: Ergun, Kurt and Ozturk, SCCG 2012, section "Approximating the
// Empirical Distribution".
#pragma once

#include <vector>

namespace skytree {

struct RankFit {
  double alpha;
  double rms_error;      ///< root of the mean squared difference of probabilities
  double kl_divergence;  ///< of the model from the empirical probabilities, in nats
};

constexpr double kSmallestAlpha = 1e-30;
/// Times the number of blocks: from there on the model is flat to a float.
constexpr double kLargestAlphaPerBlock = 1e5;

/// Least squares over alpha between the model's probabilities, integrated over each rank, and the
/// empirical ones (n >= 1, descending, sum 1).
RankFit fit_rank_model(const std::vector<double>& empirical);

/// The model in double: probability of each rank.
std::vector<double> rank_probabilities(double alpha, int count);

}  // namespace skytree
