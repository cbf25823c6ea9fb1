// SPDX-License-Identifier: GPL-3.0-or-later
// Tabulated BRDFs: values against the models that they were made of, samples against the density,
// energy, reciprocity, and MERL files, good and bad.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>

#include "kernel/bsdf.h"
#include "kernel/rng.h"
#include "src/brdf_kdtree.h"

namespace skytree {
namespace {

struct Case {
  const char* name;
  bool ward;
  float alpha_x, alpha_y;
  BlockProbability probability = BlockProbability::MIN_VARIANCE;
};

BrdfTablePointer make_table(const Case& c) {
  return c.ward ? make_ward_table(c.alpha_x, c.alpha_y) : make_ggx_table(c.alpha_x, c.alpha_y);
}

/// The renderer's lobe of the same model.
Lobe analytic_lobe(const Case& c) {
  Lobe lobe = {};
  lobe.type = c.ward ? LobeType::kWard : LobeType::kGlossy;
  lobe.weight = {1, 1, 1};
  lobe.normal = {0, 0, 1};
  lobe.tangent = {1, 0, 0};
  lobe.bitangent = {0, 1, 0};
  lobe.alpha_x = c.alpha_x;
  lobe.alpha_y = c.alpha_y;
  return lobe;
}

Vec3 direction_at(float cosine, float turns) {
  float sine, cos_phi;
  sky_sincos_turns(turns, &sine, &cos_phi);
  const float r = std::sqrt(1.0f - cosine * cosine);
  return {r * cos_phi, r * sine, cosine};
}

class BrdfTableTest : public testing::TestWithParam<Case> {
 protected:
  /// Built once for all tests: an anisotropic one takes a second.
  static const BrdfKdTree& make() {
    static std::map<std::string, std::unique_ptr<BrdfKdTree>> all;
    std::unique_ptr<BrdfKdTree>& brdf = all[GetParam().name];
    if (!brdf) {
      BrdfKdTreeConfig config;
      config.tree.block_probability = GetParam().probability;
      brdf = std::make_unique<BrdfKdTree>(make_table(GetParam()), config);
    }
    return *brdf;
  }
};

TEST_P(BrdfTableTest, ValueIsTheModels) {
  // Directions as the model samples them: where its light is. Mean absolute difference of the
  // weights, relative to their mean.
  const BrdfTable& table = make().table();
  const Lobe lobe = analytic_lobe(GetParam());
  double difference = 0, sum = 0;
  for (uint32_t k = 0; k < 4096; ++k) {
    const Vec2 v = random_pair(3, k, 1);
    const Vec3 o = direction_at(0.15f + 0.85f * v.x, v.y);
    const Vec3 i = sample_lobe(lobe, o, random_pair(3, k, 0));
    const BsdfValue value = eval_lobe(lobe, o, i);
    if (!(value.pdf > 0.0f)) continue;
    difference += std::fabs(brdf_table_value(table.view(), o, i).x * i.z - value.f.x) / value.pdf;
    sum += value.f.x / value.pdf;
  }
  EXPECT_LT(difference / sum, 0.01);
}

TEST_P(BrdfTableTest, IsReciprocal) {
  const BrdfTable& table = make().table();
  for (uint32_t k = 0; k < 256; ++k) {
    const Vec2 a = random_pair(4, k, 0), b = random_pair(4, k, 1);
    const Vec3 o = direction_at(0.05f + 0.9f * a.x, a.y), i = direction_at(0.05f + 0.9f * b.x, b.y);
    const float forward = brdf_table_value(table.view(), o, i).x;
    EXPECT_NEAR(forward, brdf_table_value(table.view(), i, o).x, 1e-3f * forward + 1e-7f);
  }
}

/// Cells of the half vectors: s of the stretched one by azimuth, in the tree's own measure.
struct HalfCells {
  static constexpr int kRows = 16, kColumns = 12, kSub = 16;  // borders of the tree
  static double border(int row, int rows) {
    const double t = double(row) / rows;
    return 2.0 * std::pow(std::sin(0.25 * M_PI * t * t), 2);
  }
  static int index(const BrdfTableView& table, Vec3 o, Vec3 i) {
    const Vec3 s = stretch_half(table, normalize(o + i)).h;
    const double theta = std::atan2(std::hypot(s.x, s.y), s.z);
    const int row = std::min(int(std::sqrt(theta / (0.5 * M_PI)) * kRows), kRows - 1);
    return row * kColumns + std::min(int(azimuth_turns(s.x, s.y) * kColumns), kColumns - 1);
  }
};

TEST_P(BrdfTableTest, SamplesFollowTheDensity) {
  const BrdfKdTree& brdf = make();
  const TabulatedBrdfView view = brdf.view();
  constexpr int kSamples = 60000, kRows = HalfCells::kRows * HalfCells::kSub,
                kColumns = HalfCells::kColumns * HalfCells::kSub;
  for (const float cosine : {0.95f, 0.5f, 0.1f}) {
    SCOPED_TRACE(cosine);
    const Vec3 o = direction_at(cosine, 0.125f);
    std::vector<double> expected(HalfCells::kRows * HalfCells::kColumns, 0.0),
        drawn(expected.size(), 0.0);
    double lost = 0, total = 0;
    for (uint32_t k = 0; k < kSamples; ++k) {
      const Vec2 u = {unit_float(hash_u32(2 * k + 77)), unit_float(hash_u32(hash_u32(2 * k + 78)))};
      const Vec3 i = brdf_sample(view, o, u);
      ASSERT_NEAR(length(i), 1.0f, 1e-5f);
      if (i.z <= 0.0f) {
        lost += 1;
        continue;
      }
      ASSERT_GT(brdf_pdf(view, o, i), 0.0f);
      drawn[size_t(HalfCells::index(view.table, o, i))] += 1;
    }
    for (int r = 0; r < kRows; ++r) {
      const double s0 = HalfCells::border(r, kRows), s1 = HalfCells::border(r + 1, kRows);
      for (int c = 0; c < kColumns; ++c) {
        const double s = 0.5 * (s0 + s1), phi = 2.0 * M_PI * (c + 0.5) / kColumns;
        const double radius = std::sqrt(s * (2.0 - s));
        const Vec3 h =
            normalize({float(radius * std::cos(phi)) * view.table.stretch.x,
                       float(radius * std::sin(phi)) * view.table.stretch.y, float(1.0 - s)});
        const float cos_half = dot(o, h);
        if (cos_half <= 0.0f) continue;
        const Vec3 i = normalize(h * (2.0f * cos_half) - o);
        if (i.z <= 0.0f) continue;
        // A unit of (s, turns) is 2 pi of the stretched half vector's solid angle.
        const double mass = double(brdf_pdf(view, o, i)) *
                            brdf_jacobian(stretch_half(view.table, h), cos_half) * (s1 - s0) /
                            kColumns;
        expected[size_t(r / HalfCells::kSub * HalfCells::kColumns + c / HalfCells::kSub)] += mass;
        total += mass;
      }
    }
    EXPECT_NEAR(total + lost / kSamples, 1.0, 0.01) << "the pdf does not integrate to 1";
    double chi2 = 0, pooled_expected = 0, pooled_drawn = 0;
    int degrees = -1;
    for (size_t k = 0; k < expected.size(); ++k) {
      pooled_expected += expected[k] / total * (kSamples - lost);
      pooled_drawn += drawn[k];
      if (pooled_expected < 10) continue;
      chi2 += std::pow(pooled_drawn - pooled_expected, 2) / pooled_expected;
      ++degrees;
      pooled_expected = pooled_drawn = 0;
    }
    ASSERT_GT(degrees, 3);
    // The quadrature's own error leaves room up to 5 sigma, as with the analytic lobes.
    const double v = 2.0 / (9.0 * degrees);
    EXPECT_LT((std::cbrt(chi2 / degrees) - (1.0 - v)) / std::sqrt(v), 5.0)
        << chi2 << " of " << degrees;
  }
}

TEST_P(BrdfTableTest, ReflectsWhatTheModelDoesAndNoMoreThanItReceives) {
  // Furnace: the mean weight is the albedo. Unbiased against the model's, which is sampled its own
  // way, within the table's interpolation error.
  const BrdfKdTree& brdf = make();
  const TabulatedBrdfView view = brdf.view();
  const Lobe lobe = analytic_lobe(GetParam());
  for (const float cosine : {0.95f, 0.5f, 0.2f}) {
    const Vec3 o = direction_at(cosine, 0.3f);
    double table_sum = 0, model_sum = 0, square = 0;
    constexpr uint32_t kSamples = 1 << 14;
    for (uint32_t k = 0; k < kSamples; ++k) {
      const Vec2 u = random_pair(5, k, 0);
      const Vec3 i = brdf_sample(view, o, u);
      if (i.z > 0.0f) {
        const double w = brdf_table_value(view.table, o, i).x * i.z / brdf_pdf(view, o, i);
        table_sum += w / kSamples;
        square += w * w / kSamples;
      }
      const BsdfValue value = eval_lobe(lobe, o, sample_lobe(lobe, o, u));
      if (value.pdf > 0.0f) model_sum += value.f.x / value.pdf / kSamples;
    }
    // At grazing views a table of four dimensions is two per cent off.
    const double tolerance = brdf.table().isotropic() ? 0.015 : 0.03;
    EXPECT_NEAR(table_sum, model_sum, tolerance * model_sum) << cosine;
    EXPECT_LT(table_sum, 1.01);
    RecordProperty("deviation_" + std::to_string(cosine),
                   std::to_string(std::sqrt(square / (table_sum * table_sum) - 1)));
    if (GetParam().probability != BlockProbability::FITTED) {
      EXPECT_LT(std::sqrt(square / (table_sum * table_sum) - 1), 1.5) << cosine;
    }
  }
}

TEST_P(BrdfTableTest, TheRenderersLobeIsTheTable) {
  const BrdfKdTree& brdf = make();
  const TabulatedBrdfView view = brdf.view();
  Lobe lobe = analytic_lobe(GetParam());
  lobe.type = LobeType::kTabulated;
  lobe.table = &view;
  lobe.weight = {0.5f, 0.5f, 0.5f};
  const Vec3 o = direction_at(0.6f, 0.2f);
  for (uint32_t k = 0; k < 64; ++k) {
    const Vec3 i = sample_lobe(lobe, o, random_pair(8, k, 0));
    const BsdfValue value = eval_lobe(lobe, o, i);
    if (i.z <= 0.0f) {
      EXPECT_EQ(value.pdf, 0.0f);
      continue;
    }
    EXPECT_EQ(value.pdf, brdf_pdf(view, o, i));
    EXPECT_FLOAT_EQ(value.f.y, 0.5f * brdf_table_value(view.table, o, i).y * i.z);
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, BrdfTableTest,
    testing::Values(Case{"ward", true, 0.2f, 0.2f}, Case{"ward_sharp", true, 0.02f, 0.02f},
                    Case{"ward_aniso", true, 0.4f, 0.05f}, Case{"ward_paper", true, 0.5f, 0.001f},
                    Case{"ggx", false, 0.3f, 0.3f}, Case{"ggx_sharp", false, 0.02f, 0.02f},
                    Case{"ggx_aniso", false, 0.4f, 0.1f},
                    Case{"ggx_fitted", false, 0.3f, 0.3f, BlockProbability::FITTED},
                    Case{"ward_aniso_fitted", true, 0.4f, 0.05f, BlockProbability::FITTED}),
    [](const auto& info) { return info.param.name; });

// MERL

/// A file as the database has them: a Lambert surface of these reflectances, -1 below the horizon.
std::string write_merl(const char* name, Vec3 albedo, int32_t header_rows = 90, long cut = 0) {
  const std::string path = testing::TempDir() + name;
  std::ofstream file(path, std::ios::binary);
  const int32_t header[3] = {header_rows, 90, 180};
  file.write(reinterpret_cast<const char*>(header), sizeof header);
  const double scale[3] = {1.0 / 1500, 1.15 / 1500, 1.66 / 1500};
  std::vector<double> values;
  for (int c = 0; c < 3; ++c) {
    const double value = (c == 0 ? albedo.x : c == 1 ? albedo.y : albedo.z) / M_PI / scale[c];
    for (int h = 0; h < 90; ++h) {
      const double theta_h = 0.5 * M_PI * std::pow((h + 0.5) / 90, 2);
      for (int d = 0; d < 90; ++d) {
        const double theta_d = 0.5 * M_PI * (d + 0.5) / 90;
        for (int p = 0; p < 180; ++p) {
          const double side =
              std::sin(theta_d) * std::cos(M_PI * (p + 0.5) / 180) * std::sin(theta_h);
          values.push_back(std::cos(theta_d) * std::cos(theta_h) < std::fabs(side) ? -1.0 : value);
        }
      }
    }
  }
  file.write(reinterpret_cast<const char*>(values.data()),
             std::streamsize(values.size() * sizeof(double)) - cut);
  return path;
}

TEST(Merl, FileIsReadInItsUnitsAndOrder) {
  const std::string path = write_merl("lambert.binary", {0.2f, 0.5f, 0.8f});
  const BrdfTablePointer table = read_merl(path);
  std::remove(path.c_str());
  EXPECT_TRUE(table->isotropic());
  EXPECT_EQ(table->nbytes(), size_t(90 * 90 * 180 * 3 * 4));
  const BrdfKdTree brdf(table);
  for (const float cosine : {0.9f, 0.4f, 0.1f}) {
    const Vec3 o = direction_at(cosine, 0.7f);
    double sum[3] = {0, 0, 0};
    for (uint32_t k = 0; k < 1 << 14; ++k) {
      const Vec3 i = brdf_sample(brdf.view(), o, random_pair(2, k, 0));
      if (i.z <= 0.0f) continue;
      const Vec3 f =
          brdf_table_value(brdf.view().table, o, i) * (i.z / brdf_pdf(brdf.view(), o, i));
      sum[0] += f.x / (1 << 14);
      sum[1] += f.y / (1 << 14);
      sum[2] += f.z / (1 << 14);
    }
    EXPECT_NEAR(sum[0], 0.2, 0.004);
    EXPECT_NEAR(sum[1], 0.5, 0.01);
    EXPECT_NEAR(sum[2], 0.8, 0.016);
  }
}

std::string merl_error(const std::string& path) {
  try {
    read_merl(path);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(Merl, BadFilesAreNamedWithWhatIsWrong) {
  EXPECT_NE(merl_error("/nowhere/x.binary").find("cannot be opened"), std::string::npos);
  std::string path = write_merl("cut.binary", {0.5f, 0.5f, 0.5f}, 90, 1000);
  EXPECT_NE(merl_error(path).find("is truncated"), std::string::npos) << merl_error(path);
  EXPECT_NE(merl_error(path).find("cut.binary"), std::string::npos);
  std::remove(path.c_str());
  path = write_merl("size.binary", {0.5f, 0.5f, 0.5f}, 45);
  EXPECT_NE(merl_error(path).find("45 x 90 x 180"), std::string::npos) << merl_error(path);
  std::remove(path.c_str());
  path = testing::TempDir() + "short.binary";
  std::ofstream(path) << "hello";
  EXPECT_NE(merl_error(path).find("too short"), std::string::npos);
  std::remove(path.c_str());
}

}  // namespace
}  // namespace skytree
