// How well two lists of numbers agree in their order. x[i] and y[i] belong together. Unset where it
// is not defined: fewer than two pairs, or a list whose values are all equal. Pure functions; any
// thread.
#pragma once

#include <optional>
#include <span>

namespace b4mrl {

// Spearman's coefficient: Pearson's correlation of the ranks, equal values with the mean of their
// ranks (scipy.stats.spearmanr).
std::optional<double> Spearman(std::span<const double> x, std::span<const double> y);

// Kendall's tau-b, which corrects for ties (scipy.stats.kendalltau). Its time is quadratic in the
// number of pairs.
std::optional<double> Kendall(std::span<const double> x, std::span<const double> y);

}  // namespace b4mrl
