#include "report/page.h"

#include <cmath>
#include <filesystem>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/recording_writer.h"
#include "report/page_assets.h"
#include "report/png.h"

namespace binrig {

namespace {

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string base64(const std::uint8_t* data, std::size_t size) {
  static const char* const letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((size + 2) / 3 * 4);
  for (std::size_t i = 0; i < size; i += 3) {
    const std::uint32_t word = std::uint32_t{data[i]} << 16 | (i + 1 < size ? std::uint32_t{data[i + 1]} << 8 : 0u) |
                               (i + 2 < size ? std::uint32_t{data[i + 2]} : 0u);
    out += letters[word >> 18 & 63];
    out += letters[word >> 12 & 63];
    out += i + 1 < size ? letters[word >> 6 & 63] : '=';
    out += i + 2 < size ? letters[word & 63] : '=';
  }
  return out;
}

std::string data_uri(const std::vector<std::uint8_t>& png) {
  return "data:image/png;base64," + base64(png.data(), png.size());
}

const char* mark_class(Mark mark) {
  switch (mark) {
    case Mark::none:
      return "";
    case Mark::good:
      return "good";
    case Mark::bad:
      return "bad";
    case Mark::open:
      return "open";
  }
  return "";
}

std::string panel_image(const PanelImage& image, const std::string& title, const std::string& alt) {
  return fmt::format(
      "<div class=panel><div class=title>{0}</div><img src=\"{1}\" data-step={2} data-title=\"{0}\" "
      "alt=\"{3}\"></div>\n",
      escaped(title), data_uri(indexed_png(image.index, image.palette)), image.step,
      escaped(alt.empty() ? title : title + ": " + alt));
}

std::string colour_bar(double low, double high, const std::string& unit, ColourScale scale) {
  const auto& table = scale_colours(scale);
  std::string stops, ticks;
  for (int i = 0; i <= 16; ++i) stops += (i ? "," : "") + hex_colour(table[i * (scale_steps - 1) / 16]);
  for (const double tick : round_ticks(low, high)) {
    ticks += fmt::format("<span style=\"left:{:.2f}%\">{:.6g}</span>", (tick - low) / (high - low) * 100,
                         std::abs(tick) < 1e-12 * (high - low) ? 0.0 : tick);
  }
  return fmt::format(
      "<div class=bar><div class=ramp><i style=\"background:linear-gradient(to right,{})\"></i>{}</div>"
      "<div class=unit>{}</div></div>\n",
      stops, ticks, escaped(unit));
}

const char* const wipe_tools =
    "<div class=\"tools live\"><button class=wipe type=button>lay over each other</button>"
    "<input type=range min=0 max=100 value=50 aria-label=\"where the second picture begins\"></div>\n";

}  // namespace

TableCell::TableCell(std::string given, Mark mark) : text(std::move(given)), mark(mark) {
  number = !text.empty() && text.size() <= 32 &&
           text.find_first_not_of("0123456789.eE+-<> %()\xe2\x80\x93\xc2\xa0") == std::string::npos &&
           text.find_first_not_of("0123456789.+-<> %") != 0;
}

TableCell::TableCell(double value, Mark mark) : text(significant(value)), mark(mark), number(true) {}

std::string significant(double value, int digits) {
  if (!std::isfinite(value)) return "-";
  if (value == 0) return "0";
  const double size = std::abs(value);
  if (size >= 1e6 || size < 1e-4) return fmt::format("{:.{}e}", value, digits - 1);
  const int decimals = std::max(0, digits - 1 - static_cast<int>(std::floor(std::log10(size))));
  return fmt::format("{:.{}f}", value, decimals);
}

std::string p_text(double p) {
  if (!std::isfinite(p)) return "-";
  if (p < 1e-12) return "< 1e-12";
  return p < 1e-3 ? fmt::format("{:.1e}", p) : fmt::format("{:.3f}", p);
}

std::string percent(double share, int digits) {
  return std::isfinite(share) ? significant(100 * share, digits) + " %" : "-";
}

struct Page::Impl {
  std::string title, subtitle, facts, verdict, body;
  std::vector<std::pair<std::string, std::vector<std::uint8_t>>> files;
  std::set<std::string> names;
  std::set<ColourScale> scales;
  int open_details = 0;

  void add_file(const std::string& name, std::vector<std::uint8_t> png) {
    if (name.empty() || name.find_first_of("/\\ \"<>") != std::string::npos) {
      throw Error("a figure's name must be a plain file name, not \"" + name + "\"");
    }
    if (!names.insert(name).second) throw Error("two figures of one page are called \"" + name + "\"");
    files.emplace_back(name + ".png", std::move(png));
  }
  std::string picture(const Picture& p) {
    add_file(p.name, p.png);
    return fmt::format("<figure><img src=\"{}\" width={} alt=\"{}\"><figcaption>{}</figcaption></figure>\n",
                       data_uri(p.png), p.width_px, escaped(p.alt), escaped(p.caption));
  }
};

Page::Page(const std::string& title, const std::string& subtitle) : impl_(std::make_unique<Impl>()) {
  impl_->title = title;
  impl_->subtitle = subtitle;
}

Page::~Page() = default;

void Page::fact(const std::string& name, const std::string& value) {
  impl_->facts += fmt::format("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(value));
}

void Page::verdict(Mark mark, const std::string& headline, const std::vector<std::string>& reasons) {
  std::string items;
  for (const auto& reason : reasons) items += "<li>" + escaped(reason) + "</li>\n";
  impl_->verdict += fmt::format("<div class=\"verdict {}\" role=status><strong>{}</strong>{}</div>\n", mark_class(mark),
                                escaped(headline), items.empty() ? "" : "<ul>" + items + "</ul>");
}

void Page::section(const std::string& title) { impl_->body += "<h2>" + escaped(title) + "</h2>\n"; }
void Page::subsection(const std::string& title) { impl_->body += "<h3>" + escaped(title) + "</h3>\n"; }
void Page::text(const std::string& paragraph) { impl_->body += "<p>" + escaped(paragraph) + "</p>\n"; }
void Page::note(const std::string& paragraph) { impl_->body += "<p class=note>" + escaped(paragraph) + "</p>\n"; }
void Page::code(const std::string& text) { impl_->body += "<div class=code>" + escaped(text) + "</div>\n"; }

void Page::list(const std::vector<std::string>& items) {
  impl_->body += "<ul>\n";
  for (const auto& item : items) impl_->body += "<li>" + escaped(item) + "</li>\n";
  impl_->body += "</ul>\n";
}

void Page::table(const Table& table) {
  std::string html = "<div class=scroll><table>";
  if (!table.caption.empty()) html += "<caption>" + escaped(table.caption) + "</caption>";
  std::vector<bool> numeric(table.columns.size(), !table.rows.empty());
  for (const auto& row : table.rows) {
    if (row.size() != table.columns.size()) {
      throw Error(fmt::format("a table with {} columns has a row of {} cells", table.columns.size(), row.size()));
    }
    for (std::size_t c = 0; c < row.size(); ++c) numeric[c] = numeric[c] && row[c].number;
  }
  html += "<thead><tr>";
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    html += fmt::format("<th scope=col{}>{}</th>", numeric[c] ? " class=num" : "", escaped(table.columns[c]));
  }
  html += "</tr></thead><tbody>\n";
  for (const auto& row : table.rows) {
    html += "<tr>";
    for (const TableCell& cell : row) {
      html += fmt::format("<td class=\"{}{}\">{}</td>", cell.number ? "num " : "", mark_class(cell.mark),
                          escaped(cell.text));
    }
    html += "</tr>\n";
  }
  impl_->body += html + "</tbody></table></div>\n";
}

void Page::figure(const Picture& picture) { impl_->body += impl_->picture(picture); }

void Page::figures(const std::vector<Picture>& pictures) {
  impl_->body += "<div class=grid>\n";
  for (const auto& picture : pictures) impl_->body += impl_->picture(picture);
  impl_->body += "</div>\n";
}

void Page::figure(const MapFigure& given) {
  MapFigure map = given;
  choose_scale(map);
  impl_->add_file(map.name, rgb_png(compose(map)));
  impl_->scales.insert(map.colours);
  std::string html = fmt::format(
      "<figure class=map data-low={} data-high={} data-scale={} data-unit=\"{}\" data-u={} data-v={}><div "
      "class=panels>\n",
      map.low, map.high, scale_name(map.colours), escaped(map.unit), map.origin.x, map.origin.y);
  int step = 1;
  for (const MapPanel& panel : map.panels) {
    const PanelImage image = colour_panel(panel, map.low, map.high, map.colours);
    step = std::max(step, image.step);
    html += panel_image(image, panel.title, map.alt);
  }
  html += "</div>\n" + colour_bar(map.low, map.high, map.unit, map.colours);
  html += "<div class=\"readout live\">Point at a map to read its values.</div>\n";
  if (map.panels.size() == 2 && map.panels[0].values.size() == map.panels[1].values.size()) html += wipe_tools;
  const std::string thinned = step > 1 ? fmt::format(" One pixel in {} is shown, in each direction.", step) : "";
  impl_->body += html + "<figcaption>" + escaped(map.caption + thinned) + "</figcaption></figure>\n";
}

void Page::figure(const CategoryFigure& map) {
  impl_->add_file(map.name, rgb_png(compose(map)));
  nlohmann::json labels = nlohmann::json::object();
  std::string legend, html;
  std::vector<bool> present(256);
  for (const CategoryPanel& panel : map.panels) {
    html += panel_image(colour_panel(panel, map.categories), panel.title, map.alt);
    for (int r = 0; r < panel.labels.rows; ++r) {
      for (int c = 0; c < panel.labels.cols; ++c) present[panel.labels.at<std::uint8_t>(r, c)] = true;
    }
  }
  for (std::size_t i = 0; i < map.categories.size(); ++i) {
    const Category& kind = map.categories[i];
    labels[std::to_string(kind.colour[0] * 65536 + kind.colour[1] * 256 + kind.colour[2])] = kind.label;
    if (present[i]) {
      legend +=
          fmt::format("<span><i style=\"background:{}\"></i>{}</span>", hex_colour(kind.colour), escaped(kind.label));
    }
  }
  html = fmt::format("<figure class=map data-labels=\"{}\" data-u={} data-v={}><div class=panels>\n",
                     escaped(labels.dump()), map.origin.x, map.origin.y) +
         html + "</div>\n<div class=legend>" + legend + "</div>\n";
  html += "<div class=\"readout live\">Point at a map to read its values.</div>\n";
  if (map.panels.size() == 2 && map.panels[0].labels.size() == map.panels[1].labels.size()) html += wipe_tools;
  impl_->body += html + "<figcaption>" + escaped(map.caption) + "</figcaption></figure>\n";
}

void Page::figure(const CloudFigure& clouds) {
  const auto packed = pack(clouds);
  const auto still = rgb_png(compose(clouds));
  impl_->add_file(clouds.name, still);
  impl_->scales.insert(clouds.colours);
  std::string html = fmt::format("<figure class=clouds data-scale={} data-yaw={} data-pitch={}>\n",
                                 scale_name(clouds.colours), clouds.yaw_rad, clouds.pitch_rad);
  html += fmt::format("<noscript><img class=still src=\"{}\" alt=\"{}\"></noscript>\n<div class=\"panels live\">\n",
                      data_uri(still), escaped(clouds.alt));
  for (std::size_t i = 0; i < packed.size(); ++i) {
    // Int16Array reads the bytes in the reader's own order: little-endian on everything that shows web pages.
    html += fmt::format(
        "<div class=panel><div class=title>{0}</div><canvas class=cloud role=img aria-label=\"{0}: {1}\" "
        "data-xyz=\"{2}\" "
        "data-colour=\"{3}\"></canvas></div>\n",
        escaped(clouds.panels[i].title), escaped(clouds.alt),
        base64(reinterpret_cast<const std::uint8_t*>(packed[i].xyz.data()), packed[i].xyz.size() * 2),
        base64(packed[i].colour.data(), packed[i].colour.size()));
  }
  html += "</div>\n" + colour_bar(clouds.low, clouds.high, clouds.unit, clouds.colours);
  html +=
      "<div class=\"tools live\"><span>Drag to turn.</span><button type=button data-zoom=1.3>closer</button>"
      "<button type=button data-zoom=0.77>farther</button><button type=button data-zoom=0>first view</button></div>\n";
  impl_->body += html + "<figcaption>" + escaped(clouds.caption) + "</figcaption></figure>\n";
}

void Page::begin_details(const std::string& title) {
  impl_->body += "<details><summary>" + escaped(title) + "</summary>\n";
  ++impl_->open_details;
}

void Page::end_details() {
  if (impl_->open_details == 0) throw Error("a page ends details that it never began");
  impl_->body += "</details>\n";
  --impl_->open_details;
}

std::string Page::write(const std::string& folder, const std::string& file) const {
  if (impl_->open_details) throw Error("a page leaves details open");
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) throw Error("the report's folder " + folder + " cannot be made: " + failed.message());
  nlohmann::json scales = nlohmann::json::object();
  for (const ColourScale scale : impl_->scales) {
    for (const Rgb& colour : scale_colours(scale)) scales[scale_name(scale)].push_back(hex_colour(colour).substr(1));
  }
  std::string html = fmt::format(
      "<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8><meta name=viewport content=\"width=device-width, "
      "initial-scale=1\">\n<title>{0}</title>\n<style>{1}</style></head>\n<body><main>\n<header><div "
      "class=brand>binrig "
      "report</div><h1>{0}</h1><p class=subtitle>{2}</p>\n",
      escaped(impl_->title), page_style, escaped(impl_->subtitle));
  if (!impl_->facts.empty()) html += "<dl class=facts>\n" + impl_->facts + "</dl>\n";
  html += "</header>\n" + impl_->verdict + impl_->body;
  html += "<footer>Made by binrig. The pictures are PNG files beside this page.</footer>\n";
  html += "</main>\n<script>var binrigScales=" + scales.dump() + ";\n" + page_script + "</script></body></html>\n";
  const std::filesystem::path out(folder);
  for (const auto& [name, png] : impl_->files) write_file_atomically((out / name).string(), png.data(), png.size());
  write_file_atomically((out / file).string(), html);
  return (out / file).string();
}

}  // namespace binrig
