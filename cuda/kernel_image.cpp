// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/kernel_image.h"

#ifdef SKYTREE_CUDA_IMAGE

// The assembler reads the file: no generated source of megabytes of numbers.
__asm__(
    ".section .rodata\n"
    ".balign 16\n"
    "skytree_cuda_image_begin:\n"
    ".incbin \"" SKYTREE_CUDA_IMAGE
    "\"\n"
    "skytree_cuda_image_end:\n"
    ".byte 0\n"  // PTX is text, and text ends with a zero
    ".previous\n");
extern "C" {
extern const char skytree_cuda_image_begin[] __attribute__((visibility("hidden")));
extern const char skytree_cuda_image_end[] __attribute__((visibility("hidden")));
}

namespace skytree::cuda {
const void* kernel_image() { return skytree_cuda_image_begin; }
size_t kernel_image_bytes() { return skytree_cuda_image_end - skytree_cuda_image_begin; }
int kernel_toolkit_version() { return SKYTREE_CUDA_TOOLKIT_VERSION; }
}  // namespace skytree::cuda

#else

namespace skytree::cuda {
const void* kernel_image() { return nullptr; }
size_t kernel_image_bytes() { return 0; }
int kernel_toolkit_version() { return 0; }
}  // namespace skytree::cuda

#endif
