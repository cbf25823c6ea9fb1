// SPDX-License-Identifier: GPL-3.0-or-later
// Light of a map on a diffuse surface without its shadows, as a polynomial of the normal: what a
// control variate for next-event estimation needs. The clamped cosine max(x, 0) is close to a
// polynomial P(x) of degree 4 (its expansion in spherical harmonics up to the fourth band:
// R. Ramamoorthi, P. Hanrahan, "An Efficient Representation for Irradiance Environment Maps",
// SIGGRAPH 2001), and
//   G(n) = integral over the sphere of L(w) P(dot(n, w)) dw
// is then a polynomial of n, exact for the interpolated map, known once 25 moments of the map are.
#pragma once

#include "kernel/vec.h"

namespace skytree {

/// P(x): least squares on [-1, 1]; the bands of even degree above 4 are left out, odd ones above 1
/// are none.
SKY_HD float diffuse_polynomial(float x) {
  const float square = x * x;
  return 0.05859375f + 0.5f * x + square * (0.8203125f - 0.41015625f * square);
}

/// G as a linear and a homogeneous quartic polynomial (on the unit sphere the lower even degrees
/// are quartic too, times powers of x^2 + y^2 + z^2 = 1): 18 numbers a channel hold the 25 moments.
struct DiffuseMoments {
  Vec3 linear[3];    // RGB factors of x, y, z
  Vec3 quartic[15];  // of z^4; z^3 (x, y); z^2 (xx, xy, yy); z (xxx, xxy, xyy, yyy); xxxx ... yyyy
};

/// G(n), RGB: radiance times steradian. `n` has unit length and is in the map's frame. A channel
/// can be slightly negative, as P is between its zeros.
SKY_HD Vec3 diffuse_integral(const DiffuseMoments& moments, Vec3 n) {
  const Vec3* c = moments.quartic;
  const float x = n.x, y = n.y, z = n.z;
  const float xx = x * x, xy = x * y, yy = y * y;
  Vec3 sum = c[0] * z + (c[1] * x + c[2] * y);
  sum = sum * z + (c[3] * xx + c[4] * xy + c[5] * yy);
  sum = sum * z + ((c[6] * xx + c[7] * xy + c[8] * yy) * x + c[9] * (yy * y));
  sum = sum * z + ((c[10] * xx + c[11] * xy + c[12] * yy) * xx + (c[13] * xy + c[14] * yy) * yy);
  return sum + (moments.linear[0] * x + moments.linear[1] * y + moments.linear[2] * z);
}

}  // namespace skytree
