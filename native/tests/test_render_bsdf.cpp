// SPDX-License-Identifier: GPL-3.0-or-later
// Every lobe against its own pdf, by histogram and by quadrature; energy; reciprocity.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "kernel/bsdf.h"
#include "kernel/rng.h"

namespace skytree {
namespace {

struct LobeCase {
  const char* name;
  LobeType type;
  float alpha_x, alpha_y;
};

Lobe make_lobe(const LobeCase& c) {
  Lobe lobe = {};
  lobe.type = c.type;
  lobe.select = 1.0f;
  lobe.weight = {1, 1, 1};
  // A frame that is aligned with no axis, so that mixed-up components show.
  lobe.normal = normalize({0.3f, -0.5f, 0.8f});
  orthonormal_basis(lobe.normal, &lobe.tangent, &lobe.bitangent);
  lobe.alpha_x = c.alpha_x;
  lobe.alpha_y = c.alpha_y;
  lobe.eta = 1.5f;
  lobe.f0 = {0.9f, 0.6f, 0.3f};
  if (c.type == LobeType::kRoughDiffuse) {
    lobe.rough = make_oren_nayar(0.8f);
    lobe.f0 = {1, 1, 1};
  }
  return lobe;
}

Vec3 from_frame(const Lobe& lobe, float cosine, float azimuth) {
  const float sine = std::sqrt(1.0f - cosine * cosine);
  return to_world(lobe, {sine * std::cos(azimuth), sine * std::sin(azimuth), cosine});
}

class LobeTest : public testing::TestWithParam<std::tuple<LobeCase, float>> {
 protected:
  Lobe lobe = make_lobe(std::get<0>(GetParam()));
  Vec3 view = from_frame(lobe, std::get<1>(GetParam()), 0.7f);
  bool narrow = lobe.type != LobeType::kDiffuse && std::min(lobe.alpha_x, lobe.alpha_y) < 0.05f;
};

// Directions are compared where the lobe lives: as half vectors scaled to slopes over alpha, or for
// the diffuse lobe as they are; in that plane any alpha is a wide distribution and a grid of cells
// resolves it.
struct Plane {
  const Lobe& lobe;
  Vec3 view;
  Vec2 project(Vec3 direction) const {
    const Vec3 h = to_local(lobe, normalize(view + direction));
    return {std::atan(h.x / (h.z * lobe.alpha_x)), std::atan(h.y / (h.z * lobe.alpha_y))};
  }
};

TEST_P(LobeTest, SamplesFollowPdf) {
  // chi^2 of sampled directions over a grid of the sphere (broad lobes) or of half-vector slopes
  // (narrow ones).
  constexpr int kCells = 12, kSub = 24;
  constexpr int kSamples = 200000;
  const Plane plane{lobe, view};
  std::vector<double> observed(kCells * kCells, 0.0), expected(kCells * kCells, 0.0);
  int lost = 0;
  for (uint32_t i = 0; i < kSamples; ++i) {
    // Independent numbers: chi^2 assumes them, and stratified ones would pass too easily.
    const Vec2 u = {unit_float(hash_u32(2 * i + 77)), unit_float(hash_u32(hash_u32(2 * i + 78)))};
    const Vec3 direction = sample_lobe(lobe, view, u);
    EXPECT_NEAR(length(direction), 1.0f, 1e-4f);
    if (!(eval_lobe(lobe, view, direction).pdf > 0.0f)) {
      ++lost;  // below the surface
      continue;
    }
    const Vec2 p = plane.project(direction);
    const int x = std::min(int((p.x / M_PI + 0.5) * kCells), kCells - 1);
    const int y = std::min(int((p.y / M_PI + 0.5) * kCells), kCells - 1);
    observed[y * kCells + x] += 1.0;
  }
  double total = 0.0;
  for (int y = 0; y < kCells * kSub; ++y) {
    for (int x = 0; x < kCells * kSub; ++x) {
      const double px = ((x + 0.5) / (kCells * kSub) - 0.5) * M_PI;
      const double py = ((y + 0.5) / (kCells * kSub) - 0.5) * M_PI;
      const double sx = std::tan(px) * lobe.alpha_x, sy = std::tan(py) * lobe.alpha_y;
      const double norm = std::sqrt(sx * sx + sy * sy + 1.0);
      const Vec3 local = {float(sx / norm), float(sy / norm), float(1.0 / norm)};
      const Vec3 h = to_world(lobe, local);
      const float cos_half = dot(h, view);
      if (cos_half <= 0.0f) continue;
      const Vec3 direction = h * (2.0f * cos_half) - view;
      // d(px,py) to slopes, slopes to half vectors (cos^3), half vectors to directions (4 cos).
      const double slopes = lobe.alpha_x * (1.0 + std::tan(px) * std::tan(px)) * lobe.alpha_y *
                            (1.0 + std::tan(py) * std::tan(py));
      const double area = std::pow(M_PI / (kCells * kSub), 2);
      const double mass = eval_lobe(lobe, view, direction).pdf * slopes * area *
                          std::pow(norm, -3.0) * 4.0 * cos_half;
      expected[(y / kSub) * kCells + x / kSub] += mass;
      total += mass;
    }
  }
  EXPECT_NEAR(total + double(lost) / kSamples, 1.0, 0.01) << "the pdf does not integrate to 1";
  double chi2 = 0.0;
  int freedom = -1;
  double pooled_observed = 0.0, pooled_expected = 0.0;
  for (int i = 0; i < kCells * kCells; ++i) {
    const double e = expected[i] / total * (kSamples - lost);
    if (e < 10.0) {
      pooled_observed += observed[i];
      pooled_expected += e;
      continue;
    }
    chi2 += (observed[i] - e) * (observed[i] - e) / e;
    ++freedom;
  }
  if (pooled_expected >= 10.0) {
    chi2 += std::pow(pooled_observed - pooled_expected, 2) / pooled_expected;
    ++freedom;
  }
  ASSERT_GT(freedom, 3);
  // Wilson-Hilferty: chi^2 as a normal deviate. The quadrature's own error leaves room up to 5
  // sigma.
  const double z = (std::cbrt(chi2 / freedom) - (1.0 - 2.0 / (9.0 * freedom))) /
                   std::sqrt(2.0 / (9.0 * freedom));
  EXPECT_LT(z, 5.0) << "chi^2 " << chi2 << " with " << freedom << " degrees of freedom";
}

TEST_P(LobeTest, ReflectsNoMoreThanItReceives) {
  double albedo = 0.0;
  constexpr uint32_t kSamples = 1 << 16;
  for (uint32_t i = 0; i < kSamples; ++i) {
    const Vec3 direction = sample_lobe(lobe, view, random_pair(5, i, 0));
    const BsdfValue value = eval_lobe(lobe, view, direction);
    if (value.pdf > 0.0f) albedo += value.f.x / value.pdf;
  }
  albedo /= kSamples;
  EXPECT_LE(albedo, 1.0 + 1e-3);
  if (lobe.type == LobeType::kDiffuse) {
    EXPECT_NEAR(albedo, 1.0, 1e-5);
  }
  if (lobe.type == LobeType::kRoughDiffuse) {
    EXPECT_NEAR(albedo, 1.0, 2e-3);  // the average albedo's constant is rounded
  }
  if (lobe.type == LobeType::kGlossy && narrow) {
    EXPECT_GT(albedo, 0.9);
  }
}

TEST_P(LobeTest, IsReciprocal) {
  for (uint32_t i = 0; i < 256; ++i) {
    const Vec2 u = random_pair(9, i, 0);
    const Vec3 a = sample_lobe(lobe, view, u);
    if (dot(a, lobe.normal) < 0.05f) continue;
    const float forward = eval_lobe(lobe, view, a).f.x / dot(a, lobe.normal);
    const float backward = eval_lobe(lobe, a, view).f.x / dot(view, lobe.normal);
    EXPECT_NEAR(forward, backward, 2e-3f * std::max(forward, backward) + 1e-6f);
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, LobeTest,
    testing::Combine(testing::Values(LobeCase{"diffuse", LobeType::kDiffuse, 1, 1},
                                     LobeCase{"rough_diffuse", LobeType::kRoughDiffuse, 1, 1},
                                     LobeCase{"glossy", LobeType::kGlossy, 0.3f, 0.3f},
                                     LobeCase{"glossy_aniso", LobeType::kGlossy, 0.6f, 0.05f},
                                     LobeCase{"glossy_sharp", LobeType::kGlossy, 0.001f, 0.001f},
                                     LobeCase{"dielectric", LobeType::kDielectric, 0.2f, 0.2f},
                                     LobeCase{"metal", LobeType::kMetal, 0.1f, 0.4f},
                                     LobeCase{"ward", LobeType::kWard, 0.2f, 0.2f},
                                     LobeCase{"ward_aniso", LobeType::kWard, 0.5f, 0.001f}),
                     testing::Values(0.95f, 0.5f, 0.15f)),
    [](const auto& info) {
      return std::string(std::get<0>(info.param).name) + "_" +
             std::to_string(int(100 * std::get<1>(info.param)));
    });

TEST(Fresnel, DielectricMatchesItsLimits) {
  EXPECT_NEAR(fresnel_dielectric(1.0f, 1.5f), 0.04f, 1e-6f);
  EXPECT_NEAR(fresnel_dielectric(0.0f, 1.5f), 1.0f, 1e-5f);
}

TEST(Random, PairsAreStratifiedAndIndependentOfEachOther) {
  // The first 2^k points of each pair are a (0,k,2)-net: one point in each elementary interval.
  for (uint32_t pair = 0; pair < 4; ++pair) {
    for (int bits = 0; bits <= 8; ++bits) {
      std::vector<int> seen(256, 0);
      for (uint32_t i = 0; i < 256; ++i) {
        const Vec2 u = random_pair(1234, i, pair);
        ASSERT_TRUE(u.x >= 0 && u.x < 1 && u.y >= 0 && u.y < 1);
        ++seen[(int(u.x * float(1 << bits)) << (8 - bits)) + int(u.y * float(1 << (8 - bits)))];
      }
      for (const int count : seen) EXPECT_EQ(count, 1);
    }
  }
  // Between pairs nothing may be left of the common index.
  double correlation = 0.0;
  for (uint32_t seed = 0; seed < 64; ++seed) {
    for (uint32_t i = 0; i < 64; ++i) {
      correlation += (random_pair(seed, i, 0).x - 0.5) * (random_pair(seed, i, 1).x - 0.5);
    }
  }
  EXPECT_NEAR(correlation / 4096 * 12, 0.0, 0.06);
}

}  // namespace
}  // namespace skytree
