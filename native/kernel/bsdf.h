// SPDX-License-Identifier: GPL-3.0-or-later
// The lobes that every material is made of: Lambert, Oren-Nayar, GGX with three kinds of Fresnel,
// Ward, tables. Each lobe is evaluated, sampled and given its pdf in one place; all directions
// point away from the surface, in world space.
#pragma once

#include "kernel/microfacet.h"
#include "kernel/oren_nayar.h"
#include "kernel/tabulated_brdf.h"
#include "kernel/ward.h"

namespace skytree {

enum class LobeType : int32_t {
  kDiffuse,
  kGlossy,
  kDielectric,
  kMetal,
  kWard,
  kRoughDiffuse,
  kTabulated
};

/// One reflection lobe of a surface.
struct Lobe {
  LobeType type;
  float select;                     // probability with which sampling chooses it
  Vec3 weight;                      // reflectance factor, the closure's weight included
  Vec3 normal, tangent, bitangent;  // shading frame; the last two are unset for the diffuse ones
  float alpha_x, alpha_y;
  float eta;  // kDielectric
  union {
    OrenNayar rough;                 // kRoughDiffuse
    const TabulatedBrdfView* table;  // kTabulated
  };
  Vec3 f0;  // kMetal: reflectance at normal incidence; kRoughDiffuse: weight of repeated bounces
};

/// f is the BSDF times the cosine at the shading normal, pdf per steradian.
struct BsdfValue {
  Vec3 f;
  float pdf;
};

SKY_HD Vec3 to_local(const Lobe& lobe, Vec3 w) {
  return {dot(w, lobe.tangent), dot(w, lobe.bitangent), dot(w, lobe.normal)};
}
SKY_HD Vec3 to_world(const Lobe& lobe, Vec3 w) {
  return lobe.tangent * w.x + lobe.bitangent * w.y + lobe.normal * w.z;
}

SKY_HD Vec3 lobe_fresnel(const Lobe& lobe, float cosine) {
  if (lobe.type == LobeType::kDielectric) {
    const float f = fresnel_dielectric(cosine, lobe.eta);
    return {f, f, f};
  }
  if (lobe.type == LobeType::kMetal) {
    const float s = schlick_weight(cosine);
    return lobe.f0 + (Vec3{1, 1, 1} - lobe.f0) * s;
  }
  return {1, 1, 1};
}

SKY_HD BsdfValue eval_ggx(const Lobe& lobe, Vec3 wo, Vec3 wi) {
  const Vec3 o = to_local(lobe, wo);
  const Vec3 i = to_local(lobe, wi);
  if (o.z <= 0.0f || i.z <= 0.0f) return {{0, 0, 0}, 0.0f};
  const Vec3 h = normalize(o + i);
  const float lambda_o = ggx_lambda(o, lobe.alpha_x, lobe.alpha_y);
  const float lambda_i = ggx_lambda(i, lobe.alpha_x, lobe.alpha_y);
  const float common = ggx_distribution(h, lobe.alpha_x, lobe.alpha_y) / (4.0f * o.z);
  const Vec3 f =
      lobe.weight * lobe_fresnel(lobe, dot(o, h)) * (common / (1.0f + lambda_o + lambda_i));
  return {f, common / (1.0f + lambda_o)};
}

/// The colour enters single scattering once and what bounces between facets more often.
SKY_HD BsdfValue eval_rough_diffuse(const Lobe& lobe, Vec3 wo, Vec3 wi) {
  const float cos_i = dot(lobe.normal, wi);
  const float cos_o = maxf(dot(lobe.normal, wo), 1e-4f);
  if (cos_i <= 0.0f) return {{0, 0, 0}, 0.0f};
  const OrenNayar& model = lobe.rough;
  const float single = oren_nayar_single(model, cos_o, cos_i, dot(wo, wi));
  const float lost = (1.0f - oren_nayar_albedo(model, cos_o)) *
                     (1.0f - oren_nayar_albedo(model, cos_i)) / (1.0f - model.average);
  return {(lobe.weight * single + lobe.f0 * (lost * kInvPi)) * cos_i, cos_i * kInvPi};
}

/// A call on a device, as few surfaces have tables.
SKY_HD_RARE BsdfValue eval_table(const Lobe& lobe, Vec3 wo, Vec3 wi) {
  const Vec3 o = to_local(lobe, wo);
  const Vec3 i = to_local(lobe, wi);
  if (o.z <= 0.0f || i.z <= 0.0f) return {{0, 0, 0}, 0.0f};
  const Vec3 f = brdf_table_value(lobe.table->table, o, i);
  return {lobe.weight * f * i.z, brdf_pdf(*lobe.table, o, i)};
}

SKY_HD_RARE Vec3 sample_table(const Lobe& lobe, Vec3 wo, Vec2 u) {
  const Vec3 o = to_local(lobe, wo);
  return normalize(to_world(lobe, brdf_sample(*lobe.table, {o.x, o.y, maxf(o.z, 0.0f)}, u)));
}

SKY_HD BsdfValue eval_lobe(const Lobe& lobe, Vec3 wo, Vec3 wi) {
  if (lobe.type == LobeType::kDiffuse) {
    const float pdf = maxf(dot(lobe.normal, wi), 0.0f) * kInvPi;
    return {lobe.weight * pdf, pdf};
  }
  if (lobe.type == LobeType::kRoughDiffuse) return eval_rough_diffuse(lobe, wo, wi);
  if (lobe.type == LobeType::kWard) {
    const Vec3 o = to_local(lobe, wo);
    const Vec3 i = to_local(lobe, wi);
    if (o.z <= 0.0f || i.z <= 0.0f) return {{0, 0, 0}, 0.0f};
    const WardValue value = ward_eval(o, i, lobe.alpha_x, lobe.alpha_y);
    return {lobe.weight * value.f_cos, value.pdf};
  }
  if (lobe.type == LobeType::kTabulated) return eval_table(lobe, wo, wi);
  return eval_ggx(lobe, wo, wi);
}

/// A direction drawn from the lobe; it may lie below the surface, where eval_lobe gives zero.
SKY_HD Vec3 sample_lobe(const Lobe& lobe, Vec3 wo, Vec2 u) {
  if (lobe.type == LobeType::kDiffuse || lobe.type == LobeType::kRoughDiffuse) {
    Vec3 tangent, bitangent;
    orthonormal_basis(lobe.normal, &tangent, &bitangent);
    float sine, cosine;
    sky_sincos_turns(u.x, &sine, &cosine);
    const float r = sqrtf(u.y);
    return tangent * (r * cosine) + bitangent * (r * sine) + lobe.normal * sqrtf(1.0f - u.y);
  }
  if (lobe.type == LobeType::kTabulated) return sample_table(lobe, wo, u);
  const Vec3 o = to_local(lobe, wo);
  const Vec3 h = lobe.type == LobeType::kWard
                     ? ward_sample_half_vector(lobe.alpha_x, lobe.alpha_y, u)
                     : ggx_sample_visible_normal(o, lobe.alpha_x, lobe.alpha_y, u);
  return normalize(to_world(lobe, h * (2.0f * dot(o, h)) - o));
}

}  // namespace skytree
