// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/nd_kdtree.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>

#include "src/nd_blocks.h"
#include "src/stopwatch.h"

namespace skytree {
namespace {

void check_config(const NdKdTreeConfig& config) {
  if (config.block_count < 1 || config.block_count > NdKdTreeConfig::kLargestBlockCount) {
    throw std::invalid_argument("block_count must be between 1 and " +
                                std::to_string(NdKdTreeConfig::kLargestBlockCount));
  }
  if (config.slice_count < 1 || config.slice_count > config.block_count) {
    throw std::invalid_argument(
        "slice_count must be between 1 and block_count: every slice has a block");
  }
  if (config.split_criterion == SplitCriterion::RANGE ||
      config.split_criterion == SplitCriterion::MEDIAN_CUT) {
    throw std::invalid_argument(
        "split_criterion RANGE and MEDIAN_CUT exist in two dimensions only; use VARIANCE, SSE or "
        "MIN_VARIANCE");
  }
  if (!(config.uniform_share >= 0.0 && config.uniform_share <= 1.0)) {
    throw std::invalid_argument("uniform_share must be between 0 and 1");
  }
}

/// The values with integral 1 over the free axes in every cell of the condition; a cell where there
/// is nothing to sample is uniform.
std::vector<float> normalised(const NdGrid& grid, int condition_count) {
  size_t conditions = 1;
  for (int a = 0; a < condition_count; ++a) conditions *= size_t(grid.size(a));
  const size_t cells = grid.values.size() / conditions;
  std::vector<double> volumes(1, 1.0);
  for (int a = condition_count; a < grid.dimensions(); ++a) {
    std::vector<double> finer;
    for (const double v : volumes) {
      for (int i = 0; i < grid.size(a); ++i) finer.push_back(v * grid.width(a, i));
    }
    volumes = std::move(finer);
  }
  std::vector<float> values(grid.values.size());
  for (size_t c = 0; c < conditions; ++c) {
    const float* row = &grid.values[c * cells];
    double sum = 0;
    for (size_t x = 0; x < cells; ++x) sum += volumes[x] * row[x];
    for (size_t x = 0; x < cells; ++x) {
      values[c * cells + x] = sum > 0 ? float(row[x] / sum) : 1.0f;
    }
  }
  return values;
}

/// Probabilities of a slice's blocks, which `moments` describes; ranks[k] is the block of rank k,
/// only with FITTED.
std::vector<double> block_probabilities(const std::vector<NdMoments>& moments,
                                        const NdKdTreeConfig& config, RankFit* fit,
                                        std::vector<int32_t>* ranks) {
  const size_t count = moments.size();
  std::vector<double> p(count);
  double total = 0;
  for (size_t b = 0; b < count; ++b) total += moments[b].mass;
  for (size_t b = 0; b < count; ++b) p[b] = moments[b].mass / total;
  ranks->resize(count);
  std::iota(ranks->begin(), ranks->end(), 0);
  std::stable_sort(ranks->begin(), ranks->end(),
                   [&](int32_t a, int32_t b) { return p[size_t(a)] > p[size_t(b)]; });
  std::vector<double> empirical;
  for (const int32_t b : *ranks) empirical.push_back(p[size_t(b)]);
  *fit = fit_rank_model(empirical);
  if (config.block_probability == BlockProbability::FITTED) {
    const std::vector<double> model = rank_probabilities(fit->alpha, int(count));
    for (size_t k = 0; k < count; ++k) p[size_t((*ranks)[k])] = model[k];
    return p;
  }
  if (config.block_probability == BlockProbability::MIN_VARIANCE) {
    total = 0;
    for (size_t b = 0; b < count; ++b)
      total += p[b] = std::sqrt(moments[b].volume * moments[b].square);
    for (double& x : p) x /= total;
  }
  for (size_t b = 0; b < count; ++b) {
    p[b] += config.uniform_share * (moments[b].volume - p[b]);
  }
  return p;
}

}  // namespace

NdKdTree::NdKdTree(const NdGrid& grid, int condition_count, const NdKdTreeConfig& config)
    : condition_count_(condition_count), free_count_(grid.dimensions() - condition_count) {
  const Stopwatch watch;
  check_grid(grid, condition_count);
  check_config(config);
  const std::vector<float> conditional = normalised(grid, condition_count);
  const std::vector<NdBuildNode> upper =
      build_slices(grid, conditional, condition_count, config.slice_count);
  std::vector<NdSums> sums;
  std::vector<int32_t> slice_of(upper.size(), -1);
  for (size_t i = 0; i < upper.size(); ++i) {
    if (upper[i].first_child >= 0) continue;
    slice_of[i] = int32_t(sums.size());
    sums.emplace_back(grid, conditional, condition_count, upper[i].box);
  }
  const std::vector<std::vector<NdBuildNode>> trees =
      build_blocks(sums, config.block_count, config.split_criterion, free_count_);

  const auto border = [&](int axis, int32_t cell) {
    return float(grid.edges[size_t(axis)][size_t(cell)]);
  };
  for (size_t i = 0; i < upper.size(); ++i) {
    const NdBuildNode& node = upper[i];
    if (node.first_child < 0) {
      nodes_.push_back({0.0f, 0.0f, uint32_t(slice_of[i]) << 3 | kNdSlice});
    } else {
      nodes_.push_back({border(node.axis, node.position), 0.0f,
                        uint32_t(node.first_child) << 3 | uint32_t(node.axis)});
    }
  }
  for (size_t s = 0; s < trees.size(); ++s) {
    const std::vector<NdBuildNode>& tree = trees[s];
    const size_t root = nodes_.size();
    std::vector<int32_t> blocks, block_of(tree.size(), -1);
    std::vector<NdMoments> moments;
    for (size_t i = 0; i < tree.size(); ++i) {
      if (tree[i].first_child >= 0) continue;
      block_of[i] = int32_t(blocks.size());
      blocks.push_back(int32_t(i));
      moments.push_back(sums[s].moments(tree[i].box));
    }
    RankFit fit;
    std::vector<int32_t> ranks;
    const std::vector<double> p = block_probabilities(moments, config, &fit, &ranks);
    fits_.push_back(fit);
    NdSlice slice = {};
    slice.root = int32_t(root);
    slice.first_block = block_count_;
    slice.ranks.alpha = float(fit.alpha);
    slice.ranks.count = int32_t(blocks.size());
    slice.ranks.log_range = float(std::log1p(double(blocks.size()) / slice.ranks.alpha));
    slices_.push_back(slice);

    std::vector<double> below(tree.size(), 0.0);
    for (size_t i = tree.size(); i-- > 0;) {
      const int32_t child = tree[i].first_child;
      below[i] =
          child < 0 ? p[size_t(block_of[i])] : below[size_t(child)] + below[size_t(child) + 1];
    }
    for (size_t i = 0; i < tree.size(); ++i) {
      const NdBuildNode& node = tree[i];
      if (node.first_child < 0) {
        const size_t b = size_t(block_of[i]);
        nodes_.push_back({float(p[b] / moments[b].volume), 0.0f,
                          uint32_t(block_count_ + int(b)) << 3 | kNdBlock});
      } else {
        const double share = below[i] > 0 ? below[size_t(node.first_child)] / below[i] : 0.5;
        nodes_.push_back({border(condition_count_ + node.axis, node.position), float(share),
                          uint32_t(root + size_t(node.first_child)) << 3 |
                              uint32_t(condition_count_ + node.axis)});
      }
    }
    if (config.block_probability == BlockProbability::FITTED) {
      for (const int32_t b : ranks) {
        const NdBox& box = tree[size_t(blocks[size_t(b)])].box;
        for (int a = 0; a < free_count_; ++a) {
          bounds_.push_back(border(condition_count_ + a, box.lo[size_t(a)]));
        }
        for (int a = 0; a < free_count_; ++a) {
          bounds_.push_back(border(condition_count_ + a, box.hi[size_t(a)]));
        }
      }
    }
    block_count_ += int(blocks.size());
  }
  build_seconds_ = watch.seconds();
}

NdKdTreeView NdKdTree::view() const {
  return {nodes_.data(), slices_.data(), bounds_.empty() ? nullptr : bounds_.data(),
          condition_count_, free_count_};
}

size_t NdKdTree::nbytes() const {
  return nodes_.size() * sizeof(NdNode) + slices_.size() * sizeof(NdSlice) +
         bounds_.size() * sizeof(float);
}

}  // namespace skytree
