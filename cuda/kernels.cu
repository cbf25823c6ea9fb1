// SPDX-License-Identifier: GPL-3.0-or-later
// Thin wrappers: which thread computes what. What is computed stands in native/kernel, the same for
// the CPU.
//
// Where the tables live: kernel parameters are in constant memory (views, settings); the kd-tree's
// tables, about 50 KB at most, are read through L1, where they stay, since each block of threads
// reads them all over: shared memory would hold them no closer, and would cost a copy per block and
// the occupancy.
#include "cuda/kernel_parameters.h"
#include "kernel/draw_samples.h"

namespace skytree::cuda {
namespace {

__device__ uint32_t thread_index() { return blockIdx.x * blockDim.x + threadIdx.x; }

}  // namespace

extern "C" {

__global__ void __launch_bounds__(kThreads)
    sample_directions(const __grid_constant__ SampleParameters p) {
  const uint32_t i = thread_index();
  if (i < p.count) p.out[i] = sample_environment(p.sampler, p.u[i]);
}

__global__ void __launch_bounds__(kThreads) evaluate_pdf(const __grid_constant__ PdfParameters p) {
  const uint32_t i = thread_index();
  if (i < p.count) p.out[i] = environment_pdf(p.sampler, p.directions[i]);
}

__global__ void __launch_bounds__(kThreads)
    draw_directions(const __grid_constant__ DrawParameters p) {
  const uint32_t i = thread_index();
  if (i < p.count) p.sums[i] = draw_samples(p.sampler, i, p.samples);
}

__global__ void __launch_bounds__(kThreads) trace_rays(const __grid_constant__ TraceParameters p) {
  const uint32_t i = thread_index();
  if (i < p.count) p.out[i] = trace_ray(p.tracer, p.instances, p.rays[i], p.any);
}

__global__ void __launch_bounds__(kThreads) pilot_tiles(const __grid_constant__ PilotParameters p) {
  const uint32_t i = thread_index();
  if (i >= p.count) return;
  const int tile = static_cast<int>(i);
  p.factors[i] = pilot_tile(p.scene, p.tracer, p.settings, p.first_x + tile % p.columns,
                            p.first_y + tile / p.columns);
}

__global__ void __launch_bounds__(kThreads, kRenderBlocks)
    render_pass(const __grid_constant__ PassParameters p) {
  // A warp takes 8 x 4 neighbouring pixels: their rays visit the same nodes.
  const int lane = threadIdx.x & 31, warp = threadIdx.x >> 5;
  const int blocks_x = (p.width + kBlockWidth - 1) / kBlockWidth;
  const int x = static_cast<int>(blockIdx.x % blocks_x) * kBlockWidth + (warp & 1) * 8 + (lane & 7);
  const int y =
      static_cast<int>(blockIdx.x / blocks_x) * kBlockHeight + (warp >> 1) * 4 + (lane >> 3);
  if (x >= p.width || y >= p.height) return;
  FilmPixel* film = p.film + static_cast<int64_t>(y) * p.width + x;
  uint32_t rays = 0, sample = 0;
  int vertex = 0;
  PathState path;
  begin_path(p.scene, p.settings, p.x0 + x, p.y0 + y, p.first_sample, &path);
  // One loop over all vertices of all samples: a thread whose path has ended starts its next sample
  // while its neighbours still follow theirs, instead of waiting for the longest path of the warp.
  for (;;) {
    if (advance_path(p.scene, p.tracer, p.settings, vertex, &path, &rays)) {
      ++vertex;
      continue;
    }
    // Sums stay in memory: in registers they would take eight through all of the path, and be
    // spilt.
    if (!add_to_film({path.radiance, path.alpha, 0}, film)) atomicAdd(&p.counters->rejected, 1ull);
    if (++sample == p.sample_count) break;
    begin_path(p.scene, p.settings, p.x0 + x, p.y0 + y, p.first_sample + sample, &path);
    vertex = 0;
  }
  atomicAdd(&p.counters->rays, static_cast<unsigned long long>(rays));
}

__global__ void __launch_bounds__(kThreads)
    resolve_film(const __grid_constant__ ResolveParameters p) {
  const uint32_t i = thread_index();
  if (i == 0) *p.counters_out = *p.counters;
  if (i < p.count) p.means[i] = film_mean(p.film[i].radiance, p.film[i].alpha, p.scale);
}

}  // extern "C"

}  // namespace skytree::cuda
