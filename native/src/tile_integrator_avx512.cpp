// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled with -mavx512f and its like, where the compiler knows that option; else empty.
#if defined(__AVX512F__)

#include "kernel/pilot.h"
#include "src/tile_integrator.h"

#define SKYTREE_ISA avx512
#define SKYTREE_LANES 16
#include "src/tile_integrator_body.h"

namespace skytree {

extern const RenderTile render_tile_avx512;
const RenderTile render_tile_avx512 = avx512::render_tile;

}  // namespace skytree

#endif
