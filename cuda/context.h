// SPDX-License-Identifier: GPL-3.0-or-later
// What lives on a GPU, each thing freed with its object: contexts, memory, streams, events. Every
// object keeps its context alive and makes it current for as long as its own calls last, so that
// any thread may use and destroy it.
#pragma once

#include <atomic>
#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <typeindex>
#include <utility>

#include "cuda/driver.h"

namespace skytree::cuda {

/// A context of Skytree's own, with the kernels loaded. Not the device's primary context, which
/// Blender's Cycles and others share: a fault in one must not take the other's work along.
class Context {
 public:
  /// The one context of GPU `ordinal`, shared by all that hold it; made anew after mark_lost().
  /// Throws Error.
  static std::shared_ptr<Context> acquire(int ordinal);
  explicit Context(int ordinal);
  ~Context();
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  /// After a fault every call in a context fails: the next acquire() makes another one.
  void mark_lost();

  /// A kernel by its name. Throws Error.
  FunctionHandle function(const std::string& name) const;

  /// What several sessions use of one scene exists once: the object made for `key`, or a new one by
  /// `make`, which returns a std::unique_ptr<T>. Lives as long as somebody holds it. Null if `make`
  /// returns that, or when cancelled while another thread makes something.
  template <class T, class Make>
  std::shared_ptr<const T> share(uint64_t key, const std::atomic<bool>& cancel, Make make) {
    std::unique_lock<std::timed_mutex> lock(shared_guard_, std::defer_lock);
    while (!lock.try_lock_for(std::chrono::milliseconds(5))) {
      if (cancel) return nullptr;
    }
    std::weak_ptr<const void>& entry = shared_[{std::type_index(typeid(T)), key}];
    auto object = std::static_pointer_cast<const T>(entry.lock());
    if (!object) {
      entry = object = std::shared_ptr<const T>(make());
      forget_expired();
    }
    return object;
  }

  /// False after a fault, when every call in this context fails.
  bool healthy() const;
  /// Bytes copied to the GPU so far.
  size_t uploaded_bytes() const { return uploaded_bytes_; }

  ContextHandle handle() const { return handle_; }
  const std::string& device_name() const { return device_name_; }
  int multiprocessors() const { return multiprocessors_; }

 private:
  void load_kernels();

  int ordinal_;
  std::string device_name_;
  int multiprocessors_ = 0;
  ContextHandle handle_ = nullptr;
  ModuleHandle module_ = nullptr;
  friend class Buffer;
  void forget_expired();
  std::atomic<size_t> uploaded_bytes_{0};
  std::timed_mutex shared_guard_;
  size_t shared_limit_ = 64;  // forget expired entries when there are more
  std::map<std::pair<std::type_index, uint64_t>, std::weak_ptr<const void>> shared_;
  mutable std::mutex functions_guard_;
  mutable std::map<std::string, FunctionHandle> functions_;
};

using ContextPointer = std::shared_ptr<Context>;

/// Makes a context current on this thread until the end of the scope.
class ContextScope {
 public:
  explicit ContextScope(const Context& context);
  ~ContextScope();
  ContextScope(const ContextScope&) = delete;
  ContextScope& operator=(const ContextScope&) = delete;
};

/// Device memory. Empty when default-made or of zero bytes; then pointer() is 0.
class Buffer {
 public:
  Buffer() = default;
  Buffer(ContextPointer context, size_t bytes);
  /// Allocates and copies; waits until the copy is done.
  Buffer(ContextPointer context, const void* data, size_t bytes);
  Buffer(Buffer&& other) noexcept { swap(other); }
  Buffer& operator=(Buffer&& other) noexcept {
    swap(other);
    return *this;
  }
  ~Buffer();

  DevicePointer pointer() const { return pointer_; }
  size_t bytes() const { return bytes_; }
  /// Copies, and waits until the data are there: any stream may use them after that.
  void upload(const void* data, size_t bytes);
  void download(void* data, size_t bytes) const;

  /// The pointer as kernels take it; not to be dereferenced on the host.
  template <class T>
  const T* as() const {
    return reinterpret_cast<const T*>(static_cast<uintptr_t>(pointer_));
  }
  template <class T>
  T* writable() const {
    return reinterpret_cast<T*>(static_cast<uintptr_t>(pointer_));
  }

 private:
  void swap(Buffer& other) noexcept;
  ContextPointer context_;
  DevicePointer pointer_ = 0;
  size_t bytes_ = 0;
};

/// Page-locked host memory, which copies in the background need.
class PinnedBuffer {
 public:
  PinnedBuffer(ContextPointer context, size_t bytes);
  ~PinnedBuffer();
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;
  template <class T>
  const T* as() const {
    return static_cast<const T*>(data_);
  }
  void* data() const { return data_; }
  size_t bytes() const { return bytes_; }

 private:
  ContextPointer context_;
  void* data_ = nullptr;
  size_t bytes_;
};

class Stream {
 public:
  explicit Stream(ContextPointer context);
  ~Stream();
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;
  StreamHandle handle() const { return handle_; }
  /// Waits for all work in the stream. Throws Error if any of it failed.
  void synchronize() const;

 private:
  ContextPointer context_;
  StreamHandle handle_ = nullptr;
};

/// A point in a stream that other streams and the host can wait for.
class Event {
 public:
  explicit Event(ContextPointer context);
  ~Event();
  Event(const Event&) = delete;
  Event& operator=(const Event&) = delete;
  void record(const Stream& stream);
  void make_wait(const Stream& stream) const;
  void synchronize() const;

 private:
  ContextPointer context_;
  EventHandle handle_ = nullptr;
};

/// A queued copy of a whole buffer, and zeros for a whole buffer; sizes are multiples of 4.
void copy_to_host(const Context& context, const PinnedBuffer& to, const Buffer& from,
                  const Stream& stream);
void clear(const Context& context, const Buffer& buffer, const Stream& stream);

/// Queues a kernel of one parameter, which is how all kernels here are written: a struct that is
/// copied at the call.
template <class Parameters>
void launch(const Context& context, const Stream& stream, const char* name, unsigned blocks,
            unsigned threads, const Parameters& parameters) {
  const FunctionHandle function = context.function(name);
  const ContextScope scope(context);
  void* pointers[] = {const_cast<Parameters*>(&parameters)};
  check(driver().launch_kernel(function, blocks, 1, 1, threads, 1, 1, 0, stream.handle(), pointers,
                               nullptr),
        name);
}

}  // namespace skytree::cuda
