// p-values and quantiles, and the correction for testing many claims. Pure functions; any
// thread.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace b4mrl {

// The probability that at least `count` of independent events happen, of which each has a chance of
// its own. With chances of 1/2, the exact sign test of "positive and negative differences are
// equally likely".
double ChanceOfAtLeast(size_t count, std::span<const double> chances);

// Student's t distribution with a number of degrees of freedom of at least 1. The p-value is the
// probability of a value at least as far from 0 as `t`, for Welch's test with degrees that are no
// whole number; the quantile of p in (0, 1) is the value that the distribution stays below with
// probability p.
double StudentTwoSided(double t, double degrees);
double StudentQuantile(double p, size_t degrees);

// The probability that a standard normal value is at least as far from 0 as `z`. Its quantile is
// NormalQuantile of proto/base/rng.h.
double NormalTwoSided(double z);

// Holm's step-down adjustment: a claim is rejected at level a, with a family-wise error of at most
// a over all claims, where its adjusted value is at most a. In the order of `p_values`.
std::vector<double> HolmAdjusted(std::span<const double> p_values);

}  // namespace b4mrl
