// SPDX-License-Identifier: GPL-3.0-or-later
// The stages of kernel/stages.h over the pixels of one tile, rays traced in packets.
#pragma once

#include <stdint.h>

#include "kernel/scene_view.h"
#include "src/embree_api.h"

namespace skytree {

constexpr int kTilePixels = kTileSize * kTileSize;

/// What all tiles of one render share.
struct IntegratorJob {
  SceneView scene;
  RenderSettings settings;
  RTCScene tree;
  decltype(EmbreeApi::Intersect8) intersect8;
  decltype(EmbreeApi::Occluded8) occluded8;
  decltype(EmbreeApi::Intersect16) intersect16;
  decltype(EmbreeApi::Occluded16) occluded16;
  int width, height;
};

/// Result of one sample of every pixel of a tile, row by row of kTileSize.
struct TileSample {
  Vec3 radiance[kTilePixels];
  float alpha[kTilePixels];
};

/// A worker's memory, reused from tile to tile.
struct TileScratch;
TileScratch* new_tile_scratch();
void delete_tile_scratch(TileScratch* scratch);

/// One sample of the pixels of tile (x, y) that lie inside the film, or of its pilot paths
/// (kernel/pilot.h).
struct TileWork {
  int x, y;
  uint32_t sample;
  bool pilot;
};

/// Renders one sample of a tile. One call traces it as a whole: which rays share a packet, and with
/// it every rounding inside Embree, depends on nothing else. Returns the number of rays traced.
using RenderTile = uint64_t (*)(const IntegratorJob&, const TileWork&, TileScratch*, TileSample*);

/// The version for the instruction set of this processor.
RenderTile select_render_tile();

}  // namespace skytree
