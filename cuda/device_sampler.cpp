// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/device_sampler.h"

#include "kernel/product_lobes.h"

namespace skytree::cuda {
namespace {

/// Calls visit(pointer member, number of elements) for each table that the sampler's type reads.
template <class Visit>
void for_each_table(EnvSamplerView* view, Visit visit) {
  switch (view->type) {
    case EnvSamplerType::UNIFORM:
      return;
    case EnvSamplerType::KDTREE_RANK:
    case EnvSamplerType::KDTREE_WARP:
    case EnvSamplerType::KDTREE_LINEAR: {
      KdTreeView& tree = view->kdtree;
      const size_t inner = tree.inner_count, blocks = inner + 1;
      visit(&tree.linear_blocks, blocks);
      visit(&tree.warps, blocks);
      visit(&tree.pdf, blocks);
      visit(&tree.warp_origins, blocks);
      visit(&tree.split_keys, inner);
      visit(&tree.split_warps, inner);
      visit(&tree.children, inner);
      visit(&tree.start_grid, size_t(kStartColumns) * kStartRows);
      visit(&tree.warp_grid, size_t(kWarpGrid) * kWarpGrid);
      ProductView& products = tree.products;
      visit(&products.cut.nodes, size_t(products.cut.count));
      visit(&products.cut.splits, size_t(products.cut.count));
      visit(&products.cut.node_of_block, blocks);
      visit(&products.cuts, size_t(kTableCuts));
      visit(&products.means, size_t(kTableCuts));
      return;
    }
    case EnvSamplerType::INVERSION_GUIDED:
    case EnvSamplerType::INVERSION_BINARY: {
      InversionView& table = view->inversion;
      const size_t width = table.width, height = table.height;
      visit(&table.marginal, height + 1);
      visit(&table.conditional, height * (width + 1));
      visit(&table.rows, height);
      visit(&table.marginal_guide, height);
      visit(&table.conditional_guide, height * width);
      return;
    }
    case EnvSamplerType::ALIAS: {
      AliasView& table = view->alias;
      visit(&table.entries, size_t(table.width) * table.height);
      visit(&table.rows, size_t(table.height));
      return;
    }
    case EnvSamplerType::HIERARCHY: {
      HierarchyView& table = view->hierarchy;
      visit(&table.weights, size_t(hierarchy_base(table)) + size_t(table.width) * table.height);
      visit(&table.rows, size_t(table.height));
      return;
    }
    case EnvSamplerType::FILTERED: {
      FilteredView& table = view->filtered;
      visit(&table.texels, 3 * size_t(table.texel_count));
      visit(&table.rows, size_t(table.row_count));
      visit(&table.levels, size_t(table.level_count));
      return;
    }
  }
}

}  // namespace

std::vector<SamplerTable> sampler_tables(const EnvSamplerView& host) {
  EnvSamplerView view = host;
  std::vector<SamplerTable> tables;
  for_each_table(&view, [&](auto* pointer, size_t count) {
    const auto offset = reinterpret_cast<char*>(pointer) - reinterpret_cast<char*>(&view);
    if (*pointer) tables.push_back({size_t(offset), *pointer, count * sizeof(**pointer)});
  });
  return tables;
}

DeviceSampler::DeviceSampler(const ContextPointer& context, const EnvSamplerView& host)
    : view_(host) {
  for_each_table(&view_, [&](auto* pointer, size_t count) {
    using Element =
        std::remove_const_t<std::remove_pointer_t<std::remove_pointer_t<decltype(pointer)>>>;
    if (!*pointer) return;
    tables_.emplace_back(context, *pointer, count * sizeof(Element));
    *pointer = tables_.back().template as<Element>();
  });
}

}  // namespace skytree::cuda
