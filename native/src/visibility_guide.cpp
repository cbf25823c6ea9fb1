// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/visibility_guide.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <queue>

namespace skytree {
namespace {

constexpr int kInner = kGuideRegions - 1;
constexpr int kGrid = 256;  // points along each side at which the warp is measured

/// Solid angle per rectangle of the unit square, from the warp's density on a grid.
class WarpMeasure {
 public:
  explicit WarpMeasure(const EnvSamplerView& sampler) : sums_((kGrid + 1) * (kGrid + 1), 0.0) {
    for (int y = 0; y < kGrid; ++y) {
      double row = 0.0;
      for (int x = 0; x < kGrid; ++x) {
        const DirectionSample sample =
            sample_environment(sampler, {0.5f, (x + 0.5f) / kGrid, (y + 0.5f) / kGrid});
        row += sample.pdf > 0.0f ? 1.0 / sample.pdf : 0.0;
        at(x + 1, y + 1) = at(x + 1, y) + row;
      }
    }
  }
  double solid_angle(const int* lo, const int* hi) const {
    return at(hi[0], hi[1]) - at(lo[0], hi[1]) - at(hi[0], lo[1]) + at(lo[0], lo[1]);
  }

 private:
  double& at(int x, int y) { return sums_[size_t(y) * (kGrid + 1) + x]; }
  double at(int x, int y) const { return sums_[size_t(y) * (kGrid + 1) + x]; }
  std::vector<double> sums_;
};

struct Part {
  int lo[2], hi[2];
  double solid_angle;
  int parent, side;  // where its number goes; -1: the root
  int order;
  bool operator<(const Part& other) const {
    return solid_angle != other.solid_angle ? solid_angle < other.solid_angle : order > other.order;
  }
  int size(int axis) const { return hi[axis] - lo[axis]; }
};

/// The grid line that halves the part's solid angle best; 0 if it cannot be cut.
int middle(const WarpMeasure& measure, const Part& part, int axis) {
  int first = part.lo[axis] + 1, last = part.hi[axis] - 1;
  if (first > last) return 0;
  while (first < last) {
    const int line = (first + last) / 2;
    int hi[2] = {part.hi[0], part.hi[1]};
    hi[axis] = line;
    if (2.0 * measure.solid_angle(part.lo, hi) < part.solid_angle) {
      first = line + 1;
    } else {
      last = line;
    }
  }
  return first;
}

}  // namespace

VisibilityGuide::VisibilityGuide(const EnvSamplerView& sampler, const Mat3& world_to_env, Vec3 eye,
                                 float cell_size, const GuideConfig& config)
    : config_(config),
      counters_(static_cast<GuideCounter*>(
          std::calloc(size_t(kGuideSlots) * kGuideRegions, sizeof(GuideCounter)))),
      ratios_(static_cast<uint16_t*>(
          std::calloc(size_t(kGuideSlots + 1) * kGuideRegions, sizeof(uint16_t)))),
      densities_(
          static_cast<float*>(std::calloc(size_t(kGuideSlots + 1) * kGuideRegions, sizeof(float)))),
      used_(kGuideSlots, 0),
      touched_(kGuideSlots, 0),
      mean_squares_(kInner + kGuideRegions),
      masses_(kInner + kGuideRegions),
      trials_(kInner + kGuideRegions),
      squares_(kInner + kGuideRegions) {
  if (!counters_ || !ratios_ || !densities_) throw std::bad_alloc();
  cut_square(sampler);
  std::fill(masses_.begin() + kInner, masses_.end(), 1.0);
  set_ratios(kGuideEvenSlot);
  view_.nodes = nodes_.data();
  measure_open_gains(sampler, world_to_env);
  view_.ratios = ratios_.get();
  view_.densities = densities_.get();
  view_.used = used_.data();
  view_.counters = counters_.get();
  view_.touched = touched_.data();
  view_.eye = eye;
  view_.cell_size = cell_size;
}

void VisibilityGuide::cut_square(const EnvSamplerView& sampler) {
  const WarpMeasure measure(sampler);
  std::priority_queue<Part> parts;
  Part whole = {{0, 0}, {kGrid, kGrid}, 0.0, -1, 0, 0};
  whole.solid_angle = measure.solid_angle(whole.lo, whole.hi);
  parts.push(whole);
  int order = 0;
  auto set_child = [&](const Part& part, int number) {
    if (part.parent >= 0) nodes_[part.parent].children[part.side] = uint16_t(number);
  };
  while (int(nodes_.size()) < kInner) {
    Part part = parts.top();
    parts.pop();
    // Along the axis that leaves the squarer halves on the grid; a grid of kGrid^2 points always
    // has a part that can be cut.
    int axis = part.size(0) >= part.size(1) ? 0 : 1;
    if (part.size(axis) < 2) {
      part.solid_angle = -1.0;  // to the end of the queue
      parts.push(part);
      continue;
    }
    const int line = middle(measure, part, axis);
    const int number = int(nodes_.size());
    set_child(part, number);
    GuideNode node = {};
    node.axis = axis;
    node.threshold = float(line) / kGrid;
    node.first_share = float(line - part.lo[axis]) / float(part.size(axis));
    nodes_.push_back(node);
    for (int side = 0; side < 2; ++side) {
      Part child = part;
      (side ? child.lo : child.hi)[axis] = line;
      child.solid_angle = measure.solid_angle(child.lo, child.hi);
      child.parent = number;
      child.side = side;
      child.order = ++order;
      parts.push(child);
    }
  }
  for (int region = 0; region < kGuideRegions; ++region) {
    const Part& part = parts.top();
    set_child(part, kInner + region);
    areas_.push_back(float(part.size(0)) * float(part.size(1)) / (float(kGrid) * kGrid));
    parts.pop();
  }
}

/// The same promise as make_ratios finds, for surfaces that face along an axis and see everything.
void VisibilityGuide::measure_open_gains(const EnvSamplerView& sampler, const Mat3& world_to_env) {
  std::vector<double> squares(size_t(kGuideSides) * kGuideRegions, 0.0);
  std::vector<int> counts(kGuideRegions, 0);
  for (int y = 0; y < kGrid; ++y) {
    for (int x = 0; x < kGrid; ++x) {
      const Vec2 point = {(x + 0.5f) / kGrid, (y + 0.5f) / kGrid};
      const int region = guide_region(view_, point);
      const Vec3 direction = transpose_mul(
          world_to_env, sample_environment(sampler, {0.5f, point.x, point.y}).direction);
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
  uint64_t trials = 0, guided = 0;
  for (uint32_t slot = 0; slot < kGuideSlots; ++slot) {
    if (!touched_[slot]) continue;
    used_[slot] = make_ratios(slot);
    trials += trials_[0];
    guided += used_[slot] ? trials_[0] : 0;
  }
  return trials ? double(guided) / double(trials) : 0.0;
}

/// False where guiding is not worth it.
bool VisibilityGuide::make_ratios(uint32_t slot) {
  const GuideCounter* counters = counters_.get() + size_t(slot) * kGuideRegions;
  for (int region = 0; region < kGuideRegions; ++region) {
    trials_[kInner + region] = counters[region].trials;
    squares_[kInner + region] = counters[region].squares;
  }
  for (int node = kInner; node-- > 0;) {
    const uint16_t* children = nodes_[node].children;
    trials_[node] = trials_[children[0]] + trials_[children[1]];
    squares_[node] = squares_[children[0]] + squares_[children[1]];
  }
  if (trials_[0] < config_.least_trials || squares_[0] == 0) return false;

  // From the root down: a node's mean square leans on its parent's, the less the more trials it
  // had.
  mean_squares_[0] = double(squares_[0]) / (255.0 * double(trials_[0]));
  for (int node = 0; node < kInner; ++node) {
    for (const uint16_t child : nodes_[node].children) {
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
  if (mean_square < least_gain * mean * mean) return false;
  for (int region = 0; region < kGuideRegions; ++region) {
    double& mass = masses_[kInner + region];
    mass = config_.defensive_share * areas_[region] + (1.0 - config_.defensive_share) * mass / mean;
  }
  set_ratios(slot);
  return true;
}

/// From the masses of the regions.
void VisibilityGuide::set_ratios(uint32_t slot) {
  uint16_t* ratios = ratios_.get() + size_t(slot) * kGuideRegions;
  float* densities = densities_.get() + size_t(slot) * kGuideRegions;
  for (int node = kInner; node-- > 0;) {
    const uint16_t* children = nodes_[node].children;
    masses_[node] = masses_[children[0]] + masses_[children[1]];
    const double ratio = masses_[children[0]] / masses_[node];
    ratios[node] = uint16_t(std::clamp(std::floor(65536.0 * ratio), 0.0, 65535.0));
  }
  // What the rounded ratios really give, so that density and sampling agree.
  masses_[0] = 1.0;
  for (int node = 0; node < kInner; ++node) {
    const double ratio = guide_ratio(ratios[node]);
    masses_[nodes_[node].children[0]] = masses_[node] * ratio;
    masses_[nodes_[node].children[1]] = masses_[node] * (1.0 - ratio);
  }
  for (int region = 0; region < kGuideRegions; ++region) {
    densities[region] = float(masses_[kInner + region] / areas_[region]);
  }
}

size_t VisibilityGuide::nbytes() const {
  return size_t(kGuideSlots) *
             (kGuideRegions * (sizeof(GuideCounter) + sizeof(uint16_t) + sizeof(float)) + 2) +
         nodes_.size() * sizeof(GuideNode);
}

int VisibilityGuide::used_slots() const {
  return int(std::count(used_.begin(), used_.end(), uint8_t(1)));
}

}  // namespace skytree
