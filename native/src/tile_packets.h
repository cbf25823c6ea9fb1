// SPDX-License-Identifier: GPL-3.0-or-later
// Rays of a batch through Embree, a packet at a time. Included by tile_integrator_body.h inside the
// namespace of an instruction set, which says how many lanes a packet has.
#pragma once

namespace skytree {
namespace SKYTREE_ISA {

#if SKYTREE_LANES == 16
using RayPacket = RTCRay16;
using RayHitPacket = RTCRayHit16;
#else
using RayPacket = RTCRay8;
using RayHitPacket = RTCRayHit8;
#endif
constexpr int kLanes = SKYTREE_LANES;

static void intersect(const IntegratorJob& job, const int* valid, RTCIntersectContext* context,
                      RayHitPacket* packet) {
#if SKYTREE_LANES == 16
  job.intersect16(valid, job.tree, context, packet);
#else
  job.intersect8(valid, job.tree, context, packet);
#endif
}

static void occluded(const IntegratorJob& job, const int* valid, RTCIntersectContext* context,
                     RayPacket* packet) {
#if SKYTREE_LANES == 16
  job.occluded16(valid, job.tree, context, packet);
#else
  job.occluded8(valid, job.tree, context, packet);
#endif
}

/// What all packets have in common.
static void clear_packet(RayPacket* packet) {
  for (int lane = 0; lane < kLanes; ++lane) {
    packet->time[lane] = 0.0f;
    packet->mask[lane] = ~0u;
    packet->id[lane] = 0;
    packet->flags[lane] = 0;
  }
}

/// Rays ray_at(first), ... into a packet; lanes beyond count repeat the first and are switched off.
template <class RayAt>
static void fill_packet(RayPacket* packet, int* valid, int first, int count, const RayAt& ray_at) {
  for (int lane = 0; lane < kLanes; ++lane) {
    const bool used = first + lane < count;
    const Ray& ray = ray_at(used ? first + lane : first);
    valid[lane] = used ? -1 : 0;
    packet->org_x[lane] = ray.origin.x;
    packet->org_y[lane] = ray.origin.y;
    packet->org_z[lane] = ray.origin.z;
    packet->dir_x[lane] = ray.direction.x;
    packet->dir_y[lane] = ray.direction.y;
    packet->dir_z[lane] = ray.direction.z;
    packet->tnear[lane] = ray.t_min;
    packet->tfar[lane] = ray.t_max;
  }
}

/// The same of rays that are arrays, with room for a packet's copy beyond the last; all begin at
/// t = 0.
static void copy_packet(RayPacket* packet, int* valid, int first, int count, const float* origin_x,
                        const float* origin_y, const float* origin_z, const float* direction_x,
                        const float* direction_y, const float* direction_z) {
  constexpr size_t kBytes = kLanes * sizeof(float);
  memcpy(packet->org_x, origin_x + first, kBytes);
  memcpy(packet->org_y, origin_y + first, kBytes);
  memcpy(packet->org_z, origin_z + first, kBytes);
  memcpy(packet->dir_x, direction_x + first, kBytes);
  memcpy(packet->dir_y, direction_y + first, kBytes);
  memcpy(packet->dir_z, direction_z + first, kBytes);
  for (int lane = 0; lane < kLanes; ++lane) {
    valid[lane] = first + lane < count ? -1 : 0;
    packet->tnear[lane] = 0.0f;
  }
  // Lanes that are switched off repeat the first, as in fill_packet: nothing of another packet is
  // left.
  for (int lane = count - first; lane < kLanes; ++lane) {
    packet->org_x[lane] = packet->org_x[0];
    packet->org_y[lane] = packet->org_y[0];
    packet->org_z[lane] = packet->org_z[0];
    packet->dir_x[lane] = packet->dir_x[0];
    packet->dir_y[lane] = packet->dir_y[0];
    packet->dir_z[lane] = packet->dir_z[0];
  }
}

/// hits[i] for ray i < count; fill(packet, valid, first) fills in the rays of a packet.
template <class Fill>
static void trace_closest(const IntegratorJob& job, int count, bool coherent, Hit* hits,
                          const Fill& fill) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  if (coherent) context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  alignas(64) int valid[kLanes];
  RayHitPacket packet;
  clear_packet(&packet.ray);
  for (int first = 0; first < count; first += kLanes) {
    fill(&packet.ray, valid, first);
    for (int lane = 0; lane < kLanes; ++lane) packet.hit.geomID[lane] = RTC_INVALID_GEOMETRY_ID;
    intersect(job, valid, &context, &packet);
    for (int lane = 0; lane < kLanes && first + lane < count; ++lane) {
      const bool hit = packet.hit.geomID[lane] != RTC_INVALID_GEOMETRY_ID;
      // Geometries at the top level are numbered as instances are: some are instances, some the
      // triangles of one (TreeKind).
      const uint32_t through = packet.hit.instID[0][lane];
      const uint32_t instance =
          through != RTC_INVALID_GEOMETRY_ID ? through : packet.hit.geomID[lane];
      hits[first + lane] = {hit ? static_cast<int32_t>(instance) : -1,
                            static_cast<int32_t>(packet.hit.primID[lane]), packet.hit.u[lane],
                            packet.hit.v[lane], packet.ray.tfar[lane]};
    }
  }
}

/// Connections of a batch, each member an array, so that packets are filled by copying.
struct Connections {
  static constexpr int kCapacity = kMaxConnections * kTilePixels;
  // Room for a packet's copy beyond the last.
  Vectors<kCapacity + 48> origin, direction, weight;
  float map_u[kCapacity], map_v[kCapacity];
  int path[kCapacity];
  uint32_t guide_record[kCapacity];
  float half[kCapacity];
  bool occluded[kCapacity];
  int count;
};

SKY_HD void append(const Connection& connection, int path, Connections* connections) {
  const int i = connections->count++;
  connections->origin.set(i, connection.ray.origin);
  connections->direction.set(i, connection.ray.direction);
  connections->weight.set(i, connection.weight);
  connections->map_u[i] = connection.map.x;
  connections->map_v[i] = connection.map.y;
  connections->path[i] = path;
  connections->guide_record[i] = connection.guide_record;
  connections->half[i] = connection.half;
}

SKY_HD Connection connection_at(const Connections& connections, int i) {
  return {{connections.origin.get(i), 0.0f, connections.direction.get(i), INFINITY},
          connections.weight.get(i),
          {connections.map_u[i], connections.map_v[i]},
          connections.guide_record[i],
          connections.half[i]};
}

/// Whether anything is in the way of the connections.
static void trace_any(const IntegratorJob& job, Connections* connections) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  alignas(64) int valid[kLanes];
  RayPacket packet;
  clear_packet(&packet);
  for (int first = 0; first < connections->count; first += kLanes) {
    const auto &o = connections->origin, &d = connections->direction;
    copy_packet(&packet, valid, first, connections->count, o.x, o.y, o.z, d.x, d.y, d.z);
    for (int lane = 0; lane < kLanes; ++lane) packet.tfar[lane] = INFINITY;
    occluded(job, valid, &context, &packet);
    for (int lane = 0; lane < kLanes && first + lane < connections->count; ++lane) {
      connections->occluded[first + lane] = packet.tfar[lane] < 0.0f;
    }
  }
}

/// trace_any where surfaces may be transparent: surface after surface, each dims the connection.
/// `hits` and `waiting` have room for all of them. Returns the number of rays.
static uint64_t trace_through(const IntegratorJob& job, Connections* connections, Hit* hits,
                              int* waiting) {
  uint64_t rays = 0;
  int left = connections->count;
  for (int i = 0; i < left; ++i) {
    connections->occluded[i] = true;
    waiting[i] = i;
  }
  for (int depth = 0; left > 0 && depth <= kMaxTransparentBounces; ++depth) {
    trace_closest(job, left, false, hits, [&](RayPacket* packet, int* valid, int first) {
      fill_packet(packet, valid, first, left,
                  [&](int i) { return connection_at(*connections, waiting[i]).ray; });
    });
    rays += left;
    int on = 0;
    for (int i = 0; i < left; ++i) {
      const int k = waiting[i];
      Connection connection = connection_at(*connections, k);
      if (hits[i].instance < 0) {
        connections->occluded[k] = false;
      } else if (pass_through(job.scene, hits[i], &connection)) {
        connections->origin.set(k, connection.ray.origin);
        connections->weight.set(k, connection.weight);
        waiting[on++] = k;
      }
    }
    left = on;
  }
  return rays;
}

}  // namespace SKYTREE_ISA
}  // namespace skytree
