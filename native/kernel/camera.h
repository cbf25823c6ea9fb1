// SPDX-License-Identifier: GPL-3.0-or-later
// Camera rays for any projection matrix whose planes of constant depth are not tilted: perspective
// and orthographic, with any shift, which is every matrix that Blender makes for these two.
#pragma once

#include "kernel/vec.h"

namespace skytree {

struct Ray {
  Vec3 origin;
  float t_min;
  Vec3 direction;
  float t_max;
};

/// On the near plane, and from there to the far plane, both are affine in normalised device
/// coordinates (x,y).
struct CameraView {
  Vec3 near_center, near_dx, near_dy;
  Vec3 span_center, span_dx, span_dy;
  float width, height;  // of the whole film, pixels
};

/// The ray through film position (x,y) in pixels from the lower left corner; it ends at the far
/// plane.
SKY_HD Ray camera_ray(const CameraView& camera, float x, float y) {
  const float ndc_x = 2.0f * x / camera.width - 1.0f;
  const float ndc_y = 2.0f * y / camera.height - 1.0f;
  const Vec3 origin = camera.near_center + camera.near_dx * ndc_x + camera.near_dy * ndc_y;
  const Vec3 span = camera.span_center + camera.span_dx * ndc_x + camera.span_dy * ndc_y;
  const float distance = length(span);
  return {origin, 0.0f, span * (1.0f / distance), distance};
}

}  // namespace skytree
