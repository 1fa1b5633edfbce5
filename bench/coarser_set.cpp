// coarser_set: a recording set as a camera with every n-th pixel of each row and column would have recorded it.
//
//   coarser_set SET N OUT
//
// Values and reasons are those of the pixels that stay: nothing is averaged. What is said in pixels (intrinsics and how
// well they are known) is divided by n. For questions that would take an hour on a real camera's own frames; noise that
// neighbours share is shared less, and lengths in a model of the full frames do not fit: a model is to be fitted anew.
#include <cstdio>
#include <filesystem>
#include <fstream>

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/error.h"

namespace fs = std::filesystem;

namespace binrig {
namespace {

/// Every n-th pixel, from the first on.
cv::Mat thinned(const cv::Mat& image, int n) {
  cv::Mat out((image.rows + n - 1) / n, (image.cols + n - 1) / n, image.type());
  const size_t bytes = image.elemSize();
  for (int v = 0; v < out.rows; ++v)
    for (int u = 0; u < out.cols; ++u) std::copy_n(image.ptr(v * n, u * n), bytes, out.ptr(v, u));
  return out;
}

/// Divides what stands in pixels, wherever it is in the document.
void scale(nlohmann::json& node, int n) {
  if (!node.is_structured()) return;
  for (auto& [key, value] : node.items()) {
    if (key == "cam_K") {
      for (int i = 0; i < 6; ++i) value.at(i) = value.at(i).get<double>() / n;
    } else if (key == "cam_K_sigma_px") {
      for (auto& sigma : value) sigma = sigma.get<double>() / n;
    } else if (key == "fx" || key == "fy" || key == "cx" || key == "cy") {
      value = value.get<double>() / n;
    } else if (key == "width" || key == "height") {
      value = (value.get<int>() + n - 1) / n;
    } else {
      scale(value, n);
    }
  }
}

void write_coarser(const fs::path& from, int n, const fs::path& to) {
  for (const auto& entry : fs::recursive_directory_iterator(from)) {
    const fs::path target = to / fs::relative(entry.path(), from);
    if (entry.is_directory()) {
      fs::create_directories(target);
      continue;
    }
    const std::string name = entry.path().filename(), extension = entry.path().extension();
    if (extension == ".png" || extension == ".jpg") {
      const cv::Mat image = cv::imread(entry.path(), cv::IMREAD_UNCHANGED);
      if (image.empty()) throw Error("cannot read " + entry.path().string());
      if (!cv::imwrite(target, thinned(image, n))) throw Error("cannot write " + target.string());
    } else if (name == "camera.json" || name == "recording.json" || name == "scene_camera.json") {
      auto document = nlohmann::json::parse(std::ifstream(entry.path()));
      scale(document, n);
      std::ofstream(target) << document.dump(1) << "\n";
    } else {
      fs::copy_file(entry.path(), target, fs::copy_options::overwrite_existing);
    }
  }
}

}  // namespace
}  // namespace binrig

int main(int argc, char** argv) {
  const int n = argc == 4 ? std::atoi(argv[2]) : 0;
  if (n < 1) {
    std::fprintf(stderr, "coarser_set SET N OUT: every N-th pixel of SET's images, with its camera, as the set OUT\n");
    return 2;
  }
  try {
    fs::create_directories(argv[3]);
    binrig::write_coarser(argv[1], n, argv[3]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
