// SPDX-License-Identifier: GPL-3.0-or-later
// BRDFs as tables over half and difference vectors (kernel/tabulated_brdf.h): of Ward's and the GGX
// model, made here, and measured ones from MERL files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "kernel/tabulated_brdf.h"

namespace skytree {

/// Cells along (theta_h, phi_h, theta_d, phi_d).
struct BrdfTableSize {
  int half_theta, half_phi, diff_theta, diff_phi;
};

class BrdfTable {
 public:
  /// Values as BrdfTableView describes them; negative ones, infinities and NaN count as 0. Throws
  /// std::invalid_argument if the number of values is wrong or a stretch is not in (0, 1].
  BrdfTable(std::vector<float> values, BrdfTableSize size, int channels, Vec2 stretch = {1, 1});

  BrdfTableView view() const;
  const BrdfTableSize& size() const { return size_; }
  int channels() const { return channels_; }
  Vec2 stretch() const { return stretch_; }
  size_t nbytes() const { return values_.size() * sizeof(float); }
  bool isotropic() const { return size_.half_phi == 1; }

 private:
  std::vector<float> values_;
  BrdfTableSize size_;
  int channels_;
  Vec2 stretch_;
};

using BrdfTablePointer = std::shared_ptr<const BrdfTable>;

/// Reflection models of the renderer (kernel/ward.h, kernel/microfacet.h) with reflectance 1;
/// alphas in [0.001, 1]. Equal alphas give an isotropic table. With `stretched`, an elongated lobe
/// is round in its table; without, the table is as a measured one would be. A size of 0 means a
/// default.
BrdfTablePointer make_ward_table(float alpha_x, float alpha_y, bool stretched = true,
                                 BrdfTableSize size = {0, 0, 0, 0});
BrdfTablePointer make_ggx_table(float alpha_x, float alpha_y, bool stretched = true,
                                BrdfTableSize size = {0, 0, 0, 0});

constexpr BrdfTableSize kMerlSize = {90, 1, 90, 180};

/// A file of the MERL BRDF database: three int32 (90, 90, 180), then red, green and blue as
/// doubles, to be scaled by 1, 1.15 and 1.66 over 1500. What lies below the horizon is negative
/// there; it takes the value of the steepest valid direction, so that interpolation does not darken
/// grazing light. Throws std::runtime_error that names the file and what is wrong with it.
BrdfTablePointer read_merl(const std::string& path);

}  // namespace skytree
