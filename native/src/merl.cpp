// SPDX-License-Identifier: GPL-3.0-or-later
// Reader of MERL BRDF files: W. Matusik, H. Pfister, M. Brand, L. McMillan, "A Data-Driven
// Reflectance Model", SIGGRAPH 2003.
#include <cstdint>
#include <fstream>
#include <stdexcept>

#include "src/brdf_table.h"

namespace skytree {
namespace {

constexpr double kScale[3] = {1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0};

[[noreturn]] void fail(const std::string& path, const std::string& why) {
  throw std::runtime_error("MERL file \"" + path + "\": " + why);
}

}  // namespace

BrdfTablePointer read_merl(const std::string& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) fail(path, "cannot be opened; check the path and whether it may be read");
  const std::streamoff bytes = file.tellg();
  file.seekg(0);
  const BrdfTableSize& size = kMerlSize;
  const size_t cells = size_t(size.half_theta) * size_t(size.diff_theta) * size_t(size.diff_phi);
  const std::streamoff wanted = std::streamoff(3 * sizeof(int32_t) + 3 * cells * sizeof(double));
  int32_t header[3] = {0, 0, 0};
  if (bytes < std::streamoff(sizeof header) ||
      !file.read(reinterpret_cast<char*>(header), sizeof header)) {
    fail(path, "is no MERL file: it is too short even for the header");
  }
  if (header[0] != size.half_theta || header[1] != size.diff_theta || header[2] != size.diff_phi) {
    fail(path, "is no MERL file: its header says " + std::to_string(header[0]) + " x " +
                   std::to_string(header[1]) + " x " + std::to_string(header[2]) +
                   " cells instead of 90 x 90 x 180");
  }
  if (bytes != wanted) {
    fail(path, std::string(bytes < wanted ? "is truncated" : "has data after its end") + ": " +
                   std::to_string(bytes) + " bytes instead of " + std::to_string(wanted) +
                   "; fetch it again");
  }
  std::vector<double> plane(cells);
  std::vector<float> values(3 * cells);
  for (size_t channel = 0; channel < 3; ++channel) {
    if (!file.read(reinterpret_cast<char*>(plane.data()),
                   std::streamsize(cells * sizeof(double)))) {
      fail(path, "cannot be read to its end");
    }
    for (size_t i = 0; i < cells; ++i) values[3 * i + channel] = float(plane[i] * kScale[channel]);
  }
  // theta_d rises along the rows; beyond the horizon its last valid value is carried on.
  const size_t columns = size_t(size.diff_phi) * 3, rows = size_t(size.diff_theta);
  size_t valid = 0;
  for (size_t h = 0; h < size_t(size.half_theta); ++h) {
    for (size_t k = 0; k < columns; ++k) {
      float last = 0.0f;
      for (size_t d = 0; d < rows; ++d) {
        float& value = values[(h * rows + d) * columns + k];
        if (value >= 0.0f && value <= 3.4e38f) {
          last = value;
          ++valid;
        } else {
          value = last;
        }
      }
    }
  }
  if (valid == 0) fail(path, "has no valid value; all are negative or not finite");
  return std::make_shared<BrdfTable>(std::move(values), size, 3);
}

}  // namespace skytree
