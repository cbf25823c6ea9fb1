// SPDX-License-Identifier: GPL-3.0-or-later
// Surfaces at a packet of hits: what they need is fetched hit by hit, which lets one hit's memory
// wait beside another's, and computed for all at once. Same kernel function and same bits as
// make_surface. Included by tile_integrator_body.h.
#pragma once

namespace skytree {
namespace SKYTREE_ISA {

/// Three rows or three corners.
struct Triples {
  Vectors<kLanes> part[3];

  void set(int i, Vec3 a, Vec3 b, Vec3 c) {
    part[0].set(i, a);
    part[1].set(i, b);
    part[2].set(i, c);
  }
  Mat3 matrix(int i) const { return {{part[0].get(i), part[1].get(i), part[2].get(i)}}; }
};

/// Lanes beyond the last hit repeat it.
struct LaneSurfaces {
  Triples corners, corner_normals, linear, normal_matrix;
  Vectors<kLanes> translation, view;
  float u[kLanes], v[kLanes];
  Vectors<kLanes> position, geometric_normal, normal;
  float side[kLanes], position_error[kLanes];

  Surface get(int i) const {
    Surface surface;
    surface.position = position.get(i);
    surface.geometric_normal = geometric_normal.get(i);
    surface.normal = normal.get(i);
    surface.side = side[i];
    surface.position_error = position_error[i];
    return surface;
  }
};

static void fetch_facet(const SceneView& scene, const Hit& hit, Vec3 view, int lane,
                        LaneSurfaces* surfaces) {
  const InstanceView& instance = scene.instances[hit.instance];
  const Facet facet = load_facet(scene.meshes[instance.mesh], hit.triangle);
  surfaces->corners.set(lane, facet.p0, facet.p1, facet.p2);
  surfaces->corner_normals.set(lane, facet.n0, facet.n1, facet.n2);
  surfaces->linear.set(lane, instance.linear.row[0], instance.linear.row[1],
                       instance.linear.row[2]);
  surfaces->normal_matrix.set(lane, instance.normal.row[0], instance.normal.row[1],
                              instance.normal.row[2]);
  surfaces->translation.set(lane, instance.translation);
  surfaces->view.set(lane, view);
  surfaces->u[lane] = hit.u;
  surfaces->v[lane] = hit.v;
}

SKY_LANE_LOOP void shape_surfaces(LaneSurfaces* surfaces) {
  SKY_VECTOR_LOOP
  for (int i = 0; i < kLanes; ++i) {
    const Triples &p = surfaces->corners, &n = surfaces->corner_normals;
    const Facet facet = {p.part[0].get(i), p.part[1].get(i), p.part[2].get(i),
                         n.part[0].get(i), n.part[1].get(i), n.part[2].get(i)};
    const Surface surface = facet_surface(
        facet, surfaces->linear.matrix(i), surfaces->translation.get(i),
        surfaces->normal_matrix.matrix(i), surfaces->u[i], surfaces->v[i], surfaces->view.get(i));
    surfaces->position.set(i, surface.position);
    surfaces->geometric_normal.set(i, surface.geometric_normal);
    surfaces->normal.set(i, surface.normal);
    surfaces->side[i] = surface.side;
    surfaces->position_error[i] = surface.position_error;
  }
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
