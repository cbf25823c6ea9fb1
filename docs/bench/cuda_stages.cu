// SPDX-License-Identifier: GPL-3.0-or-later
// What render_pass could be instead: the stages of a path as kernels of their own, as a wavefront
// renderer would launch them, and persistent threads that fetch pixels. Compiled by cuda_kernels.py
// to see what each would need, never run. docs/cuda.md draws the conclusion.
#include "cuda/kernel_parameters.h"

namespace skytree::cuda {

struct StageParameters {
  PassParameters pass;
  PathState* paths;
  Hit* hits;
  Connection* connections;  // kMaxConnections a path
  int* connection_counts;
  bool* alive;
  uint32_t count, sample;
};

extern "C" {

__global__ void __launch_bounds__(kThreads) stage_trace(const __grid_constant__ StageParameters p) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i < p.count && p.alive[i]) {
    p.hits[i] = trace_ray(p.pass.tracer, p.pass.scene.instances, p.paths[i].ray, false);
  }
}

__global__ void __launch_bounds__(kThreads) stage_shade(const __grid_constant__ StageParameters p) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i >= p.count || !p.alive[i]) return;
  PathState path = p.paths[i];
  Connection connections[kMaxConnections];
  int made = 0;
  const int vertex = path.bounce + path.transparent_bounces;
  p.alive[i] = shade(p.pass.scene, p.pass.settings, p.hits[i], vertex, &path, connections, &made);
  for (int k = 0; k < made; ++k) p.connections[kMaxConnections * i + k] = connections[k];
  p.connection_counts[i] = made;
  p.paths[i] = path;
}

__global__ void __launch_bounds__(kThreads)
    stage_connect(const __grid_constant__ StageParameters p) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i >= p.count) return;
  for (int k = 0; k < p.connection_counts[i]; ++k) {
    Connection connection = p.connections[kMaxConnections * i + k];
    uint32_t rays = 0;
    if (trace_connection(p.pass.scene, p.pass.tracer, &connection, &rays)) {
      p.paths[i].radiance += connection.weight;
    }
  }
}

/// As many threads as fit, each fetching pixel after pixel until none is left.
__global__ void __launch_bounds__(kThreads, kRenderBlocks)
    persistent_pass(const __grid_constant__ PassParameters p, uint32_t* next) {
  const uint32_t count = static_cast<uint32_t>(p.width) * p.height;
  uint32_t pixel = atomicAdd(next, 1u);
  if (pixel >= count) return;
  uint32_t rays = 0, sample = 0;
  int vertex = 0;
  PathState path;
  begin_path(p.scene, p.settings, p.x0 + pixel % p.width, p.y0 + pixel / p.width, p.first_sample,
             &path);
  for (;;) {
    if (advance_path(p.scene, p.tracer, p.settings, vertex, &path, &rays)) {
      ++vertex;
      continue;
    }
    if (!add_to_film({path.radiance, path.alpha, 0}, p.film + pixel)) {
      atomicAdd(&p.counters->rejected, 1ull);
    }
    if (++sample == p.sample_count) {
      sample = 0;
      pixel = atomicAdd(next, 1u);
      if (pixel >= count) break;
    }
    begin_path(p.scene, p.settings, p.x0 + pixel % p.width, p.y0 + pixel / p.width,
               p.first_sample + sample, &path);
    vertex = 0;
  }
  atomicAdd(&p.counters->rays, static_cast<unsigned long long>(rays));
}

}  // extern "C"

}  // namespace skytree::cuda
