// What is costly to make and wanted again soon: kept until others were used since.
#pragma once

#include <cstddef>
#include <functional>
#include <list>
#include <mutex>
#include <unordered_map>
#include <utility>

namespace binrig {

/// Values by key, as many as fit into a limit; the one that was used longest ago goes first. Values are shared, so they
/// should be cheap to copy (cv::Mat, std::shared_ptr) and must not be written to. Thread-safe. `Hash` of equal keys is
/// equal.
template <typename Key, typename Value, typename Hash = std::hash<Key>>
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
      if (const Value* found = find(key)) return *found;
    }
    Value value = make();
    const std::lock_guard lock(mutex_);
    if (const Value* found = find(key)) return *found;
    kept_.emplace_front(key, value);
    where_[key] = kept_.begin();
    total_ += size_(value);
    while (total_ > limit_ && kept_.size() > 1) {
      total_ -= size_(kept_.back().second);
      where_.erase(kept_.back().first);
      kept_.pop_back();
    }
    return value;
  }

 private:
  using Kept = std::list<std::pair<Key, Value>>;  // used last comes first
  const Value* find(const Key& key) {
    const auto at = where_.find(key);
    if (at == where_.end()) return nullptr;
    kept_.splice(kept_.begin(), kept_, at->second);
    return &at->second->second;
  }

  const std::size_t limit_;
  const Size size_;
  std::mutex mutex_;
  Kept kept_;
  std::unordered_map<Key, typename Kept::iterator, Hash> where_;
  std::size_t total_ = 0;
};

}  // namespace binrig
