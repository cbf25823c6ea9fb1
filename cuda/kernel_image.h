// SPDX-License-Identifier: GPL-3.0-or-later
// The compiled kernels, embedded into the library by CMake: a fat binary, or nothing where there
// was no nvcc.
#pragma once

#include <cstddef>

namespace skytree::cuda {

/// Null in a build without nvcc.
const void* kernel_image();
size_t kernel_image_bytes();

/// Version of the CUDA toolkit that made the kernels, as 1000 * major + 10 * minor; 0 without
/// kernels.
int kernel_toolkit_version();

}  // namespace skytree::cuda
