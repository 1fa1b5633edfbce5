// Is the noise Gaussian? And are two noises distributed alike?
//
// Neighbouring pixels are correlated, so tests count only pixels on a lattice wide enough that they are not: the
// effective n is their number.
#pragma once

#include <vector>

#include "compare/noise/autocovariance.h"
#include "compare/probability.h"

namespace binrig {

/// Pearson's chi-square test of normality with mean and standard deviation estimated from the same sample, in k cells
/// of equal probability, k = 2 n^(2/5) between 8 and 40. Estimated parameters take less than two degrees of freedom
/// from Pearson's X^2 (Chernoff and Lehmann 1954), so its exact form for the normal distribution is used (Rao and
/// Robson 1974, Nikulin 1973): Y^2 = X^2 + [v1^2 / (1 - k sum c1^2) + v2^2 / (2 - k sum c2^2)] / n, chi-square with k -
/// 1 degrees of freedom. The map is one row: the cells' standardised deviations. Not done below 100 values or without
/// variance.
TestResult gaussianity(const std::vector<float>& independent_values);

/// Chi-square test that two independent samples come from one distribution, in cells of equal share of the pooled
/// sample; degrees of freedom = cells - 1. With `standardised`, each sample is first brought to mean 0 and standard
/// deviation 1, so that shapes alone are compared (two degrees of freedom less: slightly conservative).
TestResult same_distribution(const std::vector<float>& first, const std::vector<float>& second, bool standardised);

/// The lattice spacing (px) at which the correlation no longer matters to a test. Mean and variance being estimated,
/// the chi-square of normality feels correlations only in their third power (the indicator functions' Hermite
/// coefficients of order 1 and 2 are projected out), so `gaussianity` asks for a sum of |rho|^3 over the lattice below
/// 0.02; a comparison of two samples feels the correlation itself and asks for |rho| <= 0.03 or what chance makes.
struct Thinning {
  int for_normality = 1, for_comparison = 1;
};
Thinning thinning(const cv::Mat& covariance, const cv::Mat& pairs);

/// Values of the valid pixels whose row and column are multiples of `spacing`.
void collect(const cv::Mat& residual, const cv::Mat& valid, int spacing, std::vector<float>& values);

/// The whole test on one residual image: correlation measured, pixels thinned out, tested.
TestResult gaussianity(const cv::Mat& residual, const cv::Mat& valid);

}  // namespace binrig
