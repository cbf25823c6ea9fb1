// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/tree_pruning.h"

#include <algorithm>
#include <queue>

namespace skytree {
namespace {

/// What a branch saves for each block that it has more than its root alone.
struct Branch {
  double worth;
  int32_t node;

  bool operator<(const Branch& other) const {  // the queue's top: least worth, then made last
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
  std::priority_queue<Branch> weakest;
  for (int32_t i = 0; i < count; ++i) {
    if (tree.nodes[i].first_child >= 0) weakest.push({worth(i), i});
  }
  int32_t step = 0;
  std::vector<int32_t> stack;
  while (!weakest.empty()) {
    const Branch branch = weakest.top();
    weakest.pop();
    const int32_t node = branch.node;
    if (removed[node] >= 0 || branch.worth != worth(node)) continue;  // gone, or queued again
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
    const double cost = costs[node] - branch_costs[node];
    const int32_t fewer = blocks[node] - 1;
    for (int32_t i = node; i >= 0; i = parents[i]) {
      branch_costs[i] += cost;
      blocks[i] -= fewer;
      if (i != node) weakest.push({worth(i), i});
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
