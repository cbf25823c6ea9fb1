// SPDX-License-Identifier: GPL-3.0-or-later
#include "cuda/context.h"

#include <utility>

#include "cuda/kernel_image.h"

namespace skytree::cuda {
namespace {

std::mutex registry_guard;
std::map<int, std::weak_ptr<Context>>& registry() {
  static std::map<int, std::weak_ptr<Context>> contexts;
  return contexts;
}

// For destructors: what cannot be freed now, because the context is lost, goes with the context.
template <class Call>
void release_in(const ContextPointer& context, Call call) noexcept {
  try {
    const ContextScope scope(*context);
    call(driver());
  } catch (...) {
  }
}

}  // namespace

ContextPointer Context::acquire(int ordinal) {
  const std::lock_guard<std::mutex> lock(registry_guard);
  std::weak_ptr<Context>& entry = registry()[ordinal];
  ContextPointer context = entry.lock();
  if (!context) entry = context = std::make_shared<Context>(ordinal);
  return context;
}

Context::Context(int ordinal) : ordinal_(ordinal) {
  if (!kernel_image()) {
    throw std::runtime_error(
        "This build of Skytree has no CUDA kernels: it was made without nvcc. Choose the CPU, or "
        "build it where the "
        "CUDA toolkit is.");
  }
  const DriverApi& api = driver();
  Device device;
  check(api.device_get(&device, ordinal), "Opening the GPU (cuDeviceGet)");
  char name[256] = "";
  check(api.device_get_name(name, sizeof name, device), "Reading the GPU's name (cuDeviceGetName)");
  device_name_ = name;
  check(api.device_get_attribute(&multiprocessors_, kAttributeMultiprocessorCount, device),
        "Reading the GPU's properties (cuDeviceGetAttribute)");
  check(api.context_create(&handle_, kContextBlockingSync, device),
        "Making a context on the GPU (cuCtxCreate)");
  ContextHandle created = nullptr;
  api.context_pop(&created);  // cuCtxCreate leaves it current, and the caller's own must be again
  try {
    load_kernels();
  } catch (...) {
    api.context_destroy(handle_);
    throw;
  }
}

void Context::load_kernels() {
  const ContextScope scope(*this);
  char log[4096] = "";
  JitOption options[] = {kJitErrorLogBuffer, kJitErrorLogBufferSizeBytes};
  void* values[] = {log, reinterpret_cast<void*>(sizeof log)};
  const Result result = driver().module_load(&module_, kernel_image(), 2, options, values);
  if (result != kSuccess) {
    std::string doing = "Loading the kernels on " + device_name_ + " (cuModuleLoadDataEx)";
    if (log[0]) doing += " [" + std::string(log) + "]";
    throw Error(result, doing);
  }
}

Context::~Context() {
  try {
    const DriverApi& api = driver();
    {
      const ContextScope scope(*this);
      api.module_unload(module_);
    }
  } catch (...) {  // a lost context: destroying it is all that is left
  }
  try {
    driver().context_destroy(handle_);
  } catch (...) {
  }
}

void Context::mark_lost() {
  const std::lock_guard<std::mutex> lock(registry_guard);
  const auto entry = registry().find(ordinal_);
  if (entry != registry().end() && entry->second.lock().get() == this) registry().erase(entry);
}

bool Context::healthy() const {
  try {
    const ContextScope scope(*this);
    size_t free_bytes, total_bytes;
    return driver().memory_get_info(&free_bytes, &total_bytes) == kSuccess;
  } catch (const std::runtime_error&) {
    return false;
  }
}

void Context::forget_expired() {
  if (shared_.size() <= shared_limit_) return;
  for (auto entry = shared_.begin(); entry != shared_.end();) {
    entry = entry->second.expired() ? shared_.erase(entry) : std::next(entry);
  }
  shared_limit_ = 2 * shared_.size() + 64;
}

FunctionHandle Context::function(const std::string& name) const {
  const std::lock_guard<std::mutex> lock(functions_guard_);
  FunctionHandle& function = functions_[name];
  if (!function) {
    const ContextScope scope(*this);
    check(driver().module_get_function(&function, module_, name.c_str()),
          ("Looking up kernel " + name + " (cuModuleGetFunction)").c_str());
  }
  return function;
}

ContextScope::ContextScope(const Context& context) {
  check(driver().context_push(context.handle()), "Entering the GPU's context (cuCtxPushCurrent)");
}

ContextScope::~ContextScope() {
  ContextHandle popped = nullptr;
  driver().context_pop(&popped);
}

Buffer::Buffer(ContextPointer context, size_t bytes) : context_(std::move(context)), bytes_(bytes) {
  if (bytes == 0) return;
  const ContextScope scope(*context_);
  const Result result = driver().memory_alloc(&pointer_, bytes);
  if (result != kSuccess) {
    throw Error(result, "Allocating " + std::to_string((bytes + (1 << 20) - 1) >> 20) +
                            " MB on the GPU (cuMemAlloc)");
  }
}

Buffer::Buffer(ContextPointer context, const void* data, size_t bytes)
    : Buffer(std::move(context), bytes) {
  upload(data, bytes);
}

Buffer::~Buffer() {
  if (pointer_) release_in(context_, [this](const DriverApi& api) { api.memory_free(pointer_); });
}

void Buffer::swap(Buffer& other) noexcept {
  std::swap(context_, other.context_);
  std::swap(pointer_, other.pointer_);
  std::swap(bytes_, other.bytes_);
}

void Buffer::upload(const void* data, size_t bytes) {
  if (bytes == 0) return;
  const ContextScope scope(*context_);
  check(driver().copy_to_device(pointer_, data, bytes), "Copying to the GPU (cuMemcpyHtoD)");
  // From pageable memory that returns when the data has left it, which is before they have arrived,
  // and our streams do not wait for the default stream, in which they travel.
  check(driver().stream_synchronize(nullptr),
        "Waiting for a copy to the GPU (cuStreamSynchronize)");
  context_->uploaded_bytes_ += bytes;
}

void Buffer::download(void* data, size_t bytes) const {
  if (bytes == 0) return;
  const ContextScope scope(*context_);
  check(driver().copy_to_host(data, pointer_, bytes), "Copying from the GPU (cuMemcpyDtoH)");
}

PinnedBuffer::PinnedBuffer(ContextPointer context, size_t bytes)
    : context_(std::move(context)), bytes_(bytes) {
  const ContextScope scope(*context_);
  check(driver().memory_alloc_host(&data_, bytes),
        "Allocating page-locked memory (cuMemAllocHost)");
}

PinnedBuffer::~PinnedBuffer() {
  release_in(context_, [this](const DriverApi& api) { api.memory_free_host(data_); });
}

Stream::Stream(ContextPointer context) : context_(std::move(context)) {
  const ContextScope scope(*context_);
  check(driver().stream_create(&handle_, kStreamNonBlocking), "Making a stream (cuStreamCreate)");
}

Stream::~Stream() {
  // Work that is still queued writes to buffers that go next: wait for it.
  release_in(context_, [this](const DriverApi& api) { api.stream_synchronize(handle_); });
  release_in(context_, [this](const DriverApi& api) { api.stream_destroy(handle_); });
}

void Stream::synchronize() const {
  const ContextScope scope(*context_);
  check(driver().stream_synchronize(handle_), "Waiting for the GPU (cuStreamSynchronize)");
}

Event::Event(ContextPointer context) : context_(std::move(context)) {
  const ContextScope scope(*context_);
  check(driver().event_create(&handle_, kEventBlockingSync | kEventDisableTiming),
        "Making an event (cuEventCreate)");
}

Event::~Event() {
  release_in(context_, [this](const DriverApi& api) { api.event_destroy(handle_); });
}

void Event::record(const Stream& stream) {
  const ContextScope scope(*context_);
  check(driver().event_record(handle_, stream.handle()), "Marking a stream (cuEventRecord)");
}

void Event::make_wait(const Stream& stream) const {
  const ContextScope scope(*context_);
  check(driver().stream_wait_event(stream.handle(), handle_, 0),
        "Ordering streams (cuStreamWaitEvent)");
}

void Event::synchronize() const {
  const ContextScope scope(*context_);
  check(driver().event_synchronize(handle_), "Waiting for the GPU (cuEventSynchronize)");
}

void copy_to_host(const Context& context, const PinnedBuffer& to, const Buffer& from,
                  const Stream& stream) {
  const ContextScope scope(context);
  check(driver().copy_to_host_async(to.data(), from.pointer(), from.bytes(), stream.handle()),
        "Copying from the GPU (cuMemcpyDtoHAsync)");
}

void clear(const Context& context, const Buffer& buffer, const Stream& stream) {
  const ContextScope scope(context);
  check(driver().memset_async(buffer.pointer(), 0, buffer.bytes() / 4, stream.handle()),
        "Clearing the film (cuMemsetD32Async)");
}

}  // namespace skytree::cuda
