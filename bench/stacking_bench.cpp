// Piles of every part over many seeds: how long they take to come to rest, and how well they lie. One thread.
//
//   stacking_bench [--parts cylinder,wrench,mix] [--counts 9,18,50] [--seeds 100]
//
// Counts above 18 fall into a bin that grows with them in all three directions, so that the pile fits.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "sim/part_models.h"
#include "sim/pile_quality.h"
#include "sim/stacking.h"

namespace {
using namespace binrig;

Body body_of(const std::string& name) {
  const PartModel part = part_model(name);
  Body body;
  body.name = name;
  body.pieces = cached_convex_pieces(*part.mesh).pieces;
  body.mass = mass_properties(*part.mesh, 7850);
  return body;
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(std::ceil(q * static_cast<double>(values.size()))) - 1];
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

void run(const std::string& name, int count, int seeds) {
  std::vector<Body> bodies;
  for (const std::string& part : name == "mix" ? part_names() : std::vector<std::string>{name}) {
    bodies.push_back(body_of(part));
  }
  std::vector<int> kinds;
  for (int i = 0; i < count; ++i) kinds.push_back(i % static_cast<int>(bodies.size()));
  BinBox bin;
  if (count > 18) bin.inner_size_mm *= std::cbrt(count / 18.0);
  std::vector<double> simulated, cpu, wall;
  double settle_mm = 0, rest_mm = 0, hover_mm = 0;
  int left = 0, locked = 0, hovering = 0, unsteady = 0;
  for (int seed = 0; seed < seeds; ++seed) {
    Stacking stacking(bodies, bin, {}, RandomStream(static_cast<std::uint64_t>(seed)));
    const SettleReport report = stacking.drop(kinds, Layout{});
    const PileQuality quality = pile_quality(stacking);
    simulated.push_back(report.simulated_s);
    cpu.push_back(report.cpu_s);
    wall.push_back(report.wall_s);
    settle_mm = std::max(settle_mm, report.most_penetration_mm);
    rest_mm = std::max(rest_mm, quality.most_penetration_mm);
    hover_mm = std::max(hover_mm, quality.most_hover_mm);
    hovering += quality.hovering;
    locked += quality.interlocked;
    left += report.left_bin;
    unsteady += !report.steady;
  }
  std::printf("| %s | %d | %d | %.2f / %.2f | %.2f / %.2f / %.2f | %.2f | %.3f | %.3f | %.3f | %d | %d | %d | %d |\n",
              name.c_str(), count, seeds, mean(simulated), quantile(simulated, 0.95), mean(cpu), quantile(cpu, 0.95),
              quantile(cpu, 1), mean(wall), settle_mm, rest_mm, hover_mm, hovering, left, locked, unsteady);
  std::fflush(stdout);
}
}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Time to rest and quality of random piles"};
  std::vector<std::string> parts = part_names();
  parts.push_back("mix");
  std::vector<int> counts{9, 18, 50};
  int seeds = 100;
  app.add_option("--parts", parts, "kinds of part, or mix")->delimiter(',')->check(CLI::IsMember(parts));
  app.add_option("--counts", counts, "parts a pile")->delimiter(',')->check(CLI::Range(1, 1000));
  app.add_option("--seeds", seeds, "piles of each")->check(CLI::Range(1, 100000));
  CLI11_PARSE(app, argc, argv);
  std::puts(
      "| part | n | seeds | simulated s: mean / 95 % | CPU s: mean / 95 % / max | wall s | settle mm | rest mm | hover "
      "mm "
      "| hovering | left | locked | unsteady |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
  for (int count : counts) {
    for (const std::string& part : parts) run(part, count, seeds);
  }
  return 0;
}
