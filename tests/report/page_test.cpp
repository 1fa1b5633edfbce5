#include "report/page.h"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "core/frame.h"
#include "report/png.h"

namespace binrig {
namespace {

using testing::HasSubstr;
using testing::Not;

class Report : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "binrig-report-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  void TearDown() override {
    // BINRIG_KEEP_REPORTS=1 leaves the sample page for a look in a browser.
    if (!std::getenv("BINRIG_KEEP_REPORTS")) std::filesystem::remove_all(folder_);
  }
  std::string read(const std::string& name) {
    std::ifstream in(folder_ + "/" + name);
    return std::string(std::istreambuf_iterator<char>(in), {});
  }
  std::string folder_;
};

cv::Mat waves(int rows, int cols, float phase) {
  cv::Mat image(rows, cols, CV_32F);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) image.at<float>(r, c) = std::sin(0.05f * r + phase) * std::cos(0.08f * c);
  }
  return image;
}

Plot sample_plot(const std::string& name) {
  Plot plot;
  plot.name = name;
  plot.alt = "two curves that fall with frequency";
  plot.caption = "Power against frequency. The band holds 95 % of what chance allows.";
  plot.x_label = "frequency (cycles/px)";
  plot.y_label = "power density (mm^2 px^2)";
  plot.log_y = true;
  Curve a{"measured", {}, {}, Ink::measured, Stroke::line}, b{"simulated", {}, {}, Ink::simulated, Stroke::dashed};
  Band band{"95 % band", {}, {}, {}, Ink::simulated};
  for (int i = 1; i <= 64; ++i) {
    const double f = i / 128.0, s = 0.01 + std::exp(-20 * f * f);
    a.x.push_back(f);
    a.y.push_back(s);
    b.x.push_back(f);
    b.y.push_back(1.1 * s);
    band.x.push_back(f);
    band.low.push_back(0.8 * s);
    band.high.push_back(1.3 * s);
  }
  plot.curves = {a, b};
  plot.bands = {band};
  plot.rules = {{0.3, "half power", true}};
  return plot;
}

TEST_F(Report, OnePageHoldsEverythingAndNeedsNoNetwork) {
  Page page("A sample <page>", "every kind of content, with \"quotes\" & ampersands");
  page.fact("sensor", "none");
  page.fact("command",
            "binrig compare --measured recordings/real/d415-table --model models/thesis-five.yaml --out out");
  page.verdict(Mark::bad, "The simulation differs from the measurement in 1 of 3 aspects.",
               {"Its noise is 12 % too small (p < 1e-12).", "Spectrum and holes agree."});
  page.section("Tables");
  Table table;
  table.columns = {"aspect", "measured", "simulated", "p-value", "outcome"};
  table.caption = "What agrees and what does not.";
  table.rows = {{"noise (mm)", 0.213, 0.187, p_text(1e-20), TableCell("differs", Mark::bad)},
                {"correlation length (px)", 3.1, 3.0, p_text(0.4), TableCell("agrees", Mark::good)},
                {"temporal noise", "-", "-", "-", TableCell("not asked", Mark::open)}};
  page.table(table);
  page.note("A remark.");
  page.section("Pictures");
  page.figures({draw(sample_plot("spectrum")), draw(sample_plot("spectrum_again"))});
  MapFigure map{"residuals", "waves", "Residuals at one scale.", "mm", {}, 0, 0, ColourScale::diverging, {10, 20}};
  cv::Mat holes(120, 160, CV_8U, cv::Scalar(255));
  holes(cv::Rect(20, 20, 30, 10)).setTo(0);
  map.panels = {{"measured", waves(120, 160, 0), holes}, {"simulated", waves(120, 160, 1), {}}};
  page.figure(map);
  CategoryFigure reasons{"reasons", "stripes", "Every reason.", {}, reason_categories(), {}};
  cv::Mat labels(52, 130, CV_8U);
  for (int r = 0; r < labels.rows; ++r) labels.row(r).setTo(r / 4);
  reasons.panels = {{"all", labels}};
  page.figure(reasons);
  CloudFigure clouds{"clouds", "two wavy sheets", "Drag them.", "mm", {}, -1, 1};
  for (int i = 0; i < 2; ++i) {
    CloudPanel panel{i ? "simulated" : "measured", {}, {}};
    const cv::Mat z = waves(100, 150, static_cast<float>(i));
    for (int r = 0; r < 100; ++r) {
      for (int c = 0; c < 150; ++c) {
        panel.points.emplace_back(c, r, 10 * z.at<float>(r, c));
        panel.values.push_back(z.at<float>(r, c));
      }
    }
    clouds.panels.push_back(panel);
  }
  page.figure(clouds);
  page.begin_details("More");
  page.list({"one", "two"});
  page.code("rms = sqrt(mean(e^2))");
  page.end_details();
  EXPECT_EQ(page.write(folder_ + "/new/folder"), folder_ + "/new/folder/report.html");

  const std::string html = read("new/folder/report.html");
  EXPECT_THAT(html, Not(HasSubstr("http://")));
  EXPECT_THAT(html, Not(HasSubstr("https://")));
  EXPECT_THAT(html, Not(HasSubstr("src=\"/")));
  EXPECT_THAT(html, HasSubstr("A sample &lt;page&gt;"));
  EXPECT_THAT(html, HasSubstr("&quot;quotes&quot; &amp; ampersands"));
  for (std::size_t at = html.find("<img "); at != std::string::npos; at = html.find("<img ", at + 1)) {
    const std::string tag = html.substr(at, html.find('>', at) - at);
    EXPECT_THAT(tag, HasSubstr(" alt=\"")) << tag.substr(0, 40);
    EXPECT_THAT(tag, HasSubstr("src=\"data:image/png;base64,")) << tag.substr(0, 40);
  }
  for (const char* name : {"spectrum", "spectrum_again", "residuals", "reasons", "clouds"}) {
    const cv::Mat png = cv::imread(folder_ + "/new/folder/" + name + ".png");
    EXPECT_GT(png.cols, 150) << name;
  }
}

TEST_F(Report, MisuseIsAnError) {
  Page page("t", "s");
  Table table{{"a", "b"}, {{"only one"}}, ""};
  EXPECT_THROW(page.table(table), Error);
  const Picture picture = draw(sample_plot("twice"));
  page.figure(picture);
  EXPECT_THROW(page.figure(picture), Error);
  Picture elsewhere = picture;
  elsewhere.name = "../escape";
  EXPECT_THROW(page.figure(elsewhere), Error);
  EXPECT_THROW(page.end_details(), Error);
}

TEST_F(Report, AFolderThatCannotBeMadeIsNamed) {
  std::ofstream(folder_ + "/file") << "x";
  Page page("t", "s");
  try {
    page.write(folder_ + "/file/below");
    FAIL() << "no error";
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr(folder_ + "/file/below"));
  }
}

TEST(Colours, EveryScaleCanBeReadBack) {
  for (const ColourScale scale : {ColourScale::sequential, ColourScale::diverging, ColourScale::grey}) {
    const auto& table = scale_colours(scale);
    const std::set<Rgb> different(table.begin(), table.end());
    EXPECT_EQ(different.size(), 255u) << scale_name(scale);
    EXPECT_FALSE(different.contains(absent_colour)) << scale_name(scale);
  }
}

TEST(Colours, EveryReasonHasItsOwnColour) {
  std::set<Rgb> different;
  for (const Category& c : reason_categories()) different.insert(c.colour);
  EXPECT_EQ(different.size(), static_cast<std::size_t>(reason_count));
}

TEST(Map, PixelsFallOnTheirPlaceInTheScale) {
  cv::Mat values = (cv::Mat_<float>(1, 5) << -5.f, -1.f, 0.5f, 1.f, 9.f);
  cv::Mat valid = (cv::Mat_<std::uint8_t>(1, 5) << 1, 1, 1, 0, 1);
  const PanelImage image = colour_panel({"", values, valid}, -1, 1, ColourScale::grey);
  const auto grey = [&](int c) { return image.rgb().at<cv::Vec3b>(0, c)[0]; };
  EXPECT_EQ(grey(0), 0);
  EXPECT_EQ(grey(1), 0);
  EXPECT_EQ(grey(2), 191);  // (0.5 + 1) / 2 * 254 = 190.5
  EXPECT_EQ(image.rgb().at<cv::Vec3b>(0, 3), cv::Vec3b(absent_colour[0], absent_colour[1], absent_colour[2]));
  EXPECT_EQ(grey(4), 254);
}

TEST(Map, BothPanelsShareOneScaleWhateverTheyHold) {
  MapFigure figure{"m", "", "", "mm", {}, 0, 0, ColourScale::diverging, {}};
  figure.panels = {{"a", cv::Mat(50, 50, CV_32F, cv::Scalar(0.1)), {}}, {"b", waves(50, 50, 0) * 3, {}}};
  choose_scale(figure);
  EXPECT_DOUBLE_EQ(figure.low, -figure.high);
  EXPECT_GT(figure.high, 2);
  MapFigure flat{"m", "", "", "mm", {}, 0, 0, ColourScale::sequential, {}};
  flat.panels = {{"a", cv::Mat(5, 5, CV_32F, cv::Scalar(7)), {}}};
  choose_scale(flat);
  EXPECT_LT(flat.low, flat.high);
}

TEST(Map, LargeImagesAreThinnedOutNotAveraged) {
  cv::Mat checks(1000, 1500, CV_32F);
  for (int r = 0; r < checks.rows; ++r) {
    for (int c = 0; c < checks.cols; ++c) checks.at<float>(r, c) = (r + c) % 2 ? 1.f : -1.f;
  }
  const PanelImage image = colour_panel({"", checks, {}}, -1, 1, ColourScale::grey);
  EXPECT_EQ(image.step, 3);
  EXPECT_EQ(image.index.cols, 500);
  for (int c = 0; c < image.index.cols; ++c) {
    const int g = image.rgb().at<cv::Vec3b>(5, c)[0];
    EXPECT_TRUE(g == 0 || g == 254);
  }
}

TEST(Map, TicksAreRoundAndInside) {
  for (const auto& [low, high] : {std::pair{0.0, 1.0}, {-0.37, 0.37}, {812.2, 815.9}, {-1e-4, 3e-4}}) {
    const auto ticks = round_ticks(low, high);
    EXPECT_GE(ticks.size(), 3u);
    EXPECT_LE(ticks.size(), 9u);
    for (const double t : ticks) {
      EXPECT_GE(t, low - 1e-9 * (high - low));
      EXPECT_LE(t, high + 1e-9 * (high - low));
    }
  }
}

TEST(Png, IndexedPicturesComeBackAsTheyWere) {
  cv::Mat index(37, 53, CV_8U);
  for (int i = 0; i < index.rows * index.cols; ++i) index.at<std::uint8_t>(i / 53, i % 53) = (i * 7919) % 251;
  std::vector<Rgb> palette;
  for (int i = 0; i < 251; ++i) palette.push_back({std::uint8_t(i), std::uint8_t(255 - i), std::uint8_t(3 * i)});
  const cv::Mat back = cv::imdecode(indexed_png(index, palette), cv::IMREAD_COLOR);
  ASSERT_EQ(back.size(), index.size());
  for (int r = 0; r < index.rows; ++r) {
    for (int c = 0; c < index.cols; ++c) {
      const Rgb& want = palette[index.at<std::uint8_t>(r, c)];
      ASSERT_EQ(back.at<cv::Vec3b>(r, c), cv::Vec3b(want[2], want[1], want[0]));
    }
  }
  palette.resize(250);
  EXPECT_THROW(indexed_png(index, palette), Error);
  EXPECT_THROW(indexed_png(cv::Mat(), palette), Error);
}

TEST(Plot, HistogramsOfDifferentSizesCompare) {
  const Curve few = histogram_curve("few", {0, 0.5, 2}, {3, 1}, Ink::measured);
  // Densities 3/4 / 0.5 and 1/4 / 1.5: they integrate to one.
  EXPECT_DOUBLE_EQ(few.y[0] * 0.5 + few.y[1] * 1.5, 1.0);
  EXPECT_THROW(histogram_curve("bad", {0, 1}, {1, 2}, Ink::measured), Error);
}

TEST(Plot, WhatCannotBeDrawnIsAnError) {
  Plot plot = sample_plot("p");
  plot.curves[0].y.pop_back();
  EXPECT_THROW(draw(plot), Error);
  Plot nothing;
  nothing.name = "nothing";
  nothing.log_y = true;
  nothing.curves = {{"negative", {1, 2}, {-1, -2}}};
  EXPECT_THROW(draw(nothing), Error);
}

TEST(Plot, OddLabelsAreOnlyText) {
  Plot plot = sample_plot("p");
  plot.title = "100 % of \"quotes\", back\\slashes, $dollars and `ls` {braces}";
  EXPECT_FALSE(draw(plot).png.empty());
}

TEST(Plot, AMissingGnuplotIsSaidClearly) {
  const std::string path = std::getenv("PATH");
  setenv("PATH", "/nowhere", 1);
  std::string message;
  try {
    draw(sample_plot("p"));
  } catch (const Error& e) {
    message = e.what();
  }
  setenv("PATH", path.c_str(), 1);
  EXPECT_THAT(message, HasSubstr("apt-get install gnuplot-nox"));
}

TEST(Cloud, IsThinnedOutAndPutIntoOneBox) {
  CloudFigure figure{"c", "", "", "mm", {}, -1, 1};
  CloudPanel a{"a", {}, {}}, b{"b", {{-10, 0, 5}, {10, 0, 5}}, {-3, 3}};
  for (int i = 0; i < 100000; ++i) {
    a.points.emplace_back(static_cast<float>(i % 10), 0.f, 5.f);
    a.values.push_back(0);
  }
  figure.panels = {a, b};
  const auto packed = pack(figure);
  EXPECT_LE(packed[0].colour.size(), 40000u);
  EXPECT_EQ(packed[1].xyz[0], -32000);
  EXPECT_EQ(packed[1].xyz[3], 32000);
  EXPECT_EQ(packed[1].colour[0], 0);
  EXPECT_EQ(packed[1].colour[1], 254);
  figure.panels[1].values.pop_back();
  EXPECT_THROW(pack(figure), Error);
}

TEST(Numbers, AreWrittenWithTheirDigits) {
  EXPECT_EQ(significant(0.012345), "0.0123");
  EXPECT_EQ(significant(1240.4), "1240");
  EXPECT_EQ(significant(-3.14159, 4), "-3.142");
  EXPECT_EQ(significant(0), "0");
  EXPECT_EQ(significant(NAN), "-");
  EXPECT_EQ(significant(1.5e-7), "1.50e-07");
  EXPECT_EQ(p_text(0.0312), "0.031");
  EXPECT_EQ(p_text(0), "< 1e-12");
  EXPECT_EQ(percent(0.1234), "12.3 %");
}

}  // namespace
}  // namespace binrig
