// SPDX-License-Identifier: GPL-3.0-or-later
// The samplers for numpy: checks of arrays and settings, and the GIL. Docstrings are in
// skytree_core/_native.pyi's terms: (n, k) shapes, units, what is raised.
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "bind_arrays.h"
#include "bindings.h"
#include "src/alias_sampler.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"
#include "src/median_cut.h"

namespace py = pybind11;

namespace skytree {
namespace {

Vec3 random_number(const double* v, size_t row) {
  for (int k = 0; k < 3; ++k) {
    if (!(v[k] >= 0.0 && v[k] < 1.0)) {
      throw std::invalid_argument(row_text("u", row, v) + "; random numbers must be in [0, 1)");
    }
  }
  // A double just below 1 would round up to 1.
  return {fminf((float)v[0], kOneMinusEpsilon), fminf((float)v[1], kOneMinusEpsilon),
          fminf((float)v[2], kOneMinusEpsilon)};
}

/// A filtered map has neither samples nor a density.
void require_density(const EnvironmentSampler& sampler) {
  if (sampler.view().type == EnvSamplerType::FILTERED) {
    throw std::invalid_argument(
        "a filtered map draws no directions: the surfaces' BSDFs do; give it to a RenderSession");
  }
}

py::tuple sample(const EnvironmentSampler& sampler, const py::object& u) {
  require_density(sampler);
  const std::vector<Vec3> numbers = convert_rows(require_triples(u, "u"), random_number);
  const py::ssize_t count = (py::ssize_t)numbers.size();
  FloatArray directions({count, (py::ssize_t)3});
  FloatArray pdf(count);
  float* out = directions.mutable_data();
  float* density = pdf.mutable_data();
  {
    py::gil_scoped_release release;
    const EnvSamplerView view = sampler.view();
    for (py::ssize_t i = 0; i < count; ++i) {
      const DirectionSample s = sample_environment(view, numbers[i]);
      out[3 * i] = s.direction.x;
      out[3 * i + 1] = s.direction.y;
      out[3 * i + 2] = s.direction.z;
      density[i] = s.pdf;
    }
  }
  return py::make_tuple(directions, pdf);
}

FloatArray pdf(const EnvironmentSampler& sampler, const py::object& directions) {
  require_density(sampler);
  const std::vector<Vec3> unit =
      convert_rows(require_triples(directions, "directions"), unit_direction);
  FloatArray result((py::ssize_t)unit.size());
  float* density = result.mutable_data();
  {
    py::gil_scoped_release release;
    const EnvSamplerView view = sampler.view();
    for (size_t i = 0; i < unit.size(); ++i) density[i] = environment_pdf(view, unit[i]);
  }
  return result;
}

constexpr Choice<BlockProbability> kBlockProbabilities[] = {
    {"FITTED", BlockProbability::FITTED},
    {"EXACT", BlockProbability::EXACT},
    {"MIN_VARIANCE", BlockProbability::MIN_VARIANCE}};
constexpr Choice<RankObjective> kRankObjectives[] = {
    {"LEAST_SQUARES", RankObjective::LEAST_SQUARES},
    {"LIKELIHOOD", RankObjective::LIKELIHOOD},
    {"SECOND_MOMENT", RankObjective::SECOND_MOMENT}};
constexpr Choice<BlockDensity> kBlockDensities[] = {{"AUTO", BlockDensity::AUTO},
                                                    {"CONSTANT", BlockDensity::CONSTANT},
                                                    {"LINEAR", BlockDensity::LINEAR}};

/// An array that a render thread may be the last to let go of: it is given back under the GIL.
std::shared_ptr<FloatArray> share(const FloatArray& array) {
  return {new FloatArray(array), [](FloatArray* a) {
            py::gil_scoped_acquire acquire;
            delete a;
          }};
}

/// What builds of one map share, with the array.
struct SharedMap : MapStatistics {
  explicit SharedMap(const FloatArray& array)
      : MapStatistics(image_view(array)), image(share(array)) {}

  std::shared_ptr<FloatArray> image;
};

/// The sampler with the array that it was built from, for reconstruct().
struct KdTree : KdTreeSampler {
  KdTree(std::shared_ptr<FloatArray> array, const KdTreeConfig& config)
      : KdTreeSampler(image_view(*array), config), image(std::move(array)) {}
  KdTree(SharedMap& map, const KdTreeConfig& config)
      : KdTreeSampler(map, config), image(map.image) {}

  std::shared_ptr<FloatArray> image;
};

/// A number, or "AUTO" for as many blocks as pay.
int parse_block_count(const py::object& value) {
  if (py::isinstance<py::str>(value)) {
    if (value.cast<std::string>() == "AUTO") return KdTreeConfig::kAutoBlockCount;
    throw std::invalid_argument("block_count is \"" + value.cast<std::string>() +
                                "\"; it must be a number or \"AUTO\"");
  }
  const int64_t count = value.cast<int64_t>();
  if (count < 1 || count > KdTreeConfig::kLargestBlockCount) {
    throw std::invalid_argument("block_count is " + std::to_string(count) +
                                "; it must be from 1 to " +
                                std::to_string(KdTreeConfig::kLargestBlockCount) + ", or \"AUTO\"");
  }
  return (int)count;
}

std::shared_ptr<KdTree> make_kdtree(const py::object& image, const py::object& block_count,
                                    const std::string& split_criterion,
                                    const std::string& block_probability,
                                    const std::string& statistics,
                                    std::optional<double> uniform_share,
                                    const std::string& alpha_objective,
                                    const std::string& block_density, double compensation,
                                    const py::object& progress, int threads) {
  const auto shared = py::isinstance<SharedMap>(image) ? image.cast<std::shared_ptr<SharedMap>>()
                                                       : std::shared_ptr<SharedMap>();
  const auto array = shared ? shared->image : share(require_image(image));
  KdTreeConfig config;
  config.threads = threads;
  config.block_count = parse_block_count(block_count);
  config.split_criterion = parse(split_criterion, "split_criterion", kSplitCriteria);
  config.block_probability = parse(block_probability, "block_probability", kBlockProbabilities);
  config.statistics = parse(statistics, "statistics", kStatistics);
  config.uniform_share = uniform_share;
  config.rank_objective = parse(alpha_objective, "alpha_objective", kRankObjectives);
  config.block_density = parse(block_density, "block_density", kBlockDensities);
  config.compensation = compensation;
  if (!progress.is_none()) {
    config.progress = [&progress](double done) {
      py::gil_scoped_acquire acquire;
      const py::object answer = progress(done);
      return answer.is_none() || answer.cast<bool>();
    };
  }
  py::gil_scoped_release release;
  return shared ? std::make_shared<KdTree>(*shared, config)
                : std::make_shared<KdTree>(array, config);
}

RankFit fit_ranks(const py::object& probabilities, const std::string& objective) {
  const py::array array = require_float_array(probabilities, "probabilities");
  const RankObjective chosen = parse(objective, "objective", kRankObjectives);
  if (array.ndim() != 1 || array.size() < 1) {
    throw std::invalid_argument("probabilities has shape " + shape_text(array) +
                                "; it must be (n,), not empty");
  }
  const py::array_t<double, py::array::c_style | py::array::forcecast> doubles(array);
  std::vector<double> sorted(doubles.data(), doubles.data() + doubles.size());
  double sum = 0;
  for (double p : sorted) {
    if (!(p >= 0.0 && p < INFINITY)) {
      throw std::invalid_argument("probabilities holds " + std::to_string(p) +
                                  "; they must be finite and not negative");
    }
    sum += p;
  }
  if (!(sum > 0.0 && sum < INFINITY)) {
    throw std::invalid_argument("probabilities sum to " + std::to_string(sum) +
                                "; their sum must be positive and finite");
  }
  std::sort(sorted.begin(), sorted.end(), std::greater<double>());
  for (double& p : sorted) p /= sum;
  return fit_rank_model(sorted, chosen);
}

template <typename Container, typename Get>
py::array_t<double> to_array(const Container& values, const Get& get) {
  py::array_t<double> array((py::ssize_t)values.size());
  for (size_t i = 0; i < values.size(); ++i) array.mutable_data()[i] = get(values[i]);
  return array;
}

py::array bounds(const KdTree& sampler) {
  if (sampler.is_linear()) {
    py::array_t<float> array({(py::ssize_t)sampler.rects().size(), (py::ssize_t)4});
    float* out = array.mutable_data();
    const TreeGrid& grid = sampler.grid();
    for (const TexelRect& rect : sampler.rects()) {
      *out++ = (float)rect.lo[0] + 0.5f;
      *out++ = 0.5f * (float)grid.half_texels(rect.lo[1]);
      *out++ = (float)rect.hi[0] + 0.5f;
      *out++ = 0.5f * (float)grid.half_texels(rect.hi[1]);
    }
    return array;
  }
  py::array_t<int32_t> array({(py::ssize_t)sampler.rects().size(), (py::ssize_t)4});
  int32_t* out = array.mutable_data();
  for (const TexelRect& rect : sampler.rects()) {
    for (int32_t v : {rect.lo[0], rect.lo[1], rect.hi[0], rect.hi[1]}) *out++ = v;
  }
  return array;
}

py::array_t<double> tilts(const KdTree& sampler) {
  py::array_t<double> array({(py::ssize_t)sampler.rects().size(), (py::ssize_t)2});
  double* out = array.mutable_data();
  std::fill(out, out + array.size(), 0.0);
  for (const Tilts& t : sampler.tilts()) {
    *out++ = t.along;
    *out++ = t.down;
  }
  return array;
}

py::tuple point_lights(const KdTree& sampler) {
  if (sampler.is_linear()) {
    throw std::invalid_argument(
        "point_lights() needs blocks of texels: block_density=\"CONSTANT\"");
  }
  std::vector<PointLight> lights;
  {
    const LatLongImage image = image_view(*sampler.image);
    py::gil_scoped_release release;
    lights = make_point_lights(image, sampler.rects());
  }
  const py::ssize_t count = (py::ssize_t)lights.size();
  FloatArray directions({count, (py::ssize_t)3}), power({count, (py::ssize_t)3});
  for (py::ssize_t i = 0; i < count; ++i) {
    const Vec3 d = lights[i].direction, p = lights[i].power;
    const float values[6] = {d.x, d.y, d.z, p.x, p.y, p.z};
    std::copy(values, values + 3, directions.mutable_data() + 3 * i);
    std::copy(values + 3, values + 6, power.mutable_data() + 3 * i);
  }
  return py::make_tuple(directions, power);
}

FloatArray reconstruct(const KdTree& sampler) {
  FloatArray out({sampler.image->shape(0), sampler.image->shape(1), (py::ssize_t)3});
  const LatLongImage image = image_view(*sampler.image);
  float* data = out.mutable_data();
  py::gil_scoped_release release;
  sampler.reconstruct(image, data);
  return out;
}

std::shared_ptr<AliasSampler> make_alias(const py::object& image, int threads) {
  if (py::isinstance<SharedMap>(image)) {
    const auto shared = image.cast<std::shared_ptr<SharedMap>>();
    py::gil_scoped_release release;
    return std::make_shared<AliasSampler>(*shared, threads);
  }
  const FloatArray array = require_image(image);
  py::gil_scoped_release release;
  return std::make_shared<AliasSampler>(image_view(array), threads);
}

std::shared_ptr<InversionSampler> make_inversion(const py::object& image, const std::string& method,
                                                 int threads) {
  const FloatArray array = require_image(image);
  if (method != "guided" && method != "binary") {
    throw std::invalid_argument("method is \"" + method + "\"; it must be one of guided, binary");
  }
  py::gil_scoped_release release;
  return std::make_shared<InversionSampler>(image_view(array), method == "guided", threads);
}

}  // namespace

void bind_samplers(py::module_& m) {
  py::register_exception<BuildCancelled>(m, "BuildCancelled", PyExc_RuntimeError).attr("__doc__") =
      "The progress callback of KdTreeSampler asked to stop.";

  py::class_<EnvironmentSampler, std::shared_ptr<EnvironmentSampler>>(m, "EnvironmentSampler", R"(
A density over directions, immutable and safe to share between threads.

Directions are in the map's frame: +Z up, azimuth atan2(y, x), as Cycles shows the map. Densities are per steradian.)")
      .def("sample", &sample, py::arg("u"), R"(
Draw directions.

u: (n, 3), any floating-point dtype, in [0, 1). u[:, 0] chooses where a method chooses once; (u[:, 1], u[:, 2]) is warped or
placed inside what was chosen, so the better stratified pair belongs there.

Returns (directions (n, 3) float32 of unit length, pdf (n,) float32 per steradian).
Raises ValueError for another shape or dtype, and for numbers out of range.)")
      .def("pdf", &pdf, py::arg("directions"), R"(
Density per steradian with which sample() returns each direction.

directions: (n, 3), any floating-point dtype; normalised if they are not of unit length.

Returns (n,) float32; for a direction that sample() returned, exactly the pdf that came with it.
Raises ValueError for another shape or dtype, and for a zero or non-finite vector.)")
      .def_property_readonly(
          "nbytes", &EnvironmentSampler::nbytes,
          "Bytes of the tables that sample() and pdf() read, the image left out.")
      .def_property_readonly(
          "bad_texels", [](const EnvironmentSampler& s) { return s.bad_texels().total(); },
          "Number of texels with a NaN, infinite or negative component; they count as 0.")
      .def_property_readonly(
          "bad_texels_message",
          [](const EnvironmentSampler& s) { return s.bad_texels().message(); },
          "How many bad texels of which kind, in a sentence; empty if there are none.");

  py::class_<RankFit>(m, "RankFit", "What fit_rank_model() returns.")
      .def_readonly("alpha", &RankFit::alpha, "The model's parameter.")
      .def_readonly("rms_error", &RankFit::rms_error,
                    "Root mean squared difference between model q and probabilities p.")
      .def_readonly("kl_divergence", &RankFit::kl_divergence, "Sum of p log(p/q), nats.")
      .def_readonly("second_moment", &RankFit::second_moment, "Sum of p^2/q, at least 1.")
      .def_readonly("largest_ratio", &RankFit::largest_ratio, "Largest p/q.");
  m.def("fit_rank_model", &fit_ranks, py::arg("probabilities"),
        py::arg("objective") = "LEAST_SQUARES", R"(
Fit the paper's one-parameter model (SCCG 2012, equation 2), integrated over each rank, to probabilities.

probabilities: (n,) of any order and any positive sum; they are sorted and normalised. objective: "LEAST_SQUARES" makes
the sum of (q-p)^2 small, "LIKELIHOOD" that of p log(p/q), "SECOND_MOMENT" that of p^2/q.

Returns a RankFit. Raises ValueError for bad probabilities.)");
  m.def(
      "rank_probabilities",
      [](double alpha, int count) {
        if (!(alpha > 0.0 && alpha < INFINITY) || count < 1) {
          throw std::invalid_argument("alpha must be positive and finite, count at least 1");
        }
        return to_array(rank_probabilities(alpha, count), [](double p) { return p; });
      },
      py::arg("alpha"), py::arg("count"),
      "(count,) float64: the model's probability of each rank (SCCG 2012, equation 2, "
      "integrated).");

  py::class_<SharedMap, std::shared_ptr<SharedMap>>(m, "MapStatistics", R"(
What kd-trees of one map have in common, for many of them one after the other: KdTreeSampler takes it in place of the image,
and so does AliasSampler, for the luminance.

Luminance and sums over the map are kept, and each criterion's tree as far as it was grown: a smaller block count takes part
of it, a larger one lets it grow on. Samplers are those of the image, to the bit. Safe to share between threads; builds of one
map wait for each other.

image: (H, W, 3) linear RGB, row 0 at the top; a reference is kept, and its texels must not change. Raises ValueError for a
bad image.)")
      .def(py::init([](const py::object& image) {
             return std::make_shared<SharedMap>(require_image(image));
           }),
           py::arg("image"))
      .def_property_readonly(
          "nbytes",
          [](const SharedMap& map) {
            py::gil_scoped_release release;
            return map.nbytes();
          },
          "Bytes kept so far, the image left out: 4 a texel of luminance, about 2 for each of at "
          "most\n"
          "three kinds of sums (\"RADIANCE\", the same for linear density, \"PIXELS\"), and the "
          "trees.");

  py::class_<KdTree, EnvironmentSampler, std::shared_ptr<KdTree>>(m, "KdTreeSampler", R"(
Kd-tree importance sampling of a lat-long map (Ergun, Kurt and Ozturk, SCCG 2012).

image: (H, W, 3) linear RGB, row 0 at the top, any size from 1x1; a reference is kept for reconstruct(). Or a MapStatistics.
block_count: 1 to 32768; fewer come out if no block with variation is left to split (a constant map stays one block).
    "AUTO" with linear density: as many, up to 4096, as bring the predicted variance of irradiance within 4 % of what 4096
    blocks give; otherwise 1024.
split_criterion: which block is split next, and where: "RANGE", "VARIANCE", "SSE" (the paper's), "MIN_VARIANCE" (what most
    reduces the sum over blocks of sqrt(solid angle * integral of L^2)) or "MEDIAN_CUT" (Debevec 2005, for comparison and
    teaching: the oldest block, halving its power along its longer side; 2^n blocks with "EXACT" are his regions).
block_probability: "FITTED" (the paper's model of sorted probabilities with one parameter alpha), "EXACT" (in proportion to
    the block's power) or "MIN_VARIANCE" (in proportion to sqrt(solid angle * integral of L^2)).
statistics: "RADIANCE" (weighted by solid angle, radiance interpolated between texels as a renderer does) or "PIXELS" (the
    paper's: every pixel counts alike, with its own value).
alpha_objective: what alpha is fitted for: "LEAST_SQUARES" of probabilities, "LIKELIHOOD", or least "SECOND_MOMENT" of the
    blocks' weights; see fit_rank_model().
uniform_share: share of samples spread over the sphere with "EXACT" and "MIN_VARIANCE"; bounds the largest weight. None:
    0.05, or 0.005 with linear density and no compensation.
block_density: "CONSTANT" in a block (the paper's), or "LINEAR" along azimuth and elevation, with blocks of the cells
    between texel centres, in which the interpolated map is one bilinear patch. "AUTO": "LINEAR" where split_criterion and
    block_probability are "MIN_VARIANCE" and statistics "RADIANCE", as it needs these.
compensation: 0 to 1, with "EXACT" and "MIN_VARIANCE": this much of the map's mean is taken from every block, because
    BSDF sampling finds even light well enough (MIS compensation, Karlik et al. 2019). Leave it 0 where samples of this
    sampler alone are used.
progress: called with the share done, 0 to 1; returning False stops the build with BuildCancelled.

Raises ValueError for a bad image or setting. Values that are NaN, infinite or negative count as 0.)")
      .def(py::init(&make_kdtree), py::arg("image"), py::arg("block_count") = 1024,
           py::arg("split_criterion") = "SSE", py::arg("block_probability") = "FITTED",
           py::kw_only(), py::arg("statistics") = "RADIANCE", py::arg("uniform_share") = py::none(),
           py::arg("alpha_objective") = "LEAST_SQUARES", py::arg("block_density") = "AUTO",
           py::arg("compensation") = 0.0, py::arg("progress") = py::none(), py::arg("threads") = 0)
      .def_property_readonly(
          "alpha", [](const KdTree& s) { return s.fit().alpha; },
          "Parameter of the rank model, fitted to empirical (paper, equation 2).")
      .def_property_readonly(
          "fit_error", [](const KdTree& s) { return s.fit().rms_error; },
          "Root mean squared difference between the model's probabilities and empirical.")
      .def_property_readonly(
          "kl_divergence", [](const KdTree& s) { return s.fit().kl_divergence; },
          "Kullback-Leibler divergence of the model from empirical, in nats.")
      .def_property_readonly("block_count", &KdTree::block_count, "Number of blocks that exist.")
      .def_property_readonly("bounds", &bounds, R"(
(n, 4): x0, y0, x1, y1 of each block in texels, x1 and y1 exclusive. In the order of probabilities: by descending power
with "FITTED", else depth first down the tree. int32 where density is constant in a block. Where it is linear, float32:
blocks begin and end at texel centres, at .5, and x1 may be width + .5, which wraps to .5; the first and last half row reach
to 0 and height.)")
      .def_property_readonly(
          "block_density", [](const KdTree& s) { return s.is_linear() ? "LINEAR" : "CONSTANT"; },
          "What the density in a block is: \"CONSTANT\" or \"LINEAR\".")
      .def_property_readonly("tilts", &tilts, R"(
(n, 2) float64 with linear density: a and b of each block's density, proportional to
(1 + a (2p - 1)) (1 + b (2q - 1)), p from its left and q (in solid angle) from its upper border, 0 to 1. Else zeros.)")
      .def_property_readonly(
          "probabilities",
          [](const KdTree& s) { return to_array(s.probabilities(), [](double p) { return p; }); },
          "(n,) float64: what each block is chosen with, in the order of bounds.")
      .def_property_readonly(
          "empirical",
          [](const KdTree& s) { return to_array(s.empirical(), [](double p) { return p; }); },
          "(n,) float64: the blocks' shares of the map's power, descending; what alpha was fitted "
          "to.")
      .def("reconstruct", &reconstruct, R"(
The map with every block at its mean radiance (the paper's Figure 1), tilted where density is linear: (H, W, 3) float32. Reads the image that was given to
the constructor, which must not have been written to since.)")
      .def("point_lights", &point_lights, R"(
One distant light for each block (Debevec 2005; with split_criterion "MEDIAN_CUT" his lights). BIASED: soft shadows become
copies of hard ones. Returns (directions (n,3) float32, the blocks' centroids by luminance; power (n,3) float32, the
integral of radiance over each block). Reads the image that was given to the constructor.)")
      .def_property_readonly(
          "build_seconds", &KdTree::build_seconds,
          "Seconds that reading the image, growing the tree and making the tables took.");

  py::class_<InversionSampler, EnvironmentSampler, std::shared_ptr<InversionSampler>>(
      m, "InversionSampler", R"(
Inversion of marginal and conditional distribution functions over texels.

image: (H, W, 3) linear RGB. method: "guided" (the search starts from a table, Chen and Asau 1974) or "binary".
Weights are solid angle times the mean of the interpolated luminance over a texel. threads build, 0: all cores.
Raises ValueError for a bad image.)")
      .def(py::init(&make_inversion), py::arg("image"), py::kw_only(), py::arg("method") = "guided",
           py::arg("threads") = 0)
      .def_property_readonly("build_seconds", &InversionSampler::build_seconds,
                             "Seconds that building the tables took.");

  py::class_<AliasSampler, EnvironmentSampler, std::shared_ptr<AliasSampler>>(m, "AliasSampler", R"(
Alias table over texels (Walker 1977, Vose 1991), with the weights of InversionSampler.

image: (H, W, 3) linear RGB, or a MapStatistics. threads build, 0: all cores. Raises ValueError for a bad image.)")
      .def(py::init(&make_alias), py::arg("image"), py::kw_only(), py::arg("threads") = 0)
      .def_property_readonly("build_seconds", &AliasSampler::build_seconds,
                             "Seconds that building the table took.");

  py::class_<UniformSampler, EnvironmentSampler, std::shared_ptr<UniformSampler>>(
      m, "UniformSampler", "Every direction alike: 1/(4 pi) per steradian.")
      .def(py::init<>());
}

}  // namespace skytree
