// SPDX-License-Identifier: GPL-3.0-or-later
// A whole scene as plain pointers, all that the stages of the integrator read.
#pragma once

#include "kernel/camera.h"
#include "kernel/env_sampler.h"
#include "kernel/filter.h"
#include "kernel/material.h"

namespace skytree {

struct EnvironmentView {
  LatLongImage image;
  EnvSamplerView sampler;
  Mat3 world_to_env;  // rotation
  Vec3 color;         // factor on the image
  bool visible;       // to camera rays
};

struct SceneView {
  const MeshView* meshes;
  const InstanceView* instances;
  const int32_t* instance_materials;
  const MaterialView* materials;
  MaterialTables tables;
  EnvironmentView environment;
  CameraView camera;
  bool has_emission;      // some material emits
  bool has_transparency;  // some material lets rays through
};

struct RenderSettings {
  uint32_t seed;
  int max_bounces;  // 0: the environment as the first surface sees it
  bool film_transparent;
  bool bsdf_sampling;          // off: light samples alone, without MIS
  const float* filter_table;   // kFilterTableSize
  bool light_sampling = true;  // off: BSDF samples alone, without MIS
  bool blue_noise = false;     // neighbouring pixels' errors differ (kernel/rng.h)
};

/// Where in the map a world direction points.
SKY_HD Vec2 environment_uv(const EnvironmentView& environment, Vec3 direction) {
  return latlong_uv(environment.world_to_env * direction);
}

/// Radiance of the environment along a world direction.
SKY_HD Vec3 environment_radiance(const EnvironmentView& environment, Vec3 direction) {
  return environment.color *
         lookup_bilinear(environment.image, environment.world_to_env * direction);
}

}  // namespace skytree
