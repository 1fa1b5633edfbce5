// Noise that whole rows or columns share.
#pragma once

#include "compare/noise/autocovariance.h"
#include "compare/probability.h"

namespace binrig {

struct RowColumnNoise {
  Estimate row_variance_mm2, column_variance_mm2;  ///< may come out negative where there is none
  TestResult no_row_noise, no_column_noise;        ///< one-sided: rejected where the variance is above 0
  double row_sigma_mm() const;
  double column_sigma_mm() const;
};

/// An offset common to a row adds its variance to the covariance of pixels of one row at any distance, and nothing to
/// pixels of different rows. So A_row^2 = mean of C(dy = 0, dx) - mean of C(|dy| = 2 .. 4, dx) over |dx| = M/2 .. M;
/// ordinary noise, however correlated over less than M/2, cancels. Columns likewise. Standard errors by jackknife; Holm
/// for the two.
RowColumnNoise row_column_noise(const Autocovariance& autocovariance);

}  // namespace binrig
