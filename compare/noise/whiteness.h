// Are neighbouring pixels' noises independent? And over what distance not?
#pragma once

#include "compare/noise/autocovariance.h"
#include "compare/probability.h"

namespace binrig {

/// Portmanteau test after Box and Pierce (1970) in two dimensions: Q = sum over the lags of a half plane, |dx|, |dy| <=
/// 4, of pairs(k) rho(k)^2, which is chi-square with as many degrees of freedom as there are lags if pixels are
/// independent. The map is rho(k).
TestResult whiteness(const cv::Mat& covariance, const cv::Mat& pairs);
TestResult whiteness(const Autocovariance& autocovariance);

/// Autocorrelation averaged over directions: element d is the mean of rho over lags with distance d - 0.5 .. d + 0.5
/// px.
std::vector<double> radial_autocorrelation(const cv::Mat& covariance);

/// Distance (px) at which radial_autocorrelation first falls to 1/e, by linear interpolation; 0 for no variance, the
/// largest lag where it never falls so far. Noise with the spectrum exp(-(2 pi L f)^2) of EFFECTS has 2 L.
double correlation_length_px(const cv::Mat& covariance);

}  // namespace binrig
