// SPDX-License-Identifier: GPL-3.0-or-later
// The body of tile_integrator.h, compiled once per instruction set: tile_integrator_*.cpp include
// it inside a namespace of their own. No STL here, and kernel functions are `static`: whatever the
// linker may merge between two such files could end up with instructions that the processor lacks.
#pragma once

namespace skytree {
namespace SKYTREE_ISA {

/// What all packets have in common.
static void clear_packet(RTCRay8* packet) {
  for (int lane = 0; lane < 8; ++lane) {
    packet->time[lane] = 0.0f;
    packet->mask[lane] = ~0u;
    packet->id[lane] = 0;
    packet->flags[lane] = 0;
  }
}

/// Rays ray_at(first), ... into a packet; lanes beyond count repeat the first and are switched off.
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
  clear_packet(&packet.ray);
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
  clear_packet(&packet);
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
  float random[2 * kPairsPerBounce][kTilePixels];
  Connection connections[2 * kTilePixels];
  int connection_path[2 * kTilePixels];
  bool occluded[2 * kTilePixels];
  int waiting[2 * kTilePixels];  // connections: on their way through transparency, then arrived
  float direction_x[2 * kTilePixels];  // of the arrived ones
  float direction_y[2 * kTilePixels];
  float direction_z[2 * kTilePixels];
  float u[2 * kTilePixels];  // where in the map they ended
  float v[2 * kTilePixels];
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

/// Asks for the texels that a look-up at uv will read.
static void fetch_ahead(const LatLongImage& image, Vec2 uv) {
  const int x = static_cast<int>(maxf(uv.x * static_cast<float>(image.width) - 0.5f, 0.0f));
  const int y = static_cast<int>(clampf(uv.y * static_cast<float>(image.height) - 0.5f, 0.0f,
                                        static_cast<float>(image.height - 1)));
  const float* above = image.texels + 3 * (static_cast<int64_t>(y) * image.width + x);
  __builtin_prefetch(above);
  __builtin_prefetch(above + 5);
  if (y + 1 >= image.height) return;
  __builtin_prefetch(above + 3 * static_cast<int64_t>(image.width));
  __builtin_prefetch(above + 3 * static_cast<int64_t>(image.width) + 5);
}

/// connection_uv for a batch; the first loop vectorises.
static void locate_in_map(const EnvironmentView& environment, Batch* batch, int count) {
  for (int i = 0; i < count; ++i) {
    const Vec2 uv = environment_uv(
        environment, {batch->direction_x[i], batch->direction_y[i], batch->direction_z[i]});
    batch->u[i] = uv.x;
    batch->v[i] = uv.y;
  }
  for (int i = 0; i < count; ++i) fetch_ahead(environment.image, {batch->u[i], batch->v[i]});
}

/// 2 x 4 pixels are neighbours in a packet: the more alike its rays, the cheaper it is.
static int tile_order(int i) {
  const int block = i >> 3, lane = i & 7;
  const int x = ((block & 3) << 2) | (lane & 3);
  const int y = ((block >> 2) << 1) | (lane >> 2);
  return y * kTileSize + x;
}

/// Loops of their own, which the compiler vectorises. All seeds are of one kind.
static void draw_pairs(const uint32_t* seeds, int count, uint32_t sample, uint32_t pair,
                       float* __restrict x, float* __restrict y) {
  if (count > 0 && has_blue_noise(seeds[0])) {
    for (int i = 0; i < count; ++i) {
      const Vec2 u = blue_noise_pair(seeds[i], sample, pair);
      x[i] = u.x;
      y[i] = u.y;
    }
    return;
  }
  for (int i = 0; i < count; ++i) {
    const Vec2 u = hashed_pair(seeds[i], sample, pair);
    x[i] = u.x;
    y[i] = u.y;
  }
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
    batch.seeds[count] = pixel_seed(job.settings.seed, x, y, job.settings.blue_noise);
    batch.active[count++] = pixel;
  }
  draw_pairs(batch.seeds, count, sample, kPairFilter, batch.random[0], batch.random[1]);
  for (int i = 0; i < count; ++i) {
    const int pixel = batch.active[i];
    start_path(job.scene, job.settings, tile_x * kTileSize + pixel % kTileSize,
               tile_y * kTileSize + pixel / kTileSize, batch.seeds[i], sample,
               {batch.random[0][i], batch.random[1][i]}, &batch.paths[pixel]);
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
    for (uint32_t pair = 0; pair < kPairsPerBounce; ++pair) {
      draw_pairs(batch.seeds, count, sample, first_pair(vertex) + pair, batch.random[2 * pair],
                 batch.random[2 * pair + 1]);
    }
    int connection_count = 0, alive = 0;
    for (int i = 0; i < count; ++i) {
      const int path = batch.active[i];
      const VertexRandom random = {{batch.random[0][i], batch.random[1][i]},
                                   {batch.random[2][i], batch.random[3][i]},
                                   {batch.random[4][i], batch.random[5][i]}};
      int made = 0;
      const bool go_on = shade(job.scene, job.settings, batch.hits[i], random, &batch.paths[path],
                               batch.connections + connection_count, &made);
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
    int arrived = 0;
    for (int i = 0; i < connection_count; ++i) {
      batch.waiting[arrived] = i;
      arrived += !batch.occluded[i];
    }
    for (int k = 0; k < arrived; ++k) {
      const Vec3 direction = batch.connections[batch.waiting[k]].ray.direction;
      batch.direction_x[k] = direction.x;
      batch.direction_y[k] = direction.y;
      batch.direction_z[k] = direction.z;
    }
    locate_in_map(job.scene.environment, &batch, arrived);
    for (int k = 0; k < arrived; ++k) {
      const int i = batch.waiting[k];
      batch.paths[batch.connection_path[i]].radiance +=
          connection_radiance(job.scene, batch.connections[i], {batch.u[k], batch.v[k]});
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
