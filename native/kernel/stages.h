// SPDX-License-Identifier: GPL-3.0-or-later
// The path tracer, one function per stage. A host loop or a GPU kernel runs each over a batch of
// paths:
//   start_path -> [trace] -> shade -> [trace connections] -> add their weights -> ... -> film
// Tracing lies between the stages and is not part of them.
//
// Next-event estimation on the environment with multiple importance sampling by the balance
// heuristic: E. Veach, "Robust Monte Carlo Methods for Light Transport Simulation", 1997,
// chapter 9.
#pragma once

#include "kernel/estimators.h"
#include "kernel/multi_jittered.h"
#include "kernel/product_lobes.h"
#include "kernel/resampling.h"

namespace skytree {

struct PathState {
  Ray ray;
  Vec3 throughput;
  Vec3 radiance;
  Vec3 sky;  // what `ray` brings if it leaves the scene, but for the map's radiance unless the
             // vertex looks_ahead; unset for a camera ray, bounce 0
  float alpha;
  float control;  // factor on the first vertex's control variate, kernel/estimators.h
  uint32_t seed;  // of the pixel
  uint32_t sample;
  int bounce;
  int transparent_bounces;
  int light_rays;         // of the first surface; 0: none was met
  Vec3 light_difference;  // of two halves of its light samples (light_half)
};

/// A ray to the environment and what it brings unless something is in its way: weight, or where
/// map.x is not negative weight times the radiance at these map coordinates. Most rays of a closed
/// room are stopped: they need not wait for texels.
struct Connection {
  Ray ray;
  Vec3 weight;
  Vec2 map;
  uint32_t
      guide_record;  // what the guide counts of it (visibility_guide.h), kNoGuideRecord: nothing
  float half;        // sign in the path's light_difference
};

/// Map coordinates of a connection whose weight is complete.
SKY_HD Vec2 no_map_coordinates() { return {-1.0f, 0.0f}; }

SKY_HD Vec3 connection_radiance(const SceneView& scene, const Connection& connection) {
  if (connection.map.x < 0.0f) return connection.weight;
  return connection.weight *
         lookup_bilinear_uv(scene.environment.image, connection.map.x, connection.map.y);
}

/// Whether the radiance of a BSDF ray from a vertex is looked up before the ray is traced: where
/// the control variate needs it, and where the look-up depends on the ray's density.
SKY_HD bool looks_ahead(const SceneView& scene, int bounce, float control) {
  return (bounce == 0 && control > 0.0f) ||
         scene.environment.sampler.type == EnvSamplerType::FILTERED;
}

/// Slot of a vertex in what is learnt of visibility.
SKY_HD uint32_t vertex_guide_slot(const SceneView& scene, const Surface& surface) {
  return kLearnsVisibility && scene.guide.cuts
             ? guide_slot(scene.guide, surface.position, surface.geometric_normal)
             : kNoGuideSlot;
}

/// What directs the light samples of vertex `bounce`.
SKY_HD ProductMix vertex_products(const SceneView& scene, const Shading& shading, Vec3 view,
                                  int bounce, uint32_t slot) {
  const EnvironmentView& environment = scene.environment;
  if (bounce > 0 || environment.sampler.type != EnvSamplerType::KDTREE_LINEAR ||
      !environment.sampler.kdtree.products.cuts || is_guided(scene.guide, slot)) {
    return {};
  }
  return mix_products(environment.sampler.kdtree.products, environment.world_to_env, shading, view);
}

/// The record of a light sample whose ray is still to be traced; one below the surface is counted
/// at once.
SKY_HD uint32_t light_guide_record(const SceneView& scene, uint32_t slot, int32_t region,
                                   Vec3 geometric_normal, Vec3 direction) {
  if (region < 0) return kNoGuideRecord;
  const float cosine = dot(geometric_normal, direction);
  const uint32_t record = guide_record(slot, region, maxf(cosine, 0.0f));
  if (cosine > 0.0f) return record;
  guide_commit(scene.guide, record, false);
  return kNoGuideRecord;
}

/// Random numbers of a probe, its own: the sequences of the pixel's other samples stay as they are.
SKY_HD Vec2 probe_random(uint32_t seed, uint32_t sample) {
  return hashed_pair(seed ^ 0x68bc21ebu, sample, 0);
}
constexpr float kProbeChoice = 0.5f;  // the sampler's third number

/// A ray that only asks what is visible in a direction of the map; false if it would go below the
/// surface.
SKY_HD bool make_probe(const SceneView& scene, const Surface& surface, uint32_t slot,
                       int32_t region, Vec3 local, Connection* connection) {
  const Vec3 direction = transpose_mul(scene.environment.world_to_env, local);
  const uint32_t record =
      light_guide_record(scene, slot, region, surface.geometric_normal, direction);
  *connection = {{offset_origin(surface, direction), 0.0f, direction, INFINITY},
                 {0, 0, 0},
                 no_map_coordinates(),
                 record,
                 0.0f};
  return record != kNoGuideRecord;
}

/// The probe of a path's first vertex, into any region. Later vertices send none: there are more of
/// them, and what they could learn is worth less than their rays cost.
SKY_HD bool probe_visibility(const SceneView& scene, const Surface& surface, uint32_t slot,
                             uint32_t seed, uint32_t sample, Connection* connection) {
  const GuidedPoint guided = guide_warp(scene.guide, kGuideEvenSlot, probe_random(seed, sample));
  const DirectionSample light =
      sample_environment(scene.environment.sampler, {kProbeChoice, guided.point.x, guided.point.y});
  return make_probe(scene, surface, slot, guided.region, light.direction, connection);
}

/// Pairs of random numbers: one for the camera, then kPairsPerBounce for each vertex.
enum RandomPair : uint32_t { kPairFilter = 0, kPairVertex = 1, kPairsPerBounce = 3 };

/// The pairs of one vertex, from first_pair on.
enum VertexPair : uint32_t { kPairLight = 0, kPairBsdf = 1, kPairChoice = 2 };

constexpr int kMaxTransparentBounces = 64;
constexpr int kFirstRouletteBounce = 4;
constexpr int kMaxConnections = kMaxLightRays + 2;  // of one vertex

SKY_HD uint32_t first_pair(int vertex) {
  return kPairVertex + kPairsPerBounce * static_cast<uint32_t>(vertex);
}

/// The random numbers of one vertex, all of them.
struct VertexRandom {
  Vec2 light, bsdf, choice;
};

SKY_HD VertexRandom vertex_random(uint32_t point_count, const PathState& path, int vertex) {
  const uint32_t first = first_pair(vertex);
  return {sample_pair(point_count, path.seed, path.sample, first + kPairLight),
          sample_pair(point_count, path.seed, path.sample, first + kPairBsdf),
          sample_pair(point_count, path.seed, path.sample, first + kPairChoice)};
}

/// The camera ray of a sample of pixel (x,y), `filter_u` its random pair kPairFilter.
SKY_HD Ray sample_camera_ray(const SceneView& scene, const RenderSettings& settings, int x, int y,
                             Vec2 filter_u) {
  const float film_x =
      static_cast<float>(x) + 0.5f + sample_filter(settings.filter_table, filter_u.x);
  const float film_y =
      static_cast<float>(y) + 0.5f + sample_filter(settings.filter_table, filter_u.y);
  return camera_ray(scene.camera, film_x, film_y);
}

/// Stage 1: sample `sample` of the pixel with this seed begins with a camera ray.
SKY_HD void start_path(const Ray& ray, uint32_t seed, uint32_t sample, float control,
                       PathState* path) {
  path->ray = ray;
  path->throughput = {1, 1, 1};
  path->radiance = {0, 0, 0};
  path->sky = {0, 0, 0};
  path->alpha = 1.0f;
  path->control = control;
  path->seed = seed;
  path->sample = sample;
  path->bounce = 0;
  path->transparent_bounces = 0;
  path->light_rays = 0;
  path->light_difference = {0, 0, 0};
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
  if (path->bounce > 0) {
    path->radiance +=
        looks_ahead(scene, path->bounce - 1, path->control)
            ? path->sky
            : path->sky * lookup_bilinear(scene.environment.image,
                                          scene.environment.world_to_env * path->ray.direction);
  } else if (settings.film_transparent) {
    path->alpha = 1.0f - mean_component(path->throughput);
  } else if (scene.environment.visible) {
    path->radiance +=
        path->throughput * environment_radiance(scene.environment, path->ray.direction);
  }
}

/// The light samples of a vertex: connections, and their part of the control variate into the
/// path's radiance. Returns the number of connections.
SKY_HD int sample_lights(const SceneView& scene, const RenderSettings& settings, int vertex,
                         uint32_t slot, const ProductMix& mix, LightSamples lights, float control,
                         float choice, const Surface& surface, const Shading& shading,
                         PathState* path, Connection* connections) {
  const EnvironmentView& environment = scene.environment;
  if (settings.candidates > 0) {
    const VertexRandom random = vertex_random(settings.point_count, *path, vertex);
    ResampledLight light = {};
    if (!resample_light(
            environment, surface, shading, -path->ray.direction, settings.candidates,
            settings.bsdf_candidates, {random.choice.x, random.light.x, random.light.y},
            {random.choice.y, random.bsdf.x, random.bsdf.y},
            unit_float(hash_u32(path->seed + hash_u32(path->sample + hash_u32((uint32_t)vertex)))),
            &light)) {
      return 0;
    }
    connections[0] = {{offset_origin(surface, light.direction), 0.0f, light.direction, INFINITY},
                      path->throughput * light.f *
                          environment_radiance(environment, light.direction) * (1.0f / light.pdf),
                      no_map_coordinates(),
                      kNoGuideRecord,
                      0.0f};
    return 1;
  }
  int count = 0;
  const int light_rays = lights.count;
  for (int i = 0; i < light_rays; ++i) {
    const Vec2 u =
        sample_pair(settings.point_count * static_cast<uint32_t>(light_rays), path->seed,
                    lights.first + static_cast<uint32_t>(i), first_pair(vertex) + kPairLight);
    const float half = light_half(light_rays, i);
    const GuidedSample guided = sample_guided(environment.sampler, scene.guide, slot, mix,
                                              {light_choice(choice, light_rays, i), u.x, u.y});
    const DirectionSample light = guided.light;
    if (!(light.pdf > 0.0f)) continue;
    const Vec3 direction = transpose_mul(environment.world_to_env, light.direction);
    const uint32_t record =
        light_guide_record(scene, slot, guided.region, surface.geometric_normal, direction);
    const BsdfValue bsdf = eval_bsdf(shading, surface, -path->ray.direction, direction);
    const float density =
        mixture_density(light_rays, light.pdf, bsdf_ray_count(settings), bsdf.pdf);
    Vec2 map = latlong_uv(light.direction);
    Vec3 incoming = path->throughput * environment.color * (1.0f / density);
    if (control > 0.0f) {
      incoming *= lookup_bilinear_uv(environment.image, map.x, map.y);
      map = no_map_coordinates();
      const Vec3 taken = incoming * control_value(shading, direction) * control;
      path->radiance += -taken;
      path->light_difference += taken * -half;
    }
    if (!(max_component(bsdf.f) > 0.0f)) continue;
    connections[count++] = {{offset_origin(surface, direction), 0.0f, direction, INFINITY},
                            incoming * bsdf.f,
                            map,
                            record,
                            half};
  }
  if (slot != kNoGuideSlot && scene.guide.probing && vertex == 0) {
    count += probe_visibility(scene, surface, slot, path->seed, path->sample, connections + count);
  }
  return count;
}

/// Whether all that a BSDF ray of vertex `bounce` can bring is the environment: then asking whether
/// it hits at all is cheaper than following it.
SKY_HD bool ends_in_sky(const SceneView& scene, const RenderSettings& settings, int bounce) {
  return bounce == settings.max_bounces && !scene.has_emission && !scene.has_transparency;
}

/// Takes the BSDF sample as the path's next ray; false where roulette ends it. One number per
/// vertex is left over for that: the light's choice, which the light sample has used up on its own.
SKY_HD bool continue_path(const BsdfValue& bsdf, const Ray& next, Vec3 sky, float roulette,
                          PathState* path) {
  path->throughput *= bsdf.f * (1.0f / bsdf.pdf);
  path->sky = sky;
  if (path->bounce >= kFirstRouletteBounce) {
    const float survive = minf(1.0f, max_component(path->throughput));
    if (roulette >= survive) return false;
    path->throughput *= 1.0f / survive;
    path->sky *= 1.0f / survive;
  }
  path->ray = next;
  ++path->bounce;
  return true;
}

/// Shades vertex number `vertex`, a point of a surface whose material is evaluated. Writes up to
/// kMaxConnections connections and their number, and the next ray into the path; returns whether
/// the path goes on.
SKY_HD bool shade_surface(const SceneView& scene, const RenderSettings& settings, const Hit& hit,
                          const Surface& surface, const Shading& shading, int vertex,
                          PathState* path, Connection* connections, int* connection_count) {
  *connection_count = 0;
  const Vec3 view = -path->ray.direction;
  path->radiance += path->throughput * shading.emission;
  const EnvironmentView& environment = scene.environment;
  const bool last = path->bounce > settings.max_bounces;  // only emission is still wanted here
  const LightSamples lights = last || shading.count == 0
                                  ? LightSamples{0, 0}
                                  : light_samples(settings, path->bounce, path->sample, shading);
  const int light_rays = lights.count;
  if (path->bounce == 0) path->light_rays = light_rays;
  const float control = light_rays > 0 && path->bounce == 0 ? path->control : 0.0f;
  const Vec2 choices =
      sample_pair(settings.point_count, path->seed, path->sample, first_pair(vertex) + kPairChoice);
  const uint32_t slot = light_rays > 0 ? vertex_guide_slot(scene, surface) : kNoGuideSlot;
  ProductMix mix = {};
  if (light_rays > 0) {
    if (settings.candidates == 0) mix = vertex_products(scene, shading, view, path->bounce, slot);
    if (control > 0.0f) {
      path->radiance += path->throughput * control_integral(environment, shading) * control;
    }
    *connection_count = sample_lights(scene, settings, vertex, slot, mix, lights, control,
                                      choices.x, surface, shading, path, connections);
  }

  float choice = choices.y;
  const float through = mean_component(shading.transparency);
  if (through > 0.0f) {
    float reflected = 0.0f;
    for (int i = 0; i < shading.count; ++i) reflected += mean_component(shading.lobes[i].weight);
    const float p = last ? 1.0f : through / (through + reflected);
    if (choice < p) {
      if (++path->transparent_bounces > kMaxTransparentBounces) return false;
      // To the vertex before, the surface is only a filter, as it is to its light samples.
      const Vec3 filter = shading.transparency * (1.0f / p);
      path->throughput *= filter;
      path->sky *= filter;
      path->ray.origin = offset_origin(surface, path->ray.direction);
      path->ray.t_max -= hit.t;
      return path->ray.t_max > 0.0f;
    }
    choice = (choice - p) / (1.0f - p);
    path->throughput *= 1.0f / (1.0f - p);
  }
  if (shading.count == 0 || last) return false;

  const Vec3 direction = sample_bsdf(
      shading, view, choice,
      sample_pair(settings.point_count, path->seed, path->sample, first_pair(vertex) + kPairBsdf));
  const BsdfValue bsdf = eval_bsdf(shading, surface, view, direction);
  if (!(bsdf.pdf > 0.0f)) return false;
  Vec3 sky = {0, 0, 0};
  Vec2 map = no_map_coordinates();
  if (settings.bsdf_sampling) {
    const float light_pdf = light_rays > 0 ? guided_pdf(environment.sampler, scene.guide, slot, mix,
                                                        environment.world_to_env * direction)
                                           : 0.0f;
    const float density = mixture_density(light_rays, light_pdf, 1.0f, bsdf.pdf);
    map = environment_uv(environment, direction);
    Vec3 incoming = path->throughput * environment.color * (1.0f / density);
    if (looks_ahead(scene, path->bounce, path->control)) {
      incoming *= sampled_radiance(environment, map, bsdf.pdf);
      map = no_map_coordinates();
    }
    if (control > 0.0f) path->radiance += -(incoming * control_value(shading, direction) * control);
    sky = incoming * bsdf.f;
  }
  if (!(max_component(bsdf.f) > 0.0f)) return false;
  const Ray next = {offset_origin(surface, direction), 0.0f, direction, INFINITY};
  if (ends_in_sky(scene, settings, path->bounce)) {
    if (settings.bsdf_sampling)
      connections[(*connection_count)++] = {next, sky, map, kNoGuideRecord, 0.0f};
    return false;
  }
  return continue_path(bsdf, next, sky, choices.x, path);
}

/// Stage 3: shades vertex number `vertex`, which `hit` describes; as shade_surface.
SKY_HD bool shade(const SceneView& scene, const RenderSettings& settings, const Hit& hit,
                  int vertex, PathState* path, Connection* connections, int* connection_count) {
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
  return shade_surface(scene, settings, hit, surface, shading, vertex, path, connections,
                       connection_count);
}

}  // namespace skytree
