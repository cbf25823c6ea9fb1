// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <memory>
#include <string>

#include "src/device_renderer.h"

namespace skytree {

/// For a device as Python names it: "CPU" (null), "CUDA" (the first GPU) or "CUDA:n". Throws
/// std::invalid_argument for anything else; a GPU that is not there shows when it shall render.
std::unique_ptr<DeviceRenderer> make_device_renderer(const std::string& device);

void bind_devices(pybind11::module_& m);
void bind_compressed_map(pybind11::module_& m);
void bind_samplers(pybind11::module_& m);
void bind_brdf(pybind11::module_& m);  // before bind_render
void bind_related(pybind11::module_& m);
void bind_render(pybind11::module_& m);

}  // namespace skytree
