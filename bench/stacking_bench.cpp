// Piles of every part over many seeds: how long they take to come to rest, and how well they lie. One thread.
//
//   stacking_bench [--parts cylinder,wrench,mix] [--counts 9,18,50] [--seeds 100] [--results FILE]
//
// Counts above 18 fall into a bin that grows with them in all three directions, so that the pile fits.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <tuple>
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

// What one pile gave; kept as a line of text, so that a long measurement can be stopped and taken up again.
struct Pile {
  double simulated_s = 0, cpu_s = 0, wall_s = 0, settle_mm = 0, rest_mm = 0, hover_mm = 0;
  int hovering = 0, left = 0, locked = 0, unsteady = 0;
};
using Piles = std::map<std::tuple<int, std::string, int>, Pile>;  // by count, part and seed

Pile measured(const std::string& name, int count, int seed) {
  std::vector<Body> bodies;
  for (const std::string& part : name == "mix" ? part_names() : std::vector<std::string>{name}) {
    bodies.push_back(body_of(part));
  }
  std::vector<int> kinds;
  for (int i = 0; i < count; ++i) kinds.push_back(i % static_cast<int>(bodies.size()));
  BinBox bin;
  if (count > 18) bin.inner_size_mm *= std::cbrt(count / 18.0);
  Stacking stacking(bodies, bin, {}, RandomStream(static_cast<std::uint64_t>(seed)));
  const SettleReport report = stacking.drop(kinds, DropLayout{});
  const PileQuality quality = pile_quality(stacking);
  return {report.simulated_s,          report.cpu_s,          report.wall_s,    report.most_penetration_mm,
          quality.most_penetration_mm, quality.most_hover_mm, quality.hovering, report.left_bin,
          quality.interlocked,         report.steady ? 0 : 1};
}

Piles read_piles(const std::string& path) {
  Piles piles;
  std::ifstream in(path);
  int count = 0, seed = 0;
  std::string name;
  Pile p;
  while (in >> count >> name >> seed >> p.simulated_s >> p.cpu_s >> p.wall_s >> p.settle_mm >> p.rest_mm >>
         p.hover_mm >> p.hovering >> p.left >> p.locked >> p.unsteady) {
    piles[{count, name, seed}] = p;
  }
  return piles;
}

void print_table(const Piles& piles) {
  std::puts(
      "| part | n | seeds | simulated s: mean / 95 % | CPU s: mean / 95 % / max | wall s | settle mm | rest mm "
      "| hover mm | hovering | left | locked | unsteady |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
  for (auto it = piles.begin(); it != piles.end();) {
    const auto [count, name, first] = it->first;
    std::vector<double> simulated, cpu, wall;
    Pile sum;
    for (; it != piles.end() && std::get<0>(it->first) == count && std::get<1>(it->first) == name; ++it) {
      const Pile& p = it->second;
      simulated.push_back(p.simulated_s);
      cpu.push_back(p.cpu_s);
      wall.push_back(p.wall_s);
      sum.settle_mm = std::max(sum.settle_mm, p.settle_mm);
      sum.rest_mm = std::max(sum.rest_mm, p.rest_mm);
      sum.hover_mm = std::max(sum.hover_mm, p.hover_mm);
      sum.hovering += p.hovering;
      sum.left += p.left;
      sum.locked += p.locked;
      sum.unsteady += p.unsteady;
    }
    std::printf(
        "| %s | %d | %zu | %.2f / %.2f | %.2f / %.2f / %.2f | %.2f | %.3f | %.3f | %.3f | %d | %d | %d | %d |\n",
        name.c_str(), count, cpu.size(), mean(simulated), quantile(simulated, 0.95), mean(cpu), quantile(cpu, 0.95),
        quantile(cpu, 1), mean(wall), sum.settle_mm, sum.rest_mm, sum.hover_mm, sum.hovering, sum.left, sum.locked,
        sum.unsteady);
  }
}
}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Time to rest and quality of random piles"};
  std::vector<std::string> parts = part_names();
  parts.push_back("mix");
  std::vector<int> counts{9, 18, 50};
  int seeds = 100;
  std::string results;
  app.add_option("--parts", parts, "kinds of part, or mix")->delimiter(',')->check(CLI::IsMember(parts));
  app.add_option("--counts", counts, "parts a pile")->delimiter(',')->check(CLI::Range(1, 1000));
  app.add_option("--seeds", seeds, "piles of each; 0: only print what FILE holds")->check(CLI::Range(0, 100000));
  app.add_option("--results", results, "a file to which every pile is added, and whose piles are not measured again");
  CLI11_PARSE(app, argc, argv);
  // Seeds outside, so that a measurement that is stopped has as many of each part.
  Piles piles = read_piles(results);
  for (int seed = 0; seed < seeds; ++seed) {
    for (int count : counts) {
      for (const std::string& part : parts) {
        if (piles.count({count, part, seed}) != 0) continue;
        const Pile p = measured(part, count, seed);
        piles[{count, part, seed}] = p;
        if (results.empty()) continue;
        std::ofstream(results, std::ios::app)
            << count << ' ' << part << ' ' << seed << ' ' << p.simulated_s << ' ' << p.cpu_s << ' ' << p.wall_s << ' '
            << p.settle_mm << ' ' << p.rest_mm << ' ' << p.hover_mm << ' ' << p.hovering << ' ' << p.left << ' '
            << p.locked << ' ' << p.unsteady << '\n';
      }
    }
  }
  print_table(piles);
  return 0;
}
