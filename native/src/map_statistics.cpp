// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/map_statistics.h"

#include <algorithm>

namespace skytree {

MapStatistics::MapStatistics(const LatLongImage& image) : image_(image) { check_image(image); }

std::shared_ptr<const LuminancePlane> MapStatistics::luminance(ThreadTeam& team) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (!luminance_) luminance_ = read_luminance(image_, team, {});
  return luminance_;
}

size_t MapStatistics::nbytes() const {
  std::lock_guard<std::mutex> lock(mutex_);
  size_t bytes = luminance_ ? luminance_->nbytes() : 0;
  for (const auto& [kind, measured] : statistics_) bytes += measured ? measured->nbytes() : 0;
  for (const auto& [kind, growth] : growths_) {
    if (growth) bytes += growth->tree.nbytes() + growth->tilts.size() * sizeof(TiltMoments);
  }
  return bytes;
}

MapStatistics::Tree MapStatistics::tree(Statistics statistics, SplitCriterion criterion,
                                        int block_count, ThreadTeam& team,
                                        const BuildProgress& progress) {
  std::lock_guard<std::mutex> lock(mutex_);
  if (!luminance_) luminance_ = read_luminance(image_, team, progress);
  auto& measured = statistics_[statistics];
  if (!measured) measured = measure_statistics(luminance_, statistics, team, progress);
  auto& growth = growths_[{statistics, criterion}];
  if (!growth) growth = std::make_unique<Growth>(measured, criterion, team);
  Tree tree;
  tree.statistics = measured;
  try {
    tree.tree = growth->tree.tree(block_count, team, progress);
    if (statistics == Statistics::CELLS) measure_tilts(growth.get(), &tree, team);
  } catch (const BuildCancelled&) {
    throw;
  } catch (...) {
    growth.reset();  // stopped in the middle of a step
    throw;
  }
  return tree;
}

void MapStatistics::measure_tilts(Growth* growth, Tree* tree, ThreadTeam& team) const {
  const std::vector<BuildNode>& nodes = tree->tree.nodes;
  if (growth->tilts.size() < nodes.size()) {
    growth->tilts.resize(nodes.size());
    growth->has_tilt.resize(nodes.size());
  }
  std::vector<int32_t> wanted;
  for (size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].first_child < 0 && !growth->has_tilt[i]) wanted.push_back((int32_t)i);
  }
  // Neighbours one after the other, as they share pages of memory.
  std::sort(wanted.begin(), wanted.end(), [&](int32_t a, int32_t b) {
    constexpr int kBand = 64;  // rows
    const TexelRect &p = nodes[a].rect, &q = nodes[b].rect;
    const int band = p.lo[1] / kBand, other = q.lo[1] / kBand;
    return band != other ? band < other : p.lo[0] < q.lo[0];
  });
  team.run_chunks((int)wanted.size(), 64, [&](int, int first, int last) {
    for (int k = first; k < last; ++k) {
      const BuildNode& node = nodes[wanted[k]];
      growth->tilts[wanted[k]] = measure_tilt(*tree->statistics, node.rect, node.moments);
    }
  });
  for (int32_t i : wanted) growth->has_tilt[i] = true;
  tree->tilts.assign(growth->tilts.begin(), growth->tilts.begin() + (ptrdiff_t)nodes.size());
}

}  // namespace skytree
