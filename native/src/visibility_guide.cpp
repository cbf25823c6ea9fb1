// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/visibility_guide.h"

#include <algorithm>
#include <cmath>
#include <new>

namespace skytree {
namespace {

constexpr int kInner = kGuideRegions - 1;
constexpr int kGrid = 128;  // points along each side at which the warp is measured

Vec2 grid_point(int x, int y) { return {(x + 0.5f) / kGrid, (y + 0.5f) / kGrid}; }

/// Where the warp takes the grid's points, row by row.
std::vector<DirectionSample> sample_grid(const EnvSamplerView& sampler) {
  std::vector<DirectionSample> samples;
  samples.reserve(size_t(kGrid) * kGrid);
  for (int y = 0; y < kGrid; ++y) {
    for (int x = 0; x < kGrid; ++x) {
      const Vec2 point = grid_point(x, y);
      samples.push_back(sample_environment(sampler, {0.5f, point.x, point.y}));
    }
  }
  return samples;
}

/// Solid angle per rectangle of the unit square, from the warp's density on the grid.
class WarpMeasure {
 public:
  explicit WarpMeasure(const std::vector<DirectionSample>& samples)
      : sums_((kGrid + 1) * (kGrid + 1), 0.0) {
    for (int y = 0; y < kGrid; ++y) {
      double row = 0.0;
      for (int x = 0; x < kGrid; ++x) {
        const float pdf = samples[size_t(y) * kGrid + x].pdf;
        row += pdf > 0.0f ? 1.0 / pdf : 0.0;
        at(x + 1, y + 1) = at(x + 1, y) + row;
      }
    }
  }
  /// Of a rectangle whose sides are told in units of the grid's.
  double solid_angle(const double* lo, const double* hi) const {
    return sum(hi[0], hi[1]) - sum(lo[0], hi[1]) - sum(hi[0], lo[1]) + sum(lo[0], lo[1]);
  }

 private:
  double& at(int x, int y) { return sums_[size_t(y) * (kGrid + 1) + x]; }
  double at(int x, int y) const { return sums_[size_t(y) * (kGrid + 1) + x]; }
  double sum(double x, double y) const {
    const int left = std::min(int(x), kGrid - 1), low = std::min(int(y), kGrid - 1);
    const double p = x - left, q = y - low;
    return (1.0 - q) * ((1.0 - p) * at(left, low) + p * at(left + 1, low)) +
           q * ((1.0 - p) * at(left, low + 1) + p * at(left + 1, low + 1));
  }
  std::vector<double> sums_;
};

struct Part {
  double lo[2], hi[2];
  double size(int axis) const { return hi[axis] - lo[axis]; }
};

/// Where the part's solid angle is halved, but not at its very ends.
double middle(const WarpMeasure& measure, const Part& part, int axis) {
  const double half = 0.5 * measure.solid_angle(part.lo, part.hi);
  Part first = part;
  double low = part.lo[axis] + part.size(axis) / 64.0,
         high = part.hi[axis] - part.size(axis) / 64.0;
  for (int i = 0; i < 24; ++i) {
    first.hi[axis] = 0.5 * (low + high);
    (measure.solid_angle(first.lo, first.hi) < half ? low : high) = first.hi[axis];
  }
  return 0.5 * (low + high);
}

}  // namespace

VisibilityGuide::VisibilityGuide(const EnvSamplerView& sampler, const Mat3& world_to_env, Vec3 eye,
                                 float cell_size, const GuideConfig& config)
    : config_(config),
      counters_(static_cast<GuideCounter*>(
          std::calloc(size_t(kGuideSlots) * kGuideRegions, sizeof(GuideCounter)))),
      ratios_(
          static_cast<float*>(std::calloc(size_t(kGuideSlots + 1) * kGuideRegions, sizeof(float)))),
      used_(kGuideSlots, 0),
      touched_(kGuideSlots, 0),
      mean_squares_(kInner + kGuideRegions),
      masses_(kInner + kGuideRegions),
      trials_(kInner + kGuideRegions),
      squares_(kInner + kGuideRegions) {
  if (!counters_ || !ratios_) throw std::bad_alloc();
  const std::vector<DirectionSample> samples = sample_grid(sampler);
  cut_square(samples);
  std::fill(masses_.begin() + kInner, masses_.end(), 1.0);
  set_ratios(kGuideEvenSlot);
  view_.cuts = cuts_.data();
  view_.shares = shares_.data();
  measure_open_gains(samples, world_to_env);
  view_.ratios = ratios_.get();
  view_.used = used_.data();
  view_.counters = counters_.get();
  view_.touched = touched_.data();
  view_.eye = eye;
  view_.cell_size = cell_size;
}

void VisibilityGuide::cut_square(const std::vector<DirectionSample>& samples) {
  const WarpMeasure measure(samples);
  std::vector<Part> parts = {{{0.0, 0.0}, {kGrid, kGrid}}};
  for (int node = 0; node < kInner; ++node) {
    const Part part = parts[node];
    // Along the axis that leaves the squarer halves on the grid.
    const int axis = part.size(0) >= part.size(1) ? 0 : 1;
    const double line = middle(measure, part, axis);
    cuts_.push_back(float(axis ? -line / kGrid : line / kGrid));
    shares_.push_back(float((line - part.lo[axis]) / part.size(axis)));
    for (int side = 0; side < 2; ++side) {
      Part child = part;
      (side ? child.lo : child.hi)[axis] = line;
      parts.push_back(child);
    }
  }
  for (int region = 0; region < kGuideRegions; ++region) {
    const Part& part = parts[kInner + region];
    areas_.push_back(float(part.size(0) * part.size(1) / (double(kGrid) * kGrid)));
  }
}

/// The same promise as make_ratios finds, for surfaces that face along an axis and see everything.
void VisibilityGuide::measure_open_gains(const std::vector<DirectionSample>& samples,
                                         const Mat3& world_to_env) {
  std::vector<double> squares(size_t(kGuideSides) * kGuideRegions, 0.0);
  std::vector<int> counts(kGuideRegions, 0);
  for (int y = 0; y < kGrid; ++y) {
    for (int x = 0; x < kGrid; ++x) {
      const int region = guide_region(view_, grid_point(x, y));
      const Vec3 direction = transpose_mul(world_to_env, samples[size_t(y) * kGrid + x].direction);
      const float axes[kGuideSides] = {direction.x,  -direction.x, direction.y,
                                       -direction.y, direction.z,  -direction.z};
      ++counts[region];
      for (uint32_t side = 0; side < kGuideSides; ++side) {
        const double cosine = std::max(axes[side], 0.0f);
        squares[side * kGuideRegions + region] += cosine * cosine;
      }
    }
  }
  for (uint32_t side = 0; side < kGuideSides; ++side) {
    double mean_square = 0.0, mean = 0.0;
    for (int region = 0; region < kGuideRegions; ++region) {
      const double square = squares[side * kGuideRegions + region] / std::max(counts[region], 1);
      mean_square += areas_[region] * square;
      mean += areas_[region] * std::sqrt(square);
    }
    open_gains_[side] = mean > 0.0 ? std::max(mean_square / (mean * mean), 1.0) : 1.0;
  }
}

double VisibilityGuide::update() {
  double trials = 0.0, left = 0.0;
  for (uint32_t slot = 0; slot < kGuideSlots; ++slot) {
    if (!touched_[slot]) continue;
    const double slot_left = make_ratios(slot);
    used_[slot] = slot_left < 1.0;
    if (trials_[0] < config_.least_trials) continue;
    trials += double(trials_[0]);
    left += slot_left * double(trials_[0]);
  }
  return trials > 0.0 ? left / trials : 0.0;
}

/// What is left of the second moment; 1 where guiding is not worth it and nothing is made.
double VisibilityGuide::make_ratios(uint32_t slot) {
  const GuideCounter* counters = counters_.get() + size_t(slot) * kGuideRegions;
  for (int region = 0; region < kGuideRegions; ++region) {
    trials_[kInner + region] = counters[region].trials;
    squares_[kInner + region] = counters[region].squares;
  }
  for (int node = kInner; node-- > 0;) {
    trials_[node] = trials_[2 * node + 1] + trials_[2 * node + 2];
    squares_[node] = squares_[2 * node + 1] + squares_[2 * node + 2];
  }
  if (trials_[0] < config_.least_trials || squares_[0] == 0) return 1.0;

  // From the root down: a node's mean square leans on its parent's, the less the more trials it
  // had.
  mean_squares_[0] = double(squares_[0]) / (255.0 * double(trials_[0]));
  for (int node = 0; node < kInner; ++node) {
    for (const int child : {2 * node + 1, 2 * node + 2}) {
      mean_squares_[child] =
          (double(squares_[child]) / 255.0 + config_.prior_trials * mean_squares_[node]) /
          (double(trials_[child]) + config_.prior_trials);
    }
  }
  // Least variance: density in proportion to the root of the mean square. Its gain over the even
  // density is mean(q^2) / mean(q)^2.
  double mean_square = 0.0, mean = 0.0;
  for (int region = 0; region < kGuideRegions; ++region) {
    const double square = mean_squares_[kInner + region];
    masses_[kInner + region] = areas_[region] * std::sqrt(square);
    mean_square += areas_[region] * square;
    mean += masses_[kInner + region];
  }
  const double least_gain = config_.least_gain * open_gains_[slot % 8];
  if (mean_square < least_gain * mean * mean) return 1.0;
  double left = 0.0;
  for (int region = 0; region < kGuideRegions; ++region) {
    const double area = areas_[region];
    double& mass = masses_[kInner + region];
    mass = config_.defensive_share * area + (1.0 - config_.defensive_share) * mass / mean;
    left += area * area * mean_squares_[kInner + region] / mass;
  }
  set_ratios(slot);
  return left / mean_square;
}

/// From the masses of the regions.
void VisibilityGuide::set_ratios(uint32_t slot) {
  float* ratios = ratios_.get() + size_t(slot) * kGuideRegions;
  for (int node = kInner; node-- > 0;) {
    masses_[node] = masses_[2 * node + 1] + masses_[2 * node + 2];
    ratios[node] = float(std::clamp(masses_[2 * node + 1] / masses_[node], 1e-5, 1.0 - 1e-5));
  }
}

size_t VisibilityGuide::nbytes() const {
  return size_t(kGuideSlots) * (kGuideRegions * (sizeof(GuideCounter) + sizeof(float)) + 2) +
         (cuts_.size() + shares_.size()) * sizeof(float);
}

int VisibilityGuide::used_slots() const {
  return int(std::count(used_.begin(), used_.end(), uint8_t(1)));
}

}  // namespace skytree
