// SPDX-License-Identifier: GPL-3.0-or-later
// How much of the control variate (kernel/estimators.h) a tile of the film takes: before its first
// sample, a few pilot paths through it are followed without and with the variate.
//
// In the open the best factor is near 1. Where a roof hides the sky it is 0: there the variate
// would only bring noise. Pilot paths have random numbers of their own, so the factor is
// independent of every sample that it is used for, and they stay unbiased; and it depends on the
// scene, the seed and the tile only, so that bits depend on neither threads nor borders nor passes.
#pragma once

#include "kernel/stages.h"

namespace skytree {

constexpr int kPilotPaths = 32;

/// Position of pilot path `i` in its tile: an even grid, two of each four rows turned.
SKY_HD int pilot_x(int i) { return 4 * (i & 3) + (i >> 2) % 4; }
SKY_HD int pilot_y(int i) { return 2 * (i >> 2) + (i & 1); }

/// The settings that pilot paths are followed with: the first surface's light alone.
SKY_HD RenderSettings pilot_settings(const RenderSettings& settings, float control) {
  RenderSettings pilot = settings;
  pilot.seed = hash_u32(settings.seed + 0x70696c6fu);
  pilot.max_bounces = 0;
  pilot.point_count = 0;
  pilot.film_transparent = true;
  pilot.controls.factors = nullptr;
  pilot.control = control;
  return pilot;
}

struct PilotSums {
  float products, squares;
};

/// Takes in one pilot path: its radiance without and with the variate.
SKY_HD void add_pilot(Vec3 plain, Vec3 controlled, PilotSums* sums) {
  const Vec3 added = controlled - plain;
  const float product = dot(added, plain), square = dot(added, added);
  if (!(fabsf(product) + square < INFINITY)) return;
  sums->products += product;
  sums->squares += square;
}

/// The factor that makes the variance smallest, as a multiple of 1/4: a coarse one does nearly as
/// well, and devices whose rays differ by rounding agree on it.
SKY_HD float control_factor(const PilotSums& sums) {
  if (!(sums.squares > 0.0f)) return 0.0f;
  const float best = clampf(-sums.products / sums.squares, 0.0f, 1.0f);
  return 0.25f * floorf(4.0f * best + 0.5f);
}

}  // namespace skytree
