// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/brdf_kdtree.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "src/stopwatch.h"

namespace skytree {
namespace {

/// Borders of the view's height, denser towards grazing, where lobes change fastest.
std::vector<double> view_edges(int cells) {
  std::vector<double> edges;
  for (int i = 0; i <= cells; ++i) edges.push_back(std::pow(double(i) / cells, 1.5));
  return edges;
}

/// Borders in s = 1 - cos(theta) that are even in sqrt(theta), like the table's cells.
std::vector<double> half_edges(int cells) {
  std::vector<double> edges;
  for (int i = 0; i <= cells; ++i) {
    const double t = double(i) / cells, sine = std::sin(0.25 * M_PI * t * t);
    edges.push_back(2.0 * sine * sine);
  }
  edges.back() = 1.0;
  return edges;
}

/// What is to be sampled: luminance of the BRDF times cosine, per unit of the tree's free
/// dimensions.
float importance(const BrdfTableView& table, Vec3 o, const NdPoint& point, bool mirrored) {
  const Vec3 h = brdf_half_vector(table, o, point, mirrored);
  const float cos_half = dot(o, h);
  if (cos_half <= 0.0f) return 0.0f;
  const Vec3 i = normalize(h * (2.0f * cos_half) - o);
  if (i.z <= 0.0f) return 0.0f;
  return luminance(brdf_table_value(table, o, i)) * i.z *
         brdf_jacobian(stretch_half(table, h), cos_half);
}

/// Means over the grid's cells by a few points of an additive recurrence in each (M. Roberts, "The
/// Unreasonable Effectiveness of Quasirandom Sequences", 2018).
NdGrid importance_grid(const BrdfTableView& table) {
  const bool isotropic = table.half_phi == 1;
  NdGrid grid;
  if (isotropic) {
    grid.edges = {view_edges(32), half_edges(64), uniform_edges(32)};
  } else {
    grid.edges = {view_edges(12), uniform_edges(24), half_edges(64), uniform_edges(48)};
  }
  const int points = isotropic ? 8 : 4, dimensions = grid.dimensions();
  const double golden = isotropic ? 1.22074408460575947536 : 1.16730397826141868426;
  size_t cells = 1;
  for (int a = 0; a < dimensions; ++a) cells *= size_t(grid.size(a));
  grid.values.resize(cells);
  int at[kNdMaxDimensions] = {0, 0, 0, 0};
  for (size_t cell = 0; cell < cells; ++cell) {
    double sum = 0;
    for (int k = 0; k < points; ++k) {
      NdPoint x = {};
      double step = 1.0;
      for (int a = 0; a < dimensions; ++a) {
        step /= golden;
        const double offset = 0.5 + step * k, f = offset - std::floor(offset);
        x.x[a] = float(grid.edges[size_t(a)][size_t(at[a])] + f * grid.width(a, at[a]));
      }
      const float z = fmaxf(x.x[0], 1e-5f), r = sqrtf(fmaxf(1.0f - z * z, 0.0f));
      Vec3 o = {r, 0.0f, z};
      NdPoint free = {{x.x[1], x.x[2], 0, 0}};
      if (!isotropic) {
        float sine, cosine;
        sky_sincos_turns(x.x[1], &sine, &cosine);
        o = {r * cosine, r * sine, z};
        free = {{x.x[2], x.x[3], 0, 0}};
      }
      sum += importance(table, o, free, k & 1);
    }
    const float mean = float(sum / points);
    grid.values[cell] = mean <= 3.4e38f ? mean : 0.0f;
    for (int a = dimensions - 1; a >= 0 && ++at[a] == grid.size(a); --a) at[a] = 0;
  }
  return grid;
}

NdKdTree build_tree(const BrdfTablePointer& table, BrdfKdTreeConfig config, double* seconds) {
  if (!table) throw std::invalid_argument("a BRDF table is needed");
  const Stopwatch watch;
  const bool isotropic = table->isotropic();
  if (config.tree.block_count == 0) config.tree.block_count = isotropic ? 2048 : 8192;
  if (config.tree.slice_count == 0) {
    config.tree.slice_count = std::min(isotropic ? 12 : 96, config.tree.block_count);
  }
  NdKdTree tree(importance_grid(table->view()), isotropic ? 1 : 2, config.tree);
  *seconds = watch.seconds();
  return tree;
}

}  // namespace

BrdfKdTree::BrdfKdTree(BrdfTablePointer table, BrdfKdTreeConfig config)
    : table_(std::move(table)), tree_(build_tree(table_, config, &build_seconds_)) {}

}  // namespace skytree
