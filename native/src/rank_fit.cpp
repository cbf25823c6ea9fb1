// SPDX-License-Identifier: GPL-3.0-or-later
// The solver is Ceres' TinySolver (Levenberg-Marquardt): for one parameter it does what the full
// Ceres does, is a header that needs Eigen only, and leaves no symbols of Ceres or glog behind that
// could meet those of a Blender which links its own Ceres.
//
// The cost has more than one minimum on some maps (a few bright blocks and a long flat tail), so
// the solver starts from the best of a coarse scan.
#include "src/rank_fit.h"

#include <ceres/tiny_solver.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace skytree {
namespace {

/// One rank's residual and its derivative by q.
struct Residual {
  double value, slope;
};

/// The square is the term of the objective, up to what a sum over all ranks does not change.
Residual rank_residual(RankObjective objective, double p, double q, double n) {
  switch (objective) {
    case RankObjective::LIKELIHOOD: {
      // p log(p/q) - p + q is never negative and vanishes only at q = p, so it has a smooth root
      // with the sign of q - p; p and q sum to 1, so the sum is that of p log(p/q).
      const double ratio = (q - p) / q;
      if (std::abs(ratio) < 1e-4) return {(q - p) / std::sqrt(2.0 * q), 1.0 / std::sqrt(2.0 * q)};
      const double term = std::max(0.0, (p > 0 ? p * std::log(p / q) : 0.0) - p + q);
      const double root = std::copysign(std::sqrt(term), q - p);
      return {root, 0.5 * ratio / root};
    }
    case RankObjective::SECOND_MOMENT:
      return {p / std::sqrt(q), -0.5 * p / (q * std::sqrt(q))};
    default:  // times n, so that the solver's tolerances mean the same for any n
      return {n * (q - p), n};
  }
}

/// Residuals by the logarithm of alpha.
class RankCost {
 public:
  using Scalar = double;
  enum { NUM_RESIDUALS = Eigen::Dynamic, NUM_PARAMETERS = 1 };

  RankCost(const std::vector<double>& empirical, RankObjective objective)
      : empirical_(empirical), objective_(objective) {}

  int NumResiduals() const { return (int)empirical_.size(); }

  bool operator()(const double* log_alpha, double* residuals, double* jacobian) const {
    const double alpha = std::exp(*log_alpha);
    const double n = (double)empirical_.size();
    if (!(alpha > 0.0) || !std::isfinite(alpha)) return false;
    const double range = std::log1p(n / alpha);
    const double range_slope = -n / (alpha + n);  // by log alpha
    for (size_t i = 0; i < empirical_.size(); ++i) {
      const double x = alpha + (double)i;
      const double probability = std::log1p(1.0 / x) / range;
      const Residual residual = rank_residual(objective_, empirical_[i], probability, n);
      residuals[i] = residual.value;
      if (jacobian) {
        const double mass_slope = -alpha / (x * (x + 1.0));
        jacobian[i] = residual.slope * (mass_slope - probability * range_slope) / range;
      }
    }
    return true;
  }

  double cost(double log_alpha) const {
    std::vector<double> residuals(empirical_.size());
    (*this)(&log_alpha, residuals.data(), nullptr);
    double sum = 0;
    for (double r : residuals) sum += r * r;
    return sum;
  }

 private:
  const std::vector<double>& empirical_;
  const RankObjective objective_;
};

}  // namespace

std::vector<double> rank_probabilities(double alpha, int count) {
  std::vector<double> probabilities(count);
  const double range = std::log1p(count / alpha);
  for (int i = 0; i < count; ++i) probabilities[i] = std::log1p(1.0 / (alpha + i)) / range;
  return probabilities;
}

RankFit fit_rank_model(const std::vector<double>& empirical, RankObjective objective,
                       ThreadTeam* team) {
  const int count = (int)empirical.size();
  const RankCost cost(empirical, objective);
  const double lowest = std::log(kSmallestAlpha);
  const double highest = std::log(kLargestAlphaPerBlock * count);
  constexpr int kScan = 48;
  const auto candidate = [&](int i) { return lowest + (highest - lowest) * i / kScan; };
  double costs[kScan];
  const auto scan = [&](int, int i) { costs[i] = cost.cost(candidate(i)); };
  if (team) {
    team->run(kScan, scan);
  } else {
    for (int i = 0; i < kScan; ++i) scan(0, i);
  }
  double best = highest, best_cost = cost.cost(highest);
  for (int i = 0; i < kScan; ++i) {
    if (costs[i] < best_cost) {
      best = candidate(i);
      best_cost = costs[i];
    }
  }
  if (count > 1) {
    ceres::TinySolver<RankCost> solver;
    solver.options.parameter_tolerance = 1e-10;
    solver.options.function_tolerance = 1e-14;
    Eigen::Matrix<double, 1, 1> log_alpha(best);
    solver.Solve(cost, &log_alpha);
    const double solved = std::clamp(log_alpha[0], lowest, highest);
    if (cost.cost(solved) <= best_cost) best = solved;
  }

  RankFit fit = {std::exp(best), 0.0, 0.0, 0.0, 0.0};
  const std::vector<double> model = rank_probabilities(fit.alpha, count);
  for (int i = 0; i < count; ++i) {
    const double difference = model[i] - empirical[i];
    const double ratio = empirical[i] / model[i];
    fit.rms_error += difference * difference / count;
    if (empirical[i] > 0) fit.kl_divergence += empirical[i] * std::log(ratio);
    fit.second_moment += empirical[i] * ratio;
    fit.largest_ratio = std::max(fit.largest_ratio, ratio);
  }
  fit.rms_error = std::sqrt(fit.rms_error);
  return fit;
}

}  // namespace skytree
