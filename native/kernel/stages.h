// SPDX-License-Identifier: GPL-3.0-or-later
// The path tracer, one function per stage. A host loop or a GPU kernel runs each over a batch of
// paths:
//   start_path -> [trace] -> shade -> [trace connections] -> connection_radiance -> ... -> film
// Tracing lies between the stages and is not part of them.
//
// Next-event estimation on the environment with multiple importance sampling by the balance
// heuristic: E. Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997,
// chapter 9.
#pragma once

#include "kernel/resampling.h"

namespace skytree {

struct PathState {
  Ray ray;
  Vec3 throughput;
  Vec3 radiance;
  float alpha;
  float bsdf_pdf;  // with which `ray` was drawn; 0 for a camera ray
  uint32_t seed;   // of the pixel
  uint32_t sample;
  int bounce;
  int transparent_bounces;
};

/// A ray to the environment that counts only if nothing is in its way.
struct Connection {
  Ray ray;
  Vec3 weight;     // throughput times BSDF and cosine
  float pdf;       // the part of the MIS denominator that is known before tracing
  bool from_bsdf;  // the sampler's pdf is still to be added
};

/// Pairs of random numbers: one for the camera, then kPairsPerBounce for each vertex.
enum RandomPair : uint32_t { kPairFilter = 0, kPairLight = 1, kPairsPerBounce = 3 };

/// The random numbers of one vertex. A batch draws them in a loop of their own, which vectorises.
struct VertexRandom {
  Vec2 light, bsdf, choice;
};

constexpr int kMaxTransparentBounces = 64;
constexpr int kFirstRouletteBounce = 4;

/// Its pairs follow in the order of VertexRandom.
SKY_HD uint32_t first_pair(int vertex) {
  return kPairLight + kPairsPerBounce * static_cast<uint32_t>(vertex);
}

SKY_HD VertexRandom vertex_random(uint32_t seed, uint32_t sample, int vertex) {
  const uint32_t first = first_pair(vertex);
  return {random_pair(seed, sample, first), random_pair(seed, sample, first + 1),
          random_pair(seed, sample, first + 2)};
}

/// Stage 1: the camera ray of sample `sample` of pixel (x,y), `filter_u` its random pair
/// kPairFilter.
SKY_HD void start_path(const SceneView& scene, const RenderSettings& settings, int x, int y,
                       uint32_t seed, uint32_t sample, Vec2 filter_u, PathState* path) {
  const float film_x =
      static_cast<float>(x) + 0.5f + sample_filter(settings.filter_table, filter_u.x);
  const float film_y =
      static_cast<float>(y) + 0.5f + sample_filter(settings.filter_table, filter_u.y);
  path->ray = camera_ray(scene.camera, film_x, film_y);
  path->throughput = {1, 1, 1};
  path->radiance = {0, 0, 0};
  path->alpha = 1.0f;
  path->bsdf_pdf = 0.0f;
  path->seed = seed;
  path->sample = sample;
  path->bounce = 0;
  path->transparent_bounces = 0;
}

/// Radiance that an unoccluded connection brings; `uv` is environment_uv of its direction, apart so
/// that a batch can fetch its texels ahead: in a large map nearly every look-up waits for memory.
SKY_HD Vec3 connection_radiance(const SceneView& scene, const Connection& connection, Vec2 uv) {
  const EnvironmentView& environment = scene.environment;
  float pdf = connection.pdf;
  if (connection.from_bsdf) {
    pdf +=
        environment_pdf(environment.sampler, environment.world_to_env * connection.ray.direction);
  }
  return connection.weight * environment.color * sampled_radiance(environment, uv, pdf) *
         (1.0f / pdf);
}

/// A connection that met a surface, in scenes with transparency: what the surface lets through goes
/// on from there. False when that is nothing.
SKY_HD bool pass_through(const SceneView& scene, const Hit& hit, Connection* connection) {
  const Vec3 view = -connection->ray.direction;
  const InstanceView& instance = scene.instances[hit.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  const Surface surface = make_surface(mesh, instance, scene.instance_materials, hit, view);
  if (surface.material < 0) return false;
  connection->weight *= transparency(scene.tables, scene.materials[surface.material], surface.uv);
  connection->ray.origin = offset_origin(surface, connection->ray.direction);
  return max_component(connection->weight) > 0.0f;
}

/// A path whose ray left the scene.
SKY_HD void shade_miss(const SceneView& scene, const RenderSettings& settings, PathState* path) {
  const EnvironmentView& environment = scene.environment;
  if (path->bsdf_pdf == 0.0f) {
    if (settings.film_transparent) {
      path->alpha = 1.0f - mean_component(path->throughput);
    } else if (environment.visible) {
      path->radiance += path->throughput * environment_radiance(environment, path->ray.direction);
    }
    return;
  }
  if (!settings.bsdf_sampling) return;
  const Vec3 direction = environment.world_to_env * path->ray.direction;
  const float light_pdf =
      settings.light_sampling ? environment_pdf(environment.sampler, direction) : 0.0f;
  // The throughput was divided by bsdf_pdf when the ray was drawn.
  const float weight = path->bsdf_pdf / (path->bsdf_pdf + light_pdf);
  path->radiance += path->throughput * environment.color *
                    sampled_radiance(environment, latlong_uv(direction), path->bsdf_pdf) * weight;
}

/// Light sample: at most one connection, false if there is none.
SKY_HD bool sample_light(const SceneView& scene, const RenderSettings& settings,
                         const PathState& path, const Surface& surface, const Shading& shading,
                         const VertexRandom& random, Connection* connection) {
  const EnvironmentView& environment = scene.environment;
  if (settings.candidates > 0) {
    const uint32_t vertex = (uint32_t)(path.bounce + path.transparent_bounces);
    ResampledLight light = {};
    if (!resample_light(environment, surface, shading, -path.ray.direction, settings.candidates,
                        settings.bsdf_candidates, {random.choice.x, random.light.x, random.light.y},
                        {random.choice.y, random.bsdf.x, random.bsdf.y},
                        unit_float(hash_u32(path.seed + hash_u32(path.sample + hash_u32(vertex)))),
                        &light)) {
      return false;
    }
    connection->ray = {offset_origin(surface, light.direction), 0.0f, light.direction, INFINITY};
    connection->weight = path.throughput * light.f;
    connection->pdf = light.pdf;
    connection->from_bsdf = false;
    return true;
  }
  const DirectionSample light =
      sample_environment(environment.sampler, {random.choice.x, random.light.x, random.light.y});
  const Vec3 direction = transpose_mul(environment.world_to_env, light.direction);
  const BsdfValue bsdf = eval_bsdf(shading, surface, -path.ray.direction, direction);
  if (!(max_component(bsdf.f) > 0.0f) || !(light.pdf > 0.0f)) return false;
  connection->ray = {offset_origin(surface, direction), 0.0f, direction, INFINITY};
  connection->weight = path.throughput * bsdf.f;
  connection->pdf = light.pdf + (settings.bsdf_sampling ? bsdf.pdf : 0.0f);
  connection->from_bsdf = false;
  return true;
}

/// Stage 3: shades the vertex that `hit` describes. Writes up to two connections and their number,
/// and the next ray into the path; returns whether the path goes on.
SKY_HD bool shade(const SceneView& scene, const RenderSettings& settings, const Hit& hit,
                  const VertexRandom& random, PathState* path, Connection* connections,
                  int* connection_count) {
  *connection_count = 0;
  if (hit.instance < 0) {
    shade_miss(scene, settings, path);
    return false;
  }
  const Vec3 view = -path->ray.direction;
  const InstanceView& instance = scene.instances[hit.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  const Surface surface = make_surface(mesh, instance, scene.instance_materials, hit, view);
  if (surface.material < 0) return false;  // a surface without material is black
  Shading shading;
  evaluate_material(scene.tables, scene.materials[surface.material], mesh, instance, hit, surface,
                    view, &shading);
  path->radiance += path->throughput * shading.emission;

  const bool last = path->bounce > settings.max_bounces;  // only emission is still wanted here
  if (settings.light_sampling && shading.count > 0 && !last &&
      sample_light(scene, settings, *path, surface, shading, random, connections)) {
    *connection_count = 1;
  }

  float choice = random.choice.y;
  const float through = mean_component(shading.transparency);
  if (through > 0.0f) {
    float reflected = 0.0f;
    for (int i = 0; i < shading.count; ++i) reflected += mean_component(shading.lobes[i].weight);
    const float p = last ? 1.0f : through / (through + reflected);
    if (choice < p) {
      if (++path->transparent_bounces > kMaxTransparentBounces) return false;
      // bsdf_pdf stays: to the vertex before, the surface is only a filter, and so it is to its
      // light sample.
      path->throughput *= shading.transparency * (1.0f / p);
      path->ray.origin = offset_origin(surface, path->ray.direction);
      path->ray.t_max -= hit.t;
      return path->ray.t_max > 0.0f;
    }
    choice = (choice - p) / (1.0f - p);
    path->throughput *= 1.0f / (1.0f - p);
  }
  if (shading.count == 0 || last) return false;

  const Vec3 direction = sample_bsdf(shading, view, choice, random.bsdf);
  const BsdfValue bsdf = eval_bsdf(shading, surface, view, direction);
  if (!(bsdf.pdf > 0.0f) || !(max_component(bsdf.f) > 0.0f)) return false;
  const Ray next = {offset_origin(surface, direction), 0.0f, direction, INFINITY};
  if (path->bounce == settings.max_bounces && !scene.has_emission && !scene.has_transparency) {
    // Whatever this ray hits would stay black: asking whether it hits at all is cheaper.
    if (settings.bsdf_sampling) {
      connections[(*connection_count)++] = {next, path->throughput * bsdf.f, bsdf.pdf,
                                            settings.light_sampling};
    }
    return false;
  }
  path->throughput *= bsdf.f * (1.0f / bsdf.pdf);
  if (path->bounce >= kFirstRouletteBounce) {
    const float survive = minf(1.0f, max_component(path->throughput));
    // One number per vertex is left over: the light's choice, which the NEE ray has already used up
    // on its own.
    if (random.choice.x >= survive) return false;
    path->throughput *= 1.0f / survive;
  }
  path->ray = next;
  path->bsdf_pdf = bsdf.pdf;
  ++path->bounce;
  return true;
}

}  // namespace skytree
