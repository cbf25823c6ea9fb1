// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/tile_integrator.h"

#include <new>

#include "kernel/stages.h"

#define SKYTREE_ISA baseline
#include "src/tile_integrator_body.h"

namespace skytree {

// All versions lay the batch out alike; its size comes from this one.
struct alignas(64) TileScratch {
  baseline::Batch batch;
};
TileScratch* new_tile_scratch() { return new TileScratch; }
void delete_tile_scratch(TileScratch* scratch) { delete scratch; }

RenderTile select_render_tile() { return baseline::render_tile; }

}  // namespace skytree
