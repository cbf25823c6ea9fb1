// SPDX-License-Identifier: GPL-3.0-or-later
// What a kernel must compute, computed on the host by the same headers: trees as the device has
// them, and an image.
#pragma once

#include <vector>

#include "kernel/path.h"
#include "src/bvh_builder.h"
#include "src/environment_sampler.h"
#include "src/filter_table.h"
#include "src/render_session.h"

namespace skytree::cuda {

struct HostTrees {
  std::vector<MeshBvh> trees;
  std::vector<MeshBvhView> views;
  TopBvh top;
  TracerView view;

  explicit HostTrees(const SceneParts& parts) {
    const std::atomic<bool> cancel{false};
    trees.resize(parts.meshes.size());
    for (size_t i = 0; i < parts.meshes.size(); ++i) {
      const MeshPart& part = parts.meshes[i];
      build_mesh_bvh(part.view.positions, part.view.triangles, part.triangle_count, cancel,
                     &trees[i]);
      views.push_back({trees[i].nodes.data(), trees[i].triangles.data()});
    }
    std::vector<Bounds> bounds;
    for (size_t i = 0; i < parts.instances->size(); ++i) {
      const Bounds none = {{1, 1, 1}, {-1, -1, -1}};
      bounds.push_back(parts.instance_usable[i] ? trees[(*parts.instances)[i].mesh].bounds : none);
    }
    build_top_bvh(*parts.instances, bounds, cancel, &top);
    view = {top.nodes.data(), top.instances.data(), views.data()};
  }
};

/// RGBA means as RenderSession::pixels gives them.
inline std::vector<float> render_on_host(Scene* scene, const RenderOptions& options) {
  const std::atomic<bool> cancel{false};
  scene->begin_use();
  scene->commit(cancel, false);
  const SceneParts parts = scene->parts(options.width, options.height);
  const HostTrees trees(parts);
  const std::vector<float> filter = make_filter_table(options.pixel_filter, options.filter_width);
  SceneView view = parts.view;
  if (const EnvironmentSampler* sampler =
          options.sampler ? options.sampler.get() : scene->sampler()) {
    view.environment.sampler = options.product_sampling ? sampler->product_view() : sampler->view();
  }
  RenderSettings settings = make_render_settings(options, filter.data());
  std::vector<float> controls;
  const int columns = (options.width + kTileSize - 1) / kTileSize;
  if (options.control_variate) {
    for (int y = 0; y < options.height; y += kTileSize) {
      for (int x = 0; x < columns; ++x) {
        controls.push_back(pilot_tile(view, trees.view, settings, x, y / kTileSize));
      }
    }
    settings.controls = {controls.data(), 0, 0, columns};
  }
  std::vector<float> pixels;
  for (int y = 0; y < options.height; ++y) {
    for (int x = 0; x < options.width; ++x) {
      FilmPixel film = {};
      for (int s = 0; s < options.samples; ++s) {
        add_to_film(
            trace_path(view, trees.view, settings, x, y, uint32_t(options.first_sample + s)),
            &film);
      }
      const double scale = 1.0 / options.samples;
      for (const double sum : film.radiance) pixels.push_back(float(sum * scale));
      pixels.push_back(float(film.alpha * scale));
    }
  }
  scene->end_use();
  return pixels;
}

}  // namespace skytree::cuda
