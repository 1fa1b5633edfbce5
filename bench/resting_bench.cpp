// On which side do single parts come to rest? Dropped steel dice beside measured ones, and the wrench beside what
// geometry alone would say: the test of bounce and damping, to which a pile as a whole is blind.
//
//   resting_bench [--drops 1000]
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <vector>

#include <CLI/CLI.hpp>

#include "sim/convex_pieces.h"
#include "sim/mass_properties.h"
#include "sim/part_models.h"
#include "sim/stacking.h"

namespace {
using namespace binrig;

Body body_of(const Mesh& mesh) {
  Body body;
  body.name = "part";
  body.pieces = cached_convex_pieces(mesh).pieces;
  body.mass = mass_properties(mesh, 7850);
  return body;
}

struct Shares {
  int flat = 0, edge = 0, other = 0, left = 0;
  double of(int count) const { return count / double(flat + edge + other); }
};

// Flat: the axis z of the part is vertical; edge: it is level.
void count(double vertical, Shares& shares) {
  ++(vertical > 0.98 ? shares.flat : vertical < 0.05 ? shares.edge : shares.other);
}

Shares dropped(const Body& body, const BinBox& bin, const DropLayout& layout, const StackingSettings& settings,
               int drops) {
  Shares shares;
  for (int seed = 0; seed < drops; ++seed) {
    Stacking stacking({body}, bin, settings, RandomStream(static_cast<std::uint64_t>(seed)));
    stacking.drop({0}, layout);
    if (stacking.parts().empty()) {
      ++shares.left;
    } else {
      count(std::abs(stacking.parts().front().X_BO.linear()(2, 2)), shares);
    }
  }
  return shares;
}

// Set down in a random orientation and let roll without any speed: the height of the centre falls along the steepest
// way to the nearest resting side (Goldberg et al., Part pose statistics, IEEE Trans. Robotics and Automation 15(5),
// 1999, call it the quasi-static estimate).
Shares rolled_slowly(const Mesh& mesh, int drops) {
  const Vector3 centre = mass_properties(mesh, 7850).centre_mm;
  const RandomStream draws(1);
  Shares shares;
  std::uint64_t index = 0;
  for (int i = 0; i < drops; ++i) {
    const double z = 2 * draws.uniform(index) - 1, a = 2 * std::numbers::pi * draws.uniform(index + 1);
    index += 2;
    Vector3 down(std::sqrt(1 - z * z) * std::cos(a), std::sqrt(1 - z * z) * std::sin(a), z);
    for (double step = 0.01; step > 1e-5; step *= 0.995) {
      Vector3 lowest = Vector3::Zero();
      double reach = -1e30;
      for (const auto& v : mesh.vertices) {
        const Vector3 p = v.cast<double>() - centre;
        if (p.dot(down) > reach) {
          reach = p.dot(down);
          lowest = p;
        }
      }
      const Vector3 uphill = lowest - down * reach;
      if (uphill.norm() > 1e-9) down = (down - step * uphill.normalized()).normalized();
    }
    count(std::abs(down.z()), shares);
  }
  return shares;
}

void dice(int drops) {
  // Square prisms cut from a steel bar, thrown on a table: Mathematical Gazette, note 97.16 (March 2013), table 1.
  struct Measured {
    double ratio, square;
    int throws;
  };
  constexpr Measured table[] = {{0.47, 0.916, 332}, {0.63, 0.738, 840}, {0.75, 0.548, 799},  {0.81, 0.496, 740},
                                {0.93, 0.399, 516}, {0.97, 0.385, 530}, {1.16, 0.148, 1011}, {1.44, 0.052, 654}};
  BinBox table_top;
  table_top.inner_size_mm = Vector3(2000, 2000, 40);
  table_top.restitution = 0.5;
  DropLayout layout;
  layout.height_mm = 300;
  layout.jolt_gravities = 0;
  StackingSettings thrown;
  thrown.most_linear_mm_s = 1900;
  thrown.most_angular_rad_s = 200;
  std::puts("| height / side | measured: on a square | simulated, thrown | simulated, as into a bin | without speed |");
  std::puts("|---|---|---|---|---|");
  for (const Measured& m : table) {
    const auto mesh = box_mesh(Eigen::Vector3d(20, 20, 20 * m.ratio), Surface{});
    Body body = body_of(*mesh);
    const Shares poured = dropped(body, BinBox{}, DropLayout{}, {}, drops), slow = rolled_slowly(*mesh, drops);
    body.restitution = 0.5;
    const Shares free = dropped(body, table_top, layout, thrown, drops);
    std::printf("| %.2f | %.3f +- %.3f | %.3f | %.3f | %.3f |\n", m.ratio, m.square,
                std::sqrt(m.square * (1 - m.square) / m.throws), free.of(free.flat), poured.of(poured.flat),
                slow.of(slow.flat));
    std::fflush(stdout);
  }
}

void wrench(int drops) {
  const auto mesh = part_model("wrench").mesh;
  const Body body = body_of(*mesh);
  const Shares slow = rolled_slowly(*mesh, drops), poured = dropped(body, BinBox{}, DropLayout{}, {}, drops);
  DropLayout still;
  still.jolt_gravities = 0;
  const Shares quiet = dropped(body, BinBox{}, still, {}, drops);
  std::printf("wrench on its narrow edge: %.3f (bin jolted), %.3f (not jolted), %.3f without speed; leaning %.3f\n",
              poured.of(poured.edge), quiet.of(quiet.edge), slow.of(slow.edge), poured.of(poured.other));
}
}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"On which side single parts come to rest"};
  int drops = 1000;
  app.add_option("--drops", drops, "of each part")->check(CLI::Range(1, 100000));
  CLI11_PARSE(app, argc, argv);
  wrench(drops);
  dice(drops);
  return 0;
}
