// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/compressed_map.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "src/block_radiance.h"

namespace skytree {
namespace {

constexpr size_t kHeaderBytes = 28;
constexpr size_t kChecksumAt = 12;
constexpr size_t kColorBytes = 4;
constexpr int kMantissaBits = 9;
constexpr int kLargestExponent = 31;

uint32_t crc32(uint32_t crc, const uint8_t* data, size_t count) {
  crc = ~crc;
  for (size_t i = 0; i < count; ++i) {
    crc ^= data[i];
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0u);
  }
  return ~crc;
}

uint32_t file_checksum(const std::vector<uint8_t>& bytes) {
  const uint32_t head = crc32(0, bytes.data(), kChecksumAt);
  return crc32(head, bytes.data() + kChecksumAt + 4, bytes.size() - kChecksumAt - 4);
}

void put(std::vector<uint8_t>& bytes, size_t at, int count, uint32_t value) {
  for (int i = 0; i < count; ++i) bytes[at + i] = (uint8_t)(value >> 8 * i);
}

uint32_t get(const std::vector<uint8_t>& bytes, size_t at, int count) {
  uint32_t value = 0;
  for (int i = 0; i < count; ++i) value |= (uint32_t)bytes[at + i] << 8 * i;
  return value;
}

/// Bits that tell `choices` values apart.
int bits_for(int32_t choices) {
  int bits = 0;
  while (((int64_t)1 << bits) < choices) ++bits;
  return bits;
}

int64_t node_bits(const TexelRect& rect) { return rect.area() > 1 ? 1 : 0; }
bool has_two_axes(const TexelRect& rect) { return rect.size(0) > 1 && rect.size(1) > 1; }

class BitWriter {
 public:
  void write(uint32_t value, int bits) {
    for (int i = 0; i < bits; ++i, ++count_) {
      if (count_ % 8 == 0) bytes_.push_back(0);
      bytes_.back() |= (uint8_t)((value >> i & 1) << count_ % 8);
    }
  }
  const std::vector<uint8_t>& bytes() const { return bytes_; }

 private:
  std::vector<uint8_t> bytes_;
  size_t count_ = 0;
};

[[noreturn]] void refuse(const std::string& why) { throw std::invalid_argument(why); }

class BitReader {
 public:
  BitReader(const std::vector<uint8_t>& bytes, size_t begin, size_t end)
      : bytes_(bytes), next_(8 * begin), end_(8 * end) {}

  uint32_t read(int bits) {
    if (next_ + bits > end_) refuse("its tree is not complete");
    uint32_t value = 0;
    for (int i = 0; i < bits; ++i, ++next_) {
      value |= (uint32_t)(bytes_[next_ / 8] >> next_ % 8 & 1) << i;
    }
    return value;
  }
  size_t bytes_read() const { return (next_ + 7) / 8; }

 private:
  const std::vector<uint8_t>& bytes_;
  size_t next_, end_;
};

/// Both parts of a rectangle that is cut before `position`.
void cut(const TexelRect& rect, int axis, int32_t position, TexelRect* first, TexelRect* second) {
  *first = *second = rect;
  first->hi[axis] = second->lo[axis] = position;
}

/// How many splits of the tree, in the order in which they were made, fit into the budget: every
/// prefix of a greedily grown tree is the tree that fewer blocks would have given.
int32_t splits_that_fit(const std::vector<BuildNode>& nodes, int64_t bits) {
  std::vector<int32_t> parents(nodes.size() / 2);  // by split
  for (size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].first_child >= 0) parents[nodes[i].first_child / 2] = (int32_t)i;
  }
  int64_t used = 8 * (kHeaderBytes + kColorBytes) + node_bits(nodes[0].rect);
  int32_t count = 0;
  for (int32_t parent : parents) {
    const BuildNode& node = nodes[parent];
    used += 8 * kColorBytes + has_two_axes(node.rect) + bits_for(node.rect.size(node.axis) - 1) +
            node_bits(nodes[node.first_child].rect) + node_bits(nodes[node.first_child + 1].rect);
    if ((used + 7) / 8 * 8 > bits) break;
    ++count;
  }
  return count;
}

/// The exponent e with the largest component below 2^e once it is rounded to kMantissaBits.
int color_exponent(const std::array<double, 3>& color) {
  int exponent;
  const double mantissa = std::frexp(std::max({color[0], color[1], color[2]}), &exponent);
  const double steps = (double)(1 << kMantissaBits);
  return std::nearbyint(mantissa * steps) >= steps ? exponent + 1 : exponent;
}

uint32_t pack_color(const std::array<double, 3>& color, int base) {
  const bool black = !(std::max({color[0], color[1], color[2]}) > 0);
  const int exponent = black ? 0 : std::clamp(color_exponent(color) - base, 0, kLargestExponent);
  uint32_t packed = (uint32_t)exponent << 3 * kMantissaBits;
  for (int c = 0; c < 3; ++c) {
    const double steps = std::ldexp(color[c], kMantissaBits - base - exponent);
    packed |= (uint32_t)std::nearbyint(steps) << kMantissaBits * c;
  }
  return packed;
}

std::array<float, 3> unpack_color(uint32_t packed, int base) {
  const int exponent = (int)(packed >> 3 * kMantissaBits) + base - kMantissaBits;
  std::array<float, 3> color;
  for (int c = 0; c < 3; ++c) {
    const uint32_t steps = packed >> kMantissaBits * c & ((1u << kMantissaBits) - 1);
    color[c] = (float)std::ldexp((double)steps, exponent);
  }
  return color;
}

}  // namespace

CompressedMap CompressedMap::compress(const LatLongImage& image, const CompressionConfig& config) {
  check_image(image);
  if (config.max_bytes < (int64_t)(kHeaderBytes + kColorBytes + 1) || config.max_blocks < 1) {
    refuse("max_bytes is " + std::to_string(config.max_bytes) + " and max_blocks " +
           std::to_string(config.max_blocks) + "; one block takes " +
           std::to_string(kHeaderBytes + kColorBytes + 1) + " bytes");
  }
  // Each block takes its colour and at least one bit of the tree.
  const int64_t bits = 8 * std::min<int64_t>(config.max_bytes, UINT32_MAX);
  const int64_t texels = (int64_t)image.width * image.height;
  const int64_t most = std::min({bits / (8 * (int64_t)kColorBytes + 1) + 1,
                                 (int64_t)config.max_blocks, texels, (int64_t)INT32_MAX / 2});
  const BuildTree tree =
      build_kdtree(image, config.statistics, (int)most, config.split_criterion, config.progress);
  const int32_t splits =
      std::min(splits_that_fit(tree.nodes, bits), std::max(tree.block_count - 1, 0));

  BitWriter topology;
  std::vector<std::array<double, 3>> colors;
  int highest = INT32_MIN;
  const std::vector<double> weights =
      mean_row_weights(image.width, image.height, config.statistics);
  std::vector<int32_t> stack = {0};
  while (!stack.empty()) {
    const BuildNode& node = tree.nodes[stack.back()];
    stack.pop_back();
    const bool is_split = node.first_child >= 0 && node.first_child / 2 < splits;
    topology.write(is_split, (int)node_bits(node.rect));
    if (is_split) {
      topology.write((uint32_t)node.axis, has_two_axes(node.rect));
      topology.write((uint32_t)(node.position - node.rect.lo[node.axis] - 1),
                     bits_for(node.rect.size(node.axis) - 1));
      stack.push_back(node.first_child + 1);
      stack.push_back(node.first_child);
      continue;
    }
    colors.push_back(block_mean(image, node.rect, weights));
    const std::array<double, 3>& color = colors.back();
    if (std::max({color[0], color[1], color[2]}) > 0)
      highest = std::max(highest, color_exponent(color));
  }
  const int base = highest == INT32_MIN ? 0 : highest - kLargestExponent;

  std::vector<uint8_t> bytes(kHeaderBytes);
  bytes.insert(bytes.end(), topology.bytes().begin(), topology.bytes().end());
  const size_t colors_at = bytes.size();
  bytes.resize(colors_at + kColorBytes * colors.size());
  for (size_t b = 0; b < colors.size(); ++b)
    put(bytes, colors_at + kColorBytes * b, 4, pack_color(colors[b], base));
  std::copy_n("SKYM", 4, bytes.begin());
  put(bytes, 4, 2, kVersion);
  put(bytes, 8, 4, (uint32_t)bytes.size());
  put(bytes, 16, 2, (uint32_t)image.width);
  put(bytes, 18, 2, (uint32_t)image.height);
  put(bytes, 20, 4, (uint32_t)colors.size());
  put(bytes, 24, 2, (uint32_t)base);
  put(bytes, kChecksumAt, 4, file_checksum(bytes));
  return decode(std::move(bytes));  // so that a saved map and a loaded one are the same
}

CompressedMap CompressedMap::decode(std::vector<uint8_t> bytes) {
  if (bytes.size() < 4 || !std::equal(bytes.begin(), bytes.begin() + 4, "SKYM")) {
    refuse("not a compressed map of Skytree (its first bytes are others)");
  }
  const auto size_text = [&](uint32_t wanted) {
    return std::to_string(bytes.size()) + " bytes of " + std::to_string(wanted);
  };
  if (bytes.size() < kHeaderBytes) refuse("cut short: " + size_text(kHeaderBytes) + " or more");
  const uint32_t size = get(bytes, 8, 4);
  if (bytes.size() < size) refuse("cut short: " + size_text(size) + "; copy it again");
  if (bytes.size() > size) refuse("damaged: " + size_text(size) + "; copy it again");
  if (file_checksum(bytes) != get(bytes, kChecksumAt, 4)) {
    refuse("damaged: the checksum does not match; copy it again");
  }
  const uint32_t version = get(bytes, 4, 2);
  if (version > kVersion) {
    refuse("written by a newer Skytree (format " + std::to_string(version) + ", this one reads " +
           std::to_string(kVersion) + "); update Skytree");
  }
  CompressedMap map;
  map.width_ = (int)get(bytes, 16, 2);
  map.height_ = (int)get(bytes, 18, 2);
  const size_t count = get(bytes, 20, 4);
  const int base = (int16_t)get(bytes, 24, 2);
  const size_t color_bytes = kColorBytes * count;
  if (version < 1 || map.width_ < 1 || map.height_ < 1 || count < 1 ||
      color_bytes > bytes.size() - kHeaderBytes) {
    refuse("not a valid map: its header contradicts itself");
  }
  const size_t colors_at = bytes.size() - color_bytes;
  BitReader topology(bytes, kHeaderBytes, colors_at);
  std::vector<TexelRect> stack = {{{0, 0}, {map.width_, map.height_}}};
  while (!stack.empty()) {
    const TexelRect rect = stack.back();
    stack.pop_back();
    if (!topology.read((int)node_bits(rect))) {
      if (map.rects_.size() == count) refuse("not a valid map: it has more blocks than colours");
      map.rects_.push_back(rect);
      continue;
    }
    const int axis = has_two_axes(rect) ? (int)topology.read(1) : rect.size(0) > 1 ? 0 : 1;
    const int32_t offset = (int32_t)topology.read(bits_for(rect.size(axis) - 1)) + 1;
    if (offset >= rect.size(axis)) refuse("not a valid map: a plane lies outside its block");
    TexelRect first, second;
    cut(rect, axis, rect.lo[axis] + offset, &first, &second);
    stack.push_back(second);
    stack.push_back(first);
  }
  if (map.rects_.size() != count || topology.bytes_read() != colors_at) {
    refuse("not a valid map: its tree and its colours do not belong together");
  }
  map.colors_.reserve(count);
  for (size_t b = 0; b < count; ++b) {
    map.colors_.push_back(unpack_color(get(bytes, colors_at + kColorBytes * b, 4), base));
    for (float component : map.colors_.back()) {
      if (!std::isfinite(component)) refuse("not a valid map: a colour is infinite");
    }
  }
  map.bytes_ = std::move(bytes);
  return map;
}

void CompressedMap::paint(float* out) const {
  for (size_t b = 0; b < rects_.size(); ++b) fill_block(rects_[b], colors_[b], width_, out);
}

}  // namespace skytree
