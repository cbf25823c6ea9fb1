// SPDX-License-Identifier: GPL-3.0-or-later
// What each kernel takes: one struct by value, shared by host and device. Pointers in it are device
// pointers.
#pragma once

#include "kernel/path.h"

namespace skytree::cuda {

/// Launch width of every kernel; what shares a block is a tile of 16 x 8 pixels.
constexpr int kThreads = 128;
constexpr int kBlockWidth = 16, kBlockHeight = 8;
/// Blocks of render_pass that a multiprocessor shall hold: 80 registers a thread. What that spills
/// costs less than the warps bring (docs/cuda.md); .ci/tests/test_cuda_kernels.py watches over it.
constexpr int kRenderBlocks = 6;

/// sample_directions: out[i] = sample_environment(sampler, u[i]).
struct SampleParameters {
  EnvSamplerView sampler;
  const Vec3* u;
  DirectionSample* out;
  uint32_t count;
};

/// evaluate_pdf: out[i] = environment_pdf(sampler, directions[i]).
struct PdfParameters {
  EnvSamplerView sampler;
  const Vec3* directions;
  float* out;
  uint32_t count;
};

/// draw_directions: sums[i] = draw_samples(sampler, i, samples), for timing.
struct DrawParameters {
  EnvSamplerView sampler;
  float* sums;
  uint32_t count, samples;
};

/// trace_rays: out[i] = the hit of rays[i].
struct TraceParameters {
  TracerView tracer;
  const InstanceView* instances;
  const Ray* rays;
  Hit* out;
  uint32_t count;
  bool any;
};

/// pilot_tiles: factors[i] = pilot_tile of tile i, row by row from (first_x, first_y) on.
struct PilotParameters {
  SceneView scene;
  TracerView tracer;
  RenderSettings settings;
  int first_x, first_y, columns;
  uint32_t count;
  float* factors;
};

/// render_pass: adds samples first_sample … + sample_count - 1 of each pixel of the region to the
/// film.
struct PassParameters {
  SceneView scene;
  TracerView tracer;
  RenderSettings settings;
  int x0, y0, width, height;  // region, pixels
  uint32_t first_sample, sample_count;
  FilmPixel* film;  // height x width, bottom row first
  PassCounters* counters;
};

/// resolve_film: means of the film, and the counters beside them, for the copy to the host.
struct ResolveParameters {
  const FilmPixel* film;
  const PassCounters* counters;
  Rgba* means;
  PassCounters* counters_out;
  uint32_t count;  // pixels
  double scale;    // 1 / samples
};

}  // namespace skytree::cuda
