// A report: one HTML file that needs no network, and its pictures as PNG files beside it.
//
//   Page page("Fidelity of kinect.yaml", "measured: d415-table, simulated: 4 frames");
//   page.fact("sensor", "RealSense D415");
//   page.verdict(Mark::bad, "The simulation differs from the measurement.", {"Its noise is 12 % too small."});
//   page.section("Noise");
//   page.table(table);
//   page.figure(draw(plot));
//   page.write("out");            // out/report.html, out/noise_spectrum.png ...
//
// All texts are plain: the page escapes them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "report/cloud.h"
#include "report/map.h"
#include "report/plot.h"

namespace binrig {

/// How something turned out. Shown as a word's colour and a sign, so that it survives grey print.
enum class Mark { none, good, bad, open };

struct TableCell {
  /// Text that is a number with at most a sign, "<" or "%" about it ("< 1e-12", "-3.2 %", "-") is set as one.
  TableCell(std::string text, Mark mark = Mark::none);  // NOLINT: implicit on purpose
  TableCell(const char* text, Mark mark = Mark::none) : TableCell(std::string(text), mark) {}  // NOLINT
  /// Three significant digits.
  TableCell(double value, Mark mark = Mark::none);                                                         // NOLINT
  TableCell(int value, Mark mark = Mark::none) : text(std::to_string(value)), mark(mark), number(true) {}  // NOLINT
  std::string text;
  Mark mark = Mark::none;
  bool number = false;  ///< set flush right
};

struct Table {
  std::vector<std::string> columns;  ///< heads, with units: "sigma (mm)"
  std::vector<std::vector<TableCell>> rows;
  std::string caption;
};

/// "0.0123", "1.24e-07", "1240": `digits` significant digits, no trailing rubbish; "-" for what is not finite.
std::string significant(double value, int digits = 3);
/// "0.031", "< 1e-12": how p-values are written.
std::string p_text(double p);
/// "12.3 %" of a share 0.123.
std::string percent(double share, int digits = 3);

class Page {
 public:
  Page(const std::string& title, const std::string& subtitle);
  ~Page();
  Page(const Page&) = delete;
  Page& operator=(const Page&) = delete;

  /// A line of the block under the title: what, with which settings, when.
  void fact(const std::string& name, const std::string& value);
  /// The answer in words, first of all; one line a reason.
  void verdict(Mark mark, const std::string& headline, const std::vector<std::string>& reasons = {});

  void section(const std::string& title);
  void subsection(const std::string& title);
  void text(const std::string& paragraph);
  /// A remark set apart: a limit of the method, a warning about the data.
  void note(const std::string& paragraph);
  void list(const std::vector<std::string>& items);
  /// A formula or command, in a fixed-width box.
  void code(const std::string& text);
  /// Throws Error if a row has another number of cells than there are columns.
  void table(const Table& table);
  /// Names must differ within a page (they are file names); else Error.
  void figure(const Picture& picture);
  /// Two in a row where there is room.
  void figures(const std::vector<Picture>& pictures);
  void figure(const MapFigure& map);
  void figure(const CategoryFigure& map);
  void figure(const CloudFigure& clouds);
  /// What follows until end_details() is folded away behind a line that opens it (always open in print).
  void begin_details(const std::string& title);
  void end_details();

  /// Writes FOLDER/report.html and the pictures, each file at once or not at all; creates the folder. Returns the
  /// page's path. Throws Error if it cannot be written.
  std::string write(const std::string& folder, const std::string& file = "report.html") const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace binrig
