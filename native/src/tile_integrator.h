// SPDX-License-Identifier: GPL-3.0-or-later
// The stages of kernel/stages.h over the pixels of one tile, rays traced in packets.
#pragma once

#include <stdint.h>

#include "kernel/scene_view.h"
#include "src/embree_api.h"

namespace skytree {

constexpr int kTileSize = 16;
constexpr int kTilePixels = kTileSize * kTileSize;

/// What all tiles of one render share.
struct IntegratorJob {
  SceneView scene;
  RenderSettings settings;
  RTCScene tree;
  decltype(EmbreeApi::Intersect8) intersect8;
  decltype(EmbreeApi::Occluded8) occluded8;
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

/// Renders sample `sample` of the pixels of tile (tile_x, tile_y) that lie inside the film. Tiles
/// lie on a grid fixed to the film's lower left corner, and one call traces one sample of a whole
/// tile: which rays share a packet, and with it every rounding inside Embree, depends on nothing
/// else. Returns the number of rays traced.
using RenderTile = uint64_t (*)(const IntegratorJob&, int tile_x, int tile_y, uint32_t sample,
                                TileScratch*, TileSample*);

/// The version for the instruction set of this processor.
RenderTile select_render_tile();

}  // namespace skytree
