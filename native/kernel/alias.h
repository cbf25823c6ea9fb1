// SPDX-License-Identifier: GPL-3.0-or-later
// Texels drawn from an alias table: Walker 1977, built as in Vose 1991. Constant time and one or
// two cache misses, but neighbouring random numbers land far apart.
//
// An entry takes 8 bytes, not 12, as one below the mean keeps its whole weight as threshold, and as
// one from the mean on that was emptied is filled up by the next of its kind in the map: what the
// entry need not name is found by a look at those that follow. That is one step per sample at most
// in the mean, since the chance to begin and the distance to the next cancel.
#pragma once

#include "kernel/inversion.h"

namespace skytree {

struct AliasEntry {
  float weight;  // the texel's probability times their number
  union {
    uint32_t alias;   // of a weight below 1: drawn from there on, instead of the texel
    float threshold;  // of others: from there on the next such texel is drawn
  };
};

struct AliasRow {
  RowWarp warp;
  float pdf;  // per steradian, of a weight of 1
  // First texel of weight 1 or more in the rows below; without one, the number of texels.
  uint32_t next_large;
};

struct AliasView {
  const AliasEntry* entries;  // height x width
  const AliasRow* rows;       // height
  int32_t width, height;
};

SKY_HD bool is_large(AliasEntry entry) { return entry.weight >= 1.0f; }

SKY_HD float alias_threshold(AliasEntry entry) {
  return is_large(entry) ? entry.threshold : entry.weight;
}

/// What a large texel is filled up by. The last one is so by itself.
SKY_HD uint32_t next_large_texel(const AliasView& table, uint32_t texel) {
  const uint32_t y = texel / (uint32_t)table.width;
  const uint32_t end = (y + 1) * (uint32_t)table.width;
  for (uint32_t next = texel + 1; next < end; ++next) {
    if (is_large(table.entries[next])) return next;
  }
  const uint32_t next = table.rows[y].next_large;
  return next < (uint32_t)table.width * (uint32_t)table.height ? next : texel;
}

SKY_HD uint32_t alias_of(const AliasView& table, AliasEntry entry, uint32_t texel) {
  return is_large(entry) ? next_large_texel(table, texel) : entry.alias;
}

/// u.x chooses the texel; 24 bits are too few for a large map, so its low digits come from u.y, and
/// what is left of them places the point along the row.
SKY_HD uint32_t sample_alias(const AliasView& table, Vec3 u, float* offset, float* weight) {
  const uint64_t count = (uint64_t)table.width * (uint64_t)table.height;
  const uint64_t high = (uint64_t)(u.x * 16777216.0f);
  const uint64_t low = (uint64_t)(u.y * 16777216.0f);
  const uint64_t scaled = high * count + ((low * count) >> 24);
  const uint32_t texel = (uint32_t)(scaled >> 24);
  const float remainder = (float)(scaled & 0xffffffu) * 5.9604644775390625e-8f;
  const AliasEntry entry = table.entries[texel];
  const float threshold = alias_threshold(entry);
  if (remainder < threshold) {
    *offset = remainder / threshold;
    *weight = entry.weight;
    return texel;
  }
  const uint32_t alias = alias_of(table, entry, texel);
  *offset = (remainder - threshold) / (1.0f - threshold);
  *weight = table.entries[alias].weight;
  return alias;
}

}  // namespace skytree
