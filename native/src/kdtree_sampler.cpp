// SPDX-License-Identifier: GPL-3.0-or-later
// From the grown tree to the tables of kernel/kdtree.h.
#include "src/kdtree_sampler.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

#include "src/block_radiance.h"
#include "src/stopwatch.h"
#include "src/tree_pruning.h"

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;

bool can_be_linear(const KdTreeConfig& config) {
  return config.split_criterion == SplitCriterion::MIN_VARIANCE &&
         config.block_probability == BlockProbability::MIN_VARIANCE &&
         config.statistics == Statistics::RADIANCE;
}

void check_config(const KdTreeConfig& config) {
  if (config.block_count < 0 || config.block_count > KdTreeConfig::kLargestBlockCount) {
    throw std::invalid_argument(
        "block_count is " + std::to_string(config.block_count) + "; it must be from 1 to " +
        std::to_string(KdTreeConfig::kLargestBlockCount) + ", or 0 for as many as pay");
  }
  const double share = config.uniform_share.value_or(1.0);
  if (!(share > 0.0 && share <= 1.0)) {
    throw std::invalid_argument(
        "uniform_share is " + std::to_string(share) +
        "; it must be above 0 and at most 1, or some directions are never sampled");
  }
  if (!(config.compensation >= 0.0 && config.compensation <= 1.0)) {
    throw std::invalid_argument("compensation is " + std::to_string(config.compensation) +
                                "; it must be from 0 to 1");
  }
  if (config.compensation > 0.0 && config.block_probability == BlockProbability::FITTED) {
    throw std::invalid_argument(
        "compensation changes the blocks' probabilities; with FITTED they come from the model: "
        "choose EXACT or MIN_VARIANCE, or compensation 0");
  }
  if (config.block_density == BlockDensity::LINEAR && !can_be_linear(config)) {
    throw std::invalid_argument(
        "block_density LINEAR needs split_criterion MIN_VARIANCE, block_probability MIN_VARIANCE "
        "and statistics RADIANCE; choose these, or CONSTANT");
  }
}

Statistics grid_statistics(const KdTreeConfig& config) {
  const bool linear = config.block_density != BlockDensity::CONSTANT && can_be_linear(config);
  return linear ? Statistics::CELLS : config.statistics;
}

}  // namespace

KdTreeSampler::KdTreeSampler(const LatLongImage& image, const KdTreeConfig& config)
    : KdTreeSampler(MapStatistics(image), config) {}

KdTreeSampler::KdTreeSampler(MapStatistics& map, const KdTreeConfig& config)
    : statistics_(config.statistics), threads_(config.threads) {
  const Stopwatch stopwatch;
  check_config(config);
  ThreadTeam team(config.threads);
  const MapStatistics::Tree grown = grow(map, config, team);
  const BuildTree& tree = grown.tree;
  grid_ = grown.statistics->grid();
  bad_texels_ = tree.bad_texels;
  const bool by_rank = config.block_probability == BlockProbability::FITTED;
  std::vector<int32_t> blocks = leaves_depth_first(tree);
  if (by_rank) {
    std::stable_sort(blocks.begin(), blocks.end(), [&](int32_t a, int32_t b) {
      return tree.nodes[a].moments.power > tree.nodes[b].moments.power;
    });
  }
  for (int32_t block : blocks) rects_.push_back(tree.nodes[block].rect);
  fit_blocks(grown, blocks, team);
  set_probabilities(tree, blocks, config, team);
  layout_ = KdTreeLayout(tree, blocks, grid_);
  if (by_rank) {
    place_blocks_by_rank();
  } else {
    warp_layout_ = WarpLayout(tree, blocks, probabilities_, layout_);
    for (size_t b = 0; b < blocks.size(); ++b) probabilities_[b] = warp_layout_.blocks[b].area();
    is_linear() ? place_linear_blocks() : place_blocks_by_warp();
    if (is_linear()) cut_ = CutTables(tree, blocks, grid_, warp_layout_);
  }
  build_seconds_ = stopwatch.seconds();
}

namespace {

/// How much further than wanted a tree is grown before its weakest branches are taken back: twice
/// as far, but no more than so many blocks. Of thousands of blocks the weakest are all alike.
constexpr int kMostOvergrowth = 2048;

/// Sum over the six axes of the squared irradiance on a plane that faces them, from the middle of
/// every block.
double squared_irradiances(const BuildTree& tree, const TreeGrid& grid) {
  double sums[6] = {};
  for (const BuildNode& node : tree.nodes) {
    if (node.first_child >= 0) continue;
    const double u =
        grid.azimuth_origin() + 0.5 * (node.rect.lo[0] + node.rect.hi[0]) / (double)grid.columns();
    const double h = 0.5 * (grid.height_at(node.rect.lo[1]) + grid.height_at(node.rect.hi[1]));
    const Vec3 d = direction_at_height((float)u, (float)h, false);
    const double components[] = {d.x, d.y, d.z};
    for (int axis = 0; axis < 3; ++axis) {
      sums[2 * axis + (components[axis] < 0)] += node.moments.power * std::abs(components[axis]);
    }
  }
  return std::inner_product(std::begin(sums), std::end(sums), std::begin(sums), 0.0);
}

/// kAutoBlockCount: the variance of irradiance, averaged over planes that face the six axes, may be
/// this much above what kLargestAutoBlockCount blocks give. As squared cosines add up to 1 over the
/// axes, it is the square of the costs' sum less the squared means.
constexpr double kAutoTolerance = 0.04;

size_t splits_that_pay(const BuildTree& tree, const TreeGrid& grid,
                       const std::vector<int32_t>& splits, const std::vector<double>& costs,
                       int largest) {
  std::vector<double> after = {costs[0]};  // that many splits
  for (size_t s = 0; s < splits.size() && (int)s < largest - 1; ++s) {
    const int32_t child = tree.nodes[splits[s]].first_child;
    after.push_back(after.back() - costs[splits[s]] + costs[child] + costs[child + 1]);
  }
  const double least = after.back() * after.back();
  const double means = std::min(squared_irradiances(tree, grid), least);
  const double enough = least + kAutoTolerance * (least - means);
  size_t count = 0;
  while (count + 1 < after.size() && after[count] * after[count] > enough) ++count;
  return count;
}

}  // namespace

MapStatistics::Tree KdTreeSampler::grow(MapStatistics& map, const KdTreeConfig& config,
                                        ThreadTeam& team) const {
  const bool automatic = config.block_count == KdTreeConfig::kAutoBlockCount;
  const Statistics kind = grid_statistics(config);
  if (kind != Statistics::CELLS) {
    const int count = automatic ? KdTreeConfig::kDefaultBlockCount : config.block_count;
    return map.tree(kind, config.split_criterion, count, team, config.progress);
  }
  const int largest = automatic ? KdTreeConfig::kLargestAutoBlockCount : config.block_count;
  const int count =
      std::min(largest + std::min(largest, kMostOvergrowth), KdTreeConfig::kLargestBlockCount);
  MapStatistics::Tree grown = map.tree(kind, config.split_criterion, count, team, config.progress);
  const ImageStatistics& statistics = *grown.statistics;
  const std::vector<BuildNode>& nodes = grown.tree.nodes;
  std::vector<double> costs(nodes.size());
  for (size_t i = nodes.size(); i-- > 0;) {
    const int32_t child = nodes[i].first_child;
    if (child >= 0) grown.tilts[i] = grown.tilts[child] + grown.tilts[child + 1];
    costs[i] = approximate_cost(statistics, nodes[i].rect, grown.tilts[i]);
  }
  const std::vector<int32_t> splits = best_splits(grown.tree, costs);
  const size_t taken = automatic
                           ? splits_that_pay(grown.tree, statistics.grid(), splits, costs, largest)
                           : largest - 1;
  std::vector<TiltMoments> tilts = {grown.tilts[0]};
  for (size_t s = 0; s < std::min(taken, splits.size()); ++s) {
    const int32_t child = nodes[splits[s]].first_child;
    tilts.insert(tilts.end(), {grown.tilts[child], grown.tilts[child + 1]});
  }
  grown.tree = take_splits(grown.tree, splits, taken);
  grown.tilts = std::move(tilts);
  return grown;
}

double KdTreeSampler::solid_angle(const TexelRect& rect) const {
  return 4.0 * kPiDouble * grid_.rise(rect.lo[1], rect.hi[1]) * rect.size(0) / grid_.columns();
}

void KdTreeSampler::fit_blocks(const MapStatistics::Tree& grown, const std::vector<int32_t>& blocks,
                               ThreadTeam& team) {
  squares_.resize(blocks.size());
  if (!grid_.cells) {
    for (size_t b = 0; b < blocks.size(); ++b) {
      squares_[b] = grown.tree.nodes[blocks[b]].moments.square;
    }
    return;
  }
  tilts_.resize(blocks.size());
  const ImageStatistics& statistics = *grown.statistics;
  team.run_chunks((int)blocks.size(), 16, [&](int, int first, int last) {
    for (int b = first; b < last; ++b) {
      const FittedTilts fitted = fit_tilts(statistics, rects_[b], grown.tilts[blocks[b]]);
      // As the tables hold them, in 1/32768.
      tilts_[b] = {std::round(fitted.tilts.along * 32768) / 32768,
                   std::round(fitted.tilts.down * 32768) / 32768};
      squares_[b] = fitted.integral;
    }
  });
}

void KdTreeSampler::set_probabilities(const BuildTree& tree, const std::vector<int32_t>& blocks,
                                      const KdTreeConfig& config, ThreadTeam& team) {
  const size_t count = blocks.size();
  double power = 0;
  for (int32_t block : blocks) power += tree.nodes[block].moments.power;
  for (size_t b = 0; b < count; ++b) {
    empirical_.push_back(power > 0 ? tree.nodes[blocks[b]].moments.power / power
                                   : 1.0 / (double)count);
  }
  std::vector<double> weights = empirical_;
  std::sort(empirical_.begin(), empirical_.end(), std::greater<double>());
  fit_ = fit_rank_model(empirical_, config.rank_objective, &team);
  if (config.block_probability == BlockProbability::FITTED) {
    probabilities_ = rank_probabilities((float)fit_.alpha, (int)count);
    return;
  }
  if (config.block_probability == BlockProbability::MIN_VARIANCE) {
    for (size_t b = 0; b < count; ++b) {
      weights[b] = std::sqrt(solid_angle(rects_[b]) * squares_[b]);
    }
  }
  const double mean = std::accumulate(weights.begin(), weights.end(), 0.0) / (4.0 * kPiDouble);
  for (size_t b = 0; b < count; ++b) {
    const double even = config.compensation * mean * solid_angle(rects_[b]);
    weights[b] = std::max(weights[b] - even, 0.0);
  }
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  // Of an even map compensation leaves rounding.
  const bool directed = power > 0 && total > 1e-6 * 4.0 * kPiDouble * mean;
  const double usual = is_linear() && config.compensation == 0.0 ? 0.005 : 0.05;
  const double share = directed ? config.uniform_share.value_or(usual) : 1.0;
  for (size_t b = 0; b < count; ++b) {
    const double even = solid_angle(rects_[b]) / (4.0 * kPiDouble);
    probabilities_.push_back(share * even +
                             (share < 1.0 ? (1.0 - share) * weights[b] / total : 0.0));
  }
}

namespace {

/// Extent of a block in u, less what float rounding of a direction could cross.
void set_azimuth_warp(const TexelRect& rect, int width, BlockWarp* warp) {
  const double start = (double)rect.lo[0] / width + kAzimuthInset;
  const double end = (double)rect.hi[0] / width - kAzimuthInset;
  warp->u_start = (float)start;
  warp->u_slope = (float)(end - start);
}

}  // namespace

void KdTreeSampler::place_blocks_by_rank() {
  for (size_t b = 0; b < rects_.size(); ++b) {
    BlockWarp warp;
    set_azimuth_warp(rects_[b], grid_.width, &warp);
    set_height_warp(rects_[b].lo[1], rects_[b].hi[1], grid_.height, &warp.h_start, &warp.h_slope);
    warps_.push_back(warp);
    pdf_.push_back((float)(probabilities_[b] / solid_angle(rects_[b])));
  }
}

void KdTreeSampler::place_blocks_by_warp() {
  place_blocks_by_rank();
  for (size_t b = 0; b < rects_.size(); ++b) {
    const WarpRect& part = warp_layout_.blocks[b];
    warps_[b].u_slope = (float)(warps_[b].u_slope / part.extent(0));
    warps_[b].h_slope = (float)(warps_[b].h_slope / part.extent(1));
    warp_origins_.push_back({part.origin(0), part.origin(1)});
  }
}

void KdTreeSampler::place_linear_blocks() {
  for (size_t b = 0; b < rects_.size(); ++b) {
    const TexelRect& rect = rects_[b];
    const WarpRect& part = warp_layout_.blocks[b];
    const bool southern = grid_.is_southern(rect.lo[1], rect.hi[1]);
    const auto code = [](double tilt) { return (uint32_t)(uint16_t)(int16_t)(tilt * 32768); };
    LinearBlock block;
    block.columns = (uint32_t)rect.lo[0] | (uint32_t)rect.hi[0] << 16;
    block.tilts = code(tilts_[b].along) | code(southern ? -tilts_[b].down : tilts_[b].down) << 16;
    block.h_start =
        (float)(southern ? grid_.height_from_south(rect.hi[1]) : grid_.height_at(rect.lo[1]));
    const float rise = (float)grid_.rise(rect.lo[1], rect.hi[1]);
    block.h_rise = southern ? -rise : rise;
    block.warp_origin = {part.origin(0), part.origin(1)};
    block.warp_scale = {(float)(1.0 / part.extent(0)), (float)(1.0 / part.extent(1))};
    linear_blocks_.push_back(block);
  }
}

EnvSamplerView KdTreeSampler::view() const {
  const auto data = [](const auto& v) { return v.empty() ? nullptr : v.data(); };
  EnvSamplerView view;
  view.type = is_linear()                  ? EnvSamplerType::KDTREE_LINEAR
              : !warp_layout_.grid.empty() ? EnvSamplerType::KDTREE_WARP
                                           : EnvSamplerType::KDTREE_RANK;
  KdTreeView& tree = view.kdtree;
  tree.linear_blocks = data(linear_blocks_);
  tree.warps = data(warps_);
  tree.pdf = data(pdf_);
  tree.warp_origins = data(warp_origins_);
  tree.split_keys = layout_.split_keys.data();
  tree.split_warps = warp_layout_.split_warps.data();
  tree.children = layout_.children.data();
  tree.start_grid = layout_.start_grid.data();
  tree.warp_grid = data(warp_layout_.grid);
  tree.ranks.alpha = (float)fit_.alpha;
  tree.ranks.count = block_count();
  tree.ranks.log_range = (float)std::log1p((double)block_count() / tree.ranks.alpha);
  tree.cell_width = (float)(1.0 / grid_.width);
  tree.inner_count = (int32_t)layout_.children.size();
  return view;
}

EnvSamplerView KdTreeSampler::product_view() const {
  EnvSamplerView with = view();
  if (is_linear()) {
    std::call_once(products_made_, [&] {
      ThreadTeam team(threads_);
      products_ = std::make_unique<const ProductTable>(cut_.view(), team);
    });
    with.kdtree.products = {cut_.view(), products_->cuts.data(), products_->means.data()};
  }
  return with;
}

size_t KdTreeSampler::nbytes() const {
  const auto bytes = [](const auto& v) { return v.size() * sizeof(v[0]); };
  return bytes(warps_) + bytes(pdf_) + bytes(warp_origins_) + bytes(linear_blocks_) +
         bytes(layout_.split_keys) + bytes(layout_.children) + bytes(layout_.start_grid) +
         bytes(warp_layout_.split_warps) + bytes(warp_layout_.grid);
}

void KdTreeSampler::reconstruct(const LatLongImage& image, float* out) const {
  if (image.width != grid_.width || image.height != grid_.height) {
    throw std::invalid_argument("reconstruct needs the image that the tree was built from");
  }
  const std::vector<double> weights = mean_row_weights(grid_.width, grid_.height, statistics_);
  for (size_t b = 0; b < rects_.size(); ++b) {
    TexelRect rect = rects_[b];
    if (grid_.cells) {
      // The centre of a texel is the upper left corner of the cell one row further down.
      rect.lo[1] = std::max(rect.lo[1] - 1, 0);
      rect.hi[1] = rect.hi[1] - 1;
    }
    const std::array<double, 3> mean = block_mean(image, rect, weights);
    fill_block(rect, {(float)mean[0], (float)mean[1], (float)mean[2]}, grid_.width, out);
    if (grid_.cells) tilt_block(b, rect, out);
  }
}

void KdTreeSampler::tilt_block(size_t block, const TexelRect& texels, float* out) const {
  const TexelRect& rect = rects_[block];
  const Tilts tilts = tilts_[block];
  const double rise = grid_.rise(rect.lo[1], rect.hi[1]), top = grid_.height_at(rect.lo[1]);
  for (int y = texels.lo[1]; y < texels.hi[1]; ++y) {
    const double q = (height_from_north(2 * y + 1, 2 * grid_.height) - top) / rise;
    for (int x = texels.lo[0]; x < texels.hi[0]; ++x) {
      // Of one texel: the mean is its own.
      const double p = texels.size(0) > 1 ? (x + 0.5 - texels.lo[0]) / texels.size(0) : 0.5;
      const double along = 1 + tilts.along * (2 * p - 1);
      const double down = texels.size(1) > 1 ? 1 + tilts.down * (2 * q - 1) : 1.0;
      float* t = out + 3 * ((int64_t)y * grid_.width + x);
      for (int c = 0; c < 3; ++c) t[c] *= (float)(along * down);
    }
  }
}

}  // namespace skytree
