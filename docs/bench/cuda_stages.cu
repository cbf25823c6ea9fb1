// SPDX-License-Identifier: GPL-3.0-or-later
// The stages of a path as kernels of their own, as a wavefront renderer would launch them: compiled
// by cuda_kernels.py to see what each would need, never run. docs/cuda.md draws the conclusion.
#include "cuda/kernel_parameters.h"

namespace skytree::cuda {

struct StageParameters {
  PassParameters pass;
  PathState* paths;
  Hit* hits;
  Connection* connections;  // two a path
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
  Connection connections[2];
  int made = 0;
  const VertexRandom random =
      vertex_random(path.seed, p.sample, path.bounce + path.transparent_bounces);
  p.alive[i] = shade(p.pass.scene, p.pass.settings, p.hits[i], random, &path, connections, &made);
  for (int k = 0; k < made; ++k) p.connections[2 * i + k] = connections[k];
  p.connection_counts[i] = made;
  p.paths[i] = path;
}

__global__ void __launch_bounds__(kThreads)
    stage_connect(const __grid_constant__ StageParameters p) {
  const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;
  if (i >= p.count) return;
  for (int k = 0; k < p.connection_counts[i]; ++k) {
    Connection connection = p.connections[2 * i + k];
    uint32_t rays = 0;
    if (trace_connection(p.pass.scene, p.pass.tracer, &connection, &rays)) {
      const Vec2 uv = environment_uv(p.pass.scene.environment, connection.ray.direction);
      p.paths[i].radiance += connection_radiance(p.pass.scene, connection, uv);
    }
  }
}

}  // extern "C"

}  // namespace skytree::cuda
