// How fast a run still learns, on the scale on which learning curves are nearly straight. Pure
// functions; any thread.
#pragma once

#include <optional>

#include "benchmarks/records/curve.h"

namespace b4mrl {

// Points (of the return, where there is no score) that each doubling of the updates adds: the
// median slope over the logarithm of the updates, of the evaluations in the second half of the run.
// Nothing with fewer than five of them. A run that has settled by the rule of Fifths, whose two
// fifths are a third of a doubling apart, may gain four points a doubling and more.
std::optional<double> GainPerDoubling(const Curve& curve);

}  // namespace b4mrl
