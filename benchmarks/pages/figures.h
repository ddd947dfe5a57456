// The figures of a report. Filled marks are settled scores, open ones still move. Pure functions;
// any thread.
#pragma once

#include <string>
#include <vector>

#include "benchmarks/evidence/aggregates.h"
#include "benchmarks/evidence/hybrid_gain.h"
#include "benchmarks/pages/document.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {

// The algorithms of all figures, so that each has its colour everywhere: the paper's and ours.
std::vector<std::string> AlgorithmsOf(const Evidence& evidence);
// Their names as a figure's series.
std::vector<std::string> SeriesNames(const std::vector<std::string>& algorithms);

// The gain of each hybrid on each benchmark, ours beside the paper's.
Picture GainPicture(const std::vector<HybridGain>& ours, const std::vector<HybridGain>& paper,
                    const std::vector<Benchmark>& all);
// The paper's fig:res_fig: all algorithms by dataset, beside a simulator with the gravity error and
// one with much observation noise.
Picture ScoresPicture(const Evidence& evidence);
// The paper's fig:conf_line_plots: hybrids as the error moves from the simulator into the data.
Picture ConditionsPicture(const Evidence& evidence);
// The paper's fig:conf: SAC and TD3-BC without each single dimension.
Picture DimensionsPicture(const Evidence& evidence);
// Our scores over the paper's.
Picture BesideThePaperPicture(const Evidence& evidence);
// Share of runs above each score.
Picture ProfilesPicture(const Evidence& evidence, const Aggregates& aggregates);
// Scores over updates on the benchmarks, without panels whose runs are all shown by another one.
// Runs that are much longer than others have a panel of their own. Several pictures, each of which
// fits a printed page.
std::vector<Picture> CurvesPictures(const Evidence& evidence);

}  // namespace b4mrl
