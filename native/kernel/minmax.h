// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "kernel/config.h"

namespace skytree {

// One instruction each; fminf and fmaxf become library calls on the host because of NaN. Here a NaN
// in the first argument gives the second one, and a NaN in the second one stays.
SKY_HD float minf(float a, float b) { return a < b ? a : b; }
SKY_HD float maxf(float a, float b) { return a > b ? a : b; }

}  // namespace skytree
