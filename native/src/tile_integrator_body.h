// SPDX-License-Identifier: GPL-3.0-or-later
// The body of tile_integrator.h, compiled once per instruction set: tile_integrator_*.cpp include
// it inside a namespace of their own. No STL here, and kernel functions are `static`: whatever the
// linker may merge between two such files could end up with instructions that the processor lacks.
#pragma once

namespace skytree {
namespace SKYTREE_ISA {

/// Fills a packet from ray_at(first), ...; lanes beyond count repeat the first and are switched
/// off.
template <class RayAt>
static void fill_packet(RTCRay8* packet, int* valid, int first, int count, const RayAt& ray_at) {
  for (int lane = 0; lane < 8; ++lane) {
    const bool used = first + lane < count;
    const Ray& ray = ray_at(used ? first + lane : first);
    valid[lane] = used ? -1 : 0;
    packet->org_x[lane] = ray.origin.x;
    packet->org_y[lane] = ray.origin.y;
    packet->org_z[lane] = ray.origin.z;
    packet->dir_x[lane] = ray.direction.x;
    packet->dir_y[lane] = ray.direction.y;
    packet->dir_z[lane] = ray.direction.z;
    packet->tnear[lane] = ray.t_min;
    packet->tfar[lane] = ray.t_max;
    packet->time[lane] = 0.0f;
    packet->mask[lane] = ~0u;
    packet->id[lane] = 0;
    packet->flags[lane] = 0;
  }
}

/// hits[i] for ray_at(i), i < count.
template <class RayAt>
static void trace_closest(const IntegratorJob& job, int count, bool coherent, Hit* hits,
                          const RayAt& ray_at) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(32) int valid[8];
  RTCRayHit8 packet;
  for (int first = 0; first < count; first += 8) {
    fill_packet(&packet.ray, valid, first, count, ray_at);
    for (int lane = 0; lane < 8; ++lane) packet.hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
    job.intersect8(valid, job.tree, &context, &packet);
    for (int lane = 0; lane < 8 && first + lane < count; ++lane) {
      const bool hit = packet.hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID;
      hits[first + lane] = {hit ? static_cast<int32_t>(packet.hit.instID[0][lane]) : -1,
                            static_cast<int32_t>(packet.hit.primID[lane]), packet.hit.u[lane],
                            packet.hit.v[lane], packet.ray.tfar[lane]};
    }
  }
}

/// Whether anything is in the way of connections[i].
static void trace_any(const IntegratorJob& job, const Connection* connections, int count,
                      bool* occluded) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  alignas(32) int valid[8];
  RTCRay8 packet;
  auto ray_at = [&](int i) -> const Ray& { return connections[i].ray; };
  for (int first = 0; first < count; first += 8) {
    fill_packet(&packet, valid, first, count, ray_at);
    job.occluded8(valid, job.tree, &context, &packet);
    for (int lane = 0; lane < 8 && first + lane < count; ++lane) {
      occluded[first + lane] = packet.tfar[lane] < 0.0f;
    }
  }
}

struct Batch {
  PathState paths[kTilePixels];
  int active[kTilePixels];  // paths that have a ray to trace
  Hit hits[2 * kTilePixels];
  uint32_t seeds[kTilePixels];  // of the active paths, in their order
  VertexRandom random[kTilePixels];
  Connection connections[2 * kTilePixels];
  int connection_path[2 * kTilePixels];
  bool occluded[2 * kTilePixels];
  int waiting[2 * kTilePixels];  // connections that are still on their way through transparency
};

/// trace_any where surfaces may be transparent: surface after surface, each dims the connection.
/// Returns the number of rays.
static uint64_t trace_through(const IntegratorJob& job, Batch* batch, int count) {
  uint64_t rays = 0;
  int waiting = count;
  for (int i = 0; i < count; ++i) {
    batch->occluded[i] = true;
    batch->waiting[i] = i;
  }
  for (int depth = 0; waiting > 0 && depth <= kMaxTransparentBounces; ++depth) {
    trace_closest(job, waiting, false, batch->hits,
                  [&](int i) -> const Ray& { return batch->connections[batch->waiting[i]].ray; });
    rays += waiting;
    int left = 0;
    for (int i = 0; i < waiting; ++i) {
      const int connection = batch->waiting[i];
      if (batch->hits[i].instance < 0) {
        batch->occluded[connection] = false;
      } else if (pass_through(job.scene, batch->hits[i], &batch->connections[connection])) {
        batch->waiting[left++] = connection;
      }
    }
    waiting = left;
  }
  return rays;
}

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
    trace_closest(job, count, coherent, batch.hits,
                  [&](int i) -> const Ray& { return batch.paths[batch.active[i]].ray; });
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
    if (job.scene.has_transparency) {
      rays += trace_through(job, &batch, connection_count);
    } else {
      trace_any(job, batch.connections, connection_count, batch.occluded);
      rays += connection_count;
    }
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
