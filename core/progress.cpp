#include "core/progress.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <mutex>

namespace binrig {
namespace {
using Clock = std::chrono::steady_clock;
std::atomic<bool> silent_process{false};
double seconds_since(Clock::time_point then) { return std::chrono::duration<double>(Clock::now() - then).count(); }
}  // namespace

struct Progress::Impl {
  std::string what;
  std::int64_t total = 0, done = 0;
  Clock::time_point begin = Clock::now(), last = begin;
  bool terminal = isatty(STDERR_FILENO), shown = false;
  std::mutex mutex;

  void print() {
    const double elapsed = seconds_since(begin);
    if (total <= 0) {
      std::fprintf(stderr, "%s%s: %lld (%.0f s)%s", terminal ? "\r" : "", what.c_str(), static_cast<long long>(done),
                   elapsed, terminal ? "\x1b[K" : "\n");
    } else {
      const double share = static_cast<double>(done) / static_cast<double>(total);
      const double left = share > 0 ? elapsed * (1 / share - 1) : 0;
      if (terminal) {
        std::string bar(30, ' ');
        for (int i = 0; i < static_cast<int>(share * 30); ++i) bar[i] = '#';
        std::fprintf(stderr, "\r%s [%s] %3.0f %%, %.0f s left\x1b[K", what.c_str(), bar.c_str(), 100 * share, left);
      } else {
        std::fprintf(stderr, "%s: %lld of %lld, %.0f s, about %.0f s left\n", what.c_str(),
                     static_cast<long long>(done), static_cast<long long>(total), elapsed, left);
      }
    }
    std::fflush(stderr);
    shown = true;
  }
};

Progress::Progress(const std::string& what, std::int64_t total) : impl_(std::make_unique<Impl>()) {
  impl_->what = what;
  impl_->total = total;
}

Progress::~Progress() {
  if (impl_->shown && impl_->terminal) std::fputs("\r\x1b[K", stderr);
}

void Progress::advance(std::int64_t steps) {
  const std::lock_guard lock(impl_->mutex);
  impl_->done += steps;
  if (silent_process) return;
  const double pause = impl_->terminal ? 0.1 : 10.0;
  if (seconds_since(impl_->begin) < 0.5 || seconds_since(impl_->last) < pause) return;
  impl_->last = Clock::now();
  impl_->print();
}

void Progress::silence(bool silent) { silent_process = silent; }

}  // namespace binrig
