// SPDX-License-Identifier: GPL-3.0-or-later
// What a render can run on.
#include <algorithm>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "bindings.h"
#include "cuda/device_sampler.h"
#include "cuda/driver.h"
#include "cuda/kernel_image.h"
#include "cuda/renderer.h"
#include "cuda/sampler_timing.h"
#include "src/environment_sampler.h"

namespace py = pybind11;

namespace skytree {
namespace {

struct Device {
  std::string type, name, id;
};

std::string cpu_name() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    const size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos)
      return line.substr(colon + 2);
  }
  return "CPU";
}

std::vector<Device> devices() {
  std::vector<Device> all = {{"CPU", cpu_name(), "CPU"}};
  if (!cuda::kernel_image()) return all;
  for (const cuda::DeviceInfo& gpu : cuda::devices()) {
    all.push_back({"CUDA", gpu.name, "CUDA:" + std::to_string(gpu.ordinal)});
  }
  return all;
}

std::optional<std::string> cuda_problem() {
  if (!cuda::kernel_image()) {
    return "This build of Skytree has no CUDA kernels: it was made without nvcc.";
  }
  std::string reason;
  if (cuda::devices(&reason).empty()) return reason;
  return std::nullopt;
}

}  // namespace

std::unique_ptr<DeviceRenderer> make_device_renderer(const std::string& device) {
  if (device == "CPU") return nullptr;
  if (device == "CUDA") return cuda::make_renderer(0);
  const std::string prefix = "CUDA:";
  const std::string number = device.substr(std::min(prefix.size(), device.size()));
  const bool is_number = !number.empty() && number.size() <= 4 &&
                         number.find_first_not_of("0123456789") == std::string::npos;
  if (device.compare(0, prefix.size(), prefix) != 0 || !is_number) {
    throw std::invalid_argument("device must be \"CPU\", \"CUDA\" or \"CUDA:n\", not \"" + device +
                                "\"; devices() lists what is here");
  }
  return cuda::make_renderer(std::stoi(number));
}

void bind_devices(py::module_& m) {
  py::class_<Device>(m, "Device", "Something to render on.")
      .def_readonly("type", &Device::type, "\"CPU\" or \"CUDA\".")
      .def_readonly("name", &Device::name, "As the maker calls it.")
      .def_readonly("id", &Device::id,
                    "What RenderSession(device=...) takes: \"CPU\", \"CUDA:0\", ...")
      .def("__repr__", [](const Device& d) { return "<Device " + d.id + ": " + d.name + ">"; });
  m.def("devices", &devices,
        "What this machine can render on: the CPU first, then every usable GPU.");
  m.def(
      "_sampler_tables",
      [](const EnvironmentSampler& sampler) {
        const EnvSamplerView view = sampler.view();
        py::list tables;
        for (const cuda::SamplerTable& table : cuda::sampler_tables(view)) {
          tables.append(py::make_tuple(
              table.pointer_offset, py::bytes(static_cast<const char*>(table.data), table.bytes)));
        }
        return py::make_tuple(py::bytes(reinterpret_cast<const char*>(&view), sizeof view), tables);
      },
      "A sampler as kernels see it, for docs/bench/cuda_samplers.py: the view's bytes, and for "
      "each array behind it the "
      "offset of its pointer and its bytes.");
  m.def(
      "_time_sampler",
      [](const EnvironmentSampler& sampler, int gpu, uint32_t threads, uint32_t samples,
         int launches) {
        cuda::SamplerTiming timing;
        {
          py::gil_scoped_release release;
          timing = cuda::time_sampler(gpu, sampler.view(), threads, samples, launches);
        }
        return py::make_tuple(timing.seconds, py::array_t<float>(py::ssize_t(timing.sums.size()),
                                                                 timing.sums.data()));
      },
      py::arg("sampler"), py::arg("gpu"), py::arg("threads"), py::arg("samples"),
      py::arg("launches"),
      "Seconds of each launch of `threads` threads that draw `samples` directions each, and their "
      "sums, for docs/bench/cuda_samplers.py.");
  m.def("cuda_problem", &cuda_problem, "Why no GPU can be used, or None if one can.");
}

}  // namespace skytree
