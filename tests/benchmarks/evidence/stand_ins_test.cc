#include "benchmarks/evidence/stand_ins.h"

#include <catch2/catch.hpp>

#include "tests/benchmarks/evidence/made_results.h"

namespace b4mrl {
namespace {

TEST_CASE("Scores on a dataset that stands for another one fill that one's cells, others none") {
  constexpr char kGravity[] = "HalfCheetah/modelling-error/gravity+medium-expert";
  constexpr char kFriction[] = "HalfCheetah/modelling-error/friction+medium-expert";
  constexpr char kHidden[] = "HalfCheetah/confounding/hidden-high+medium-expert";
  constexpr char kMedium[] = "HalfCheetah/modelling-error/gravity+medium";
  const std::string late = "HalfCheetah/late-expert/";
  const auto score = [](double mean) {
    CellScore made;
    made.mean = mean;
    return made;
  };
  const CellScores ours = {{{kGravity, "iql"}, score(79)},
                           {{kGravity, "sac"}, score(45)},
                           {{kGravity, "hymopo"}, score(78)},
                           {{kFriction, "iql"}, score(79)},
                           {{kHidden, "iql"}, score(69)},
                           {{kHidden, "bc"}, score(42)},
                           {{kMedium, "iql"}, score(46)},
                           {{late + "gravity+medium-late-expert", "iql"}, score(94)},
                           {{late + "gravity+medium-late-expert", "hymopo"}, score(90)},
                           {{late + "gravity+medium-late-expert", "td3-bc"}, score(84)}};
  const CellScores scores = WithStandIn(ours, OwnBenchmarks(), kStandIns[0]);
  CHECK(scores.at({kGravity, "iql"}).mean == 94);
  CHECK(scores.at({kFriction, "iql"}).mean == 94);  // the same run
  CHECK(scores.at({kGravity, "hymopo"}).mean == 90);
  CHECK(scores.at({kGravity, "td3-bc"}).mean == 84);  // which ours of that name lacks
  CHECK(scores.at({kGravity, "sac"}).mean == 45);
  CHECK_FALSE(scores.contains({kHidden, "iql"}));
  CHECK(scores.at({kHidden, "bc"}).mean == 42);  // which the paper has not
  CHECK(scores.at({kMedium, "iql"}).mean == 46);
}

}  // namespace
}  // namespace b4mrl
