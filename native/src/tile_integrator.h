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

/// One sample of one pixel, which is y * kTileSize + x inside its tile.
struct TilePath {
  uint32_t pixel, sample;
};

/// Paths of tile (x, y), at most kTilePixels, all of pixels inside the film.
struct TileWork {
  int x, y;
  const TilePath* paths;
  int count;
};

/// What each path of a TileWork brought.
struct TileSample {
  Vec3 radiance[kTilePixels];
  float alpha[kTilePixels];
  int light_rays[kTilePixels];  // as in PathState
  Vec3 light_difference[kTilePixels];
  uint64_t later_rays;  // of all paths, from their second vertices on
};

/// The i-th pixel in an order in which 2 x 4 neighbours follow each other: the more alike the rays
/// of a packet, the cheaper it is.
inline int tile_order(int i) {
  const int block = i >> 3, lane = i & 7;
  const int x = ((block & 3) << 2) | (lane & 3);
  const int y = ((block >> 2) << 1) | (lane >> 2);
  return y * kTileSize + x;
}

/// A worker's memory, reused from tile to tile.
struct TileScratch;
TileScratch* new_tile_scratch();
void delete_tile_scratch(TileScratch* scratch);

/// Renders paths of a tile. Which rays share a packet, and with it every rounding inside Embree,
/// depends on the work alone. Returns the number of rays traced.
using RenderTile = uint64_t (*)(const IntegratorJob&, const TileWork&, TileScratch*, TileSample*);

/// The version for the instruction set of this processor.
RenderTile select_render_tile();

}  // namespace skytree
