#include "compare/probability.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/error.h"

namespace binrig {
namespace {

// Tabulated values (Abramowitz and Stegun, tables 26.1, 26.8, 26.10), five digits.
TEST(Probability, AgreesWithTables) {
  EXPECT_NEAR(normal_cdf(1.0), 0.84134, 1e-5);
  EXPECT_NEAR(normal_quantile(0.975), 1.95996, 1e-5);
  EXPECT_NEAR(chi_square_threshold(0.05, 10), 18.3070, 1e-4);
  EXPECT_NEAR(chi_square_threshold(0.995, 30), 13.7867, 1e-4);
  EXPECT_NEAR(student_threshold(0.05, 5), 2.5706, 1e-4);
  EXPECT_NEAR(student_threshold(0.01, 120), 2.6174, 1e-4);
  EXPECT_THROW(normal_quantile(0), Error);
}

TEST(Probability, QuantilesInvertTheirFunctions) {
  for (const double p : {1e-9, 1e-3, 0.05, 0.5, 0.9, 0.999}) {
    EXPECT_NEAR(normal_cdf(normal_quantile(p)) / p, 1, 1e-8) << p;
    for (const double dof : {1.0, 7.0, 39.0, 400.0}) {
      EXPECT_NEAR(chi_square_upper(chi_square_threshold(p, dof), dof) / p, 1, 1e-8) << p << " " << dof;
      EXPECT_NEAR(student_two_sided(student_threshold(p, dof), dof) / p, 1, 1e-8) << p << " " << dof;
    }
  }
}

TEST(Probability, ManyDegreesOfFreedomBecomeNormal) {
  EXPECT_NEAR(student_two_sided(1.95996, 1e7), 0.05, 1e-6);
  // A chi-square of n degrees of freedom has mean n and variance 2n.
  EXPECT_NEAR(chi_square_upper(1e5, 1e5), 0.5, 0.002);
}

TEST(Holm, IsStepDownAndKeepsTheOrder) {
  const auto p = holm({0.01, 0.04, 0.03, 0.5});
  EXPECT_DOUBLE_EQ(p[0], 0.04);  // 4 * 0.01
  EXPECT_DOUBLE_EQ(p[2], 0.09);  // 3 * 0.03
  EXPECT_DOUBLE_EQ(p[1], 0.09);  // max(0.09, 2 * 0.04)
  EXPECT_DOUBLE_EQ(p[3], 0.5);
  EXPECT_DOUBLE_EQ(holm({0.9, 0.8})[1], 1.0);
}

}  // namespace
}  // namespace binrig
