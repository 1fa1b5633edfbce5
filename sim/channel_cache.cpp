#include "sim/channel_cache.h"

#include <opencv2/core.hpp>

namespace binrig {
namespace {

std::size_t bytes_of(const Channels& c) {
  std::size_t total = 0;
  for (const cv::Mat* image : {&c.depth_mm, &c.normal, &c.cos_incidence, &c.instance, &c.projector_gap_mm, &c.diffuse,
                               &c.specular, &c.ir, &c.edge_px, &c.crease_px, &c.rgb}) {
    total += image->total() * image->elemSize();
  }
  return total;
}

template <typename T>
void append(std::string& key, const T& value) {
  key.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

void append(std::string& key, const Pose& pose) {
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 4; ++j) append(key, pose.matrix()(i, j));
  }
}

}  // namespace

std::string picture_key(const RenderScene& scene, const RenderRequest& request) {
  std::string key;
  for (const SceneObject& object : scene.objects) {
    append(key, object.mesh.get());
    append(key, object.X_CO);
  }
  if (scene.plane) {
    for (int i = 0; i < 3; ++i) append(key, scene.plane->normal[i]);
    append(key, scene.plane->offset_mm);
    append(key, scene.plane->surface.albedo);
  }
  const Camera& c = request.camera;
  for (double value : {c.fx, c.fy, c.cx, c.cy}) append(key, value);
  append(key, c.width);
  append(key, c.height);
  for (double k : c.distortion) append(key, k);
  if (request.projector_xyz_mm) {
    for (int i = 0; i < 3; ++i) append(key, (*request.projector_xyz_mm)[i]);
  }
  append(key, request.reference_distance_mm);
  return key;
}

std::shared_ptr<const Channels> ChannelCache::find(const std::string& key, ChannelSet wanted) {
  const std::lock_guard lock(mutex_);
  const auto known = of_key_.find(key);
  if (known == of_key_.end()) return nullptr;
  for (const auto& entry : known->second) {
    if ((entry->made & wanted) != wanted) continue;
    entries_.splice(entries_.begin(), entries_, entry);
    return entry->channels;
  }
  return nullptr;
}

void ChannelCache::forget(std::list<Entry>::iterator entry) {
  const auto known = of_key_.find(entry->key);
  std::erase(known->second, entry);
  if (known->second.empty()) of_key_.erase(known);
  size_ -= entry->bytes;
  entries_.erase(entry);
}

void ChannelCache::add(const std::string& key, ChannelSet made, std::shared_ptr<const Channels> channels) {
  const std::lock_guard lock(mutex_);
  if (const auto known = of_key_.find(key); known != of_key_.end()) {
    const auto before = known->second;
    for (const auto& entry : before)
      if ((entry->made & made) == entry->made) forget(entry);  // superseded
  }
  const std::size_t bytes = bytes_of(*channels);
  entries_.push_front({key, made, bytes, std::move(channels)});
  of_key_[key].push_back(entries_.begin());
  size_ += bytes;
  while (size_ > limit_ && entries_.size() > 1) forget(std::prev(entries_.end()));
}

std::shared_ptr<const Channels> ChannelCache::render(const Renderer& renderer, const RenderScene& scene,
                                                     const RenderRequest& request) {
  const std::string key = picture_key(scene, request);
  if (auto found = find(key, request.wanted)) return found;
  auto channels = renderer.render(scene, request);
  add(key, request.wanted, channels);
  return channels;
}

}  // namespace binrig
