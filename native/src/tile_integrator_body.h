// SPDX-License-Identifier: GPL-3.0-or-later
// The body of tile_integrator.h, compiled once per instruction set: tile_integrator_*.cpp include
// it inside a namespace of their own. No STL here, and kernel functions are `static`: whatever the
// linker may merge between two such files could end up with instructions that the processor lacks.
#pragma once

namespace skytree {
namespace SKYTREE_ISA {

/// Packets of 8: gathers rays, traces, scatters.
static void trace_closest(const IntegratorJob& job, const PathState* paths, const int* active,
                          int count, bool coherent, Hit* hits) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(32) int valid[8];
  RTCRayHit8 packet;
  for (int first = 0; first < count; first += 8) {
    for (int lane = 0; lane < 8; ++lane) {
      const bool used = first + lane < count;
      valid[lane] = used ? -1 : 0;
      const Ray& ray = paths[active[used ? first + lane : first]].ray;
      packet.ray.org_x[lane] = ray.origin.x;
      packet.ray.org_y[lane] = ray.origin.y;
      packet.ray.org_z[lane] = ray.origin.z;
      packet.ray.dir_x[lane] = ray.direction.x;
      packet.ray.dir_y[lane] = ray.direction.y;
      packet.ray.dir_z[lane] = ray.direction.z;
      packet.ray.tnear[lane] = ray.t_min;
      packet.ray.tfar[lane] = ray.t_max;
      packet.ray.time[lane] = 0.0f;
      packet.ray.mask[lane] = ~0u;
      packet.ray.id[lane] = 0;
      packet.ray.flags[lane] = 0;
      packet.hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
      packet.hit.instID[0][lane] = RTC_INVALID_GEOMETRY_ID;
    }
    job.intersect8(valid, job.tree, &context, &packet);
    for (int lane = 0; lane < 8 && first + lane < count; ++lane) {
      const bool hit = packet.hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID;
      hits[first + lane] = {hit ? static_cast<int32_t>(packet.hit.instID[0][lane]) : -1,
                            static_cast<int32_t>(packet.hit.primID[lane]), packet.hit.u[lane],
                            packet.hit.v[lane], packet.ray.tfar[lane]};
    }
  }
}

static void trace_any(const IntegratorJob& job, const Connection* connections, int count,
                      bool* occluded) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  alignas(32) int valid[8];
  RTCRay8 packet;
  for (int first = 0; first < count; first += 8) {
    for (int lane = 0; lane < 8; ++lane) {
      const bool used = first + lane < count;
      valid[lane] = used ? -1 : 0;
      const Ray& ray = connections[used ? first + lane : first].ray;
      packet.org_x[lane] = ray.origin.x;
      packet.org_y[lane] = ray.origin.y;
      packet.org_z[lane] = ray.origin.z;
      packet.dir_x[lane] = ray.direction.x;
      packet.dir_y[lane] = ray.direction.y;
      packet.dir_z[lane] = ray.direction.z;
      packet.tnear[lane] = ray.t_min;
      packet.tfar[lane] = ray.t_max;
      packet.time[lane] = 0.0f;
      packet.mask[lane] = ~0u;
      packet.id[lane] = 0;
      packet.flags[lane] = 0;
    }
    job.occluded8(valid, job.tree, &context, &packet);
    for (int lane = 0; lane < 8 && first + lane < count; ++lane) {
      occluded[first + lane] = packet.tfar[lane] < 0.0f;
    }
  }
}

struct Batch {
  PathState paths[kTilePixels];
  int active[kTilePixels];  // paths that have a ray to trace
  Hit hits[kTilePixels];
  uint32_t seeds[kTilePixels];  // of the active paths, in their order
  VertexRandom random[kTilePixels];
  Connection connections[2 * kTilePixels];
  int connection_path[2 * kTilePixels];
  bool occluded[2 * kTilePixels];
};

/// 2 x 4 pixels are neighbours in a packet: the more alike its rays, the cheaper it is.
static int tile_order(int i) {
  const int block = i >> 3, lane = i & 7;
  const int x = ((block & 3) << 2) | (lane & 3);
  const int y = ((block >> 2) << 1) | (lane >> 2);
  return y * kTileSize + x;
}

static uint64_t render_tile(const IntegratorJob& job, int tile_x, int tile_y, uint32_t sample,
                            TileScratch* scratch, TileSample* out) {
  Batch& batch = *reinterpret_cast<Batch*>(scratch);
  int count = 0;
  uint64_t rays = 0;
  for (int i = 0; i < kTilePixels; ++i) {
    const int pixel = tile_order(i);
    const int x = tile_x * kTileSize + pixel % kTileSize;
    const int y = tile_y * kTileSize + pixel / kTileSize;
    if (x >= job.width || y >= job.height) continue;
    const uint32_t seed = pixel_seed(job.settings.seed, x, y);
    start_path(job.scene, job.settings, x, y, seed, sample, random_pair(seed, sample, kPairFilter),
               &batch.paths[pixel]);
    batch.active[count++] = pixel;
  }
  bool coherent = true;
  // A path ends by its own rules; the bound only keeps an error in them from hanging a thread.
  const int max_vertices = job.settings.max_bounces + kMaxTransparentBounces + 2;
  for (int vertex = 0; count > 0 && vertex < max_vertices; ++vertex) {
    trace_closest(job, batch.paths, batch.active, count, coherent, batch.hits);
    rays += count;
    coherent = false;
    for (int i = 0; i < count; ++i) batch.seeds[i] = batch.paths[batch.active[i]].seed;
    for (int i = 0; i < count; ++i) batch.random[i] = vertex_random(batch.seeds[i], sample, vertex);
    int connection_count = 0, alive = 0;
    for (int i = 0; i < count; ++i) {
      const int path = batch.active[i];
      int made = 0;
      const bool go_on = shade(job.scene, job.settings, batch.hits[i], batch.random[i],
                               &batch.paths[path], batch.connections + connection_count, &made);
      for (int k = 0; k < made; ++k) batch.connection_path[connection_count++] = path;
      if (go_on) batch.active[alive++] = path;
    }
    count = alive;
    trace_any(job, batch.connections, connection_count, batch.occluded);
    rays += connection_count;
    for (int i = 0; i < connection_count; ++i) {
      if (batch.occluded[i]) continue;
      batch.paths[batch.connection_path[i]].radiance +=
          connection_radiance(job.scene, batch.connections[i]);
    }
  }
  for (int i = 0; i < kTilePixels; ++i) {
    out->radiance[i] = batch.paths[i].radiance;
    out->alpha[i] = batch.paths[i].alpha;
  }
  return rays;
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
