// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

namespace skytree {

void bind_devices(pybind11::module_& m);
void bind_samplers(pybind11::module_& m);
void bind_render(pybind11::module_& m);

}  // namespace skytree
