// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <type_traits>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace skytree {

/// Uninitialised storage for tables as large as the map. On large pages where the system has them:
/// touching ordinary pages for the first time takes longer than computing what is written there.
template <typename T>
class LargeArray {
  static_assert(std::is_trivially_destructible_v<T> && std::is_trivially_copyable_v<T>);

 public:
  LargeArray() = default;
  explicit LargeArray(size_t count) : count_(count) {
    constexpr size_t kPage = size_t(2) << 20;
    const size_t bytes = count * sizeof(T);
    const size_t alignment = bytes >= kPage ? kPage : 64;
    const size_t rounded = (bytes + alignment - 1) / alignment * alignment;
    data_.reset(static_cast<T*>(std::aligned_alloc(alignment, rounded ? rounded : alignment)));
    if (!data_) throw std::bad_alloc();
#if defined(__linux__) && defined(MADV_HUGEPAGE)
    if (bytes >= kPage)
      madvise(data_.get(), rounded, MADV_HUGEPAGE);  // a wish: failing costs time only
#endif
  }

  T* data() { return data_.get(); }
  const T* data() const { return data_.get(); }
  T& operator[](size_t i) { return data_.get()[i]; }
  const T& operator[](size_t i) const { return data_.get()[i]; }
  size_t size() const { return count_; }
  size_t nbytes() const { return count_ * sizeof(T); }
  bool empty() const { return count_ == 0; }

 private:
  struct Free {
    void operator()(T* data) const { std::free(data); }
  };
  std::unique_ptr<T, Free> data_;
  size_t count_ = 0;
};

}  // namespace skytree
