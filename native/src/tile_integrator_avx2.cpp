// SPDX-License-Identifier: GPL-3.0-or-later
// Compiled with -mavx2, where the compiler knows that option; else empty.
#if defined(__AVX2__)

#include "kernel/pilot.h"
#include "src/tile_integrator.h"

#define SKYTREE_ISA avx2
#define SKYTREE_LANES 8
#include "src/tile_integrator_body.h"

namespace skytree {

extern const RenderTile render_tile_avx2;
const RenderTile render_tile_avx2 = avx2::render_tile;

}  // namespace skytree

#endif
