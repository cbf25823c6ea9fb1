// SPDX-License-Identifier: GPL-3.0-or-later
// Environment sampling for many vertices at once. A walk down a tree stays one lane's business; all
// arithmetic before and after it is in loops that the compiler vectorises. What blocks of linear
// density need lies here as arrays; other samplers are called lane by lane. Same kernel functions
// and same bits as sample_environment and environment_pdf. Included by tile_lanes.h.
#pragma once

// The arrays of one loop are distinct members.
#define SKY_VECTOR_LOOP _Pragma("GCC ivdep")
// A loop is vectorised only if every call in it is inlined, which is more than the compiler would
// do by itself.
#define SKY_LANE_LOOP [[gnu::flatten, gnu::noinline]] static

namespace skytree {
namespace SKYTREE_ISA {

/// Length of a lane array: as many as a tile has pixels, and a cache line more, or equal places of
/// all arrays would fall into the same few sets of the cache.
constexpr int kBatch = kTilePixels + 16;

/// A block of the tree for each lane.
struct LaneBlocks {
  uint32_t columns[kBatch], tilts[kBatch];
  float h_start[kBatch], h_rise[kBatch];
  float origin_x[kBatch], origin_y[kBatch], scale_x[kBatch], scale_y[kBatch];

  LinearBlock get(int i) const {
    return {columns[i],
            tilts[i],
            h_start[i],
            h_rise[i],
            {origin_x[i], origin_y[i]},
            {scale_x[i], scale_y[i]}};
  }
  void set(int i, const LinearBlock& block) {
    columns[i] = block.columns;
    tilts[i] = block.tilts;
    h_start[i] = block.h_start;
    h_rise[i] = block.h_rise;
    origin_x[i] = block.warp_origin.x;
    origin_y[i] = block.warp_origin.y;
    scale_x[i] = block.warp_scale.x;
    scale_y[i] = block.warp_scale.y;
  }
};

/// Directions in the map's frame, their densities and map coordinates.
struct LaneLights {
  Vectors<kBatch> local;
  float pdf[kBatch];
  float u[kBatch], v[kBatch];
};

struct LaneSampling {
  LaneBlocks blocks;
  float u[kBatch];  // azimuth in the frame of the tree's cells
  int32_t azimuth[kBatch], elevation[kBatch], start[kBatch];
  int32_t block[kBatch];  // of linear density, that a direction lies in
};

/// Map coordinates of all directions.
SKY_LANE_LOOP void locate(int count, LaneLights* lights) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    const Vec2 uv = latlong_uv(lights->local.get(i));
    lights->u[i] = uv.x;
    lights->v[i] = uv.y;
  }
}

/// From blocks and the points (x, y) of the warp's unit square.
SKY_LANE_LOOP void place_in_blocks(float cell_width, int count, const float* x, const float* y,
                                   const LaneBlocks& blocks, LaneLights* lights) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    lights->local.set(i, sample_linear_block(blocks.get(i), cell_width, x[i], y[i]));
  }
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    const Vec3 direction = lights->local.get(i);
    const Vec2 uv = latlong_uv(direction);
    lights->u[i] = uv.x;
    lights->v[i] = uv.y;
    lights->pdf[i] =
        linear_block_pdf(blocks.get(i), cell_width, cell_azimuth(uv.x, cell_width), direction);
  }
}

/// sample_environment at points (x, y) of the unit square and numbers `choice`.
static void sample_environment_lanes(const EnvSamplerView& sampler, int count, const float* choice,
                                     const float* x, const float* y, LaneSampling* work,
                                     LaneLights* lights) {
  if (sampler.type == EnvSamplerType::KDTREE_LINEAR) {
    const KdTreeView& tree = sampler.kdtree;
    for (int i = 0; i < count; ++i) {
      work->start[i] = choose_block_by_warp(tree, x[i], y[i]);
    }
    for (int i = 0; i < count; ++i) {
      work->blocks.set(i, tree.linear_blocks[work->start[i]]);
    }
    place_in_blocks(tree.cell_width, count, x, y, work->blocks, lights);
    return;
  }
  for (int i = 0; i < count; ++i) {
    const DirectionSample sample = sample_environment(sampler, {choice[i], x[i], y[i]});
    lights->local.set(i, sample.direction);
    lights->pdf[i] = sample.pdf;
  }
  locate(count, lights);
}

SKY_LANE_LOOP void find_keys(const KdTreeView& tree, int count, const LaneLights& lights,
                             LaneSampling* work) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    const Vec3 direction = lights.local.get(i);
    const float u = cell_azimuth(lights.u[i], tree.cell_width);
    work->u[i] = u;
    work->azimuth[i] = azimuth_key(u);
    work->elevation[i] = elevation_key(direction);
    work->start[i] = start_cell(u, direction);
  }
}

SKY_LANE_LOOP void find_densities(float cell_width, int count, const LaneSampling& work,
                                  LaneLights* lights) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    lights->pdf[i] =
        linear_block_pdf(work.blocks.get(i), cell_width, work.u[i], lights->local.get(i));
  }
}

/// environment_pdf in the lights' directions, whose map coordinates are known.
static void environment_pdf_lanes(const EnvSamplerView& sampler, int count, LaneSampling* work,
                                  LaneLights* lights) {
  if (sampler.type == EnvSamplerType::KDTREE_LINEAR) {
    const KdTreeView& tree = sampler.kdtree;
    find_keys(tree, count, *lights, work);
    for (int i = 0; i < count; ++i) {
      const int32_t block =
          locate_from(tree, tree.start_grid[work->start[i]], work->azimuth[i], work->elevation[i]);
      work->block[i] = block;
      work->blocks.set(i, tree.linear_blocks[block]);
    }
    find_densities(tree.cell_width, count, *work, lights);
    return;
  }
  for (int i = 0; i < count; ++i) {
    lights->pdf[i] = environment_pdf(sampler, lights->local.get(i));
  }
}

/// warp_point of lane `i` after environment_pdf_lanes, which found its block.
SKY_HD Vec2 lane_warp_point(const EnvSamplerView& sampler, const LaneSampling& work,
                            const LaneLights& lights, int i) {
  const Vec3 direction = lights.local.get(i);
  if (sampler.type != EnvSamplerType::KDTREE_LINEAR) return warp_point(sampler, direction);
  return linear_block_point(work.blocks.get(i), sampler.kdtree.cell_width, work.u[i], direction);
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
