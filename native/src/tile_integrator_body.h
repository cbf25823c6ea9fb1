// SPDX-License-Identifier: GPL-3.0-or-later
// The body of tile_integrator.h, compiled once per instruction set: tile_integrator_*.cpp include
// it inside a namespace of their own. No STL here, and kernel functions are `static`: whatever the
// linker may merge between two such files could end up with instructions that the processor lacks.
#pragma once

#include <string.h>

namespace skytree {
namespace SKYTREE_ISA {

/// N vectors, each coordinate an array.
template <int N>
struct Vectors {
  float x[N], y[N], z[N];

  Vec3 get(int i) const { return {x[i], y[i], z[i]}; }
  void set(int i, Vec3 v) {
    x[i] = v.x;
    y[i] = v.y;
    z[i] = v.z;
  }
};

}  // namespace SKYTREE_ISA
}  // namespace skytree

#include "src/tile_lanes.h"
#include "src/tile_surfaces.h"

namespace skytree {
namespace SKYTREE_ISA {

struct CameraRays {
  Vectors<kBatch> origin, direction;
  float length[kBatch];
};

struct Batch {
  PathState paths[kTilePixels];
  int active[kTilePixels];  // paths that have a ray to trace
  Hit hits[Connections::kCapacity];
  int waiting[Connections::kCapacity];
  uint32_t seeds[kTilePixels], samples[kTilePixels];
  float random[2][kTilePixels];
  int film_x[kTilePixels], film_y[kTilePixels];
  CameraRays camera_rays;
  Connections connections;
  Lanes diffuse, glossy;
  LaneWork work;
};

/// Shades vertex number `vertex` at one hit, whose surface is known but for its uv: gives it a
/// place among the lanes, or shades it at once. Returns whether the path goes on from here already.
static bool shade_hit(const IntegratorJob& job, int vertex, int index, const Hit& hit,
                      Surface surface, Batch* batch) {
  const SceneView& scene = job.scene;
  PathState& path = batch->paths[index];
  const Vec3 view = -path.ray.direction;
  const InstanceView& instance = scene.instances[hit.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  surface.uv = surface_uv(mesh, hit);
  Shading shading;
  evaluate_material(scene.tables, scene.materials[surface.material], mesh, instance, hit, surface,
                    view, &shading);
  int diffuse, glossy;
  if (path.bounce <= job.settings.max_bounces && job.settings.candidates == 0 &&
      is_simple(shading, &diffuse, &glossy)) {
    path.radiance += path.throughput * shading.emission;
    const LightSamples lights = light_samples(job.settings, path.bounce, path.sample, shading);
    if (path.bounce == 0) path.light_rays = lights.count;
    uint32_t slot = kNoGuideSlot;  // of diffuse lanes: all together in shade_batch
    ProductMix products = {};
    if (glossy && lights.count > 0) {
      slot = vertex_guide_slot(scene, surface);
      products = vertex_products(scene, shading, view, path.bounce, slot);
    }
    append_lane(surface, shading, path, index, lights,
                looks_ahead(scene, path.bounce, path.control), slot, products,
                glossy ? &batch->glossy : &batch->diffuse);
    return false;
  }
  Connection connections[kMaxConnections];
  int made = 0;
  const bool goes_on =
      shade_surface(scene, job.settings, hit, surface, shading, vertex, &path, connections, &made);
  for (int k = 0; k < made; ++k) append(connections[k], index, &batch->connections);
  return goes_on;
}

/// Shades vertex number `vertex` of the batch's `count` active paths, whose hits are known. Returns
/// how many go on.
static int shade_batch(const IntegratorJob& job, int vertex, int count, Batch* batch) {
  const SceneView& scene = job.scene;
  batch->connections.count = batch->diffuse.count = batch->glossy.count = 0;
  LaneSurfaces surfaces;  // not in Batch, whose size must not depend on kLanes
  int alive = 0;
  for (int next = 0; next < count;) {
    int hits[kLanes], materials[kLanes], lanes = 0;
    for (; next < count && lanes < kLanes; ++next) {
      PathState& path = batch->paths[batch->active[next]];
      const Hit& hit = batch->hits[next];
      if (hit.instance < 0) {
        shade_miss(scene, job.settings, &path);
        continue;
      }
      const InstanceView& instance = scene.instances[hit.instance];
      materials[lanes] = surface_material(scene.meshes[instance.mesh], instance,
                                          scene.instance_materials, hit.triangle);
      if (materials[lanes] < 0) continue;  // a surface without material is black
      fetch_facet(scene, hit, -path.ray.direction, lanes, &surfaces);
      hits[lanes++] = next;
    }
    if (lanes == 0) break;
    const int last = hits[lanes - 1];
    for (int lane = lanes; lane < kLanes; ++lane) {
      fetch_facet(scene, batch->hits[last], -batch->paths[batch->active[last]].ray.direction, lane,
                  &surfaces);
    }
    shape_surfaces(&surfaces);
    for (int lane = 0; lane < lanes; ++lane) {
      const int index = batch->active[hits[lane]];
      Surface surface = surfaces.get(lane);
      surface.material = materials[lane];
      // `active` is written only where it has been read.
      if (shade_hit(job, vertex, index, batch->hits[hits[lane]], surface, batch)) {
        batch->active[alive++] = index;
      }
    }
  }
  batch->glossy.products.pad(batch->glossy.count);
  if (scene.guide.cuts) find_guide_slots(scene.guide, &batch->diffuse);
  alive = shade_lanes<false>(scene, job.settings, batch->diffuse, vertex, &batch->work,
                             batch->paths, &batch->connections, batch->active, alive);
  return shade_lanes<true>(scene, job.settings, batch->glossy, vertex, &batch->work, batch->paths,
                           &batch->connections, batch->active, alive);
}

/// What the connections bring that nothing is in the way of, to their paths in their order.
static void add_connections(const SceneView& scene, const Connections& connections,
                            TexelLookups* lookups, PathState* paths) {
  int i = 0;
  while (i < connections.count) {
    const int first = i;
    lookups->count = 0;
    for (; i < connections.count && lookups->count < kBatch; ++i) {
      if (connections.occluded[i] || connections.map_u[i] < 0.0f) continue;
      lookups->append(i, connections.map_u[i], connections.map_v[i]);
    }
    look_up(scene.environment.image, lookups);
    int next = 0;
    for (int k = first; k < i; ++k) {
      if (connections.occluded[k]) continue;
      Vec3 radiance = connections.weight.get(k);
      if (next < lookups->count && lookups->lane[next] == k) {
        radiance *= lookups->radiance.get(next++);
      }
      PathState& path = paths[connections.path[k]];
      path.radiance += radiance;
      path.light_difference += radiance * connections.half[k];
    }
  }
}

SKY_LANE_LOOP void draw_camera_rays(const SceneView& scene, const RenderSettings& settings,
                                    const int* film_x, const int* film_y,
                                    const float (*random)[kTilePixels], int count,
                                    CameraRays* rays) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    const Ray ray =
        sample_camera_ray(scene, settings, film_x[i], film_y[i], {random[0][i], random[1][i]});
    rays->origin.set(i, ray.origin);
    rays->direction.set(i, ray.direction);
    rays->length[i] = ray.t_max;
  }
}

/// Starts the paths of `work` and finds what their rays hit.
static void start_paths(const IntegratorJob& job, const TileWork& work, Batch* batch) {
  const int count = work.count;
  for (int i = 0; i < count; ++i) {
    const uint32_t pixel = work.paths[i].pixel;
    batch->film_x[i] = work.x * kTileSize + static_cast<int>(pixel % kTileSize);
    batch->film_y[i] = work.y * kTileSize + static_cast<int>(pixel / kTileSize);
    batch->seeds[i] =
        pixel_seed(job.settings.seed, batch->film_x[i], batch->film_y[i], job.settings.blue_noise);
    batch->samples[i] = work.paths[i].sample;
    batch->active[i] = i;
  }
  draw_pairs(job.settings.point_count, batch->seeds, batch->samples, count, kPairFilter,
             batch->random[0], batch->random[1]);
  CameraRays& rays = batch->camera_rays;
  draw_camera_rays(job.scene, job.settings, batch->film_x, batch->film_y, batch->random, count,
                   &rays);
  const float control = control_of_pixel(job.settings, work.x * kTileSize, work.y * kTileSize);
  for (int i = 0; i < count; ++i) {
    start_path({rays.origin.get(i), 0.0f, rays.direction.get(i), rays.length[i]}, batch->seeds[i],
               batch->samples[i], control, &batch->paths[i]);
  }
  const auto &o = rays.origin, &d = rays.direction;
  trace_closest(job, count, true, batch->hits, [&](RayPacket* packet, int* valid, int first) {
    copy_packet(packet, valid, first, count, o.x, o.y, o.z, d.x, d.y, d.z);
    for (int lane = 0; lane < kLanes; ++lane) {
      packet->tfar[lane] = rays.length[first + lane < count ? first + lane : first];
    }
  });
}

static uint64_t render_tile(const IntegratorJob& job, const TileWork& work, TileScratch* scratch,
                            TileSample* out) {
  Batch& batch = *reinterpret_cast<Batch*>(scratch);
  int count = work.count;
  uint64_t rays = 0;
  out->later_rays = 0;
  start_paths(job, work, &batch);
  // A path ends by its own rules; the bound only keeps an error in them from hanging a thread.
  const int max_vertices = job.settings.max_bounces + kMaxTransparentBounces + 2;
  for (int vertex = 0; count > 0 && vertex < max_vertices; ++vertex) {
    if (vertex > 0) {
      trace_closest(job, count, false, batch.hits, [&](RayPacket* packet, int* valid, int first) {
        fill_packet(packet, valid, first, count,
                    [&](int i) -> const Ray& { return batch.paths[batch.active[i]].ray; });
      });
    }
    uint64_t traced = uint64_t(count);
    count = shade_batch(job, vertex, count, &batch);
    Connections& connections = batch.connections;
    if (job.scene.has_transparency) {
      traced += trace_through(job, &connections, batch.hits, batch.waiting);
    } else {
      trace_any(job, &connections);
      traced += uint64_t(connections.count);
    }
    rays += traced;
    if (vertex > 0) out->later_rays += traced;
    if (job.scene.guide.counters) {
      for (int i = 0; i < connections.count; ++i) {
        guide_commit(job.scene.guide, connections.guide_record[i], !connections.occluded[i]);
      }
    }
    add_connections(job.scene, connections, &batch.work.lookups, batch.paths);
  }
  for (int i = 0; i < work.count; ++i) {
    out->radiance[i] = batch.paths[i].radiance;
    out->alpha[i] = batch.paths[i].alpha;
    out->light_rays[i] = batch.paths[i].light_rays;
    out->light_difference[i] = batch.paths[i].light_difference;
  }
  return rays;
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
