// SPDX-License-Identifier: GPL-3.0-or-later
// One kernel for each way to draw a direction, so that cuda_samplers.py can count what each costs:
// in the renderer's own kernels they are branches of one switch.
#include "cuda/kernel_parameters.h"

namespace skytree::cuda {

extern "C" {

#define SKYTREE_SAMPLER_KERNEL(name, draw)                           \
  __global__ void name(const __grid_constant__ SampleParameters p) { \
    const uint32_t i = blockIdx.x * blockDim.x + threadIdx.x;        \
    if (i < p.count) p.out[i] = draw;                                \
  }

SKYTREE_SAMPLER_KERNEL(kdtree_fitted, sample_kdtree_rank(p.sampler.kdtree, p.u[i]))
SKYTREE_SAMPLER_KERNEL(kdtree_warp, sample_kdtree_warp(p.sampler.kdtree, p.u[i]))
SKYTREE_SAMPLER_KERNEL(kdtree_linear, sample_kdtree_linear(p.sampler.kdtree, p.u[i]))
SKYTREE_SAMPLER_KERNEL(inversion_guided, sample_inversion(p.sampler.inversion, p.u[i], true))
SKYTREE_SAMPLER_KERNEL(inversion_binary, sample_inversion(p.sampler.inversion, p.u[i], false))
SKYTREE_SAMPLER_KERNEL(alias, sample_alias_table(p.sampler.alias, p.u[i]))
SKYTREE_SAMPLER_KERNEL(uniform, sample_uniform_sphere(p.u[i]))

}  // extern "C"

}  // namespace skytree::cuda
