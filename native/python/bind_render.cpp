// SPDX-License-Identifier: GPL-3.0-or-later
// Scene and RenderSession for Python: checks of array shapes, closure dictionaries, and the GIL.
#include <cmath>
#include <memory>

#include "bindings.h"
#include "src/brdf_kdtree.h"
#include "src/environment_sampler.h"
#include "src/render_session.h"
#include "src/scene.h"

namespace py = pybind11;

namespace skytree {
namespace {

using FloatArray = py::array_t<float, py::array::c_style | py::array::forcecast>;
using IntArray = py::array_t<int32_t, py::array::c_style | py::array::forcecast>;
using MatrixArray = py::array_t<double, py::array::c_style | py::array::forcecast>;

template <class Array>
void require_rows(const Array& array, const char* name, py::ssize_t columns,
                  py::ssize_t rows = -1) {
  if (array.ndim() != 2 || array.shape(1) != columns || (rows >= 0 && array.shape(0) != rows)) {
    const std::string count = rows >= 0 ? std::to_string(rows) : "n";
    throw std::invalid_argument(std::string(name) + " must have shape (" + count + ", " +
                                std::to_string(columns) + ")");
  }
}

Matrix4 to_matrix(const MatrixArray& array, const char* name) {
  require_rows(array, name, 4, 4);
  Matrix4 matrix;
  std::copy(array.data(), array.data() + 16, matrix.begin());
  return matrix;
}

Vec3 to_vec3(const py::handle& value, const char* name) {
  const auto array = FloatArray::ensure(value);
  if (!array || array.ndim() != 1 || array.shape(0) < 3 || array.shape(0) > 4) {
    PyErr_Clear();
    throw std::invalid_argument(std::string(name) + " must be three numbers");
  }
  return {array.at(0), array.at(1), array.at(2)};
}

/// The arrays that a MeshInput borrows, kept alive while the mesh copies them.
struct MeshArrays {
  FloatArray positions;
  IntArray triangles;
  std::optional<IntArray> corners;
  std::optional<FloatArray> normals, uvs, tangents;
  std::optional<IntArray> slots;

  MeshInput input(const std::string& name) const {
    require_rows(positions, "positions", 3);
    require_rows(triangles, "triangles", 3);
    MeshInput in;
    in.name = name;
    in.positions = positions.data();
    in.vertex_count = size_t(positions.shape(0));
    in.triangles = triangles.data();
    in.triangle_count = size_t(triangles.shape(0));
    py::ssize_t corner_rows = -1;
    auto corner_array = [&](const std::optional<FloatArray>& array, const char* what,
                            py::ssize_t columns) {
      if (!array) return static_cast<const float*>(nullptr);
      require_rows(*array, what, columns, corner_rows);
      corner_rows = array->shape(0);
      return array->data();
    };
    in.corner_normals = corner_array(normals, "corner_normals", 3);
    in.corner_uvs = corner_array(uvs, "corner_uvs", 2);
    in.corner_tangents = corner_array(tangents, "corner_tangents", 3);
    in.corner_count = size_t(std::max<py::ssize_t>(corner_rows, 0));
    if (corners) {
      require_rows(*corners, "corners", 3, triangles.shape(0));
      in.corners = corners->data();
    }
    if (slots) {
      if (slots->ndim() != 1 || slots->shape(0) != triangles.shape(0)) {
        throw std::invalid_argument("material_slots must have one entry per triangle");
      }
      in.material_slots = slots->data();
    }
    return in;
  }
};

Closure parse_closure(const py::dict& dict) {
  static const std::map<std::string, ClosureType> kTypes = {
      {"DIFFUSE", ClosureType::kDiffuse},    {"GLOSSY", ClosureType::kGlossy},
      {"WARD", ClosureType::kWard},          {"PRINCIPLED", ClosureType::kPrincipled},
      {"EMISSION", ClosureType::kEmission},  {"TRANSPARENT", ClosureType::kTransparent},
      {"TABULATED", ClosureType::kTabulated}};
  if (!dict.contains("type")) throw std::invalid_argument("a closure needs a type");
  const std::string type = py::str(dict["type"]);
  const auto found = kTypes.find(type);
  if (found == kTypes.end()) {
    throw std::invalid_argument(
        "closure type \"" + type +
        "\" is not one of DIFFUSE, GLOSSY, WARD, PRINCIPLED, EMISSION, TRANSPARENT, TABULATED");
  }
  Closure closure;
  closure.type = found->second;
  const bool emissive = closure.type == ClosureType::kEmission;
  const bool principled = closure.type == ClosureType::kPrincipled;
  const bool tabulated = closure.type == ClosureType::kTabulated;
  if (emissive || tabulated || closure.type == ClosureType::kTransparent) closure.color = {1, 1, 1};
  if (tabulated && !dict.contains("brdf")) {
    throw std::invalid_argument("closure TABULATED needs \"brdf\", a number from Scene.add_brdf");
  }
  if (principled) closure.roughness = 0.5f;
  // A texture multiplies the plain value, so that value is 1 where only the texture is given.
  if (dict.contains("color_texture")) closure.color = {1, 1, 1};
  if (dict.contains("roughness_texture")) closure.roughness = 1.0f;
  if (dict.contains("metallic_texture")) closure.metallic = 1.0f;
  float strength = principled ? 0.0f : 1.0f;
  float ior = 1.5f, specular = 0.5f;
  Vec3 emission = {1, 1, 1};

  for (const auto& [key_handle, value] : dict) {
    const std::string key = py::str(key_handle);
    const std::string where = "closure " + type + ": " + key;
    auto number = [&] {
      const float x = value.cast<float>();
      if (!std::isfinite(x)) throw std::invalid_argument(where + " is not finite");
      return x;
    };
    auto color = [&] {
      const Vec3 c = to_vec3(value, where.c_str());
      if (!std::isfinite(c.x + c.y + c.z)) throw std::invalid_argument(where + " is not finite");
      return Vec3{fmaxf(c.x, 0.0f), fmaxf(c.y, 0.0f), fmaxf(c.z, 0.0f)};
    };
    auto texture = [&] { return value.is_none() ? -1 : value.cast<int32_t>(); };
    try {
      if (key == "type") continue;
      if (key == "weight")
        closure.weight = fmaxf(number(), 0.0f);
      else if (key == "color")
        closure.color = color();
      else if (key == "roughness")
        closure.roughness = number();
      else if (key == "anisotropy" || key == "anisotropic")
        closure.anisotropy = number();
      else if (key == "rotation" || key == "anisotropic_rotation")
        closure.rotation = number();
      else if (key == "alpha_x")
        closure.alpha_x = clampf(number(), 1e-3f, 1.0f);
      else if (key == "alpha_y")
        closure.alpha_y = clampf(number(), 1e-3f, 1.0f);
      else if (key == "metallic")
        closure.metallic = number();
      else if (key == "ior")
        ior = number();
      else if (key == "specular")
        specular = number();
      else if (key == "emission")
        emission = color();
      else if (key == "emission_strength" || key == "strength")
        strength = number();
      else if (key == "color_texture")
        closure.color_texture = texture();
      else if (key == "roughness_texture")
        closure.roughness_texture = texture();
      else if (key == "metallic_texture")
        closure.metallic_texture = texture();
      else if (key == "normal_texture")
        closure.normal_texture = texture();
      else if (key == "brdf" && tabulated)
        closure.brdf = value.cast<int32_t>();
      else if (key == "normal_strength")
        closure.normal_strength = maxf(number(), 0.0f);
      else if (key == "emission_texture")
        closure.emission_texture = texture();
      else
        throw std::invalid_argument("closure " + type + " has no parameter \"" + key + "\"");
    } catch (const py::cast_error&) {
      throw std::invalid_argument(where + " has a value of the wrong kind");
    }
  }
  // The IOR level scales the reflectance at normal incidence; 0.5 leaves the IOR as it is.
  const float root = (ior - 1.0f) / (ior + 1.0f);
  const float f0 = clampf(root * root * 2.0f * fmaxf(specular, 0.0f), 0.0f, 0.99f);
  closure.eta = specular == 0.5f ? fmaxf(ior, 1.0f) : (1.0f + sqrtf(f0)) / (1.0f - sqrtf(f0));
  if (emissive) {
    closure.emission = closure.color * fmaxf(strength, 0.0f);
    closure.emission_texture = closure.color_texture;
    closure.color_texture = -1;
  } else if (principled) {
    closure.emission = emission * fmaxf(strength, 0.0f);
  }
  return closure;
}

std::vector<Closure> parse_closures(const py::sequence& closures) {
  std::vector<Closure> parsed;
  for (const auto& item : closures) parsed.push_back(parse_closure(item.cast<py::dict>()));
  return parsed;
}

template <class Enum>
Enum parse_name(const std::string& value, const char* what,
                const std::map<std::string, Enum>& names) {
  const auto found = names.find(value);
  if (found != names.end()) return found->second;
  std::string all;
  for (const auto& [name, _] : names) all += (all.empty() ? "" : ", ") + name;
  throw std::invalid_argument(std::string(what) + " \"" + value + "\" is not one of " + all);
}

int add_texture(Scene& scene, const FloatArray& image, const std::string& interpolation,
                const std::string& extension, const std::optional<FloatArray>& uv_transform) {
  if (image.ndim() != 3)
    throw std::invalid_argument("texture: image must have shape (H, W, 3) or (H, W, 4)");
  TextureInput input;
  input.texels = image.data();
  input.height = int(image.shape(0));
  input.width = int(image.shape(1));
  input.channels = int(image.shape(2));
  input.interpolation = parse_name<TextureInterpolation>(
      interpolation, "interpolation",
      {{"LINEAR", TextureInterpolation::kLinear}, {"CLOSEST", TextureInterpolation::kClosest}});
  input.extension = parse_name<TextureExtension>(extension, "extension",
                                                 {{"REPEAT", TextureExtension::kRepeat},
                                                  {"EXTEND", TextureExtension::kExtend},
                                                  {"CLIP", TextureExtension::kClip},
                                                  {"MIRROR", TextureExtension::kMirror}});
  if (uv_transform) {
    require_rows(*uv_transform, "uv_transform", 3, 2);
    const float* m = uv_transform->data();
    input.u_row = {m[0], m[1], m[2]};
    input.v_row = {m[3], m[4], m[5]};
  }
  py::gil_scoped_release release;
  return scene.add_texture(input);
}

void set_environment(Scene& scene, const std::optional<FloatArray>& image,
                     std::shared_ptr<const EnvironmentSampler> sampler,
                     const std::optional<MatrixArray>& rotation, const py::object& color,
                     bool visible) {
  EnvironmentInput input;
  if (image) {
    if (image->ndim() != 3 || image->shape(2) != 3 || image->size() == 0) {
      throw std::invalid_argument(
          "environment: image must have shape (H, W, 3) and at least one texel");
    }
    input.height = int(image->shape(0));
    input.width = int(image->shape(1));
    // The array is borrowed, not copied; it may be let go on a thread without the GIL.
    auto* keeper = new FloatArray(*image);
    input.texels = std::shared_ptr<const float>(image->data(), [keeper](const float*) {
      py::gil_scoped_acquire acquire;
      delete keeper;
    });
  }
  input.sampler = std::move(sampler);
  if (rotation) {
    require_rows(*rotation, "world_to_env", 3, 3);
    const double* m = rotation->data();
    for (int i = 0; i < 3; ++i)
      input.world_to_env.row[i] = {float(m[3 * i]), float(m[3 * i + 1]), float(m[3 * i + 2])};
  }
  input.color = to_vec3(color, "color");
  input.visible = visible;
  scene.set_environment(std::move(input));
}

void start(RenderSession& session, std::shared_ptr<Scene> scene, int width, int height, int samples,
           int max_bounces, uint32_t seed, const std::string& pixel_filter, double filter_width,
           const std::optional<std::array<int, 4>>& region, bool film_transparent, int first_sample,
           bool bsdf_sampling, bool light_sampling, int light_rays, bool control_variate,
           bool learn_visibility, bool product_sampling, bool adaptive_sampling, bool blue_noise,
           const std::string& point_set, std::shared_ptr<const EnvironmentSampler> sampler,
           int candidates) {
  RenderOptions options;
  options.width = width;
  options.height = height;
  options.samples = samples;
  options.max_bounces = max_bounces;
  options.seed = seed;
  options.pixel_filter =
      parse_name<PixelFilter>(pixel_filter, "pixel_filter",
                              {{"BOX", PixelFilter::kBox},
                               {"GAUSSIAN", PixelFilter::kGaussian},
                               {"BLACKMAN_HARRIS", PixelFilter::kBlackmanHarris}});
  options.filter_width = filter_width;
  if (region) {
    options.x0 = (*region)[0];
    options.y0 = (*region)[1];
    options.x1 = (*region)[2];
    options.y1 = (*region)[3];
    if (options.x0 >= options.x1 || options.y0 >= options.y1) {
      throw std::invalid_argument("region must be (x0,y0,x1,y1) inside the film and not empty");
    }
  }
  options.film_transparent = film_transparent;
  options.first_sample = first_sample;
  options.bsdf_sampling = bsdf_sampling;
  options.light_sampling = light_sampling;
  options.blue_noise = blue_noise;
  options.multi_jittered =
      parse_name<bool>(point_set, "point_set", {{"SOBOL", false}, {"CMJ", true}});
  options.candidates = candidates;
  options.light_rays = light_rays;
  options.control_variate = control_variate;
  options.learn_visibility = learn_visibility;
  options.product_sampling = product_sampling;
  options.adaptive_sampling = adaptive_sampling;
  options.sampler = std::move(sampler);
  py::gil_scoped_release release;
  session.start(std::move(scene), options);
}

/// A view of a device's image, which lives as long as the array does. Read-only: the session shows
/// the same memory to others.
py::array_t<float> image_view(std::shared_ptr<const float> image, py::ssize_t width,
                              py::ssize_t height) {
  auto owner = std::make_unique<std::shared_ptr<const float>>(std::move(image));
  const float* data = owner->get();
  const py::capsule capsule(
      owner.get(), [](void* held) { delete static_cast<std::shared_ptr<const float>*>(held); });
  owner.release();
  py::array_t<float> view({height, width, py::ssize_t(4)}, data, capsule);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

py::array_t<float> pixels(const RenderSession& session,
                          std::optional<py::array_t<float, py::array::c_style>> out) {
  const py::ssize_t width = session.region_width(), height = session.region_height();
  if (!out) {
    if (std::shared_ptr<const float> image = session.device_image()) {
      return image_view(std::move(image), width, height);
    }
  }
  if (!out) out = py::array_t<float>({height, width, py::ssize_t(4)});
  if (out->size() != height * width * 4 || !out->writeable()) {
    throw std::invalid_argument("out must be a writable float32 array of shape (" +
                                std::to_string(height) + ", " + std::to_string(width) + ", 4)");
  }
  float* data = out->mutable_data();
  py::gil_scoped_release release;
  session.pixels(data);
  return *out;
}

py::dict session_stats(const RenderSession& session) {
  const SessionStats stats = session.stats();
  py::dict dict;
  dict["rays"] = stats.rays;
  dict["seconds"] = stats.render_seconds;
  dict["cpu_seconds"] = stats.cpu_seconds;
  dict["commit_seconds"] = stats.commit_seconds;
  dict["rejected_samples"] = stats.rejected_samples;
  dict["threads"] = stats.threads;
  dict["light_rays"] = stats.light_rays;
  dict["device"] = stats.device;
  return dict;
}

py::dict scene_stats(const Scene& scene) {
  const SceneStats stats = scene.stats();
  py::dict dict;
  dict["meshes_built"] = stats.meshes_built;
  dict["top_level_built"] = stats.top_level_built;
  dict["environments_set"] = stats.environments_set;
  dict["triangles"] = stats.triangles;
  dict["instances"] = stats.instances;
  dict["nbytes"] = stats.nbytes;
  return dict;
}

void bind_scene(py::module_& m) {
  using namespace pybind11::literals;
  auto mesh_arrays = [](FloatArray positions, IntArray triangles, std::optional<IntArray> corners,
                        std::optional<FloatArray> normals, std::optional<FloatArray> uvs,
                        std::optional<FloatArray> tangents, std::optional<IntArray> slots) {
    return MeshArrays{std::move(positions), std::move(triangles), std::move(corners),
                      std::move(normals),   std::move(uvs),       std::move(tangents),
                      std::move(slots)};
  };
  py::class_<Scene, std::shared_ptr<Scene>>(m, "Scene", R"(
What a RenderSession renders: meshes, their instances, materials, textures, one camera, one environment.

Only what changed is built again. While a session renders the scene every change raises RuntimeError; an unknown id
or an array of the wrong shape raises ValueError. Geometry that cannot be rendered (triangles with an index out of
range, a vertex that is not finite or no area; singular matrices) is left out and named in `warnings`.

`flat`: for a scene that is not going to be edited. One ray-tracing tree holds all triangles in world space, where copies
of meshes stay few: rays cost less, a moved object more. Hits may be rounded differently.)")
      .def(py::init([](bool flat) {
             return std::make_shared<Scene>(flat ? TreeKind::kFlat : TreeKind::kInstanced);
           }),
           py::kw_only(), "flat"_a = false)
      .def(
          "add_mesh",
          [mesh_arrays](Scene& scene, FloatArray positions, IntArray triangles,
                        std::optional<IntArray> corners, std::optional<FloatArray> corner_normals,
                        std::optional<FloatArray> corner_uvs,
                        std::optional<FloatArray> corner_tangents,
                        std::optional<IntArray> material_slots, const std::string& name) {
            const MeshArrays arrays = mesh_arrays(positions, triangles, corners, corner_normals,
                                                  corner_uvs, corner_tangents, material_slots);
            const MeshInput input = arrays.input(name);
            py::gil_scoped_release release;
            return scene.add_mesh(input);
          },
          "positions"_a, "triangles"_a, "corners"_a = py::none(), "corner_normals"_a = py::none(),
          "corner_uvs"_a = py::none(), "corner_tangents"_a = py::none(),
          "material_slots"_a = py::none(), "name"_a = "", R"(
Adds a triangle mesh and returns its id; the arrays are copied.

positions (V,3) float32; triangles (T,3) int32 into positions; corners (T,3) int32 into the corner arrays (default:
corner 3t+k); corner_normals (C,3), corner_uvs (C,2), corner_tangents (C,3) float32; material_slots (T,) int32.)")
      .def(
          "set_mesh",
          [mesh_arrays](Scene& scene, int mesh, FloatArray positions, IntArray triangles,
                        std::optional<IntArray> corners, std::optional<FloatArray> corner_normals,
                        std::optional<FloatArray> corner_uvs,
                        std::optional<FloatArray> corner_tangents,
                        std::optional<IntArray> material_slots, const std::string& name) {
            const MeshArrays arrays = mesh_arrays(positions, triangles, corners, corner_normals,
                                                  corner_uvs, corner_tangents, material_slots);
            const MeshInput input = arrays.input(name);
            py::gil_scoped_release release;
            scene.set_mesh(mesh, input);
          },
          "mesh"_a, "positions"_a, "triangles"_a, "corners"_a = py::none(),
          "corner_normals"_a = py::none(), "corner_uvs"_a = py::none(),
          "corner_tangents"_a = py::none(), "material_slots"_a = py::none(), "name"_a = "",
          "Replaces a mesh; its instances stay. Arguments as in add_mesh.")
      .def("remove_mesh", &Scene::remove_mesh, "mesh"_a,
           "Raises ValueError while an instance uses it.")
      .def(
          "add_instance",
          [](Scene& scene, int mesh, const MatrixArray& object_to_world,
             std::vector<int> materials) {
            return scene.add_instance(mesh, to_matrix(object_to_world, "object_to_world"),
                                      std::move(materials));
          },
          "mesh"_a, "object_to_world"_a, "materials"_a = std::vector<int>(),
          "Places a mesh; `materials` holds a material id per slot (-1: none, black). Returns the "
          "instance's id.")
      .def(
          "set_transform",
          [](Scene& scene, int instance, const MatrixArray& object_to_world) {
            scene.set_transform(instance, to_matrix(object_to_world, "object_to_world"));
          },
          "instance"_a, "object_to_world"_a, "Moves an instance; no mesh is built again.")
      .def("set_instance_materials", &Scene::set_instance_materials, "instance"_a, "materials"_a)
      .def("remove_instance", &Scene::remove_instance, "instance"_a)
      .def(
          "add_material",
          [](Scene& scene, const py::sequence& closures, const std::string& name) {
            return scene.add_material(parse_closures(closures), name);
          },
          "closures"_a, "name"_a = "", R"(
Adds a material, the sum of `closures`, and returns its id.

Each closure is a dict with `type` and `weight` (the product of the mix factors above it): DIFFUSE (color, roughness), GLOSSY
(color, roughness, anisotropy, rotation in turns), WARD (color, alpha_x, alpha_y, rotation), PRINCIPLED (color,
metallic, roughness, ior, specular = IOR level, anisotropic, rotation, emission, emission_strength), EMISSION (color,
strength), TRANSPARENT (color). color_texture, roughness_texture, metallic_texture and emission_texture are texture
ids whose values multiply the plain ones; normal_texture is a normal map in tangent space, normal_strength its strength.)")
      .def(
          "set_material",
          [](Scene& scene, int material, const py::sequence& closures) {
            scene.set_material(material, parse_closures(closures));
          },
          "material"_a, "closures"_a)
      .def("remove_material", &Scene::remove_material, "material"_a)
      .def("add_texture", &add_texture, "image"_a, "interpolation"_a = "LINEAR",
           "extension"_a = "REPEAT", "uv_transform"_a = py::none(), R"(
Adds an image (H,W,3) or (H,W,4) float32, scene-linear, row 0 at the top; returns its id. interpolation: LINEAR or
CLOSEST; extension: REPEAT, EXTEND, CLIP or MIRROR. uv_transform (2,3) turns the surface's (u,v,1) into where the
image is looked up; None leaves them as they are.)")
      .def("remove_texture", &Scene::remove_texture, "texture"_a)
      .def(
          "add_brdf",
          [](Scene& scene, std::shared_ptr<BrdfKdTree> brdf) {
            return scene.add_brdf(std::move(brdf));
          },
          "brdf"_a,
          "Adds a tabulated BRDF for closures of type TABULATED; returns its id. Scenes share it.")
      .def("remove_brdf", &Scene::remove_brdf, "brdf"_a)
      .def(
          "set_camera",
          [](Scene& scene, const MatrixArray& camera_to_world, const MatrixArray& projection) {
            scene.set_camera(to_matrix(camera_to_world, "camera_to_world"),
                             to_matrix(projection, "projection"));
          },
          "camera_to_world"_a, "projection"_a,
          "Matrices (4,4); the projection as OpenGL has it, perspective or orthographic with any "
          "shift.")
      .def("set_environment", &set_environment, "image"_a = py::none(), "sampler"_a = py::none(),
           "world_to_env"_a = py::none(), "color"_a = py::make_tuple(1.0f, 1.0f, 1.0f),
           "visible"_a = true, R"(
Sets the environment; nothing is built again. `image` (H,W,3) float32 radiance, row 0 = +Z, is borrowed; None is a
constant 1. `sampler` was built from that image; None is uniform over the sphere. `world_to_env` (3,3) is a rotation
from world to map, `color` a factor on the image, `visible` whether camera rays see it.)")
      .def_property_readonly("warnings", &Scene::warnings, "What was left out and why, by name.")
      .def_property_readonly("stats", &scene_stats,
                             "Counts of what was built, triangles, instances and bytes.");
}

}  // namespace

void bind_render(py::module_& m) {
  using namespace pybind11::literals;
  bind_scene(m);
  py::class_<RenderSession>(m, "RenderSession", R"(
A progressive path-traced render on native threads (0: all cores), or on a GPU: device is "CPU", "CUDA" (the first GPU)
or an id of devices(). If the GPU fails or is not there, the threads finish the frame and `warning` says why.

A pixel's value depends on its position, the sample index and the seed only.)")
      .def(py::init([](int threads, const std::string& device) {
             return std::make_unique<RenderSession>(threads, make_device_renderer(device));
           }),
           "threads"_a = 0, "device"_a = "CPU")
      .def("start", &start, "scene"_a, "width"_a, "height"_a, "samples"_a, py::kw_only(),
           "max_bounces"_a = 4, "seed"_a = 0, "pixel_filter"_a = "BLACKMAN_HARRIS",
           "filter_width"_a = 1.5, "region"_a = py::none(), "film_transparent"_a = false,
           "first_sample"_a = 0, "bsdf_sampling"_a = true, "light_sampling"_a = true,
           "light_rays"_a = 1, "control_variate"_a = false, "learn_visibility"_a = false,
           "product_sampling"_a = false, "adaptive_sampling"_a = false, "blue_noise"_a = false,
           "point_set"_a = "SOBOL", "sampler"_a = py::none(), "candidates"_a = 0, R"(
Starts rendering and returns at once. RuntimeError while running, ValueError for values out of range.

max_bounces 0 shows the environment as the first surface sees it. pixel_filter: BOX (one pixel), GAUSSIAN or
BLACKMAN_HARRIS with filter_width in pixels, as Cycles defines them. region (x0,y0,x1,y1): pixels from the lower left
corner of the film; a pixel's value does not depend on it. first_sample continues an earlier render's sequence.
bsdf_sampling or light_sampling off leaves the other alone, without MIS. light_rays (1..4): light samples at the first
surface that a path meets; mirrors and narrow lobes take one. 0: as many as pay, 4 with max_bounces 0 and else 2, until
adaptive_sampling's first samples have told better. control_variate: diffuse light as its difference from
the unshadowed map's, tile by tile as far as pilot paths find that it helps; the mean is the same. learn_visibility: what shadow rays meet
during the first 16 samples steers later light samples where much of the environment is hidden (CPU, kd-trees chosen by a
warp); pixels then depend on the whole region that is rendered. product_sampling: light samples of glossy surfaces are
directed to what their lobes reflect (kd-trees of linear blocks). adaptive_sampling: samples is the mean of all pixels;
after the first of them the rest is shared out by the noise of each pixel's neighbours, which keeps pixels unbiased (CPU,
from 3 samples on; pixels then depend on the region). blue_noise makes the errors of neighbouring pixels differ, which
looks finer at few samples. point_set: SOBOL, good for any number of samples, or CMJ, points made for just `samples` of
them, where that is what every pixel takes: without adaptive_sampling, blue_noise and first_sample, else it is SOBOL.
sampler takes the place of the scene's own, so
that two sessions compare samplers on one scene. candidates above 0 (for comparison and teaching): each light sample is
chosen by BSDF times radiance from so many (Burke et al. 2005, unbiased), half of them BSDF samples if bsdf_sampling is on;
the BSDF's own ray then brings no light from the environment. light_rays,
control_variate and product_sampling then do nothing.)")
      .def("wait", &RenderSession::wait, "seconds"_a, py::call_guard<py::gil_scoped_release>(),
           "True if the render has ended; waits at most that long.")
      .def("cancel", &RenderSession::cancel, py::call_guard<py::gil_scoped_release>(),
           "Stops and returns when all threads stand still; what was rendered stays.")
      .def("pixels", &pixels, "out"_a = py::none(), R"(
The mean so far as float32 (h,w,4), linear RGB and alpha, bottom row first; also while rendering. `out` is filled and
returned if given. Without it, what a GPU has rendered comes as a read-only view of the memory that the GPU copied it
to.)")
      .def_property_readonly("samples_done", &RenderSession::samples_done,
                             "Samples that every pixel has.")
      .def_property_readonly("running", &RenderSession::running)
      .def_property_readonly(
          "error",
          [](const RenderSession& session) -> py::object {
            const std::string error = session.error();
            return error.empty() ? py::object(py::none()) : py::object(py::str(error));
          },
          "What stopped the render, or None.")
      .def_property_readonly(
          "warning",
          [](const RenderSession& session) -> py::object {
            const std::string warning = session.warning();
            return warning.empty() ? py::object(py::none()) : py::object(py::str(warning));
          },
          "Why the CPU renders although a GPU was asked for, or None.")
      .def_property_readonly("render_seconds",
                             [](const RenderSession& s) { return s.stats().render_seconds; })
      .def_property_readonly("stats", &session_stats,
                             "rays, seconds, cpu_seconds, commit_seconds, rejected_samples, "
                             "threads, light_rays (at the first surface, in the last samples), "
                             "device (what rendered).");
}

}  // namespace skytree
