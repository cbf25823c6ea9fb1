// SPDX-License-Identifier: GPL-3.0-or-later
// Methods of the related work, for comparison and teaching (docs/related.md).
#include "bind_arrays.h"
#include "src/filtered_map.h"
#include "src/harmonics.h"
#include "src/hierarchy_sampler.h"

namespace py = pybind11;

namespace skytree {
namespace {

using Coefficients = std::array<std::array<double, 3>, 9>;

std::shared_ptr<FilteredMap> make_filtered(const py::object& image, int64_t samples,
                                           double overlap) {
  const FloatArray array = require_image(image);
  FilterConfig config;
  config.samples = (int)std::min<int64_t>(std::max<int64_t>(samples, 0), INT32_MAX);
  config.overlap = overlap;
  py::gil_scoped_release release;
  return std::make_shared<FilteredMap>(image_view(array), config);
}

FloatArray look_up(const FilteredMap& map, const py::object& image, const py::object& directions,
                   const FloatArray& pdf) {
  const FloatArray texels = require_image(image);
  const std::vector<Vec3> rows =
      convert_rows(require_triples(directions, "directions"), unit_direction);
  const bool is_one = pdf.ndim() == 0;
  if (!is_one && (pdf.ndim() != 1 || pdf.shape(0) != (py::ssize_t)rows.size())) {
    throw std::invalid_argument("pdf has shape " + shape_text(pdf) +
                                "; it must be one number, or one for each direction");
  }
  for (py::ssize_t i = 0; i < pdf.size(); ++i) {
    if (!(pdf.data()[i] > 0.0f)) throw std::invalid_argument("pdf must be above 0");
  }
  FloatArray out({(py::ssize_t)rows.size(), (py::ssize_t)3});
  float* data = out.mutable_data();
  const float* density = pdf.data();
  const LatLongImage view = image_view(texels);
  py::gil_scoped_release release;
  const FilteredView chain = map.view().filtered;
  for (size_t i = 0; i < rows.size(); ++i) {
    const Vec3 rgb = filtered_radiance(chain, view, latlong_uv(rows[i]), density[is_one ? 0 : i]);
    for (const float channel : {rgb.x, rgb.y, rgb.z}) *data++ = channel;
  }
  return out;
}

std::shared_ptr<HierarchySampler> make_hierarchy(const py::object& image, int threads) {
  const FloatArray array = require_image(image);
  py::gil_scoped_release release;
  return std::make_shared<HierarchySampler>(image_view(array), threads);
}

py::array_t<double> coefficients(const py::object& image) {
  const FloatArray array = require_image(image);
  Coefficients result;
  {
    py::gil_scoped_release release;
    result = harmonic_coefficients(image_view(array));
  }
  py::array_t<double> out({(py::ssize_t)9, (py::ssize_t)3});
  for (int i = 0; i < 27; ++i) out.mutable_data()[i] = result[i / 3][i % 3];
  return out;
}

FloatArray irradiance(const py::array_t<double, py::array::c_style | py::array::forcecast>& given,
                      const py::object& normals) {
  if (given.ndim() != 2 || given.shape(0) != 9 || given.shape(1) != 3) {
    throw std::invalid_argument("coefficients has shape " + shape_text(given) +
                                "; it must be (9, 3), as harmonic_coefficients() returns it");
  }
  Coefficients values;
  for (int i = 0; i < 27; ++i) values[i / 3][i % 3] = given.data()[i];
  const std::vector<Vec3> rows = convert_rows(require_triples(normals, "normals"), unit_direction);
  FloatArray out({(py::ssize_t)rows.size(), (py::ssize_t)3});
  float* data = out.mutable_data();
  for (const Vec3 normal : rows) {
    const Vec3 rgb = harmonic_irradiance(values, normal);
    for (const float channel : {rgb.x, rgb.y, rgb.z}) *data++ = channel;
  }
  return out;
}

}  // namespace

void bind_related(py::module_& m) {
  py::class_<HierarchySampler, EnvironmentSampler, std::shared_ptr<HierarchySampler>>(
      m, "HierarchySampler", R"(
Hierarchical sample warping down a pyramid of sums over texels (McCool and Harwood 1997; Clarberg et al. 2005), for
comparison and teaching. Keeps stratification of (u[:, 1], u[:, 2]); 4/3 floats a texel; every level is visited.

image: (H, W, 3) linear RGB. Weights as InversionSampler's. threads build, 0: all cores. Raises ValueError for a bad image.)")
      .def(py::init(&make_hierarchy), py::arg("image"), py::kw_only(), py::arg("threads") = 0)
      .def_property_readonly("build_seconds", &HierarchySampler::build_seconds,
                             "Seconds that building the pyramid took.");

  py::class_<FilteredMap, EnvironmentSampler, std::shared_ptr<FilteredMap>>(m, "FilteredMap", R"(
Filtered importance sampling (Krivanek and Colbert 2008). BIASED: for comparison, teaching and quick looks.

Given to a RenderSession or a Scene as the sampler, it replaces light samples: each BSDF sample looks up the map's mean over
the solid angle overlap / (samples * pdf), in a prefiltered chain. Little noise; detail finer than that is lost however many
samples are taken, and the filter is round where an anisotropic lobe is not. What the sample's ray meets hides all of it.

image: (H, W, 3) linear RGB, the one that is rendered. samples: how many a pixel is meant to take; more blur no less.
overlap: 4 as in the paper, 1 as in GPU Gems 3, chapter 20. sample() and pdf() raise ValueError: it draws no directions.

Raises ValueError for a bad image or setting. Values that are NaN, infinite or negative count as 0.)")
      .def(py::init(&make_filtered), py::arg("image"), py::arg("samples") = 64, py::kw_only(),
           py::arg("overlap") = 4.0)
      .def("lookup", &look_up, py::arg("image"), py::arg("directions"), py::arg("pdf"), R"(
Radiance that BSDF samples with this pdf (per steradian; one number or (n,)) bring from directions (n, 3): (n, 3) float32.
image: the one that the map was made of. ValueError for another shape, a pdf of 0 and a vector that is no direction.)")
      .def_property_readonly(
          "samples", [](const FilteredMap& map) { return map.config().samples; },
          "How many samples of a pixel the filter is made for.")
      .def_property_readonly("level_count", &FilteredMap::level_count,
                             "Levels of the chain above the map itself.")
      .def_property_readonly("build_seconds", &FilteredMap::build_seconds,
                             "Seconds that filtering took.");

  m.def("harmonic_coefficients", &coefficients, py::arg("image"), R"(
Nine spherical-harmonic coefficients of a map's radiance (Ramamoorthi and Hanrahan 2001): (9, 3) float64, RGB, in the order
(0,0), (1,-1), (1,0), (1,1), (2,-2) ... (2,2) of the real harmonics. image: (H, W, 3). ValueError for a bad image.)");
  m.def("harmonic_irradiance", &irradiance, py::arg("coefficients"), py::arg("normals"), R"(
Irradiance on unoccluded surfaces from harmonic_coefficients(): (n, 3) float32 for normals (n, 3), in the map's frame.
BIASED: bands from the third on are left out; with a small sun that is off by tens of per cent and may be negative.)");
}

}  // namespace skytree
