// SPDX-License-Identifier: GPL-3.0-or-later
// What lets one header serve g++, clang and nvcc. Kernel headers hold plain data and functions
// only: no STL, no exceptions, no allocation, no virtual calls.
#pragma once

#if defined(__CUDACC__)
#define SKY_HD static __host__ __device__ inline
// What few surfaces need: a call. Inlined, its registers would be every path's, who
// would spill others for them (docs/cuda.md).
#define SKY_HD_RARE static __host__ __device__ __noinline__
// What several places need and most paths reach: one copy for all. A copy for each makes the
// renderer many times as long as the instruction caches, and warps wait for instructions
// (docs/cuda.md).
#define SKY_HD_CALL static __host__ __device__ __noinline__
#else
// static: the host compiles these headers for several instruction sets, and of equal functions the
// linker would keep any one, with instructions that the processor may lack.
#define SKY_HD static inline
#define SKY_HD_CALL static inline
#define SKY_HD_RARE [[gnu::noinline, maybe_unused]] static
#endif

#if defined(__CUDA_ARCH__)
#define SKY_ASSERT(condition) ((void)0)
#else
#include <cassert>
#define SKY_ASSERT(condition) assert(condition)
#endif
