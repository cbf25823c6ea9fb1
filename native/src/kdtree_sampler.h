// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "src/cut_tables.h"
#include "src/environment_sampler.h"
#include "src/kdtree_layout.h"
#include "src/map_statistics.h"
#include "src/product_table.h"
#include "src/rank_fit.h"

namespace skytree {

enum class BlockProbability {
  FITTED,        ///< the paper's: by rank, from the fitted model
  EXACT,         ///< in proportion to the block's power
  MIN_VARIANCE,  ///< in proportion to sqrt(solid angle * integral of L^2): least variance with a
                 ///< constant density in a block
};

enum class BlockDensity {
  AUTO,      ///< LINEAR where it can be: blocks split and chosen by MIN_VARIANCE, of RADIANCE
  CONSTANT,  ///< the paper's
  LINEAR,    ///< linear in azimuth times linear in elevation, on cells between texel centres
};

struct KdTreeConfig {
  static constexpr int kLargestBlockCount = 32768;  // node numbers have 16 bits
  static constexpr int kAutoBlockCount = 0;         // as many as pay (see docs/method.md)
  static constexpr int kLargestAutoBlockCount = 4096;
  static constexpr int kDefaultBlockCount = 1024;  // what kAutoBlockCount means for CONSTANT

  int block_count = kDefaultBlockCount;
  SplitCriterion split_criterion = SplitCriterion::SSE;
  BlockProbability block_probability = BlockProbability::FITTED;
  Statistics statistics = Statistics::RADIANCE;
  /// What alpha is fitted for; the paper does not say, least squares is our reading.
  RankObjective rank_objective = RankObjective::LEAST_SQUARES;
  /// Share of samples spread evenly over the sphere with EXACT and MIN_VARIANCE: no direction has
  /// density 0, and the largest weight is bounded. FITTED has no use for it. By default 0.05, and
  /// 0.005 with linear density and no compensation.
  std::optional<double> uniform_share;
  BlockDensity block_density = BlockDensity::AUTO;
  /// MIS compensation (O. Karlik et al., "MIS Compensation: Optimizing Sampling Techniques in
  /// Multiple Importance Sampling", SIGGRAPH Asia 2019), 0 to 1, not for FITTED: this much of the
  /// map's mean is taken from every block, as BSDF sampling finds even light well enough. Only
  /// where BSDF sampling takes part.
  double compensation = 0.0;
  BuildProgress progress;
  int threads = 0;  ///< that build; 0: all cores. The tables do not depend on it.
};

class KdTreeSampler : public EnvironmentSampler {
 public:
  /// The image is read here and not kept. Throws std::invalid_argument for an empty image or a
  /// setting out of range, BuildCancelled if config.progress returned false.
  explicit KdTreeSampler(const LatLongImage& image, const KdTreeConfig& config = {});
  /// The same with what other builds of the map have left, and leaving it for others. `map` is not
  /// kept.
  explicit KdTreeSampler(MapStatistics& map, const KdTreeConfig& config = {});

  EnvSamplerView view() const override;
  EnvSamplerView product_view() const override;
  size_t nbytes() const override;

  int block_count() const { return (int)rects_.size(); }
  bool is_linear() const { return grid_.cells; }
  /// Blocks in the order of probabilities(): by descending power with FITTED, else depth first down
  /// the tree. In cells of grid() where the density is linear.
  const std::vector<TexelRect>& rects() const { return rects_; }
  const TreeGrid& grid() const { return grid_; }
  /// Linear density: each block's tilts.
  const std::vector<Tilts>& tilts() const { return tilts_; }
  /// Linear density: the tree's upper part, for sampling the map times a lobe.
  CutView cut() const { return cut_.view(); }
  /// What each block is chosen with; the density in it is this by its solid angle.
  const std::vector<double>& probabilities() const { return probabilities_; }
  /// Shares of the map's power, descending: what alpha was fitted to.
  const std::vector<double>& empirical() const { return empirical_; }
  const RankFit& fit() const { return fit_; }
  double build_seconds() const { return build_seconds_; }

  /// The map as the blocks know it: every block at its mean radiance (by the statistics' weights),
  /// tilted where the density is linear; RGB row by row into out. Bad texels are left out of the
  /// means. `image` is the one that the tree was built from.
  void reconstruct(const LatLongImage& image, float* out) const;

 private:
  KdTreeSampler(MapStatistics&& map, const KdTreeConfig& config) : KdTreeSampler(map, config) {}
  MapStatistics::Tree grow(MapStatistics& map, const KdTreeConfig& config, ThreadTeam& team) const;
  void fit_blocks(const MapStatistics::Tree& grown, const std::vector<int32_t>& blocks,
                  ThreadTeam& team);
  void set_probabilities(const BuildTree& tree, const std::vector<int32_t>& blocks,
                         const KdTreeConfig& config, ThreadTeam& team);
  void place_blocks_by_rank();
  void place_blocks_by_warp();
  void place_linear_blocks();
  void tilt_block(size_t block, const TexelRect& texels, float* out) const;
  double solid_angle(const TexelRect& rect) const;

  TreeGrid grid_;
  Statistics statistics_;
  std::vector<TexelRect> rects_;
  std::vector<Tilts> tilts_;
  std::vector<double> squares_;  // integral of L^2 over the shape of the block's density
  std::vector<double> probabilities_, empirical_;
  RankFit fit_{};
  double build_seconds_ = 0;

  // What KdTreeView points to.
  std::vector<BlockWarp> warps_;
  std::vector<float> pdf_;
  std::vector<Vec2> warp_origins_;
  std::vector<LinearBlock> linear_blocks_;
  KdTreeLayout layout_;
  WarpLayout warp_layout_;
  // For product sampling, not among nbytes(), as sample() and pdf() do not read them.
  CutTables cut_;
  int threads_;  // that make them
  mutable std::once_flag products_made_;
  mutable std::unique_ptr<const ProductTable> products_;
};

}  // namespace skytree
