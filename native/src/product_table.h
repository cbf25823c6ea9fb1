// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "kernel/product_lobes.h"
#include "src/thread_team.h"

namespace skytree {

/// The cuts of kernel/product_lobes.h for one tree, 5.5 MB.
struct ProductTable {
  std::vector<ProductCut> cuts;
  std::vector<float> means;

  ProductTable(const CutView& cut, ThreadTeam& team);
};

}  // namespace skytree
