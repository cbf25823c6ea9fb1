// SPDX-License-Identifier: GPL-3.0-or-later
// The best part of a tree that was grown too large. Growth sees one split ahead; a split that pays
// only together with those below it comes too late. So the tree is grown further than wanted and
// its weakest branches are taken back: P. Chou, T. Lookabaugh, R. Gray, "Optimal Pruning with
// Applications to Tree-Structured Source Coding and Modeling", IEEE Trans. Inf. Theory 35(2), 1989,
// after L. Breiman et al., "Classification and Regression Trees", 1984.
#pragma once

#include <vector>

#include "src/kdtree_builder.h"

namespace skytree {

/// Inner nodes in the order in which they are worth making: those of the best tree with n blocks
/// are the first n - 1, or nearly so. `costs`: of every node as a block; the cost of a tree is the
/// sum over its blocks.
std::vector<int32_t> best_splits(const BuildTree& tree, const std::vector<double>& costs);

/// The tree that the first `count` splits make, its nodes in order of creation.
BuildTree take_splits(const BuildTree& tree, const std::vector<int32_t>& splits, size_t count);

}  // namespace skytree
