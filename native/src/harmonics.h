// SPDX-License-Identifier: GPL-3.0-or-later
// Irradiance by nine spherical-harmonic coefficients: R. Ramamoorthi and P. Hanrahan, "An Efficient
// Representation for Irradiance Environment Maps", SIGGRAPH 2001. BIASED, for comparison and
// teaching: diffuse surfaces without occlusion, the bands from 3 on (about 1 % of the power in
// theory, more where suns are) left out.
#pragma once

#include <array>

#include "kernel/latlong.h"

namespace skytree {

/// Coefficients L_lm of radiance in the order (0,0), (1,-1), (1,0), (1,1), (2,-2) … (2,2), RGB, of
/// the real harmonics; exact for radiance that is constant in each texel. Bad texels count as
/// black. Throws std::invalid_argument for an empty image.
std::array<std::array<double, 3>, 9> harmonic_coefficients(const LatLongImage& image);

/// Irradiance on a surface with this unit normal, in the map's frame.
Vec3 harmonic_irradiance(const std::array<std::array<double, 3>, 9>& coefficients, Vec3 normal);

}  // namespace skytree
