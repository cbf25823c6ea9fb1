// SPDX-License-Identifier: GPL-3.0-or-later
// Triangle meshes, instances, and the surface point that a hit describes.
#pragma once

#include <stdint.h>

#include "kernel/vec.h"

namespace skytree {

/// What a ray tracer answers. Plain data: no tracer's own types reach the kernel.
struct Hit {
  int32_t instance;  // -1: the ray left the scene
  int32_t triangle;
  float u, v;  // barycentric: p = (1-u-v) p0 + u p1 + v p2
  float t;
};

/// Borrowed arrays of one mesh; optional ones are null.
struct MeshView {
  const float* positions;         // (V,3)
  const int32_t* triangles;       // (T,3) into positions
  const int32_t* corners;         // (T,3) into the corner arrays; null: corner 3t+k
  const float* corner_normals;    // (C,3) unit; null: flat
  const float* corner_uvs;        // (C,2)
  const float* corner_tangents;   // (C,3)
  const int32_t* material_slots;  // (T,); null: slot 0
  Vec3 center, inverse_size;      // of the bounding box, for generated coordinates
};

struct InstanceView {
  Mat3 linear;  // object to world
  Vec3 translation;
  Mat3 normal;  // inverse transpose of linear
  int32_t mesh;
  int32_t first_material;  // into SceneView::instance_materials
  int32_t slot_count;
};

/// A point on a surface, in world space.
struct Surface {
  Vec3 position;
  Vec3 geometric_normal;  // unit, on the viewer's side
  Vec3 normal;            // shading normal, unit, on the same side
  float side;  // -1 where the viewer is behind the surface and both normals were turned over
  Vec2 uv;
  int32_t material;      // -1: none
  float position_error;  // scale of what rounds where rays leave and meet the surface
};

SKY_HD Vec3 load3(const float* array, int64_t i) {
  return {array[3 * i], array[3 * i + 1], array[3 * i + 2]};
}

SKY_HD Vec3 interpolate(Vec3 a, Vec3 b, Vec3 c, float u, float v) {
  return a * (1.0f - u - v) + b * u + c * v;
}

SKY_HD Vec3 abs_components(Vec3 v) { return {fabsf(v.x), fabsf(v.y), fabsf(v.z)}; }

SKY_HD Vec3 max_components(Vec3 a, Vec3 b) {
  return {maxf(a.x, b.x), maxf(a.y, b.y), maxf(a.z, b.z)};
}

SKY_HD float max_abs_component(Vec3 v) { return maxf(fabsf(v.x), maxf(fabsf(v.y), fabsf(v.z))); }

/// `v` if it has a length, otherwise `fallback`.
SKY_HD Vec3 normalize_or(Vec3 v, Vec3 fallback) {
  const float squared = dot(v, v);
  return squared > 1e-30f ? v * (1.0f / sqrtf(squared)) : fallback;
}

/// Index into a mesh's corner arrays.
SKY_HD int64_t corner_index(const MeshView& mesh, int32_t triangle, int k) {
  const int64_t i = 3 * static_cast<int64_t>(triangle) + k;
  return mesh.corners ? mesh.corners[i] : i;
}

/// A point of an instance's mesh in world space.
SKY_HD Vec3 place(const InstanceView& instance, Vec3 local) {
  return instance.linear * local + instance.translation;
}

/// The tangent that anisotropy is measured from. Without tangents of its own a mesh gets circles
/// around its local z axis, from generated coordinates, as Cycles does where no Tangent node is
/// linked.
SKY_HD_RARE Vec3 surface_tangent(const MeshView& mesh, const InstanceView& instance, const Hit& hit,
                                 Vec3 normal) {
  Vec3 tangent;
  if (mesh.corner_tangents) {
    const Vec3 local =
        interpolate(load3(mesh.corner_tangents, corner_index(mesh, hit.triangle, 0)),
                    load3(mesh.corner_tangents, corner_index(mesh, hit.triangle, 1)),
                    load3(mesh.corner_tangents, corner_index(mesh, hit.triangle, 2)), hit.u, hit.v);
    tangent = instance.linear * local;
  } else {
    const int32_t* t = mesh.triangles + 3 * static_cast<int64_t>(hit.triangle);
    const Vec3 p = interpolate(load3(mesh.positions, t[0]), load3(mesh.positions, t[1]),
                               load3(mesh.positions, t[2]), hit.u, hit.v);
    const Vec3 generated = (p - mesh.center) * mesh.inverse_size;
    tangent = instance.normal * Vec3{-generated.y, generated.x, 0.0f};
  }
  Vec3 fallback, unused;
  orthonormal_basis(normal, &fallback, &unused);
  return normalize_or(tangent - normal * dot(tangent, normal), fallback);
}

/// The directions in which u and v grow on a triangle, orthogonal to `normal`, which is the outward
/// shading normal; false where there are no UVs to tell. Flat across a triangle, where Blender
/// smooths tangents over its corners.
SKY_HD_RARE bool uv_frame(const MeshView& mesh, const InstanceView& instance, const Hit& hit,
                          Vec3 normal, Vec3* tangent, Vec3* bitangent) {
  if (!mesh.corner_uvs) return false;
  const int32_t* t = mesh.triangles + 3 * static_cast<int64_t>(hit.triangle);
  const Vec3 p0 = load3(mesh.positions, t[0]);
  const Vec3 edge1 = load3(mesh.positions, t[1]) - p0;
  const Vec3 edge2 = load3(mesh.positions, t[2]) - p0;
  const float* a = mesh.corner_uvs + 2 * corner_index(mesh, hit.triangle, 0);
  const float* b = mesh.corner_uvs + 2 * corner_index(mesh, hit.triangle, 1);
  const float* c = mesh.corner_uvs + 2 * corner_index(mesh, hit.triangle, 2);
  const float u1 = b[0] - a[0], v1 = b[1] - a[1], u2 = c[0] - a[0], v2 = c[1] - a[1];
  const float sign = u1 * v2 - u2 * v1 < 0.0f ? -1.0f : 1.0f;
  const Vec3 along_u = instance.linear * ((edge1 * v2 - edge2 * v1) * sign);
  const Vec3 along_v = instance.linear * ((edge2 * u1 - edge1 * u2) * sign);
  const Vec3 x = along_u - normal * dot(along_u, normal);
  const float squared = dot(x, x);
  if (!(squared > 1e-30f)) return false;
  *tangent = x * (1.0f / sqrtf(squared));
  *bitangent = cross(normal, *tangent);
  // The picture may be laid on mirrored, or the instance be.
  if (dot(*bitangent, along_v) < 0.0f) *bitangent = -*bitangent;
  return true;
}

/// What of a mesh the shape of one of its triangles depends on. Plain numbers, so that those of
/// many hits can be fetched before the first is worked on.
struct Facet {
  Vec3 p0, p1, p2;
  Vec3 n0, n1, n2;  // shading normals at the corners; 0 where the mesh is flat
};

SKY_HD Facet load_facet(const MeshView& mesh, int32_t triangle) {
  const int32_t* t = mesh.triangles + 3 * static_cast<int64_t>(triangle);
  Facet facet = {load3(mesh.positions, t[0]),
                 load3(mesh.positions, t[1]),
                 load3(mesh.positions, t[2]),
                 {0, 0, 0},
                 {0, 0, 0},
                 {0, 0, 0}};
  if (mesh.corner_normals) {
    facet.n0 = load3(mesh.corner_normals, corner_index(mesh, triangle, 0));
    facet.n1 = load3(mesh.corner_normals, corner_index(mesh, triangle, 1));
    facet.n2 = load3(mesh.corner_normals, corner_index(mesh, triangle, 2));
  }
  return facet;
}

/// The surface at (u, v) of a facet that an instance places, seen along the unit direction `view`
/// (from the surface to the viewer), but for its uv and material.
SKY_HD Surface facet_surface(const Facet& facet, const Mat3& linear, Vec3 translation,
                             const Mat3& normal_matrix, float u, float v, Vec3 view) {
  Surface surface;
  // From the barycentric coordinates and not from the ray: a distance along a long ray rounds far
  // more coarsely.
  const Vec3 local = interpolate(facet.p0, facet.p1, facet.p2, u, v);
  surface.position = linear * local + translation;
  surface.position_error =
      max_abs_component(surface.position) + max_abs_component(translation) +
      max_abs_component(local) *
          max_abs_component({max_abs_component(linear.row[0]), max_abs_component(linear.row[1]),
                             max_abs_component(linear.row[2])});

  // Through the inverse transpose like the shading normals, so that both stay on the same side
  // under mirroring.
  Vec3 geometric =
      normalize_or(normal_matrix * cross(facet.p1 - facet.p0, facet.p2 - facet.p0), view);
  const float side = dot(geometric, view) < 0.0f ? -1.0f : 1.0f;
  geometric = geometric * side;
  // Large triangles: as coarsely as its vertices round, so does the plane through them, also where
  // it passes near the origin.
  const Vec3 extent = max_components(
      abs_components(facet.p0), max_components(abs_components(facet.p1), abs_components(facet.p2)));
  const Vec3 reach = {dot(abs_components(linear.row[0]), extent),
                      dot(abs_components(linear.row[1]), extent),
                      dot(abs_components(linear.row[2]), extent)};
  surface.position_error += dot(abs_components(geometric), reach);
  const Vec3 shading = interpolate(facet.n0, facet.n1, facet.n2, u, v);
  surface.normal = normalize_or(normal_matrix * shading * side, geometric);
  surface.geometric_normal = geometric;
  surface.side = side;
  return surface;
}

/// (0,0) on a mesh without UVs.
SKY_HD Vec2 surface_uv(const MeshView& mesh, const Hit& hit) {
  if (!mesh.corner_uvs) return {0.0f, 0.0f};
  const float w = 1.0f - hit.u - hit.v;
  const float* a = mesh.corner_uvs + 2 * corner_index(mesh, hit.triangle, 0);
  const float* b = mesh.corner_uvs + 2 * corner_index(mesh, hit.triangle, 1);
  const float* c = mesh.corner_uvs + 2 * corner_index(mesh, hit.triangle, 2);
  return {a[0] * w + b[0] * hit.u + c[0] * hit.v, a[1] * w + b[1] * hit.u + c[1] * hit.v};
}

/// -1: none.
SKY_HD int32_t surface_material(const MeshView& mesh, const InstanceView& instance,
                                const int32_t* instance_materials, int32_t triangle) {
  int32_t slot = mesh.material_slots ? mesh.material_slots[triangle] : 0;
  if (slot >= instance.slot_count) slot = instance.slot_count - 1;  // as Blender clamps it
  return slot < 0 ? -1 : instance_materials[instance.first_material + slot];
}

/// The surface at `hit`, seen along the unit direction `view`.
SKY_HD Surface make_surface(const MeshView& mesh, const InstanceView& instance,
                            const int32_t* instance_materials, const Hit& hit, Vec3 view) {
  Surface surface = facet_surface(load_facet(mesh, hit.triangle), instance.linear,
                                  instance.translation, instance.normal, hit.u, hit.v, view);
  surface.uv = surface_uv(mesh, hit);
  surface.material = surface_material(mesh, instance, instance_materials, hit.triangle);
  return surface;
}

/// Where a ray in `direction` starts, so that it does not meet the triangle it leaves.
SKY_HD Vec3 offset_origin(const Surface& surface, Vec3 direction) {
  const float side = dot(surface.geometric_normal, direction) < 0.0f ? -1.0f : 1.0f;
  // 16 roundings of float: several times what the transforms and the tracer's own arithmetic lose.
  const float distance = surface.position_error * (16.0f * 5.96e-8f);
  return surface.position + surface.geometric_normal * (side * distance);
}

}  // namespace skytree
