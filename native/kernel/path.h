// SPDX-License-Identifier: GPL-3.0-or-later
// One whole path in one function: the stages of stages.h with kernel/bvh.h between them, for
// devices that give every pixel a thread. A host that traces packets runs the same stages over
// arrays instead (src/tile_integrator_body.h); order and random numbers are the same, so both
// compute the same sample but for the tracer's rounding.
#pragma once

#include "kernel/bvh.h"
#include "kernel/pilot.h"

namespace skytree {

struct PathResult {
  Vec3 radiance;
  float alpha;
  uint32_t rays;
};

/// Follows a connection, dimmed by transparent surfaces; whether any of it reaches the environment.
SKY_HD bool trace_connection(const SceneView& scene, const TracerView& tracer,
                             Connection* connection, uint32_t* rays) {
  for (int depth = 0; depth <= kMaxTransparentBounces; ++depth) {
    ++*rays;
    const Hit hit = trace_ray(tracer, scene.instances, connection->ray, !scene.has_transparency);
    if (hit.instance < 0) return true;
    if (!scene.has_transparency || !pass_through(scene, hit, connection)) return false;
  }
  return false;
}

/// Starts sample `sample` of pixel (x,y), absolute film coordinates.
SKY_HD void begin_path(const SceneView& scene, const RenderSettings& settings, int x, int y,
                       uint32_t sample, PathState* path) {
  const uint32_t seed = pixel_seed(settings.seed, x, y, settings.blue_noise);
  const Ray ray = sample_camera_ray(scene, settings, x, y,
                                    sample_pair(settings.point_count, seed, sample, kPairFilter));
  start_path(ray, seed, sample, control_of_pixel(settings, x, y), path);
}

/// From one vertex to the next: traces, shades, traces the connections. False when the path ends.
SKY_HD bool advance_path(const SceneView& scene, const TracerView& tracer,
                         const RenderSettings& settings, int vertex, PathState* path,
                         uint32_t* rays) {
  const Hit hit = trace_ray(tracer, scene.instances, path->ray, false);
  Connection connections[kMaxConnections];
  int count = 0;
  const bool alive = shade(scene, settings, hit, vertex, path, connections, &count);
  for (int i = 0; i < count; ++i) {
    if (trace_connection(scene, tracer, &connections[i], rays)) {
      path->radiance += connection_radiance(scene, connections[i]);
    }
  }
  ++*rays;
  // A path ends by its own rules; the bound only keeps an error in them from hanging a device.
  return alive && vertex + 1 < settings.max_bounces + kMaxTransparentBounces + 2;
}

/// The whole of sample `sample` of pixel (x,y).
SKY_HD PathResult trace_path(const SceneView& scene, const TracerView& tracer,
                             const RenderSettings& settings, int x, int y, uint32_t sample) {
  PathState path;
  begin_path(scene, settings, x, y, sample, &path);
  uint32_t rays = 0;
  int vertex = 0;
  while (advance_path(scene, tracer, settings, vertex, &path, &rays)) ++vertex;
  return {path.radiance, path.alpha, rays};
}

/// Factor on the control variate of tile (tile_x, tile_y) of a film of width x height pixels.
SKY_HD float pilot_tile(const SceneView& scene, const TracerView& tracer,
                        const RenderSettings& settings, int tile_x, int tile_y) {
  const RenderSettings without = pilot_settings(settings, 0.0f);
  const RenderSettings with = pilot_settings(settings, 1.0f);
  PilotSums sums = {0.0f, 0.0f};
  for (int i = 0; i < kPilotPaths; ++i) {
    const int x = tile_x * kTileSize + pilot_x(i), y = tile_y * kTileSize + pilot_y(i);
    if (x >= scene.camera.width || y >= scene.camera.height) continue;
    add_pilot(trace_path(scene, tracer, without, x, y, 0).radiance,
              trace_path(scene, tracer, with, x, y, 0).radiance, &sums);
  }
  return control_factor(sums);
}

/// Sums of a pixel's samples, as the host's film keeps them: double, because float sums drift after
/// some thousand samples.
struct FilmPixel {
  double radiance[3];
  double alpha;
};

struct PassCounters {
  unsigned long long rays;
  unsigned long long rejected;  // samples that were not finite
};

/// Returns false for a sample that is not finite; it counts as black.
SKY_HD bool add_to_film(const PathResult& result, FilmPixel* pixel) {
  pixel->alpha += result.alpha;
  const float sum = result.radiance.x + result.radiance.y + result.radiance.z;
  if (!(fabsf(sum) < INFINITY)) return false;
  pixel->radiance[0] += result.radiance.x;
  pixel->radiance[1] += result.radiance.y;
  pixel->radiance[2] += result.radiance.z;
  return true;
}

/// Four floats of an image.
struct alignas(16) Rgba {
  float r, g, b, a;
};

/// A pixel's mean, `scale` being 1 over the number of its samples.
SKY_HD Rgba film_mean(const double* radiance, double alpha, double scale) {
  return {static_cast<float>(radiance[0] * scale), static_cast<float>(radiance[1] * scale),
          static_cast<float>(radiance[2] * scale), static_cast<float>(alpha * scale)};
}

}  // namespace skytree
