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

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;
constexpr int32_t kWarpUnits = 1 << 24;
constexpr float kWarpUnit = 1.0f / (1 << 24);

void check_config(const KdTreeConfig& config) {
  if (config.block_count < 1 || config.block_count > KdTreeConfig::kLargestBlockCount) {
    throw std::invalid_argument("block_count is " + std::to_string(config.block_count) +
                                "; it must be from 1 to " +
                                std::to_string(KdTreeConfig::kLargestBlockCount));
  }
  if (!(config.uniform_share > 0.0 && config.uniform_share <= 1.0)) {
    throw std::invalid_argument(
        "uniform_share is " + std::to_string(config.uniform_share) +
        "; it must be above 0 and at most 1, or some directions are never sampled");
  }
}

/// Leaves depth first, the first child (left or top) before the second.
std::vector<int32_t> leaves_depth_first(const BuildTree& tree) {
  std::vector<int32_t> leaves, stack = {0};
  while (!stack.empty()) {
    const int32_t index = stack.back();
    stack.pop_back();
    const int32_t child = tree.nodes[index].first_child;
    if (child < 0) {
      leaves.push_back(index);
    } else {
      stack.push_back(child + 1);
      stack.push_back(child);
    }
  }
  return leaves;
}

/// Deepest node of the finished tree whose region holds a cell; side(node) tells whether the cell
/// lies before the node's plane
/// (-1), behind it (1) or across (0).
template <typename Side>
uint16_t deepest_node(const std::vector<uint32_t>& children, const Side& side) {
  int32_t node = 0;
  while (node < (int32_t)children.size()) {
    const int where = side(node);
    if (where == 0) break;
    node = next_node(children[node], where > 0);
  }
  return (uint16_t)node;
}

}  // namespace

KdTreeSampler::KdTreeSampler(const LatLongImage& image, const KdTreeConfig& config)
    : width_(image.width), height_(image.height), statistics_(config.statistics) {
  const Stopwatch stopwatch;
  check_image(image);
  check_config(config);
  const BuildTree tree = build_kdtree(image, config.block_count, config.split_criterion,
                                      config.statistics, config.progress);
  bad_texels_ = tree.bad_texels;
  const bool by_rank = config.block_probability == BlockProbability::FITTED;
  std::vector<int32_t> blocks = leaves_depth_first(tree);
  if (by_rank) {
    std::stable_sort(blocks.begin(), blocks.end(), [&](int32_t a, int32_t b) {
      return tree.nodes[a].moments.power > tree.nodes[b].moments.power;
    });
  }
  for (int32_t block : blocks) rects_.push_back(tree.nodes[block].rect);
  set_probabilities(tree, blocks, config);
  link_nodes(tree, blocks);
  fill_start_grid();
  if (by_rank) {
    place_blocks_by_rank();
  } else {
    place_blocks_by_warp(tree, blocks);
    fill_warp_grid();
  }
  build_seconds_ = stopwatch.seconds();
}

double KdTreeSampler::solid_angle(const TexelRect& rect) const {
  // From the nearer pole, as 1 - (tiny) would lose the digits.
  const bool southern = height_ - rect.hi[1] < rect.lo[1];
  const double rise =
      southern ? height_from_north(height_ - rect.lo[1], height_) -
                     height_from_north(height_ - rect.hi[1], height_)
               : height_from_north(rect.hi[1], height_) - height_from_north(rect.lo[1], height_);
  return 4.0 * kPiDouble * rise * rect.size(0) / width_;
}

void KdTreeSampler::set_probabilities(const BuildTree& tree, const std::vector<int32_t>& blocks,
                                      const KdTreeConfig& config) {
  const size_t count = blocks.size();
  double power = 0;
  for (int32_t block : blocks) power += tree.nodes[block].moments.power;
  for (size_t b = 0; b < count; ++b) {
    empirical_.push_back(power > 0 ? tree.nodes[blocks[b]].moments.power / power
                                   : 1.0 / (double)count);
  }
  std::vector<double> weights = empirical_;
  std::sort(empirical_.begin(), empirical_.end(), std::greater<double>());
  fit_ = fit_rank_model(empirical_, config.rank_objective);
  if (config.block_probability == BlockProbability::FITTED) {
    probabilities_ = rank_probabilities((float)fit_.alpha, (int)count);
    return;
  }
  if (config.block_probability == BlockProbability::MIN_VARIANCE) {
    for (size_t b = 0; b < count; ++b) {
      weights[b] = std::sqrt(solid_angle(rects_[b]) * tree.nodes[blocks[b]].moments.square);
    }
  }
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  const double share = power > 0 && total > 0 ? config.uniform_share : 1.0;
  for (size_t b = 0; b < count; ++b) {
    const double even = solid_angle(rects_[b]) / (4.0 * kPiDouble);
    probabilities_.push_back(share * even +
                             (share < 1.0 ? (1.0 - share) * weights[b] / total : 0.0));
  }
}

void KdTreeSampler::link_nodes(const BuildTree& tree, const std::vector<int32_t>& blocks) {
  std::vector<uint16_t> numbers(tree.nodes.size());
  uint16_t inner = 0;
  for (size_t i = 0; i < tree.nodes.size(); ++i) {
    if (tree.nodes[i].first_child >= 0) numbers[i] = inner++;
  }
  for (size_t b = 0; b < blocks.size(); ++b) numbers[blocks[b]] = (uint16_t)(inner + b);
  for (const BuildNode& node : tree.nodes) {
    if (node.first_child < 0) continue;
    planes_.push_back({node.axis, node.position});
    children_.push_back(numbers[node.first_child] | (uint32_t)numbers[node.first_child + 1] << 16);
    if (node.axis == 0) {
      split_keys_.push_back(azimuth_key((float)((double)node.position / width_)));
    } else {
      const bool southern = 2 * (int64_t)node.position > height_;
      const int nearer = southern ? height_ - node.position : node.position;
      split_keys_.push_back(elevation_key((float)height_from_north(nearer, height_), southern) |
                            kElevationSplit);
    }
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
    set_azimuth_warp(rects_[b], width_, &warp);
    set_height_warp(rects_[b].lo[1], rects_[b].hi[1], height_, &warp.h_start, &warp.h_slope);
    warps_.push_back(warp);
    pdf_.push_back((float)(probabilities_[b] / solid_angle(rects_[b])));
  }
}

void KdTreeSampler::place_blocks_by_warp(const BuildTree& tree,
                                         const std::vector<int32_t>& blocks) {
  // The unit square of (u.y, u.z) is cut like the map, in proportion to probability, in units of
  // 2^-24: thresholds are exact in a float, and a block's probability is the area that it really
  // gets. Every part keeps at least as many units a side as it has blocks, so that no block
  // vanishes.
  struct Part {
    double probability = 0;
    int32_t block_count = 1;
    int32_t lo[2] = {0, 0}, hi[2] = {kWarpUnits, kWarpUnits};
  };
  std::vector<Part> parts(tree.nodes.size());
  for (size_t b = 0; b < blocks.size(); ++b) parts[blocks[b]].probability = probabilities_[b];
  for (size_t i = tree.nodes.size(); i-- > 0;) {
    const int32_t child = tree.nodes[i].first_child;
    if (child < 0) continue;
    parts[i].probability = parts[child].probability + parts[child + 1].probability;
    parts[i].block_count = parts[child].block_count + parts[child + 1].block_count;
  }
  for (size_t i = 0; i < tree.nodes.size(); ++i) {
    const BuildNode& node = tree.nodes[i];
    if (node.first_child < 0) continue;
    Part& first = parts[node.first_child];
    Part& second = parts[node.first_child + 1];
    const Part& part = parts[i];
    const int axis = node.axis;
    const int32_t extent = part.hi[axis] - part.lo[axis];
    const int32_t wanted = (int32_t)std::lround(extent * (first.probability / part.probability));
    const int32_t cut = std::clamp(wanted, first.block_count, extent - second.block_count);
    for (int a = 0; a < 2; ++a) {
      first.lo[a] = second.lo[a] = part.lo[a];
      first.hi[a] = second.hi[a] = part.hi[a];
    }
    first.hi[axis] = second.lo[axis] = part.lo[axis] + cut;
    split_warps_.push_back(kWarpUnit * (float)(part.lo[axis] + cut));
  }
  for (size_t b = 0; b < blocks.size(); ++b) {
    const Part& part = parts[blocks[b]];
    const double width = (part.hi[0] - part.lo[0]) * (double)kWarpUnit;
    const double height = (part.hi[1] - part.lo[1]) * (double)kWarpUnit;
    BlockWarp warp;
    set_azimuth_warp(rects_[b], width_, &warp);
    set_height_warp(rects_[b].lo[1], rects_[b].hi[1], height_, &warp.h_start, &warp.h_slope);
    warp.u_slope = (float)(warp.u_slope / width);
    warp.h_slope = (float)(warp.h_slope / height);
    warps_.push_back(warp);
    warp_origins_.push_back({kWarpUnit * (float)part.lo[0], kWarpUnit * (float)part.lo[1]});
    probabilities_[b] = width * height;
    pdf_.push_back((float)(probabilities_[b] / solid_angle(rects_[b])));
  }
}

void KdTreeSampler::fill_start_grid() {
  // A direction on a cell's border may be rounded into the neighbour: a cell counts as a bit larger
  // than it is.
  constexpr double kMargin = 1e-6;
  for (int row = 0; row < kStartRows; ++row) {
    for (int column = 0; column < kStartColumns; ++column) {
      const double lo[2] = {(double)column / kStartColumns - kMargin,
                            (double)row / kStartRows - kMargin};
      const double hi[2] = {(double)(column + 1) / kStartColumns + kMargin,
                            (double)(row + 1) / kStartRows + kMargin};
      start_grid_.push_back(deepest_node(children_, [&](int32_t node) {
        const Plane& plane = planes_[node];
        const double at = plane.axis == 0 ? (double)plane.position / width_
                                          : height_from_north(plane.position, height_);
        return hi[plane.axis] <= at ? -1 : lo[plane.axis] >= at ? 1 : 0;
      }));
    }
  }
}

void KdTreeSampler::fill_warp_grid() {
  for (int row = 0; row < kWarpGrid; ++row) {
    for (int column = 0; column < kWarpGrid; ++column) {
      const float lo[2] = {(float)column / kWarpGrid, (float)row / kWarpGrid};
      const float hi[2] = {(float)(column + 1) / kWarpGrid, (float)(row + 1) / kWarpGrid};
      warp_grid_.push_back(deepest_node(children_, [&](int32_t node) {
        const int axis = planes_[node].axis;
        const float at = split_warps_[node];
        return hi[axis] <= at ? -1 : lo[axis] >= at ? 1 : 0;
      }));
    }
  }
}

EnvSamplerView KdTreeSampler::view() const {
  const bool by_warp = !warp_grid_.empty();
  EnvSamplerView view;
  view.type = by_warp ? EnvSamplerType::KDTREE_WARP : EnvSamplerType::KDTREE_RANK;
  KdTreeView& tree = view.kdtree;
  tree.warps = warps_.data();
  tree.pdf = pdf_.data();
  tree.warp_origins = by_warp ? warp_origins_.data() : nullptr;
  tree.split_keys = split_keys_.data();
  tree.split_warps = by_warp ? split_warps_.data() : nullptr;
  tree.children = children_.data();
  tree.start_grid = start_grid_.data();
  tree.warp_grid = by_warp ? warp_grid_.data() : nullptr;
  tree.ranks.alpha = (float)fit_.alpha;
  tree.ranks.count = block_count();
  tree.ranks.log_range = (float)std::log1p((double)block_count() / tree.ranks.alpha);
  tree.inner_count = (int32_t)children_.size();
  return view;
}

size_t KdTreeSampler::nbytes() const {
  const auto bytes = [](const auto& v) { return v.size() * sizeof(v[0]); };
  return bytes(warps_) + bytes(pdf_) + bytes(warp_origins_) + bytes(split_keys_) +
         bytes(split_warps_) + bytes(children_) + bytes(start_grid_) + bytes(warp_grid_);
}

void KdTreeSampler::reconstruct(const LatLongImage& image, float* out) const {
  if (image.width != width_ || image.height != height_) {
    throw std::invalid_argument("reconstruct needs the image that the tree was built from");
  }
  const std::vector<double> weights = mean_row_weights(width_, height_, statistics_);
  for (const TexelRect& rect : rects_) {
    const std::array<double, 3> mean = block_mean(image, rect, weights);
    fill_block(rect, {(float)mean[0], (float)mean[1], (float)mean[2]}, width_, out);
  }
}

}  // namespace skytree
