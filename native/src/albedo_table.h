// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

namespace skytree {

/// The table that kernel/material.h's dielectric_albedo reads; computed on first use.
const float* dielectric_albedo_table();

}  // namespace skytree
