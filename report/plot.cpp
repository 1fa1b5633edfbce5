#include "report/plot.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>

#include <fmt/format.h>

#include "core/error.h"

extern char** environ;

namespace binrig {

namespace {

namespace fs = std::filesystem;

/// A folder that disappears with the object.
class ScratchFolder {
 public:
  ScratchFolder() {
    std::string pattern = (fs::temp_directory_path() / "binrig-plot-XXXXXX").string();
    if (!mkdtemp(pattern.data()))
      throw Error("no temporary folder can be made in " + fs::temp_directory_path().string());
    path_ = pattern;
  }
  ~ScratchFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  fs::path operator/(const char* name) const { return path_ / name; }

 private:
  fs::path path_;
};

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c == '\n' ? ' ' : c;
  }
  return out + "\"";
}

bool drawable(const Plot& plot, double x, double y) {
  return std::isfinite(x) && std::isfinite(y) && (!plot.log_x || x > 0) && (!plot.log_y || y > 0);
}

std::string data_block(const Plot& plot, int number, const std::vector<double>& x, const std::vector<double>& y,
                       const std::vector<double>* high = nullptr) {
  std::string text = fmt::format("$d{} << EOD\n", number);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const bool ok = drawable(plot, x[i], y[i]) && (!high || drawable(plot, x[i], (*high)[i]));
    // A blank line would start a new block of data; a point that cannot be drawn is left out.
    if (ok) text += high ? fmt::format("{} {} {}\n", x[i], y[i], (*high)[i]) : fmt::format("{} {}\n", x[i], y[i]);
  }
  return text + "EOD\n";
}

std::string range_text(const std::optional<std::array<double, 2>>& range) {
  return range ? fmt::format("[{}:{}]", (*range)[0], (*range)[1]) : "[*:*]";
}

std::string stroke_text(const Curve& curve) {
  const std::string colour = hex_colour(ink_colour(curve.ink));
  switch (curve.stroke) {
    case Stroke::line:
      return fmt::format("with lines lw 2 lc rgb '{}'", colour);
    case Stroke::dashed:
      return fmt::format("with lines lw 2 dt (12,6) lc rgb '{}'", colour);
    case Stroke::dotted:
      return fmt::format("with lines lw 1.6 dt (3,5) lc rgb '{}'", colour);
    case Stroke::points:
      return fmt::format("with points pt 7 ps 1.1 lc rgb '{}'", colour);
    case Stroke::rings:
      return fmt::format("with points pt 6 ps 2.0 lw 1.6 lc rgb '{}'", colour);
    case Stroke::steps:
      return fmt::format("with steps lw 2 lc rgb '{}'", colour);
    case Stroke::boxes:
      return fmt::format("with boxes fs solid 0.35 lw 1 lc rgb '{}'", colour);
  }
  return "";
}

std::string script(const Plot& plot, const std::string& output) {
  std::string text;
  // Everything is given in pixels of the page and drawn at twice the density (fontscale, linewidth).
  text += fmt::format(
      "set terminal pngcairo noenhanced size {},{} background '#ffffff' font 'sans,11' fontscale 1.7 linewidth 2.0\n"
      "set output {}\nset encoding utf8\n",
      2 * plot.width_px, 2 * plot.height_px, quoted(output));
  text +=
      "set border 3 lc rgb '#6b7280' lw 0.8\nset tics nomirror out scale 0.6 tc rgb '#374151'\n"
      "set grid lc rgb '#e3e6eb' lt 1 lw 0.6\nset style fill transparent solid 0.20 noborder\n";
  text += "set key above left Left reverse horizontal samplen 2 spacing 1.1 maxrows 2 tc rgb '#1f2937'\n";
  text += fmt::format("set xlabel {} tc rgb '#1f2937'\nset ylabel {} tc rgb '#1f2937'\n", quoted(plot.x_label),
                      quoted(plot.y_label));
  if (!plot.title.empty()) text += fmt::format("set title {} tc rgb '#111827'\n", quoted(plot.title));
  if (plot.log_x) text += "set logscale x\nset format x '%h'\n";
  if (plot.log_y) text += "set logscale y\nset format y '%h'\n";
  text += fmt::format("set xrange {}\nset yrange {}\n", range_text(plot.x_range), range_text(plot.y_range));
  if (!plot.x_ticks.empty()) {
    constexpr std::size_t letter_px = 7;
    std::vector<std::string> ticks;
    std::size_t longest = 0;
    for (const auto& [at, label] : plot.x_ticks) {
      ticks.push_back(fmt::format("{} {}", quoted(label), at));
      longest = std::max(longest, label.size());
    }
    const bool too_long = longest * letter_px * ticks.size() > static_cast<std::size_t>(plot.width_px);
    text += fmt::format("set xtics {}({})\n", too_long ? "rotate by -20 left " : "", fmt::join(ticks, ", "));
  }
  for (const Rule& rule : plot.rules) {
    const std::string place = plot.log_x && rule.vertical && rule.at <= 0 ? "" : fmt::format("{}", rule.at);
    if (place.empty() || (!rule.vertical && plot.log_y && rule.at <= 0)) continue;
    text += rule.vertical ? fmt::format("set arrow from first {0}, graph 0 to first {0}, graph 1 nohead", place)
                          : fmt::format("set arrow from graph 0, first {0} to graph 1, first {0} nohead", place);
    text += " lc rgb '#5a5e66' lw 1.2 dt (8,6) front\n";
    if (rule.label.empty()) continue;
    text += rule.vertical ? fmt::format("set label {} at first {}, graph 0.04 offset 0.6,0", quoted(rule.label), place)
                          : fmt::format("set label {} at graph 0.02, first {} offset 0,0.6", quoted(rule.label), place);
    text += " left tc rgb '#5a5e66' front\n";
  }
  int number = 0;
  std::vector<std::string> parts;
  for (const Band& band : plot.bands) {
    text += data_block(plot, number, band.x, band.low, &band.high);
    parts.push_back(fmt::format("$d{} using 1:2:3 with filledcurves lc rgb '{}' {}", number++,
                                hex_colour(ink_colour(band.ink)),
                                band.label.empty() ? "notitle" : "title " + quoted(band.label)));
  }
  for (const Curve& curve : plot.curves) {
    text += data_block(plot, number, curve.x, curve.y);
    parts.push_back(fmt::format("$d{} using 1:2 {} {}", number++, stroke_text(curve),
                                curve.label.empty() ? "notitle" : "title " + quoted(curve.label)));
  }
  text += "plot ";
  for (std::size_t i = 0; i < parts.size(); ++i) text += (i ? ", " : "") + parts[i];
  return text + "\n";
}

std::string read_text(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return std::string(std::istreambuf_iterator<char>(in), {});
}

/// Runs gnuplot on a script file; its complaints go to `log`. Returns its exit status, 127 if it is not there.
int run_gnuplot(const fs::path& script_path, const fs::path& log) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, 1, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, 2, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  std::string name = "gnuplot", flag = "-d", file = script_path.string();  // -d: no settings of the user's own
  char* arguments[] = {name.data(), flag.data(), file.data(), nullptr};
  pid_t child = 0;
  const int failed = posix_spawnp(&child, "gnuplot", &actions, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&actions);
  if (failed) return 127;
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

void check(const Plot& plot) {
  Violations violations;
  bool anything = false;
  for (const Band& band : plot.bands) {
    if (band.x.size() != band.low.size() || band.x.size() != band.high.size()) {
      violations.add("plot " + plot.name, band.label, "band's x, low and high differ in length");
    }
    for (std::size_t i = 0; i < band.x.size() && violations.empty(); ++i) {
      anything = anything || (drawable(plot, band.x[i], band.low[i]) && drawable(plot, band.x[i], band.high[i]));
    }
  }
  for (const Curve& curve : plot.curves) {
    if (curve.x.size() != curve.y.size()) {
      violations.add("plot " + plot.name, curve.label, "curve's x and y differ in length");
    }
    for (std::size_t i = 0; i < curve.x.size() && violations.empty(); ++i) {
      anything = anything || drawable(plot, curve.x[i], curve.y[i]);
    }
  }
  if (violations.empty() && !anything) violations.add("plot " + plot.name, "", "has no point that can be drawn");
  violations.throw_if_any("a plot cannot be drawn");
}

}  // namespace

Picture draw(const Plot& plot) {
  check(plot);
  const ScratchFolder folder;
  const fs::path script_path = folder / "plot.gp", log = folder / "log", output = folder / "plot.png";
  std::ofstream(script_path) << script(plot, output.string());
  const int status = run_gnuplot(script_path, log);
  if (status == 127) throw Error("gnuplot is not installed: curves are drawn with it (apt-get install gnuplot-nox)");
  const std::string png = read_text(output);
  if (status != 0 || png.empty()) {
    throw Error(fmt::format("gnuplot could not draw {} (exit status {}): {}", plot.name, status, read_text(log)));
  }
  return {plot.name, plot.alt, plot.caption, std::vector<std::uint8_t>(png.begin(), png.end()), plot.width_px};
}

Curve histogram_curve(const std::string& label, const std::vector<double>& edges, const std::vector<double>& counts,
                      Ink ink) {
  if (edges.size() != counts.size() + 1) throw Error("histogram " + label + ": edges must be one more than counts");
  double total = 0;
  for (const double c : counts) total += c;
  Curve curve{label, {}, {}, ink, Stroke::steps};
  for (std::size_t i = 0; i < counts.size(); ++i) {
    curve.x.push_back(edges[i]);
    curve.y.push_back(total > 0 ? counts[i] / (total * (edges[i + 1] - edges[i])) : 0);
  }
  curve.x.push_back(edges.back());
  curve.y.push_back(curve.y.empty() ? 0 : curve.y.back());
  return curve;
}

}  // namespace binrig
