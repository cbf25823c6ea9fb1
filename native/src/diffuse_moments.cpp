// SPDX-License-Identifier: GPL-3.0-or-later
// Between texel centres the map is linear in azimuth and in the polar angle, so a moment of
// x^i y^j z^k splits into sums over a row and weights of rows. Along a row, powers of cos(phi) and
// sin(phi) are sums of frequencies 0 to 4, and of these linear interpolation keeps exactly
// sinc^2(pi k / width) of what the texel centres have.
#include "src/diffuse_moments.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <vector>

#include "src/clones.h"
#include "src/environment_image.h"

namespace skytree {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;
constexpr int kDegree = 4;
constexpr int kEvenWaves = 5;  // 1, cos 2, sin 2, cos 4, sin 4
constexpr int kOddWaves = 4;   // cos 1, sin 1, cos 3, sin 3
constexpr int kWaves = kEvenWaves + kOddWaves;
constexpr int kChunk = 24;  // floats: whole texels and whole vectors

/// sums[k][i mod kChunk] of values times waves. A wave is stored three times a texel, once for each
/// channel.
SKY_CLONES void add_products(const float* __restrict values, const float* __restrict waves,
                             size_t stride, int wave_count, int chunks, float* __restrict sums) {
  for (int c = 0; c < chunks; ++c) {
    for (int k = 0; k < wave_count; ++k) {
      for (int i = 0; i < kChunk; ++i) {
        sums[k * kChunk + i] += values[c * kChunk + i] * waves[k * stride + c * kChunk + i];
      }
    }
  }
}

SKY_CLONES void fold(const float* __restrict first, const float* __restrict second, int count,
                     float* __restrict sum, float* __restrict difference) {
  for (int i = 0; i < count; ++i) {
    sum[i] = first[i] + second[i];
    difference[i] = first[i] - second[i];
  }
}

/// Integrals over the azimuth of a row's interpolated radiance times cos(k phi) and sin(k phi).
class RowWaves {
 public:
  explicit RowWaves(int width)
      : width_(width),
        // Texels half a turn apart share the waves of even frequency and differ in the sign of the
        // odd ones.
        texels_(width % 2 == 0 ? width / 2 : width),
        chunks_((3 * texels_ + kChunk - 1) / kChunk),
        stride_((size_t)chunks_ * kChunk),
        waves_(kWaves * stride_),
        even_(stride_),
        odd_(stride_) {
    const int frequencies[kWaves] = {0, 2, 2, 4, 4, 1, 1, 3, 3};
    for (int k = 0; k < kWaves; ++k) {
      const bool sine = k > 0 && k % 2 == 0;
      for (int x = 0; x < texels_; ++x) {
        const double phi = 2.0 * kPiDouble * (0.5 - (x + 0.5) / width);
        const double angle = frequencies[k] * phi;
        for (int c = 0; c < 3; ++c) {
          waves_[k * stride_ + 3 * (size_t)x + c] =
              (float)(sine ? std::sin(angle) : std::cos(angle));
        }
      }
    }
  }

  /// out[k][channel]: integral of L exp(i k phi) dphi.
  void transform(const float* row, std::complex<double> (*out)[3]) {
    const size_t count = 3 * (size_t)texels_;
    if (texels_ < width_) {
      fold(row, row + count, (int)count, even_.data(), odd_.data());
    } else {
      std::copy_n(row, count, even_.begin());
      std::copy_n(row, count, odd_.begin());
    }
    float sums[kWaves * kChunk] = {};
    add_products(even_.data(), waves_.data(), stride_, kEvenWaves, chunks_, sums);
    add_products(odd_.data(), waves_.data() + kEvenWaves * stride_, stride_, kOddWaves, chunks_,
                 sums + kEvenWaves * kChunk);
    const int cosines[kDegree + 1] = {0, 5, 1, 7, 3};
    for (int k = 0; k <= kDegree; ++k) {
      const double x = kPiDouble * k / width_;
      const double sinc = k > 0 ? std::sin(x) / x : 1.0;
      const double scale = 2.0 * kPiDouble / width_ * sinc * sinc;
      for (int c = 0; c < 3; ++c) {
        double parts[2] = {0, 0};
        for (int part = 0; part < (k > 0 ? 2 : 1); ++part) {
          const float* wave = sums + (cosines[k] + part) * kChunk;
          for (int i = c; i < kChunk; i += 3) parts[part] += wave[i];
        }
        out[k][c] = scale * std::complex<double>(parts[0], parts[1]);
      }
    }
  }

 private:
  int width_, texels_, chunks_;
  size_t stride_;
  std::vector<float> waves_, even_, odd_;
};

/// cos^i sin^j as factors of exp(i k phi), k from -kDegree to kDegree.
using Frequencies = std::complex<double>[2 * kDegree + 1];

void expand(int i, int j, Frequencies& out) {
  for (auto& factor : out) factor = 0;
  out[kDegree] = 1;
  const auto multiply = [&](std::complex<double> up, std::complex<double> down) {
    Frequencies product = {};
    for (int k = 0; k <= 2 * kDegree; ++k) {
      if (k < 2 * kDegree) product[k + 1] += up * out[k];
      if (k > 0) product[k - 1] += down * out[k];
    }
    std::copy(std::begin(product), std::end(product), std::begin(out));
  };
  for (int n = 0; n < i; ++n) multiply(0.5, 0.5);
  for (int n = 0; n < j; ++n) multiply({0, -0.5}, {0, 0.5});
}

/// weights[m][k] += integral over [from, to] of (value0 to value1, linear) sin^(m+1) cos^k.
void add_row_weights(double from, double to, double value0, double value1,
                     double (*weights)[kDegree + 1]) {
  // Gauss and Legendre with 8 points: exact to double precision over at most half a turn.
  constexpr double kPoints[] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267,
                                0.9602898564975363};
  constexpr double kWeights[] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                                 0.1012285362903763};
  for (int p = 0; p < 8; ++p) {
    const double t = 0.5 + (p < 4 ? -0.5 : 0.5) * kPoints[p % 4];
    const double theta = from + t * (to - from);
    const double value = value0 + t * (value1 - value0);
    const double scale = 0.5 * kWeights[p % 4] * (to - from) * value * std::sin(theta);
    double sines = scale;
    for (int m = 0; m <= kDegree; ++m) {
      double product = sines;
      for (int k = 0; m + k <= kDegree; ++k) {
        weights[m][k] += product;
        product *= std::cos(theta);
      }
      sines *= std::sin(theta);
    }
  }
}

/// What row y adds, by the powers of sin(theta) and cos(theta): a tent between the neighbouring
/// centres, level towards a pole.
void row_weights(int y, int height, double (*weights)[kDegree + 1]) {
  const double step = kPiDouble / height;
  const double centre = (y + 0.5) * step;
  add_row_weights(y > 0 ? centre - step : 0, centre, y > 0 ? 0 : 1, 1, weights);
  add_row_weights(centre, y + 1 < height ? centre + step : kPiDouble, 1, y + 1 < height ? 0 : 1,
                  weights);
}

double factorial(int n) { return n < 2 ? 1 : n * factorial(n - 1); }
/// How often x^i y^j z^k comes up in (x + y + z)^(i+j+k).
double multinomial(int i, int j, int k) {
  return factorial(i + j + k) / (factorial(i) * factorial(j) * factorial(k));
}

/// Place of x^i y^j z^k, i + j + k = 4, in DiffuseMoments::quartic.
int quartic_index(int i, int j) { return (i + j) * (i + j + 1) / 2 + j; }

/// Moments of x^i y^j z^k for one channel.
using MomentTable = double[kDegree + 1][kDegree + 1][kDegree + 1];

void set_channel(const MomentTable& moments, int channel, DiffuseMoments* out) {
  constexpr double kFactors[] = {0.05859375, 0.5, 0.8203125, 0, -0.41015625};  // of P
  double quartic[15] = {};
  for (int i = 0; i <= kDegree; ++i) {
    for (int j = 0; i + j <= kDegree; ++j) {
      const int k = kDegree - i - j;
      quartic[quartic_index(i, j)] += kFactors[4] * multinomial(i, j, k) * moments[i][j][k];
    }
  }
  for (int i = 0; i <= 2; ++i) {
    for (int j = 0; i + j <= 2; ++j) {
      const int k = 2 - i - j;
      const double square = kFactors[2] * multinomial(i, j, k) * moments[i][j][k];
      quartic[quartic_index(i + 2, j)] += square;
      quartic[quartic_index(i, j + 2)] += square;
      quartic[quartic_index(i, j)] += square;
      quartic[quartic_index(2 * i, 2 * j)] += kFactors[0] * multinomial(i, j, k) * moments[0][0][0];
    }
  }
  const double linear[3] = {moments[1][0][0], moments[0][1][0], moments[0][0][1]};
  const auto component = [channel](Vec3& v) -> float& {
    return channel == 0 ? v.x : channel == 1 ? v.y : v.z;
  };
  for (int a = 0; a < 3; ++a) component(out->linear[a]) = (float)(kFactors[1] * linear[a]);
  for (int q = 0; q < 15; ++q) component(out->quartic[q]) = (float)quartic[q];
}

}  // namespace

DiffuseMoments diffuse_moments(const LatLongImage& image) {
  check_image(image);
  Frequencies powers[kDegree + 1][kDegree + 1];
  for (int i = 0; i <= kDegree; ++i) {
    for (int j = 0; i + j <= kDegree; ++j) expand(i, j, powers[i][j]);
  }
  MomentTable moments[3] = {};
  RowWaves waves(image.width);
  for (int y = 0; y < image.height; ++y) {
    std::complex<double> row[kDegree + 1][3];
    waves.transform(image.texels + 3 * (int64_t)y * image.width, row);
    double weights[kDegree + 1][kDegree + 1] = {};
    row_weights(y, image.height, weights);
    for (int c = 0; c < 3; ++c) {
      for (int i = 0; i <= kDegree; ++i) {
        for (int j = 0; i + j <= kDegree; ++j) {
          double along = (powers[i][j][kDegree] * row[0][c]).real();
          for (int k = 1; k <= i + j; ++k) {
            // Terms of k and -k are conjugate.
            along += 2.0 * (powers[i][j][kDegree + k] * row[k][c]).real();
          }
          for (int k = 0; i + j + k <= kDegree; ++k) {
            moments[c][i][j][k] += along * weights[i + j][k];
          }
        }
      }
    }
  }
  DiffuseMoments result;
  for (int c = 0; c < 3; ++c) set_channel(moments[c], c, &result);
  return result;
}

bool is_finite(const DiffuseMoments& moments) {
  const auto finite = [](Vec3 v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
  };
  return std::all_of(std::begin(moments.linear), std::end(moments.linear), finite) &&
         std::all_of(std::begin(moments.quartic), std::end(moments.quartic), finite);
}

}  // namespace skytree
