// Writing a recording set. Nothing recorded is ever lost: each image is written under a temporary name and renamed, then
// one line goes to the capture's journal; scene_camera.json and scene_gt.json are made from it at the end. A reader
// merges a journal that it finds, so that a killed recording stays readable up to its last whole frame.
#pragma once

#include <memory>
#include <string>

#include "core/recording_set.h"

namespace binrig {

struct WriterOptions {
  bool masks = true;          ///< mask_visib/ from Frame::ids
  bool reasons = true;        ///< reason/ for frames whose reasons say more than "unknown"
  int png_compression = 1;    ///< 0 .. 9
};

class RecordingWriter {
 public:
  /// Creates the set, or opens an existing one to add captures (its sensor must be the same, else Error).
  /// `info` gives everything but the captures. Throws Error if the folder cannot be written.
  RecordingWriter(const std::string& path, const SetInfo& info, const WriterOptions& options = {});
  /// Finishes an open capture; errors of the last moment are swallowed here, so call finish_capture() yourself.
  ~RecordingWriter();
  RecordingWriter(const RecordingWriter&) = delete;
  RecordingWriter& operator=(const RecordingWriter&) = delete;

  /// `capture.frames` is ignored. Throws Error if the capture exists already.
  void begin_capture(const CaptureInfo& capture);
  /// Appends a frame. Depth is stored in steps of frame.depth_scale_mm (0: the smallest step that fits the largest
  /// depth into 16 bits, stated in storage_loss_mm). Throws Error if the disk is full or the frame is malformed;
  /// frames before it stay intact and nothing half-written remains.
  void write(const Frame& frame);
  void finish_capture();

  /// Copies models/ and valid_region of another set, so that the new one stands alone.
  void copy_models(const std::string& from_set);

  /// Largest difference between a depth given and the depth stored so far (mm).
  double storage_loss_mm() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Writes `bytes` to a temporary file beside `path` and renames it. Throws Error naming path and the system's reason;
/// the temporary file is removed then.
void write_file_atomically(const std::string& path, const void* bytes, std::size_t size);
void write_file_atomically(const std::string& path, const std::string& text);

}  // namespace binrig
