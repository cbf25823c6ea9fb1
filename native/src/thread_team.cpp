// SPDX-License-Identifier: GPL-3.0-or-later
#include "src/thread_team.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

namespace skytree {
namespace {

constexpr int kMostByDefault = 16, kMost = 1024;

}  // namespace

ThreadTeam::ThreadTeam(int threads) {
  if (threads < 0 || threads > kMost) {
    throw std::invalid_argument("threads is " + std::to_string(threads) +
                                "; it must be from 1 to " + std::to_string(kMost) +
                                ", or 0 for all cores");
  }
  if (threads == 0)
    threads = std::clamp((int)std::thread::hardware_concurrency(), 1, kMostByDefault);
  for (int worker = 1; worker < threads; ++worker) {
    try {
      helpers_.emplace_back([this, worker] { help(worker); });
    } catch (const std::system_error&) {
      break;  // the machine gives no more: fewer do it as well
    }
  }
}

ThreadTeam::~ThreadTeam() {
  {
    std::lock_guard<std::mutex> lock(mutex_);
    shutdown_ = true;
  }
  wake_.notify_all();
  for (std::thread& helper : helpers_) helper.join();
}

void ThreadTeam::run(int count, const Body& body) {
  if (helpers_.empty() || count < 2) {
    for (int piece = 0; piece < count; ++piece) body(0, piece);
    return;
  }
  {
    std::lock_guard<std::mutex> lock(mutex_);
    body_ = &body;
    count_ = count;
    next_ = 0;
  }
  wake_.notify_all();
  work(0, body, count);
  std::unique_lock<std::mutex> lock(mutex_);
  body_ = nullptr;  // who wakes up only now finds nothing and is not waited for
  done_.wait(lock, [this] { return busy_ == 0; });
  if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
}

void ThreadTeam::run_chunks(int count, int chunk, const std::function<void(int, int, int)>& body) {
  run(count / chunk + (count % chunk != 0), [&](int worker, int piece) {
    const int first = piece * chunk;
    body(worker, first, first + std::min(chunk, count - first));
  });
}

void ThreadTeam::work(int worker, const Body& body, int count) {
  try {
    for (int piece; (piece = next_++) < count;) body(worker, piece);
  } catch (...) {
    std::lock_guard<std::mutex> lock(mutex_);
    if (!error_) error_ = std::current_exception();
    next_ = count;
  }
}

void ThreadTeam::help(int worker) {
  std::unique_lock<std::mutex> lock(mutex_);
  for (;;) {
    wake_.wait(lock, [this] { return shutdown_ || (body_ && next_ < count_); });
    if (shutdown_) return;
    ++busy_;
    const Body& body = *body_;
    const int count = count_;
    lock.unlock();
    work(worker, body, count);
    lock.lock();
    if (--busy_ == 0) done_.notify_one();
  }
}

}  // namespace skytree
