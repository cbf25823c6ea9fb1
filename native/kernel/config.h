// SPDX-License-Identifier: GPL-3.0-or-later
// What lets one header serve g++, clang and nvcc. Kernel headers hold plain data and functions
// only: no STL, no exceptions, no allocation, no virtual calls.
#pragma once

#if defined(__CUDACC__)
#define SKY_HD static __host__ __device__ inline
#else
// static: the host compiles these headers for several instruction sets, and of equal functions the
// linker would keep any one, with instructions that the processor may lack.
#define SKY_HD static inline
#endif

#if defined(__CUDA_ARCH__)
#define SKY_ASSERT(condition) ((void)0)
#else
#include <cassert>
#define SKY_ASSERT(condition) assert(condition)
#endif
