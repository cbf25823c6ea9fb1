// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "src/environment_sampler.h"
#include "src/kdtree_builder.h"
#include "src/rank_fit.h"

namespace skytree {

enum class BlockProbability {
  FITTED,        ///< the paper's: by rank, from the fitted model
  EXACT,         ///< in proportion to the block's power
  MIN_VARIANCE,  ///< in proportion to sqrt(solid angle * integral of L^2): least variance with a
                 ///< constant density in a block
};

struct KdTreeConfig {
  static constexpr int kLargestBlockCount = 32768;  // node numbers have 16 bits

  int block_count = 1024;
  SplitCriterion split_criterion = SplitCriterion::SSE;
  BlockProbability block_probability = BlockProbability::FITTED;
  Statistics statistics = Statistics::RADIANCE;
  /// What alpha is fitted for; the paper does not say, least squares is our reading.
  RankObjective rank_objective = RankObjective::LEAST_SQUARES;
  /// Share of samples spread evenly over the sphere with EXACT and MIN_VARIANCE: no direction has
  /// density 0, and the largest weight is bounded. FITTED has no use for it.
  double uniform_share = 0.05;
  BuildProgress progress;
};

class KdTreeSampler : public EnvironmentSampler {
 public:
  /// The image is read here and not kept. Throws std::invalid_argument for an empty image or a
  /// setting out of range, BuildCancelled if config.progress returned false.
  explicit KdTreeSampler(const LatLongImage& image, const KdTreeConfig& config = {});

  EnvSamplerView view() const override;
  size_t nbytes() const override;

  int block_count() const { return (int)rects_.size(); }
  /// Blocks in the order of probabilities(): by descending power with FITTED, else depth first down
  /// the tree.
  const std::vector<TexelRect>& rects() const { return rects_; }
  /// What each block is chosen with; the density in it is this by its solid angle.
  const std::vector<double>& probabilities() const { return probabilities_; }
  /// Shares of the map's power, descending: what alpha was fitted to.
  const std::vector<double>& empirical() const { return empirical_; }
  const RankFit& fit() const { return fit_; }
  double build_seconds() const { return build_seconds_; }

  /// The map with every block at its mean radiance (by the statistics' weights), RGB row by row
  /// into out. Bad texels are left out of the means. `image` is the one that the tree was built
  /// from.
  void reconstruct(const LatLongImage& image, float* out) const;

 private:
  void set_probabilities(const BuildTree& tree, const std::vector<int32_t>& blocks,
                         const KdTreeConfig& config);
  void link_nodes(const BuildTree& tree, const std::vector<int32_t>& blocks);
  void place_blocks_by_rank();
  void place_blocks_by_warp(const BuildTree& tree, const std::vector<int32_t>& blocks);
  void fill_start_grid();
  void fill_warp_grid();
  double solid_angle(const TexelRect& rect) const;

  int width_, height_;
  Statistics statistics_;
  std::vector<TexelRect> rects_;
  std::vector<double> probabilities_, empirical_;
  RankFit fit_{};
  double build_seconds_ = 0;

  // What KdTreeView points to.
  std::vector<BlockWarp> warps_;
  std::vector<float> pdf_;
  std::vector<Vec2> warp_origins_;
  std::vector<int32_t> split_keys_;
  std::vector<float> split_warps_;
  std::vector<uint32_t> children_;
  std::vector<uint16_t> start_grid_, warp_grid_;

  struct Plane {
    int32_t axis, position;  // in texels
  };
  std::vector<Plane> planes_;  // of inner nodes
};

}  // namespace skytree
