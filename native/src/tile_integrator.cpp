// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/tile_integrator.h"

#include <new>

#include "kernel/pilot.h"

#define SKYTREE_ISA baseline
#define SKYTREE_LANES 8
#include "src/tile_integrator_body.h"

namespace skytree {

#if defined(SKYTREE_HAS_AVX2)
extern const RenderTile render_tile_avx2, render_tile_avx512;
#endif

// All versions lay the batch out alike; its size comes from this one.
struct alignas(64) TileScratch {
  baseline::Batch batch;
};
TileScratch* new_tile_scratch() { return new TileScratch; }
void delete_tile_scratch(TileScratch* scratch) { delete scratch; }

RenderTile select_render_tile() {
#if defined(SKYTREE_HAS_AVX2)
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
      embree().GetDeviceProperty(embree().device, RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED)) {
    return render_tile_avx512;
  }
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2")) return render_tile_avx2;
#endif
  return baseline::render_tile;
}

}  // namespace skytree
