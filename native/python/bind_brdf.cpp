// SPDX-License-Identifier: GPL-3.0-or-later
// The kd-tree in one to four dimensions and tabulated BRDFs for numpy.
#include <cmath>
#include <memory>

#include "bindings.h"
#include "src/brdf_kdtree.h"
#include "src/nd_kdtree.h"

namespace py = pybind11;

namespace skytree {
namespace {

using FloatArray = py::array_t<float, py::array::c_style | py::array::forcecast>;
using DoubleArray = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// (n, columns) of finite numbers, or std::invalid_argument that names the array.
FloatArray require_columns(const py::object& value, const std::string& name, py::ssize_t columns) {
  const FloatArray array = FloatArray::ensure(value);
  if (!array) {
    PyErr_Clear();
    throw std::invalid_argument(name + " is not an array of numbers");
  }
  if (array.ndim() != 2 || array.shape(1) != columns) {
    throw std::invalid_argument(name + " must have shape (n, " + std::to_string(columns) + ")");
  }
  for (py::ssize_t i = 0; i < array.size(); ++i) {
    if (!std::isfinite(array.data()[i])) throw std::invalid_argument(name + " is not finite");
  }
  return array;
}

FloatArray require_unit(const py::object& value, const std::string& name, py::ssize_t columns,
                        bool below_one) {
  const FloatArray array = require_columns(value, name, columns);
  for (py::ssize_t i = 0; i < array.size(); ++i) {
    const float x = array.data()[i];
    if (!(x >= 0.0f && (below_one ? x < 1.0f : x <= 1.0f))) {
      throw std::invalid_argument(name + " must lie in [0, 1" + (below_one ? ")" : "]"));
    }
  }
  return array;
}

void require_rows(const FloatArray& array, const std::string& name, py::ssize_t rows) {
  if (array.shape(0) != rows) {
    throw std::invalid_argument(name + " must have " + std::to_string(rows) +
                                " rows, one for each sample");
  }
}

NdPoint point_at(const FloatArray& array, py::ssize_t row) {
  NdPoint point = {};
  for (py::ssize_t k = 0; k < array.shape(1); ++k)
    point.x[k] = array.data()[row * array.shape(1) + k];
  return point;
}

SplitCriterion parse_criterion(const std::string& name) {
  if (name == "VARIANCE") return SplitCriterion::VARIANCE;
  if (name == "SSE") return SplitCriterion::SSE;
  if (name == "MIN_VARIANCE") return SplitCriterion::MIN_VARIANCE;
  throw std::invalid_argument("split_criterion \"" + name +
                              "\" is not one of VARIANCE, SSE, MIN_VARIANCE");
}

BlockProbability parse_probability(const std::string& name) {
  if (name == "FITTED") return BlockProbability::FITTED;
  if (name == "EXACT") return BlockProbability::EXACT;
  if (name == "MIN_VARIANCE") return BlockProbability::MIN_VARIANCE;
  throw std::invalid_argument("block_probability \"" + name +
                              "\" is not one of FITTED, EXACT, MIN_VARIANCE");
}

std::unique_ptr<NdKdTree> make_tree(const py::object& table, int condition_dimensions,
                                    int block_count, int slice_count,
                                    const std::string& split_criterion,
                                    const std::string& block_probability, double uniform_share,
                                    const std::optional<std::vector<DoubleArray>>& edges) {
  const FloatArray values = FloatArray::ensure(table);
  if (!values || values.ndim() < 1 || values.ndim() > kNdMaxDimensions || values.size() == 0) {
    PyErr_Clear();
    throw std::invalid_argument("table must be an array of 1 to 4 dimensions, not empty");
  }
  NdGrid grid;
  for (py::ssize_t a = 0; a < values.ndim(); ++a) {
    if (!edges) {
      grid.edges.push_back(uniform_edges(int(values.shape(a))));
      continue;
    }
    if (py::ssize_t(edges->size()) != values.ndim() || (*edges)[size_t(a)].ndim() != 1) {
      throw std::invalid_argument("edges must be one array for each dimension of the table");
    }
    const DoubleArray& axis = (*edges)[size_t(a)];
    if (axis.size() != values.shape(a) + 1) {
      throw std::invalid_argument("edges[" + std::to_string(a) + "] must have " +
                                  std::to_string(values.shape(a) + 1) +
                                  " entries, one more than the axis has cells");
    }
    grid.edges.emplace_back(axis.data(), axis.data() + axis.size());
  }
  grid.values.assign(values.data(), values.data() + values.size());
  NdKdTreeConfig config;
  config.block_count = block_count;
  config.slice_count = condition_dimensions == 0 ? 1 : slice_count;
  config.split_criterion = parse_criterion(split_criterion);
  config.block_probability = parse_probability(block_probability);
  config.uniform_share = uniform_share;
  py::gil_scoped_release release;
  return std::make_unique<NdKdTree>(grid, condition_dimensions, config);
}

/// None where there is no condition.
FloatArray require_condition(const NdKdTree& tree, const py::object& condition, py::ssize_t rows) {
  if (tree.condition_count() == 0) {
    if (!condition.is_none())
      throw std::invalid_argument("condition: this tree has no conditional dimensions");
    return FloatArray(std::vector<py::ssize_t>{rows, 0});
  }
  if (condition.is_none()) {
    throw std::invalid_argument("condition (n, " + std::to_string(tree.condition_count()) +
                                ") is needed: the first dimensions of this tree are given");
  }
  const FloatArray array = require_unit(condition, "condition", tree.condition_count(), false);
  require_rows(array, "condition", rows);
  return array;
}

py::tuple tree_sample(const NdKdTree& tree, const py::object& u, const py::object& condition) {
  const FloatArray numbers = require_unit(u, "u", tree.free_count() + 1, true);
  const py::ssize_t count = numbers.shape(0), free_count = tree.free_count();
  const FloatArray given = require_condition(tree, condition, count);
  FloatArray points({count, free_count}), pdf(count);
  float* out = points.mutable_data();
  float* density = pdf.mutable_data();
  const NdKdTreeView view = tree.view();
  {
    py::gil_scoped_release release;
    for (py::ssize_t i = 0; i < count; ++i) {
      NdPoint rest = {};
      for (py::ssize_t k = 0; k < free_count; ++k)
        rest.x[k] = numbers.data()[i * (free_count + 1) + 1 + k];
      const NdSample sample = nd_sample(view, nd_slice(view, point_at(given, i)),
                                        numbers.data()[i * (free_count + 1)], rest);
      for (py::ssize_t k = 0; k < free_count; ++k) out[i * free_count + k] = sample.point.x[k];
      density[i] = sample.pdf;
    }
  }
  return py::make_tuple(points, pdf);
}

FloatArray tree_pdf(const NdKdTree& tree, const py::object& points, const py::object& condition) {
  const FloatArray at = require_columns(points, "points", tree.free_count());
  const FloatArray given = require_condition(tree, condition, at.shape(0));
  FloatArray pdf(at.shape(0));
  const NdKdTreeView view = tree.view();
  for (py::ssize_t i = 0; i < at.shape(0); ++i) {
    const NdPoint point = point_at(at, i);
    bool inside = true;
    for (int k = 0; k < tree.free_count(); ++k) inside &= point.x[k] >= 0.0f && point.x[k] <= 1.0f;
    pdf.mutable_data()[i] = inside ? nd_pdf(view, nd_slice(view, point_at(given, i)), point) : 0.0f;
  }
  return pdf;
}

// BRDFs

Vec3 unit_row(const FloatArray& array, py::ssize_t row, const char* name) {
  const float* v = array.data() + 3 * row;
  const float norm = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  if (!(norm > 0.0f))
    throw std::invalid_argument(std::string(name) + " has a row that is no direction");
  // What sample() returned must stay as it is, bit by bit, or its pdf may differ.
  return std::fabs(norm - 1.0f) < 1e-5f ? Vec3{v[0], v[1], v[2]}
                                        : Vec3{v[0] / norm, v[1] / norm, v[2] / norm};
}

Vec3 view_row(const FloatArray& array, py::ssize_t row) {
  const Vec3 o = unit_row(array, row, "wo");
  if (!(o.z > 0.0f))
    throw std::invalid_argument(
        "wo must lie above the surface: its third component must be positive");
  return o;
}

/// Calls visit(row, wo, wi, above) for each pair of directions.
template <class Visit>
void for_each_pair(const py::object& wo, const py::object& wi, Visit visit) {
  const FloatArray views = require_columns(wo, "wo", 3), lights = require_columns(wi, "wi", 3);
  require_rows(lights, "wi", views.shape(0));
  for (py::ssize_t i = 0; i < views.shape(0); ++i) {
    const Vec3 o = view_row(views, i), l = unit_row(lights, i, "wi");
    visit(i, o, l, l.z > 0.0f);
  }
}

py::tuple brdf_sample_rows(const BrdfKdTree& brdf, const py::object& wo, const py::object& u) {
  const FloatArray views = require_columns(wo, "wo", 3), numbers = require_unit(u, "u", 2, true);
  const py::ssize_t count = views.shape(0);
  require_rows(numbers, "u", count);
  FloatArray directions({count, py::ssize_t(3)}), pdf(count);
  for (py::ssize_t i = 0; i < count; ++i) {
    const Vec3 o = view_row(views, i);
    const Vec3 l = brdf_sample(brdf.view(), o, {numbers.data()[2 * i], numbers.data()[2 * i + 1]});
    float* out = directions.mutable_data() + 3 * i;
    out[0] = l.x;
    out[1] = l.y;
    out[2] = l.z;
    pdf.mutable_data()[i] = l.z > 0.0f ? brdf_pdf(brdf.view(), o, l) : 0.0f;
  }
  return py::make_tuple(directions, pdf);
}

FloatArray brdf_pdf_rows(const BrdfKdTree& brdf, const py::object& wo, const py::object& wi) {
  FloatArray pdf(require_columns(wo, "wo", 3).shape(0));
  for_each_pair(wo, wi, [&](py::ssize_t i, Vec3 o, Vec3 l, bool above) {
    pdf.mutable_data()[i] = above ? brdf_pdf(brdf.view(), o, l) : 0.0f;
  });
  return pdf;
}

FloatArray table_rows(const BrdfTable& table, const py::object& wo, const py::object& wi) {
  FloatArray values({require_columns(wo, "wo", 3).shape(0), py::ssize_t(3)});
  for_each_pair(wo, wi, [&](py::ssize_t i, Vec3 o, Vec3 l, bool above) {
    const Vec3 f = above ? brdf_table_value(table.view(), o, l) : Vec3{0, 0, 0};
    float* out = values.mutable_data() + 3 * i;
    out[0] = f.x;
    out[1] = f.y;
    out[2] = f.z;
  });
  return values;
}

std::shared_ptr<BrdfTable> table_from_array(const FloatArray& values,
                                            std::pair<float, float> stretch) {
  if (values.ndim() != 5) {
    throw std::invalid_argument("values must have shape (theta_h, phi_h, theta_d, phi_d, 1 or 3)");
  }
  const BrdfTableSize size = {int(values.shape(0)), int(values.shape(1)), int(values.shape(2)),
                              int(values.shape(3))};
  return std::make_shared<BrdfTable>(
      std::vector<float>(values.data(), values.data() + values.size()), size, int(values.shape(4)),
      Vec2{stretch.first, stretch.second});
}

std::shared_ptr<BrdfTable> shared(const BrdfTablePointer& table) {
  return std::const_pointer_cast<BrdfTable>(table);  // it has no method that changes it
}

}  // namespace

void bind_brdf(py::module_& m) {
  using namespace py::literals;
  py::class_<NdKdTree, std::shared_ptr<NdKdTree>>(m, "NdKdTreeSampler", R"(
Draws points of [0,1]^D in proportion to a tabulated function, D = 1 to 4, by a kd-tree; the first C dimensions may be
given with each sample. Ergun, Kurt, Ozturk, SCCG 2012, in more dimensions (docs/brdf.md).)")
      .def(py::init(&make_tree), "table"_a, "condition_dimensions"_a = 0, "block_count"_a = 1024,
           "slice_count"_a = 16, "split_criterion"_a = "SSE", "block_probability"_a = "EXACT",
           py::kw_only(), "uniform_share"_a = 0.05, "edges"_a = py::none(), R"(
table: array of 1 to 4 dimensions, means of the function over the cells of a grid, not negative. edges: per dimension
the borders of its cells, rising from 0 to 1; None: cells of equal width. The first `condition_dimensions` are a
condition, cut into at most `slice_count` slices, each a distribution of its own with ranks and an alpha of its own;
`block_count` blocks are shared among all. split_criterion: VARIANCE, SSE, MIN_VARIANCE; block_probability: FITTED,
EXACT, MIN_VARIANCE, as in KdTreeSampler. Raises ValueError for a bad table or setting.)")
      .def("sample", &tree_sample, "u"_a, "condition"_a = py::none(), R"(
Points (n, F) of the F = D - C free dimensions and their density (n,), given condition (n, C). u is (n, F + 1) in
[0, 1): the first chooses the block where probabilities are FITTED, the others the point. Without FITTED the points
follow the others monotonously, so that stratified numbers give stratified points.)")
      .def("pdf", &tree_pdf, "points"_a, "condition"_a = py::none(),
           "Density (n,) of points (n, F) given condition (n, C); 0 outside [0,1]^F. The density "
           "of a "
           "sampled point is, bit by bit, what came with it.")
      .def_property_readonly("nbytes", &NdKdTree::nbytes, "Bytes that sample() and pdf() read.")
      .def_property_readonly("block_count", &NdKdTree::block_count)
      .def_property_readonly("slice_count", &NdKdTree::slice_count)
      .def_property_readonly(
          "alphas",
          [](const NdKdTree& tree) {
            py::array_t<double> alphas(py::ssize_t(tree.fits().size()));
            for (size_t i = 0; i < tree.fits().size(); ++i)
              alphas.mutable_data()[i] = tree.fits()[i].alpha;
            return alphas;
          },
          "The rank model's alpha of each slice.")
      .def_property_readonly(
          "kl_divergences",
          [](const NdKdTree& tree) {
            py::array_t<double> all(py::ssize_t(tree.fits().size()));
            for (size_t i = 0; i < tree.fits().size(); ++i)
              all.mutable_data()[i] = tree.fits()[i].kl_divergence;
            return all;
          },
          "Divergence of the rank model from the blocks' shares in each slice, in nats.")
      .def_property_readonly("build_seconds", &NdKdTree::build_seconds);

  py::class_<BrdfTable, std::shared_ptr<BrdfTable>>(m, "BrdfTable", R"(
A tabulated BRDF over half and difference vectors (Rusinkiewicz 1998), interpolated linearly, reciprocal by
construction. Directions are (n,3), in the local frame with +Z the normal, pointing away from the surface.)")
      .def(py::init(&table_from_array), "values"_a,
           "stretch"_a = std::pair<float, float>(1.0f, 1.0f), R"(
values (theta_h, phi_h, theta_d, phi_d, 1 or 3): the BRDF, per steradian, without cosine, at the middles of cells that
are even in sqrt(theta_h) to 90 degrees, phi_h over a turn (one cell: isotropic), theta_d to 90 degrees, phi_d over
half a turn. stretch (x, y) in (0, 1]: half vectors are divided by it before their angles are taken.)")
      .def_static(
          "ward",
          [](float ax, std::optional<float> ay, bool stretched) {
            py::gil_scoped_release release;
            return shared(make_ward_table(ax, ay.value_or(ax), stretched));
          },
          "alpha_x"_a, "alpha_y"_a = py::none(), "stretched"_a = true,
          "Ward's model as the closure WARD has it, reflectance 1; alphas in [0.001, 1]. "
          "stretched: an "
          "elongated lobe is round in its table.")
      .def_static(
          "ggx",
          [](float ax, std::optional<float> ay, bool stretched) {
            py::gil_scoped_release release;
            return shared(make_ggx_table(ax, ay.value_or(ax), stretched));
          },
          "alpha_x"_a, "alpha_y"_a = py::none(), "stretched"_a = true,
          "GGX reflection without Fresnel, as the closure GLOSSY has it (alpha = roughness "
          "squared).")
      .def_static(
          "merl",
          [](const std::string& path) {
            py::gil_scoped_release release;
            return shared(read_merl(path));
          },
          "path"_a,
          "Reads a .binary file of the MERL database. Raises RuntimeError that names the file "
          "and what is wrong with it.")
      .def("evaluate", &table_rows, "wo"_a, "wi"_a,
           "BRDF (n,3), per steradian, without cosine; 0 below the surface.")
      .def_property_readonly("shape",
                             [](const BrdfTable& t) {
                               return py::make_tuple(t.size().half_theta, t.size().half_phi,
                                                     t.size().diff_theta, t.size().diff_phi,
                                                     t.channels());
                             })
      .def_property_readonly("isotropic", &BrdfTable::isotropic)
      .def_property_readonly("nbytes", &BrdfTable::nbytes);

  py::class_<BrdfKdTree, std::shared_ptr<BrdfKdTree>>(m, "BrdfKdTree", R"(
A tabulated BRDF with a kd-tree that samples it times cosine: given the view direction (one dimension for isotropic
tables, two else) it draws a half vector. Ergun, Kurt, Ozturk, SCCG 2012, in 3 or 4 dimensions (docs/brdf.md).)")
      .def(py::init([](std::shared_ptr<BrdfTable> table, int block_count, int slice_count,
                       const std::string& criterion, const std::string& probability, double share) {
             BrdfKdTreeConfig config;
             config.tree.block_count = block_count;
             config.tree.slice_count = slice_count;
             config.tree.split_criterion = parse_criterion(criterion);
             config.tree.block_probability = parse_probability(probability);
             config.tree.uniform_share = share;
             py::gil_scoped_release release;
             return std::make_shared<BrdfKdTree>(std::move(table), config);
           }),
           "table"_a, "block_count"_a = 0, "slice_count"_a = 0,
           "split_criterion"_a = "MIN_VARIANCE", "block_probability"_a = "MIN_VARIANCE",
           py::kw_only(), "uniform_share"_a = 0.01,
           "block_count 0: 2048, or 8192 for anisotropic tables; slice_count 0: 12, or 96. The "
           "rest as in "
           "NdKdTreeSampler.")
      .def("sample", &brdf_sample_rows, "wo"_a, "u"_a, R"(
Directions (n,3) drawn for views wo (n,3) with numbers u (n,2) in [0, 1), and their density (n,) per steradian. A
direction may lie below the surface; its density is 0 then, and it carries no light.)")
      .def("pdf", &brdf_pdf_rows, "wo"_a, "wi"_a,
           "Density (n,) of wi, per steradian; positive above the surface, 0 below.")
      .def(
          "evaluate",
          [](const BrdfKdTree& brdf, const py::object& wo, const py::object& wi) {
            return table_rows(brdf.table(), wo, wi);
          },
          "wo"_a, "wi"_a, "The table's value: see BrdfTable.evaluate.")
      .def_property_readonly(
          "nbytes", [](const BrdfKdTree& b) { return b.tree().nbytes(); },
          "Bytes that sample() and pdf() read.")
      .def_property_readonly("table_nbytes", [](const BrdfKdTree& b) { return b.table().nbytes(); })
      .def_property_readonly("block_count",
                             [](const BrdfKdTree& b) { return b.tree().block_count(); })
      .def_property_readonly("slice_count",
                             [](const BrdfKdTree& b) { return b.tree().slice_count(); })
      .def_property_readonly("build_seconds", &BrdfKdTree::build_seconds);
}

}  // namespace skytree
