// SPDX-License-Identifier: GPL-3.0-or-later
// A whole scene as plain pointers, all that the stages of the integrator read.
#pragma once

#include "kernel/camera.h"
#include "kernel/diffuse_moments.h"
#include "kernel/env_sampler.h"
#include "kernel/filter.h"
#include "kernel/guided_light.h"
#include "kernel/material.h"

namespace skytree {

struct EnvironmentView {
  LatLongImage image;
  EnvSamplerView sampler;
  Mat3 world_to_env;       // rotation
  Vec3 color;              // factor on the image
  bool visible;            // to camera rays
  DiffuseMoments moments;  // of the image; zeros where the control variate is off
};

struct SceneView {
  const MeshView* meshes;
  const InstanceView* instances;
  const int32_t* instance_materials;
  const MaterialView* materials;
  MaterialTables tables;
  EnvironmentView environment;
  CameraView camera;
  GuideView guide;
  bool has_emission;      // some material emits
  bool has_transparency;  // some material lets rays through
};

/// Pixels along the edge of a tile. Tiles lie on a grid fixed to the film's lower left corner.
constexpr int kTileSize = 16;

/// Factor on the control variate of each tile in a rectangle of them, row by row.
struct TileControls {
  const float* factors;  // null: RenderSettings::control for all
  int first_x, first_y;  // tiles
  int columns;
};

/// Light samples of a vertex, at most.
constexpr int kMaxLightRays = 4;

struct RenderSettings {
  uint32_t seed;
  int max_bounces;  // 0: the environment as the first surface sees it
  bool film_transparent;
  bool bsdf_sampling;          // off: light samples alone, without MIS
  const float* filter_table;   // kFilterTableSize
  bool light_sampling = true;  // off: BSDF samples alone, without MIS
  bool blue_noise = false;     // neighbouring pixels' errors differ (kernel/rng.h)
  uint32_t point_count = 0;    // samples of every pixel, for multi_jittered.h; 0: Sobol's points
  // Above 0: a light sample is chosen from so many candidates (resampling.h), some of them BSDF
  // samples or not; bsdf_sampling must be off.
  int candidates = 0;
  bool bsdf_candidates = false;
  int light_rays = 1;  // at the first vertex, where it is not sharp; up to kMaxLightRays
  // Where light_rays has changed: points that samples before took beyond so many each.
  uint32_t light_skip = 0;
  float control = 0.0f;  // factor on the control variate, kernel/estimators.h
  TileControls controls = {};
};

/// Factor on the control variate for a pixel.
SKY_HD float control_of_pixel(const RenderSettings& settings, int x, int y) {
  const TileControls& tiles = settings.controls;
  if (!tiles.factors) return settings.control;
  return tiles
      .factors[(y / kTileSize - tiles.first_y) * tiles.columns + x / kTileSize - tiles.first_x];
}

/// Where in the map a world direction points.
SKY_HD Vec2 environment_uv(const EnvironmentView& environment, Vec3 direction) {
  return latlong_uv(environment.world_to_env * direction);
}

/// Radiance of the environment along a world direction.
SKY_HD Vec3 environment_radiance(const EnvironmentView& environment, Vec3 direction) {
  return environment.color *
         lookup_bilinear(environment.image, environment.world_to_env * direction);
}

/// Radiance that a BSDF sample with this pdf brings from map coordinates `uv`.
SKY_HD Vec3 sampled_radiance(const EnvironmentView& environment, Vec2 uv, float pdf) {
  return environment.sampler.type == EnvSamplerType::FILTERED
             ? filtered_radiance(environment.sampler.filtered, environment.image, uv, pdf)
             : lookup_bilinear_uv(environment.image, uv.x, uv.y);
}

}  // namespace skytree
