// SPDX-License-Identifier: GPL-3.0-or-later
// Materials: a list of weighted closures, turned at each shading point into reflection lobes,
// emission and transparency. Parameters mean what they mean in Blender's nodes of the same name;
// docs/rendering.md names what differs.
#pragma once

#include "kernel/bsdf.h"
#include "kernel/geometry.h"
#include "kernel/texture.h"

namespace skytree {

enum class ClosureType : int32_t {
  kDiffuse,
  kGlossy,
  kWard,
  kPrincipled,
  kEmission,
  kTransparent,
  kTabulated
};

/// One node of a material with the product of the mix factors above it. Textures are indices, -1
/// for none; a texture multiplies the plain value.
struct Closure {
  ClosureType type = ClosureType::kDiffuse;
  float weight = 1.0f;
  Vec3 color = {0.8f, 0.8f, 0.8f};
  float roughness = 0.0f;
  float anisotropy = 0.0f;
  float rotation = 0.0f;                 // turns
  float alpha_x = 0.1f, alpha_y = 0.1f;  // Ward
  float metallic = 0.0f;
  float eta = 1.5f;  // Principled, IOR level applied
  Vec3 emission = {0, 0, 0};
  int32_t color_texture = -1;
  int32_t roughness_texture = -1;
  int32_t metallic_texture = -1;
  int32_t normal_texture = -1;  // tangent space, RGB = (n + 1) / 2
  float normal_strength = 1.0f;
  int32_t emission_texture = -1;
  int32_t brdf = -1;  // kTabulated
};

struct MaterialView {
  int32_t first_closure, closure_count;
};

/// A material may need this many lobes: Principled takes three, the others at most one.
constexpr int kMaxLobes = 12;

/// Everything a material does with light at one point. Lobes beyond `count` are unset.
struct Shading {
  Lobe lobes[kMaxLobes];
  int count;
  Vec3 emission;
  Vec3 transparency;
};

/// Directional albedo of dielectric GGX, what the layer below does not get. Axes: perceptual
/// roughness, cosine of the view angle, (eta-1)/(eta+1) from 0 to kAlbedoMaxSqrtF0.
constexpr int kAlbedoTableSize = 16;
constexpr float kAlbedoMaxSqrtF0 = 0.75f;

struct MaterialTables {
  const Closure* closures;
  const TextureView* textures;
  const float* dielectric_albedo;  // kAlbedoTableSize^3
  const TabulatedBrdfView* brdfs;
};

SKY_HD float dielectric_albedo(const float* table, float roughness, float cosine, float eta) {
  const int n = kAlbedoTableSize;
  const float position[3] = {
      clampf(roughness, 0.0f, 1.0f) * (n - 1), clampf(cosine, 0.0f, 1.0f) * (n - 1),
      clampf((eta - 1.0f) / (eta + 1.0f) / kAlbedoMaxSqrtF0, 0.0f, 1.0f) * (n - 1)};
  int cell[3];
  float fraction[3];
  for (int axis = 0; axis < 3; ++axis) {
    const int i = static_cast<int>(position[axis]);
    cell[axis] = i < n - 1 ? i : n - 2;
    fraction[axis] = position[axis] - static_cast<float>(cell[axis]);
  }
  float sum = 0.0f;
  for (int corner = 0; corner < 8; ++corner) {
    float weight = 1.0f;
    int index = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const int bit = (corner >> axis) & 1;
      weight *= bit ? fraction[axis] : 1.0f - fraction[axis];
      index = index * n + cell[axis] + bit;
    }
    sum += weight * table[index];
  }
  return sum;
}

SKY_HD Vec3 textured(const MaterialTables& tables, Vec3 value, int32_t texture, Vec2 uv) {
  return texture < 0 ? value : value * sample_texture(tables.textures[texture], uv);
}
SKY_HD float textured(const MaterialTables& tables, float value, int32_t texture, Vec2 uv) {
  return texture < 0 ? value : value * luminance(sample_texture(tables.textures[texture], uv));
}

/// Where reflections are computed the viewer must not be below the shading normal: bend the normal
/// until it is not.
SKY_HD Vec3 visible_normal(Vec3 normal, Vec3 geometric_normal, Vec3 view) {
  const float cosine = dot(normal, view);
  const float least = minf(0.01f, 0.9f * dot(geometric_normal, view));
  return cosine >= least ? normal
                         : normalize_or(normal + view * (least - cosine), geometric_normal);
}

/// The shading normal with the closure's normal map applied, on the viewer's side.
SKY_HD Vec3 mapped_normal(const MaterialTables& tables, const Closure& closure,
                          const MeshView& mesh, const InstanceView& instance, const Hit& hit,
                          const Surface& surface) {
  const Vec3 outward = surface.normal * surface.side;
  Vec3 tangent, bitangent;
  if (!uv_frame(mesh, instance, hit, outward, &tangent, &bitangent)) return surface.normal;
  const Vec3 rgb = sample_texture(tables.textures[closure.normal_texture], surface.uv);
  const Vec3 mapped =
      normalize_or(tangent * (2.0f * rgb.x - 1.0f) + bitangent * (2.0f * rgb.y - 1.0f) +
                       outward * (2.0f * rgb.z - 1.0f),
                   outward);
  const Vec3 blended = outward + (mapped - outward) * closure.normal_strength;
  return normalize_or(blended, outward) * surface.side;
}

/// A glossy lobe's frame: x along the tangent, turned by `rotation`.
SKY_HD void set_frame(Lobe* lobe, Vec3 normal, Vec3 tangent, float rotation) {
  const Vec3 y = normalize(cross(normal, tangent));
  const Vec3 x = cross(y, normal);
  float sine, cosine;
  sky_sincos_turns(rotation, &sine, &cosine);
  lobe->normal = normal;
  lobe->tangent = x * cosine + y * sine;
  lobe->bitangent = y * cosine - x * sine;
}

SKY_HD float mean_component(Vec3 v) { return (v.x + v.y + v.z) * (1.0f / 3.0f); }

/// Room for one more lobe. It counts once keep_lobe has been told its share.
SKY_HD Lobe* next_lobe(Shading* shading) {
  // The host refuses materials that could need more than kMaxLobes.
  return &shading->lobes[shading->count < kMaxLobes ? shading->count : kMaxLobes - 1];
}

/// Keeps the lobe unless it reflects nothing. `select` is its share before normalisation.
SKY_HD void keep_lobe(Shading* shading, Lobe* lobe, float select) {
  lobe->select = select;
  shading->count += select > 0.0f && shading->count < kMaxLobes;
}

SKY_HD void add_diffuse(Shading* shading, Vec3 normal, Vec3 weight) {
  Lobe* lobe = next_lobe(shading);
  lobe->type = LobeType::kDiffuse;
  lobe->normal = normal;
  lobe->weight = weight;
  keep_lobe(shading, lobe, mean_component(weight));
}

/// `weight` of the closure apart from its colour, which repeated bounces between facets take to a
/// higher power.
SKY_HD void add_rough_diffuse(Shading* shading, Vec3 normal, Vec3 color, float weight,
                              float roughness) {
  Lobe* lobe = next_lobe(shading);
  lobe->type = LobeType::kRoughDiffuse;
  lobe->normal = normal;
  lobe->rough = make_oren_nayar(roughness);
  const float average = lobe->rough.average;
  const Vec3 left = Vec3{1, 1, 1} - color * (1.0f - average);
  // The paper has color^2 here; Cycles, whose pictures these shall match, multiplies once more.
  lobe->f0 = color * color * color * (weight * average);
  // Colours far above 1, which only textures bring, would make the series diverge.
  lobe->f0 = {lobe->f0.x / maxf(left.x, 0.1f), lobe->f0.y / maxf(left.y, 0.1f),
              lobe->f0.z / maxf(left.z, 0.1f)};
  lobe->weight = color * weight;
  keep_lobe(shading, lobe, mean_component(lobe->weight));
}

/// The frame needs a tangent only where the lobe is anisotropic; fetching it costs more than the
/// lobe.
SKY_HD void set_glossy_frame(Lobe* lobe, Vec2 alpha, const MeshView& mesh,
                             const InstanceView& instance, const Hit& hit, Vec3 normal,
                             float rotation) {
  lobe->alpha_x = alpha.x;
  lobe->alpha_y = alpha.y;
  if (alpha.x == alpha.y) {
    lobe->normal = normal;
    orthonormal_basis(normal, &lobe->tangent, &lobe->bitangent);
  } else {
    set_frame(lobe, normal, surface_tangent(mesh, instance, hit, normal), rotation);
  }
}

/// A BRDF that the scene does not have reflects nothing.
SKY_HD void add_tabulated(const MaterialTables& tables, const Closure& closure,
                          const MeshView& mesh, const InstanceView& instance, const Hit& hit,
                          const Surface& surface, Vec3 normal, Shading* shading) {
  if (closure.brdf < 0) return;
  Lobe* lobe = next_lobe(shading);
  lobe->type = LobeType::kTabulated;
  lobe->table = &tables.brdfs[closure.brdf];
  // Unequal alphas ask for a tangent.
  const float elongated = lobe->table->table.half_phi > 1 ? 0.5f : 1.0f;
  set_glossy_frame(lobe, {1.0f, elongated}, mesh, instance, hit, normal, closure.rotation);
  lobe->weight =
      closure.weight * textured(tables, closure.color, closure.color_texture, surface.uv);
  keep_lobe(shading, lobe, mean_component(lobe->weight));
}

SKY_HD void add_principled(const MaterialTables& tables, const Closure& closure,
                           const Surface& surface, Vec3 normal, const Lobe& frame, float roughness,
                           Vec3 view, Shading* shading) {
  const Vec3 base = textured(tables, closure.color, closure.color_texture, surface.uv);
  const float metallic =
      clampf(textured(tables, closure.metallic, closure.metallic_texture, surface.uv), 0.0f, 1.0f);
  const float cosine = dot(normal, view);
  if (metallic > 0.0f) {
    Lobe* lobe = next_lobe(shading);
    *lobe = frame;
    lobe->type = LobeType::kMetal;
    lobe->f0 = base;
    const float w = closure.weight * metallic;
    lobe->weight = {w, w, w};
    keep_lobe(shading, lobe,
              w * mean_component(base + (Vec3{1, 1, 1} - base) * schlick_weight(cosine)));
  }
  const float rest = closure.weight * (1.0f - metallic);
  if (!(rest > 0.0f)) return;
  float albedo = 0.0f;
  if (closure.eta > 1.0f) {
    albedo = dielectric_albedo(tables.dielectric_albedo, roughness, cosine, closure.eta);
    Lobe* lobe = next_lobe(shading);
    *lobe = frame;
    lobe->type = LobeType::kDielectric;
    lobe->eta = closure.eta;
    lobe->weight = {rest, rest, rest};
    keep_lobe(shading, lobe, rest * albedo);
  }
  add_diffuse(shading, normal, base * (rest * (1.0f - albedo)));
}

/// What a material lets straight through.
SKY_HD Vec3 transparency(const MaterialTables& tables, const MaterialView& material, Vec2 uv) {
  Vec3 sum = {0, 0, 0};
  for (int i = 0; i < material.closure_count; ++i) {
    const Closure& closure = tables.closures[material.first_closure + i];
    if (closure.type != ClosureType::kTransparent) continue;
    sum += closure.weight * textured(tables, closure.color, closure.color_texture, uv);
  }
  return sum;
}

/// Lobes, emission and transparency of `material` at a surface seen from `view`; the lobes'
/// `select` sums to 1.
SKY_HD void evaluate_material(const MaterialTables& tables, const MaterialView& material,
                              const MeshView& mesh, const InstanceView& instance, const Hit& hit,
                              const Surface& surface, Vec3 view, Shading* shading) {
  shading->count = 0;
  shading->emission = {0, 0, 0};
  shading->transparency = transparency(tables, material, surface.uv);
  const Vec3 smooth = visible_normal(surface.normal, surface.geometric_normal, view);
  for (int i = 0; i < material.closure_count; ++i) {
    const Closure& closure = tables.closures[material.first_closure + i];
    const Vec3 normal =
        closure.normal_texture < 0
            ? smooth
            : visible_normal(mapped_normal(tables, closure, mesh, instance, hit, surface),
                             surface.geometric_normal, view);
    if (closure.type == ClosureType::kEmission || closure.type == ClosureType::kPrincipled) {
      shading->emission +=
          closure.weight * textured(tables, closure.emission, closure.emission_texture, surface.uv);
      if (closure.type == ClosureType::kEmission) continue;
    }
    if (closure.type == ClosureType::kTransparent) continue;
    const float roughness = clampf(
        textured(tables, closure.roughness, closure.roughness_texture, surface.uv), 0.0f, 1.0f);
    if (closure.type == ClosureType::kDiffuse) {
      const Vec3 color = textured(tables, closure.color, closure.color_texture, surface.uv);
      if (roughness < 1e-3f) {
        add_diffuse(shading, normal, closure.weight * color);
      } else {
        add_rough_diffuse(shading, normal, color, closure.weight, roughness);
      }
      continue;
    }
    Vec2 alpha = {closure.alpha_x, closure.alpha_y};
    if (closure.type == ClosureType::kGlossy) alpha = glossy_alpha(roughness, closure.anisotropy);
    if (closure.type == ClosureType::kPrincipled) {
      alpha = principled_alpha(roughness, closure.anisotropy);
      Lobe frame;
      set_glossy_frame(&frame, alpha, mesh, instance, hit, normal, closure.rotation);
      add_principled(tables, closure, surface, normal, frame, roughness, view, shading);
      continue;
    }
    if (closure.type == ClosureType::kTabulated) {
      add_tabulated(tables, closure, mesh, instance, hit, surface, normal, shading);
      continue;
    }
    Lobe* lobe = next_lobe(shading);
    lobe->type = closure.type == ClosureType::kWard ? LobeType::kWard : LobeType::kGlossy;
    set_glossy_frame(lobe, alpha, mesh, instance, hit, normal, closure.rotation);
    lobe->weight =
        closure.weight * textured(tables, closure.color, closure.color_texture, surface.uv);
    keep_lobe(shading, lobe, mean_component(lobe->weight));
  }
  if (shading->count == 1) {
    shading->lobes[0].select = 1.0f;
    return;
  }
  float total = 0.0f;
  for (int i = 0; i < shading->count; ++i) total += shading->lobes[i].select;
  for (int i = 0; i < shading->count; ++i) shading->lobes[i].select *= 1.0f / total;
}

/// All lobes together. Light from behind the geometric surface is refused: there it would leak
/// through.
SKY_HD_CALL BsdfValue eval_bsdf(const Shading& shading, const Surface& surface, Vec3 wo, Vec3 wi) {
  BsdfValue sum = {{0, 0, 0}, 0.0f};
  if (dot(surface.geometric_normal, wi) <= 0.0f) return sum;
  for (int i = 0; i < shading.count; ++i) {
    const BsdfValue value = eval_lobe(shading.lobes[i], wo, wi);
    sum.f += value.f;
    sum.pdf += value.pdf * shading.lobes[i].select;
  }
  return sum;
}

/// A direction by one lobe chosen with `choice`; eval_bsdf gives its value and its pdf over all
/// lobes.
SKY_HD Vec3 sample_bsdf(const Shading& shading, Vec3 wo, float choice, Vec2 u) {
  int i = 0;
  while (i + 1 < shading.count && choice >= shading.lobes[i].select) {
    choice -= shading.lobes[i].select;
    ++i;
  }
  return sample_lobe(shading.lobes[i], wo, u);
}

}  // namespace skytree
