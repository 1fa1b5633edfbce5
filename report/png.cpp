#include "report/png.h"

#include <algorithm>
#include <cstring>

#include <zlib.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace binrig {

namespace {

void put32(std::vector<std::uint8_t>& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void put_chunk(std::vector<std::uint8_t>& out, const char* type, const std::vector<std::uint8_t>& data) {
  put32(out, static_cast<std::uint32_t>(data.size()));
  const std::size_t begin = out.size();
  out.insert(out.end(), type, type + 4);
  out.insert(out.end(), data.begin(), data.end());
  put32(out, static_cast<std::uint32_t>(crc32(0, out.data() + begin, static_cast<uInt>(out.size() - begin))));
}

}  // namespace

std::vector<std::uint8_t> indexed_png(const cv::Mat& index, const std::vector<Rgb>& palette) {
  if (index.empty() || index.type() != CV_8U) throw Error("an indexed picture must be a CV_8U image");
  double largest = 0;
  cv::minMaxLoc(index, nullptr, &largest);
  if (palette.empty() || palette.size() > 256 || largest >= static_cast<double>(palette.size())) {
    throw Error("an indexed picture needs a palette of at most 256 colours that covers its indices");
  }
  std::vector<std::uint8_t> out{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'}, header, colours, rows;
  put32(header, static_cast<std::uint32_t>(index.cols));
  put32(header, static_cast<std::uint32_t>(index.rows));
  for (const int byte : {8, 3, 0, 0, 0}) header.push_back(static_cast<std::uint8_t>(byte));  // 8 bits, palette
  for (const Rgb& colour : palette) colours.insert(colours.end(), colour.begin(), colour.end());
  for (int r = 0; r < index.rows; ++r) {
    rows.push_back(0);  // no filter: neighbouring indices are no differences
    rows.insert(rows.end(), index.ptr<std::uint8_t>(r), index.ptr<std::uint8_t>(r) + index.cols);
  }
  uLongf size = compressBound(static_cast<uLong>(rows.size()));
  std::vector<std::uint8_t> packed(size);
  if (compress2(packed.data(), &size, rows.data(), static_cast<uLong>(rows.size()), 9) != Z_OK) {
    throw Error("a picture could not be compressed");
  }
  packed.resize(size);
  put_chunk(out, "IHDR", header);
  put_chunk(out, "PLTE", colours);
  put_chunk(out, "IDAT", packed);
  put_chunk(out, "IEND", {});
  return out;
}

std::vector<std::uint8_t> rgb_png(const cv::Mat& rgb) {
  cv::Mat bgr;
  cv::cvtColor(rgb, bgr, cv::COLOR_RGB2BGR);
  std::vector<std::uint8_t> bytes;
  cv::imencode(".png", bgr, bytes, {cv::IMWRITE_PNG_COMPRESSION, 7});
  return bytes;
}

}  // namespace binrig
