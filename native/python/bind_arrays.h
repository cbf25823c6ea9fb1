// SPDX-License-Identifier: GPL-3.0-or-later
// What several bindings ask of arrays and settings, with messages that name them.
#pragma once

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "bindings.h"
#include "src/split_criterion.h"

namespace skytree {

using FloatArray = pybind11::array_t<float, pybind11::array::c_style | pybind11::array::forcecast>;

inline std::string shape_text(const pybind11::array& array) {
  std::string text = "(";
  for (pybind11::ssize_t i = 0; i < array.ndim(); ++i) {
    text += (i ? ", " : "") + std::to_string(array.shape(i));
  }
  return text + (array.ndim() == 1 ? ",)" : ")");
}

/// An array of floating-point numbers, or std::invalid_argument that names it.
inline pybind11::array require_float_array(const pybind11::object& value, const char* name) {
  const pybind11::array array = pybind11::array::ensure(value);
  if (!array) {
    PyErr_Clear();
    throw std::invalid_argument(std::string(name) + " is not an array");
  }
  if (array.dtype().kind() != 'f') {
    throw std::invalid_argument(std::string(name) + " has dtype " +
                                pybind11::str(pybind11::object(array.dtype())).cast<std::string>() +
                                "; it must hold floating-point numbers");
  }
  return array;
}

inline FloatArray require_image(const pybind11::object& value) {
  const pybind11::array array = require_float_array(value, "image");
  if (array.ndim() != 3 || array.shape(2) != 3 || array.shape(0) < 1 || array.shape(1) < 1) {
    throw std::invalid_argument("image has shape " + shape_text(array) +
                                "; it must be (height, width, 3), linear RGB, not empty");
  }
  return FloatArray(array);
}

inline LatLongImage image_view(const FloatArray& image) {
  if (image.shape(0) > INT32_MAX || image.shape(1) > INT32_MAX)
    return {image.data(), INT32_MAX, INT32_MAX};
  return {image.data(), (int)image.shape(1), (int)image.shape(0)};
}

inline pybind11::array require_triples(const pybind11::object& value, const char* name) {
  const pybind11::array array = require_float_array(value, name);
  if (array.ndim() != 2 || array.shape(1) != 3) {
    throw std::invalid_argument(std::string(name) + " has shape " + shape_text(array) +
                                "; it must be (n, 3)");
  }
  return array;
}

inline std::string row_text(const char* name, size_t row, const double* v) {
  return std::string(name) + "[" + std::to_string(row) + "] is (" + std::to_string(v[0]) + ", " +
         std::to_string(v[1]) + ", " + std::to_string(v[2]) + ")";
}

/// Rows of three, each passed through `convert` (three doubles, row) -> Vec3, which may throw.
template <typename Convert>
std::vector<Vec3> convert_rows(const pybind11::array& array, const Convert& convert) {
  std::vector<Vec3> rows((size_t)array.shape(0));
  const auto convert_all = [&](const auto* data) {
    for (size_t i = 0; i < rows.size(); ++i) {
      const double v[3] = {data[3 * i], data[3 * i + 1], data[3 * i + 2]};
      rows[i] = convert(v, i);
    }
  };
  if (pybind11::isinstance<FloatArray>(array)) {
    convert_all(FloatArray(array).data());
  } else {
    convert_all(
        pybind11::array_t<double, pybind11::array::c_style | pybind11::array::forcecast>(array)
            .data());
  }
  return rows;
}

inline Vec3 unit_direction(const double* v, size_t row) {
  const double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
  if (!(square > 0.0 && square < INFINITY)) {
    throw std::invalid_argument(row_text("directions", row, v) + ", which is no direction");
  }
  // What sample() returned must stay as it is, bit by bit, or its pdf may differ.
  const double scale = std::abs(square - 1.0) < 1e-5 ? 1.0 : 1.0 / std::sqrt(square);
  return {(float)(scale * v[0]), (float)(scale * v[1]), (float)(scale * v[2])};
}

template <typename Enum>
struct Choice {
  const char* name;
  Enum value;
};

template <typename Enum, size_t N>
Enum parse(const std::string& text, const char* setting, const Choice<Enum> (&choices)[N]) {
  std::string names;
  for (const auto& choice : choices) {
    if (text == choice.name) return choice.value;
    names += (names.empty() ? "" : ", ") + std::string(choice.name);
  }
  throw std::invalid_argument(std::string(setting) + " is \"" + text + "\"; it must be one of " +
                              names);
}

constexpr Choice<SplitCriterion> kSplitCriteria[] = {{"RANGE", SplitCriterion::RANGE},
                                                     {"VARIANCE", SplitCriterion::VARIANCE},
                                                     {"SSE", SplitCriterion::SSE},
                                                     {"MIN_VARIANCE", SplitCriterion::MIN_VARIANCE},
                                                     {"MEDIAN_CUT", SplitCriterion::MEDIAN_CUT}};
constexpr Choice<Statistics> kStatistics[] = {{"RADIANCE", Statistics::RADIANCE},
                                              {"PIXELS", Statistics::PIXELS}};

}  // namespace skytree
