#include "core/parallel.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace binrig {
namespace {
std::atomic<int> job_count{0};
thread_local bool inside = false;
}  // namespace

int jobs() {
  const int set = job_count.load();
  static const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));  // reads a file
  return set > 0 ? set : cores;
}

void set_jobs(int count) { job_count.store(std::max(0, count)); }

void parallel_for(int count, const std::function<void(int)>& body) {
  const int threads = std::min(jobs(), count);
  if (threads <= 1 || inside) {
    for (int i = 0; i < count; ++i) body(i);
    return;
  }
  std::atomic<int> next{0};
  std::exception_ptr failure;
  std::mutex failure_mutex;
  // A thread takes a share of what is left, so that short items (image rows) cost little and long ones balance.
  auto work = [&] {
    inside = true;
    try {
      while (true) {
        const int chunk = std::max(1, (count - next.load()) / (threads * 4));
        const int begin = next.fetch_add(chunk);
        if (begin >= count) break;
        for (int i = begin; i < std::min(count, begin + chunk); ++i) body(i);
      }
    } catch (...) {
      const std::lock_guard lock(failure_mutex);
      if (!failure) failure = std::current_exception();
      next.store(count);
    }
    inside = false;
  };
  std::vector<std::thread> pool;
  for (int i = 1; i < threads; ++i) pool.emplace_back(work);
  work();
  for (std::thread& thread : pool) thread.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace binrig
