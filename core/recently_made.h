// What is costly to make and wanted again soon: kept until others were used since.
#pragma once

#include <cstddef>
#include <functional>
#include <list>
#include <mutex>
#include <utility>

namespace binrig {

/// Values by key, as many as fit into a limit; the one that was used longest ago goes first. Values are shared, so they
/// should be cheap to copy (cv::Mat, std::shared_ptr) and must not be written to. Thread-safe.
template <typename Key, typename Value>
class RecentlyMade {
 public:
  using Size = std::function<std::size_t(const Value&)>;
  /// `limit` in the units of `size`; without a size, how many values. The last value made is kept even if it alone is
  /// larger.
  explicit RecentlyMade(
      std::size_t limit, Size size = [](const Value&) { return std::size_t{1}; })
      : limit_(limit), size_(std::move(size)) {}

  /// The value of a key, made by `make()` if it is not there. Made outside the lock: two threads may make the same one,
  /// which costs time and nothing else. What `make` throws passes through, and nothing is kept.
  template <typename Make>
  Value get(const Key& key, const Make& make) {
    {
      const std::lock_guard lock(mutex_);
      if (const auto found = find(key); found != kept_.end()) return found->second;
    }
    Value value = make();
    const std::lock_guard lock(mutex_);
    if (const auto found = find(key); found != kept_.end()) return found->second;
    kept_.emplace_front(key, value);
    total_ += size_(value);
    while (total_ > limit_ && kept_.size() > 1) {
      total_ -= size_(kept_.back().second);
      kept_.pop_back();
    }
    return value;
  }

 private:
  using Kept = std::list<std::pair<Key, Value>>;  // used last comes first
  typename Kept::iterator find(const Key& key) {
    for (auto it = kept_.begin(); it != kept_.end(); ++it) {
      if (!(it->first == key)) continue;
      kept_.splice(kept_.begin(), kept_, it);
      return it;
    }
    return kept_.end();
  }

  const std::size_t limit_;
  const Size size_;
  std::mutex mutex_;
  Kept kept_;
  std::size_t total_ = 0;
};

}  // namespace binrig
