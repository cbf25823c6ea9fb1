// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/tree_pruning.h"

#include <algorithm>
#include <queue>

namespace skytree {
namespace {

/// What a branch saves for each block that it has more than its root alone.
struct Branch {
  double worth = 0;
  int32_t node = -1;  // none

  bool operator<(const Branch& other) const {  // the largest: least worth, then made last
    return worth != other.worth ? worth > other.worth : node < other.node;
  }
};

struct Candidate {
  int32_t removed;  // when the branch went
  double gain;
  int32_t node;

  bool operator<(const Candidate& other) const {
    if (removed != other.removed) return removed < other.removed;
    return gain != other.gain ? gain < other.gain : node > other.node;
  }
};

}  // namespace

std::vector<int32_t> best_splits(const BuildTree& tree, const std::vector<double>& costs) {
  const int32_t count = (int32_t)tree.nodes.size();
  std::vector<int32_t> parents(count, -1), blocks(count, 1), removed(count, -1);
  std::vector<double> branch_costs(costs);
  for (int32_t i = count - 1; i >= 0; --i) {
    const int32_t child = tree.nodes[i].first_child;
    if (child < 0) continue;
    parents[child] = parents[child + 1] = i;
    blocks[i] = blocks[child] + blocks[child + 1];
    branch_costs[i] = branch_costs[child] + branch_costs[child + 1];
  }
  const auto worth = [&](int32_t i) { return (costs[i] - branch_costs[i]) / (blocks[i] - 1); };
  // The weakest branch at or below each node: taking one back changes those above it alone.
  std::vector<Branch> weakest(count);
  const auto find_weakest = [&](int32_t i) {
    const int32_t child = tree.nodes[i].first_child;
    weakest[i] = {worth(i), i};
    for (int32_t below : {child, child + 1}) {
      if (weakest[below].node >= 0 && weakest[i] < weakest[below]) weakest[i] = weakest[below];
    }
  };
  for (int32_t i = count - 1; i >= 0; --i) {
    if (tree.nodes[i].first_child >= 0) find_weakest(i);
  }
  int32_t step = 0;
  std::vector<int32_t> stack;
  while (weakest[0].node >= 0) {
    const int32_t node = weakest[0].node;
    stack.assign(1, node);
    while (!stack.empty()) {
      const int32_t i = stack.back();
      stack.pop_back();
      if (tree.nodes[i].first_child < 0 || removed[i] >= 0) continue;
      removed[i] = step;
      stack.push_back(tree.nodes[i].first_child);
      stack.push_back(tree.nodes[i].first_child + 1);
    }
    ++step;
    weakest[node] = Branch();
    const double cost = costs[node] - branch_costs[node];
    const int32_t fewer = blocks[node] - 1;
    for (int32_t i = node; i >= 0; i = parents[i]) {
      branch_costs[i] += cost;
      blocks[i] -= fewer;
      if (i != node) find_weakest(i);
    }
  }
  std::vector<int32_t> splits;
  std::priority_queue<Candidate> next;
  const auto offer = [&](int32_t i) {
    const int32_t child = tree.nodes[i].first_child;
    if (child >= 0) next.push({removed[i], costs[i] - costs[child] - costs[child + 1], i});
  };
  offer(0);
  while (!next.empty()) {
    const int32_t node = next.top().node;
    next.pop();
    splits.push_back(node);
    offer(tree.nodes[node].first_child);
    offer(tree.nodes[node].first_child + 1);
  }
  return splits;
}

BuildTree take_splits(const BuildTree& tree, const std::vector<int32_t>& splits, size_t count) {
  BuildTree taken;
  taken.bad_texels = tree.bad_texels;
  std::vector<int32_t> numbers(tree.nodes.size(), -1);
  const auto add = [&](int32_t i) {
    numbers[i] = (int32_t)taken.nodes.size();
    taken.nodes.push_back(tree.nodes[i]);
    taken.nodes.back().first_child = -1;
  };
  add(0);
  count = std::min(count, splits.size());
  for (size_t s = 0; s < count; ++s) {
    const int32_t child = tree.nodes[splits[s]].first_child;
    taken.nodes[numbers[splits[s]]].first_child = (int32_t)taken.nodes.size();
    add(child);
    add(child + 1);
  }
  taken.block_count = (int32_t)count + 1;
  return taken;
}

}  // namespace skytree
