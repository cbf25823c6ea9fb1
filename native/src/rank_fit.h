// SPDX-License-Identifier: GPL-3.0-or-later
// Fit of the rank model's alpha: Ergun, Kurt and Ozturk, SCCG 2012, section "Approximating the
// Empirical Distribution".
#pragma once

#include <vector>

#include "src/thread_team.h"

namespace skytree {

/// What the fit makes small, with p the empirical and q the model's probabilities.
enum class RankObjective {
  LEAST_SQUARES,  ///< sum of (q - p)^2
  LIKELIHOOD,     ///< sum of p log(p / q): the alpha under which the blocks' power is likeliest
  SECOND_MOMENT,  ///< sum of p^2 / q: of the weights p / q, what a sum over blocks costs in
                  ///< variance
};

struct RankFit {
  double alpha;
  double rms_error;      ///< root of the mean squared difference of probabilities
  double kl_divergence;  ///< of the model from the empirical probabilities, in nats
  double second_moment;  ///< sum of p^2 / q, at least 1
  double largest_ratio;  ///< largest p / q: what the weight of a block's samples is multiplied by
};

constexpr double kSmallestAlpha = 1e-30;
/// Times the number of blocks: from there on the model is flat to a float.
constexpr double kLargestAlphaPerBlock = 1e5;

/// The best alpha between the model's probabilities, integrated over each rank, and the empirical
/// ones (n >= 1, descending, sum 1). With a team its threads share the work.
RankFit fit_rank_model(const std::vector<double>& empirical,
                       RankObjective objective = RankObjective::LEAST_SQUARES,
                       ThreadTeam* team = nullptr);

/// The model in double: probability of each rank.
std::vector<double> rank_probabilities(double alpha, int count);

}  // namespace skytree
