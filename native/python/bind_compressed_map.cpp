// SPDX-License-Identifier: GPL-3.0-or-later
// The compressed map for numpy, and its file.
#include <pybind11/stl/filesystem.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

#include "bind_arrays.h"
#include "bindings.h"
#include "src/compressed_map.h"

namespace py = pybind11;

namespace skytree {
namespace {

CompressedMap compress(const py::object& image, int64_t max_bytes,
                       const std::string& split_criterion, const std::string& statistics,
                       const std::optional<int32_t>& max_blocks) {
  const FloatArray array = require_image(image);
  CompressionConfig config;
  config.max_bytes = max_bytes;
  if (max_blocks) config.max_blocks = *max_blocks;
  config.split_criterion = parse(split_criterion, "split_criterion", kSplitCriteria);
  config.statistics = parse(statistics, "statistics", kStatistics);
  py::gil_scoped_release release;
  return CompressedMap::compress(image_view(array), config);
}

/// OSError of the kind that errno stands for (FileNotFoundError, PermissionError, ...).
[[noreturn]] void raise_os_error(const std::filesystem::path& path) {
  PyErr_SetFromErrnoWithFilename(PyExc_OSError, path.c_str());
  throw py::error_already_set();
}

CompressedMap load(const std::filesystem::path& path) {
  errno = 0;
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rb"),
                                                             std::fclose);
  if (!file) raise_os_error(path);
  std::vector<uint8_t> bytes;
  uint8_t chunk[1 << 14];
  while (const size_t count = std::fread(chunk, 1, sizeof chunk, file.get())) {
    bytes.insert(bytes.end(), chunk, chunk + count);
  }
  if (std::ferror(file.get())) raise_os_error(path);  // a directory, among others
  try {
    return CompressedMap::decode(std::move(bytes));
  } catch (const std::invalid_argument& problem) {
    throw std::invalid_argument(path.string() + ": " + problem.what());
  }
}

void save(const CompressedMap& map, const std::filesystem::path& path) {
  // Beside it first, so that a full disk leaves no half of a map under its name.
  std::filesystem::path part = path;
  part += ".part";
  errno = 0;
  {
    std::ofstream file(part, std::ios::binary);
    file.write((const char*)map.bytes().data(), (std::streamsize)map.bytes().size());
    file.close();
    if (!file) raise_os_error(part);
  }
  std::error_code problem;
  std::filesystem::rename(part, path, problem);
  if (problem) {
    errno = problem.value();
    raise_os_error(path);
  }
}

py::array_t<float> image(const CompressedMap& map) {
  py::array_t<float> out({(py::ssize_t)map.height(), (py::ssize_t)map.width(), (py::ssize_t)3});
  float* data = out.mutable_data();
  py::gil_scoped_release release;
  map.paint(data);
  return out;
}

py::array_t<int32_t> bounds(const CompressedMap& map) {
  py::array_t<int32_t> array({(py::ssize_t)map.rects().size(), (py::ssize_t)4});
  int32_t* out = array.mutable_data();
  for (const TexelRect& rect : map.rects()) {
    for (int32_t v : {rect.lo[0], rect.lo[1], rect.hi[0], rect.hi[1]}) *out++ = v;
  }
  return array;
}

py::array_t<float> colors(const CompressedMap& map) {
  py::array_t<float> array({(py::ssize_t)map.colors().size(), (py::ssize_t)3});
  float* out = array.mutable_data();
  for (const auto& color : map.colors()) out = std::copy(color.begin(), color.end(), out);
  return array;
}

}  // namespace

void bind_compressed_map(py::module_& m) {
  py::class_<CompressedMap>(m, "CompressedMap", R"(
A lat-long map as the blocks of a kd-tree, small enough for 48 KB (Ergun, Kurt and Ozturk, SCCG 2012, Figure 1).

image: (H, W, 3) linear RGB. max_bytes: of the file; as many blocks are made as fit. split_criterion, statistics: as in
KdTreeSampler. max_blocks: no more than these.

A file holds the tree, one colour for each block and a checksum. read_image() reads it like any other map.
Raises ValueError for a bad image or setting. Values that are NaN, infinite or negative count as 0.)")
      .def(py::init(&compress), py::arg("image"), py::arg("max_bytes") = 48 * 1024,
           py::arg("split_criterion") = "SSE", py::kw_only(), py::arg("statistics") = "RADIANCE",
           py::arg("max_blocks") = py::none())
      .def_static("load", &load, py::arg("path"), R"(
Reads a file. Raises OSError where it cannot be read, ValueError where it is no such map, is cut short or damaged, or was
written by a newer version; each names the file, the cause and what can be done.)")
      .def_static(
          "from_bytes",
          [](const py::bytes& data) {
            const std::string_view view = data;
            return CompressedMap::decode(std::vector<uint8_t>(view.begin(), view.end()));
          },
          py::arg("data"), "The same from the bytes of a file.")
      .def("save", &save, py::arg("path"), "Writes the file. Raises OSError where it cannot.")
      .def(
          "to_bytes",
          [](const CompressedMap& map) {
            return py::bytes((const char*)map.bytes().data(), map.bytes().size());
          },
          "The bytes of the file.")
      .def("image", &image, "The map with every block at its colour: (H, W, 3) float32.")
      .def_property_readonly("width", &CompressedMap::width, "Texels in a row.")
      .def_property_readonly("height", &CompressedMap::height, "Rows.")
      .def_property_readonly(
          "block_count", [](const CompressedMap& map) { return map.rects().size(); },
          "Number of blocks.")
      .def_property_readonly(
          "nbytes", [](const CompressedMap& map) { return map.bytes().size(); },
          "Bytes of the file.")
      .def_property_readonly("bounds", &bounds, R"(
(n, 4) int32: x0, y0, x1, y1 of each block in texels, x1 and y1 exclusive, depth first down the tree.)")
      .def_property_readonly("colors", &colors,
                             "(n, 3) float32: radiance of each block, in the order of bounds.");
}

}  // namespace skytree
