// SPDX-License-Identifier: GPL-3.0-or-later
// What several bindings ask of arrays and settings, with messages that name them.
#pragma once

#include <cstdint>
#include <string>

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

constexpr Choice<SplitCriterion> kSplitCriteria[] = {
    {"RANGE", SplitCriterion::RANGE},
    {"VARIANCE", SplitCriterion::VARIANCE},
    {"SSE", SplitCriterion::SSE},
    {"MIN_VARIANCE", SplitCriterion::MIN_VARIANCE}};
constexpr Choice<Statistics> kStatistics[] = {{"RADIANCE", Statistics::RADIANCE},
                                              {"PIXELS", Statistics::PIXELS}};

}  // namespace skytree
