// SPDX-License-Identifier: GPL-3.0-or-later
// Every unbiased way to choose directions towards a map.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "src/alias_sampler.h"
#include "src/hierarchy_sampler.h"
#include "src/inversion_sampler.h"
#include "src/kdtree_sampler.h"

namespace skytree::testing {

struct NamedSampler {
  std::string name;
  std::shared_ptr<const EnvironmentSampler> sampler;
};

/// Those whose density is constant in a texel.
inline std::vector<NamedSampler> constant_samplers(const LatLongImage& image, int block_count) {
  std::vector<NamedSampler> samplers;
  const char* criteria[] = {"RANGE", "VARIANCE", "SSE", "MIN_VARIANCE", "MEDIAN_CUT"};
  const char* probabilities[] = {"FITTED", "EXACT", "MIN_VARIANCE"};
  for (int c = 0; c < 5; ++c) {
    for (int p = 0; p < 3; ++p) {
      for (Statistics statistics : {Statistics::RADIANCE, Statistics::PIXELS}) {
        KdTreeConfig config;
        config.block_count = block_count;
        config.split_criterion = (SplitCriterion)c;
        config.block_probability = (BlockProbability)p;
        config.statistics = statistics;
        config.block_density = BlockDensity::CONSTANT;
        samplers.push_back({std::string(criteria[c]) + " " + probabilities[p] +
                                (statistics == Statistics::PIXELS ? " of pixels" : ""),
                            std::make_shared<KdTreeSampler>(image, config)});
      }
    }
  }
  samplers.push_back({"inversion, guided", std::make_shared<InversionSampler>(image, true)});
  samplers.push_back({"inversion, binary", std::make_shared<InversionSampler>(image, false)});
  samplers.push_back({"alias", std::make_shared<AliasSampler>(image)});
  samplers.push_back({"hierarchy", std::make_shared<HierarchySampler>(image)});
  samplers.push_back({"uniform", std::make_shared<UniformSampler>()});
  return samplers;
}

inline std::vector<NamedSampler> all_samplers(const LatLongImage& image, int block_count) {
  std::vector<NamedSampler> samplers;
  for (double compensation : {0.0, 1.0}) {
    KdTreeConfig config;
    config.block_count = block_count;
    config.split_criterion = SplitCriterion::MIN_VARIANCE;
    config.block_probability = BlockProbability::MIN_VARIANCE;
    config.block_density = BlockDensity::LINEAR;
    config.compensation = compensation;
    samplers.push_back({compensation > 0 ? "linear, compensated" : "linear",
                        std::make_shared<KdTreeSampler>(image, config)});
  }
  for (NamedSampler& named : constant_samplers(image, block_count)) {
    samplers.push_back(std::move(named));
  }
  return samplers;
}

}  // namespace skytree::testing
