// Rendered pictures, kept as long as there is room: captures of one pose, and views that effects ask for again.
#pragma once

#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "sim/renderer.h"

namespace binrig {

/// Everything that a picture depends on but the wanted channels, as bytes.
std::string picture_key(const RenderScene& scene, const RenderRequest& request);

/// The least recently used pictures go first. Thread-safe.
class ChannelCache {
 public:
  /// One picture is kept even if it alone is larger than the limit.
  explicit ChannelCache(std::size_t limit_bytes) : limit_(limit_bytes) {}

  /// The picture with at least the wanted channels, or nothing.
  std::shared_ptr<const Channels> find(const std::string& key, ChannelSet wanted);
  void add(const std::string& key, ChannelSet made, std::shared_ptr<const Channels> channels);
  /// From the cache, else rendered and kept.
  std::shared_ptr<const Channels> render(const Renderer& renderer, const RenderScene& scene,
                                         const RenderRequest& request);

 private:
  struct Entry {
    std::string key;
    ChannelSet made;
    std::size_t bytes;
    std::shared_ptr<const Channels> channels;
  };
  void forget(std::list<Entry>::iterator entry);

  std::mutex mutex_;
  std::list<Entry> entries_;  // the most recently used one first
  std::unordered_map<std::string, std::vector<std::list<Entry>::iterator>> of_key_;
  std::size_t size_ = 0, limit_;
};

}  // namespace binrig
