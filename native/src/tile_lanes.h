// SPDX-License-Identifier: GPL-3.0-or-later
// Shading of many vertices at once. Most surfaces have at most one Lambert lobe and one GGX lobe;
// theirs lie here as arrays, and what kernel/stages.h does at one vertex is done in short loops
// over them, each a call of the same kernel functions, which the compiler vectorises. Loops that
// read tables (tile_sampling.h, tile_texels.h) stay scalar. Included by tile_integrator_body.h.
#pragma once

#include <stddef.h>

#include "src/tile_guide.h"
#include "src/tile_packets.h"
#include "src/tile_points.h"
#include "src/tile_products.h"
#include "src/tile_sampling.h"
#include "src/tile_texels.h"

namespace skytree {
namespace SKYTREE_ISA {

/// Vertices that are shaded together.
struct Lanes {
  int count;
  int path[kBatch];
  uint32_t seed[kBatch], sample[kBatch];
  int light_rays[kBatch];
  uint32_t light_first[kBatch];  // as in LightSamples
  uint32_t guide_slot[kBatch];
  LaneMixes products;
  float control[kBatch];
  int ahead[kBatch];  // whether radiance is looked up before the rays are traced
  Vectors<kBatch> position, geometric_normal, view, throughput;
  float position_error[kBatch];
  Vectors<kBatch> diffuse_normal, diffuse_weight;
  // The GGX lobe, if the lanes have one.
  Vectors<kBatch> normal, tangent, bitangent, weight, f0;
  float alpha_x[kBatch], alpha_y[kBatch], eta[kBatch];
  int type[kBatch];
  float select[kBatch];        // of the diffuse lobe
  float first_select[kBatch];  // of the lobe that comes first
  int diffuse_first[kBatch];
};

/// One direction per lane and what is known of it.
struct LaneDirections {
  LaneLights lights;
  Vectors<kBatch> world;
  Vectors<kBatch> f;
  float bsdf_pdf[kBatch];
  Vectors<kBatch> radiance;
  Vectors<kBatch> weight;
};

struct LaneWork {
  LaneDirections directions;
  LaneSampling sampling;
  GuideLanes guided;
  TexelLookups lookups;
  float choice_x[kBatch], choice_y[kBatch], random_x[kBatch], random_y[kBatch];
  float light_choice[kBatch], guide_factor[kBatch];
  uint32_t index[kBatch];
  int32_t region[kBatch];      // of the guide
  int32_t cut_node[kBatch];    // that a direction lies in
  Vectors<kBatch> gain;        // to the paths' radiance
  Vectors<kBatch> difference;  // and to their light_difference
};

/// Whether `shading` fits into lanes; how many lobes of each kind it has.
static bool is_simple(const Shading& shading, int* diffuse, int* glossy) {
  *diffuse = *glossy = 0;
  if (shading.count > 2 || shading.count == 0 || max_component(shading.transparency) > 0.0f) {
    return false;
  }
  for (int i = 0; i < shading.count; ++i) {
    const LobeType type = shading.lobes[i].type;
    *diffuse += type == LobeType::kDiffuse;
    *glossy +=
        type == LobeType::kGlossy || type == LobeType::kDielectric || type == LobeType::kMetal;
  }
  return *diffuse <= 1 && *glossy <= 1 && *diffuse + *glossy == shading.count;
}

static void append_lane(const Surface& surface, const Shading& shading, const PathState& path,
                        int path_index, LightSamples lights, bool ahead, uint32_t guide_slot,
                        const ProductMix& products, Lanes* lanes) {
  const int i = lanes->count++;
  lanes->path[i] = path_index;
  lanes->seed[i] = path.seed;
  lanes->sample[i] = path.sample;
  lanes->light_rays[i] = lights.count;
  lanes->light_first[i] = lights.first;
  lanes->guide_slot[i] = guide_slot;
  lanes->products.set(i, products);
  lanes->ahead[i] = ahead;
  lanes->position.set(i, surface.position);
  lanes->position_error[i] = surface.position_error;
  lanes->geometric_normal.set(i, surface.geometric_normal);
  lanes->view.set(i, -path.ray.direction);
  lanes->throughput.set(i, path.throughput);
  lanes->control[i] = 0.0f;
  lanes->diffuse_normal.set(i, surface.geometric_normal);
  lanes->diffuse_weight.set(i, {0, 0, 0});
  lanes->select[i] = 0.0f;
  lanes->diffuse_first[i] = shading.lobes[0].type == LobeType::kDiffuse;
  lanes->first_select[i] = shading.count == 1 ? 2.0f : shading.lobes[0].select;
  for (int k = 0; k < shading.count; ++k) {
    const Lobe& lobe = shading.lobes[k];
    if (lobe.type == LobeType::kDiffuse) {
      lanes->diffuse_normal.set(i, lobe.normal);
      lanes->diffuse_weight.set(i, lobe.weight);
      lanes->select[i] = lobe.select;
      if (path.bounce == 0 && lights.count > 0) lanes->control[i] = path.control;
      continue;
    }
    lanes->normal.set(i, lobe.normal);
    lanes->tangent.set(i, lobe.tangent);
    lanes->bitangent.set(i, lobe.bitangent);
    lanes->weight.set(i, lobe.weight);
    lanes->f0.set(i, lobe.type == LobeType::kMetal ? lobe.f0 : Vec3{1, 1, 1});
    lanes->alpha_x[i] = lobe.alpha_x;
    lanes->alpha_y[i] = lobe.alpha_y;
    lanes->eta[i] = lobe.type == LobeType::kDielectric ? lobe.eta : 1.5f;
    lanes->type[i] = static_cast<int>(lobe.type);
  }
}

SKY_HD Lobe glossy_lobe(const Lanes& lanes, int i) {
  Lobe lobe;
  lobe.type = static_cast<LobeType>(lanes.type[i]);
  lobe.weight = lanes.weight.get(i);
  lobe.normal = lanes.normal.get(i);
  lobe.tangent = lanes.tangent.get(i);
  lobe.bitangent = lanes.bitangent.get(i);
  lobe.alpha_x = lanes.alpha_x[i];
  lobe.alpha_y = lanes.alpha_y[i];
  lobe.eta = lanes.eta[i];
  lobe.f0 = lanes.f0.get(i);
  return lobe;
}

SKY_HD Lobe diffuse_lobe(const Lanes& lanes, int i) {
  Lobe lobe;
  lobe.type = LobeType::kDiffuse;
  lobe.normal = lanes.diffuse_normal.get(i);
  lobe.weight = lanes.diffuse_weight.get(i);
  return lobe;
}

/// eval_bsdf in directions.world.
template <bool kGlossy>
SKY_LANE_LOOP void evaluate(const Lanes& lanes, LaneDirections* directions) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes.count; ++i) {
    const Vec3 wo = lanes.view.get(i), wi = directions->world.get(i);
    const float above = dot(lanes.geometric_normal.get(i), wi) > 0.0f ? 1.0f : 0.0f;
    BsdfValue sum = eval_lobe(diffuse_lobe(lanes, i), wo, wi);
    if constexpr (kGlossy) {
      sum.pdf *= lanes.select[i];
      const BsdfValue glossy = eval_ggx(glossy_lobe(lanes, i), wo, wi);
      sum.f += glossy.f;
      sum.pdf += glossy.pdf * (1.0f - lanes.select[i]);
    }
    directions->f.set(i, {above > 0.0f ? sum.f.x : 0.0f, above > 0.0f ? sum.f.y : 0.0f,
                          above > 0.0f ? sum.f.z : 0.0f});
    directions->bsdf_pdf[i] = above > 0.0f ? sum.pdf : 0.0f;
  }
}

/// Radiance in the lights' directions; 1 where it is looked up later.
static void look_up_lanes(const EnvironmentView& environment, const Lanes& lanes,
                          LaneDirections* directions, TexelLookups* lookups) {
  lookups->count = 0;
  for (int i = 0; i < lanes.count; ++i) {
    if (lanes.ahead[i]) {
      lookups->append(i, directions->lights.u[i], directions->lights.v[i]);
    } else {
      directions->radiance.set(i, {1, 1, 1});
    }
  }
  look_up(environment.image, lookups);
  for (int i = 0; i < lookups->count; ++i) {
    directions->radiance.set(lookups->lane[i], lookups->radiance.get(i));
  }
}

SKY_HD Vec2 lane_map(const Lanes& lanes, const LaneDirections& directions, int i) {
  return lanes.ahead[i] ? no_map_coordinates()
                        : Vec2{directions.lights.u[i], directions.lights.v[i]};
}

/// The weights of the connections along `directions`, and their part of the control variate.
/// `half` is 1 or -1 for a light sample, of lanes that have an even number.
SKY_LANE_LOOP void weigh(const SceneView& scene, const RenderSettings& settings, const Lanes& lanes,
                         float half, LaneDirections* directions, LaneWork* work) {
  const Vec3 color = scene.environment.color;
  const float bsdf_rays = bsdf_ray_count(settings);
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes.count; ++i) {
    const float density = mixture_density(lanes.light_rays[i], directions->lights.pdf[i], bsdf_rays,
                                          directions->bsdf_pdf[i]);
    const Vec3 incoming = lanes.throughput.get(i) * (color * directions->radiance.get(i)) *
                          (density > 0.0f ? 1.0f / density : 0.0f);
    const float p = diffuse_polynomial(dot(lanes.diffuse_normal.get(i), directions->world.get(i)));
    const Vec3 control = incoming * (lanes.diffuse_weight.get(i) * (kInvPi * p)) * lanes.control[i];
    work->gain.set(i, work->gain.get(i) - control);
    work->difference.set(i, work->difference.get(i) - control * half);
    directions->weight.set(i, incoming * directions->f.get(i));
  }
}

SKY_HD Surface lane_surface(const Lanes& lanes, int i) {
  Surface surface;
  surface.position = lanes.position.get(i);
  surface.geometric_normal = lanes.geometric_normal.get(i);
  surface.position_error = lanes.position_error[i];
  return surface;
}

SKY_HD Ray lane_ray(const Lanes& lanes, const LaneDirections& directions, int i) {
  const Vec3 direction = directions.world.get(i);
  return {offset_origin(lane_surface(lanes, i), direction), 0.0f, direction, INFINITY};
}

SKY_LANE_LOOP void begin_control(const EnvironmentView& environment, const Lanes& lanes,
                                 LaneWork* work) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes.count; ++i) {
    const Vec3 normal = environment.world_to_env * lanes.diffuse_normal.get(i);
    const Vec3 integral = environment.color * (lanes.diffuse_weight.get(i) * kInvPi *
                                               diffuse_integral(environment.moments, normal));
    work->gain.set(i, lanes.throughput.get(i) * integral * lanes.control[i]);
    work->difference.set(i, {0, 0, 0});
  }
}

/// The lights' directions in the world, and the guide's factor on their densities.
SKY_LANE_LOOP void turn_to_world(const Mat3& world_to_env, int count, const float* guide_factor,
                                 LaneDirections* directions) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    directions->world.set(i, transpose_mul(world_to_env, directions->lights.local.get(i)));
    directions->lights.pdf[i] *= guide_factor[i];
  }
}

SKY_LANE_LOOP void turn_to_map(const Mat3& world_to_env, int count, LaneDirections* directions) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < count; ++i) {
    directions->lights.local.set(i, world_to_env * directions->world.get(i));
  }
}

/// Sends random numbers where the guide has them, and finds regions to record. A place is directed
/// by its mixture or by what has been learnt there, never by both.
static void guide_lanes(const EnvSamplerView& sampler, const GuideView& guide, const Lanes& lanes,
                        LaneWork* work) {
  GuideLanes& guided = work->guided;
  guided.count = 0;
  for (int i = 0; i < lanes.count; ++i) {
    const uint32_t slot = lanes.guide_slot[i];
    const Vec2 u = {work->random_x[i], work->random_y[i]};
    if (is_guided(guide, slot)) {
      guided.append(i, slot, u);
    } else {
      work->region[i] = guide_point(sampler, guide, slot, {}, u).region;
    }
  }
  if (guided.count > 0) warp_lanes(guide, &guided);
  for (int j = 0; j < guided.count; ++j) {
    const int i = guided.lane[j];
    work->random_x[i] = guided.x[j];
    work->random_y[i] = guided.y[j];
    work->guide_factor[i] = guided.density[j];
    work->region[i] = guided.region(j);
  }
}

/// Light sample number `k` of the lanes that have so many.
template <bool kGlossy>
static void sample_light_lanes(const SceneView& scene, const RenderSettings& settings,
                               const Lanes& lanes, int vertex, int k, LaneWork* work,
                               Connections* connections) {
  const EnvironmentView& environment = scene.environment;
  LaneDirections& directions = work->directions;
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes.count; ++i) {
    // A lane without this sample takes any.
    const uint32_t index = lanes.light_first[i] + static_cast<uint32_t>(k);
    work->index[i] = k < lanes.light_rays[i] ? index : 0;
  }
  draw_light_points(settings, lanes.light_rays, lanes.seed, work->index, lanes.count,
                    first_pair(vertex) + kPairLight, work->random_x, work->random_y);
  for (int i = 0; i < lanes.count; ++i) {
    work->light_choice[i] = light_choice(work->choice_x[i], lanes.light_rays[i], k);
    work->guide_factor[i] = 1.0f;
    work->region[i] = kNoGuideRegion;
  }
  const ProductView& products = environment.sampler.kdtree.products;
  if (kGlossy && products.cuts) {
    warp_by_products(products, lanes.products, lanes.count, work->random_x, work->random_y,
                     work->guide_factor);
  }
  if (scene.guide.cuts) guide_lanes(environment.sampler, scene.guide, lanes, work);
  LaneLights& lights = directions.lights;
  sample_environment_lanes(environment.sampler, lanes.count, work->light_choice, work->random_x,
                           work->random_y, &work->sampling, &lights);
  turn_to_world(environment.world_to_env, lanes.count, work->guide_factor, &directions);
  evaluate<kGlossy>(lanes, &directions);
  look_up_lanes(environment, lanes, &directions, &work->lookups);
  for (int i = 0; i < lanes.count; ++i) {
    if (k < lanes.light_rays[i] && directions.lights.pdf[i] > 0.0f) continue;
    directions.radiance.set(i, {0, 0, 0});
    directions.f.set(i, {0, 0, 0});
  }
  weigh(scene, settings, lanes, light_half(0, k), &directions, work);
  const bool recording = scene.guide.counters != nullptr;
  for (int i = 0; i < lanes.count; ++i) {
    // A lane without this sample weighs nothing.
    const uint32_t record =
        !recording || k >= lanes.light_rays[i]
            ? kNoGuideRecord
            : light_guide_record(scene, lanes.guide_slot[i], work->region[i],
                                 lanes.geometric_normal.get(i), directions.world.get(i));
    if (!(max_component(directions.f.get(i)) > 0.0f)) continue;
    append({lane_ray(lanes, directions, i), directions.weight.get(i),
            lane_map(lanes, directions, i), record, light_half(lanes.light_rays[i], k)},
           lanes.path[i], connections);
  }
}

/// guide_factor on the densities in the lights' directions, whose blocks are known.
template <bool kGlossy>
static void apply_guide_factors(const SceneView& scene, const Lanes& lanes, LaneWork* work) {
  const EnvSamplerView& sampler = scene.environment.sampler;
  const ProductView& products = sampler.kdtree.products;
  LaneLights& lights = work->directions.lights;
  if (kGlossy && products.cuts) {
    for (int i = 0; i < lanes.count; ++i) {
      work->cut_node[i] = products.cut.node_of_block[work->sampling.block[i]];
    }
    find_ratios(products, lanes.products, lanes.count, work->cut_node, work->guide_factor);
    for (int i = 0; i < lanes.count; ++i) lights.pdf[i] *= work->guide_factor[i];
  }
  if (!scene.guide.cuts) return;
  GuideLanes& guided = work->guided;
  guided.count = 0;
  for (int i = 0; i < lanes.count; ++i) {
    if (!is_guided(scene.guide, lanes.guide_slot[i])) continue;
    guided.append(i, lanes.guide_slot[i], lane_warp_point(sampler, work->sampling, lights, i));
  }
  if (guided.count > 0) find_guide_densities(scene.guide, &guided);
  for (int j = 0; j < guided.count; ++j) lights.pdf[guided.lane[j]] *= guided.density[j];
}

/// vertex_guide_slot of all lanes with light samples.
SKY_LANE_LOOP void find_guide_slots(const GuideView& guide, Lanes* lanes) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes->count; ++i) {
    const uint32_t slot = guide_slot(guide, lanes->position.get(i), lanes->geometric_normal.get(i));
    lanes->guide_slot[i] = lanes->light_rays[i] > 0 ? slot : kNoGuideSlot;
  }
}

SKY_LANE_LOOP void draw_probes(const Lanes& lanes, LaneWork* work) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes.count; ++i) {
    const Vec2 u = probe_random(lanes.seed[i], lanes.sample[i]);
    work->random_x[i] = u.x;
    work->random_y[i] = u.y;
    work->light_choice[i] = kProbeChoice;
  }
}

/// probe_visibility of all lanes with light samples.
static void send_probes(const SceneView& scene, const Lanes& lanes, LaneWork* work,
                        Connections* connections) {
  const EnvironmentView& environment = scene.environment;
  GuideLanes& probes = work->guided;
  LaneLights& lights = work->directions.lights;
  draw_probes(lanes, work);
  probes.count = 0;
  for (int i = 0; i < lanes.count; ++i) {
    if (lanes.light_rays[i] == 0 || lanes.guide_slot[i] == kNoGuideSlot) continue;
    probes.append(i, kGuideEvenSlot, {work->random_x[i], work->random_y[i]});
  }
  warp_lanes(scene.guide, &probes);
  sample_environment_lanes(environment.sampler, probes.count, work->light_choice, probes.x,
                           probes.y, &work->sampling, &lights);
  for (int j = 0; j < probes.count; ++j) {
    const int i = probes.lane[j];
    Connection probe;
    if (make_probe(scene, lane_surface(lanes, i), lanes.guide_slot[i], probes.region(j),
                   lights.local.get(j), &probe)) {
      append(probe, lanes.path[i], connections);
    }
  }
}

/// Directions drawn from the lobes.
template <bool kGlossy>
SKY_LANE_LOOP void sample_bsdf_lanes(const Lanes& lanes, LaneWork* work) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < lanes.count; ++i) {
    const Vec2 u = {work->random_x[i], work->random_y[i]};
    Vec3 direction = sample_lobe(diffuse_lobe(lanes, i), lanes.view.get(i), u);
    if constexpr (kGlossy) {
      const Lobe lobe = glossy_lobe(lanes, i);
      const Vec3 o = to_local(lobe, lanes.view.get(i));
      const Vec3 h = ggx_sample_visible_normal(o, lobe.alpha_x, lobe.alpha_y, u);
      const Vec3 reflected = normalize(to_world(lobe, h * (2.0f * dot(o, h)) - o));
      const int first = work->choice_y[i] < lanes.first_select[i] ? 1 : 0;
      const bool diffuse = first == lanes.diffuse_first[i];
      direction = {diffuse ? direction.x : reflected.x, diffuse ? direction.y : reflected.y,
                   diffuse ? direction.z : reflected.z};
    }
    work->directions.world.set(i, direction);
  }
}

/// shade for lanes from their material on. Paths that go on are appended to `active`, whose new
/// length is returned.
template <bool kGlossy>
static int shade_lanes(const SceneView& scene, const RenderSettings& settings, const Lanes& lanes,
                       int vertex, LaneWork* work, PathState* paths, Connections* connections,
                       int* active, int active_count) {
  const EnvironmentView& environment = scene.environment;
  LaneDirections& directions = work->directions;
  const int count = lanes.count;
  if (count == 0) return active_count;
  draw_pairs(settings.point_count, lanes.seed, lanes.sample, count,
             first_pair(vertex) + kPairChoice, work->choice_x, work->choice_y);
  begin_control(environment, lanes, work);
  int most = 0;
  for (int i = 0; i < count; ++i) most = lanes.light_rays[i] > most ? lanes.light_rays[i] : most;
  for (int k = 0; k < most; ++k) {
    sample_light_lanes<kGlossy>(scene, settings, lanes, vertex, k, work, connections);
  }
  if (scene.guide.probing && vertex == 0) send_probes(scene, lanes, work, connections);

  draw_pairs(settings.point_count, lanes.seed, lanes.sample, count, first_pair(vertex) + kPairBsdf,
             work->random_x, work->random_y);
  sample_bsdf_lanes<kGlossy>(lanes, work);
  evaluate<kGlossy>(lanes, &directions);
  if (settings.bsdf_sampling) {
    LaneLights& lights = directions.lights;
    turn_to_map(environment.world_to_env, count, &directions);
    locate(count, &lights);
    if (most > 0) {
      environment_pdf_lanes(environment.sampler, count, &work->sampling, &lights);
      apply_guide_factors<kGlossy>(scene, lanes, work);
    } else {
      for (int i = 0; i < count; ++i) lights.pdf[i] = 0.0f;
    }
    if (environment.sampler.type == EnvSamplerType::FILTERED) {
      for (int i = 0; i < count; ++i) {
        directions.radiance.set(
            i, sampled_radiance(environment, {lights.u[i], lights.v[i]}, directions.bsdf_pdf[i]));
      }
    } else {
      look_up_lanes(environment, lanes, &directions, &work->lookups);
    }
    // Light samples alone count where a direction was drawn that the lobes refuse.
    for (int i = 0; i < count; ++i) {
      if (!(directions.bsdf_pdf[i] > 0.0f)) directions.radiance.set(i, {0, 0, 0});
    }
    weigh(scene, settings, lanes, 0.0f, &directions, work);
  }
  for (int i = 0; i < count; ++i) {
    PathState& path = paths[lanes.path[i]];
    path.radiance += work->gain.get(i);
    if (lanes.light_rays[i] % 2 == 0) path.light_difference += work->difference.get(i);
  }
  for (int i = 0; i < count; ++i) {
    const BsdfValue bsdf = {directions.f.get(i), directions.bsdf_pdf[i]};
    const Vec3 sky = settings.bsdf_sampling ? directions.weight.get(i) : Vec3{0, 0, 0};
    if (!(bsdf.pdf > 0.0f) || !(max_component(bsdf.f) > 0.0f)) continue;
    PathState& path = paths[lanes.path[i]];
    const Ray next = lane_ray(lanes, directions, i);
    if (ends_in_sky(scene, settings, path.bounce)) {
      if (settings.bsdf_sampling) {
        append({next, sky, lane_map(lanes, directions, i), kNoGuideRecord, 0.0f}, lanes.path[i],
               connections);
      }
    } else if (continue_path(bsdf, next, sky, work->choice_x[i], &path)) {
      active[active_count++] = lanes.path[i];
    }
  }
  return active_count;
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
