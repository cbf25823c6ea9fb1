// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <atomic>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace skytree {

/// Threads that share loops over independent pieces while a table is built. What a piece computes
/// must not depend on who does it: tables are the same bits for any number of threads.
class ThreadTeam {
 public:
  /// `threads` with the calling one; 0: all cores, as far as tables limited by memory profit.
  /// Throws std::invalid_argument for a negative number.
  explicit ThreadTeam(int threads = 0);
  ~ThreadTeam();
  ThreadTeam(const ThreadTeam&) = delete;
  ThreadTeam& operator=(const ThreadTeam&) = delete;

  int size() const { return (int)helpers_.size() + 1; }
  /// body(worker, piece) for every piece in [0, count); worker 0 is the calling thread. The first
  /// exception ends the loop and is thrown again here. Not to be called from a body.
  using Body = std::function<void(int worker, int piece)>;
  void run(int count, const Body& body);
  /// The same in pieces of `chunk` items: body(worker, first, last) for items [first, last).
  void run_chunks(int count, int chunk,
                  const std::function<void(int worker, int first, int last)>& body);

 private:
  void help(int worker);
  void work(int worker, const Body& body, int count);

  std::vector<std::thread> helpers_;
  std::mutex mutex_;
  std::condition_variable wake_, done_;
  const Body* body_ = nullptr;  // null: nothing to help with
  int count_ = 0, busy_ = 0;
  std::atomic<int> next_{0};
  std::exception_ptr error_;
  bool shutdown_ = false;
};

}  // namespace skytree
