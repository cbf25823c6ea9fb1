// SPDX-License-Identifier: GPL-3.0-or-later
// Anisotropic GGX reflection in the local frame (z = shading normal): distribution,
// height-correlated masking, and sampling of the visible normals.
//
// B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007; E. Heitz,
// "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs", JCGT 3(2), 2014; J.
// Dupuy and A. Benyoub, "Sampling Visible GGX Normals with Spherical Caps", HPG 2023.
#pragma once

#include "kernel/math.h"
#include "kernel/vec.h"

namespace skytree {

/// D(h) for a unit half vector, per steradian.
SKY_HD float ggx_distribution(Vec3 h, float alpha_x, float alpha_y) {
  const float x = h.x / alpha_x;
  const float y = h.y / alpha_y;
  const float k = x * x + y * y + h.z * h.z;
  return kInvPi / (alpha_x * alpha_y * k * k);
}

SKY_HD float ggx_lambda(Vec3 w, float alpha_x, float alpha_y) {
  const float x = w.x * alpha_x;
  const float y = w.y * alpha_y;
  return 0.5f * (sqrtf(1.0f + (x * x + y * y) / (w.z * w.z)) - 1.0f);
}

/// A unit normal visible from `view` (view.z > 0), with density D G1 max(view.h, 0) / view.z.
SKY_HD Vec3 ggx_sample_visible_normal(Vec3 view, float alpha_x, float alpha_y, Vec2 u) {
  const Vec3 stretched = normalize({view.x * alpha_x, view.y * alpha_y, view.z});
  float sine, cosine;
  sky_sincos_turns(u.x, &sine, &cosine);
  const float z = (1.0f - u.y) * (1.0f + stretched.z) - stretched.z;
  const float r = sqrtf(clampf(1.0f - z * z, 0.0f, 1.0f));
  const Vec3 h = Vec3{r * cosine, r * sine, z} + stretched;
  return normalize({h.x * alpha_x, h.y * alpha_y, maxf(h.z, 1e-7f)});
}

/// Narrower than this a lobe is finer than a float direction resolves; it also stands for the
/// mirror.
constexpr float kLeastAlpha = 1e-4f;

/// Cycles' reading of anisotropy in [-1,1] for its Glossy BSDF node; alpha = roughness^2. Like
/// Cycles' it saturates: of a rough lobe only the one axis gets narrower.
SKY_HD Vec2 glossy_alpha(float roughness, float anisotropy) {
  const float alpha = maxf(roughness * roughness, kLeastAlpha);
  const float a = clampf(anisotropy, -0.99f, 0.99f);
  const float narrow = 1.0f - fabsf(a);
  const float least = maxf(alpha * narrow, kLeastAlpha);
  const float largest = minf(alpha / narrow, 1.0f);
  return a < 0.0f ? Vec2{largest, least} : Vec2{least, largest};
}

/// Cycles' reading of anisotropic in [0,1] for its Principled BSDF node.
SKY_HD Vec2 principled_alpha(float roughness, float anisotropic) {
  const float alpha = maxf(roughness * roughness, kLeastAlpha);
  const float aspect = sqrtf(1.0f - clampf(anisotropic, 0.0f, 1.0f) * 0.9f);
  return {minf(alpha / aspect, 1.0f), alpha * aspect};
}

/// Unpolarised Fresnel reflectance of a dielectric; eta = inside over outside.
SKY_HD float fresnel_dielectric(float cos_incident, float eta) {
  const float g_squared = eta * eta - 1.0f + cos_incident * cos_incident;
  if (g_squared <= 0.0f) return 1.0f;
  const float g = sqrtf(g_squared);
  const float a = (g - cos_incident) / (g + cos_incident);
  const float b =
      ((g + cos_incident) * cos_incident - 1.0f) / ((g - cos_incident) * cos_incident + 1.0f);
  return 0.5f * a * a * (1.0f + b * b);
}

SKY_HD float schlick_weight(float cosine) {
  const float m = clampf(1.0f - cosine, 0.0f, 1.0f);
  return (m * m) * (m * m) * m;
}

}  // namespace skytree
