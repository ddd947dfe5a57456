#include "server/scheduling/fair_share.h"

#include <algorithm>

namespace b4mrl {

double& FairShare::Had(uint32_t account) {
  if (account >= had_.size()) had_.resize(account + 1);
  return had_[account];
}

void FairShare::Enter(uint32_t account) {
  double& had = Had(account);
  had = std::max(had, level_);
  waiting_.push_back(account);
}

void FairShare::Leave(uint32_t account) { std::erase(waiting_, account); }

void FairShare::Serve(uint32_t account, double amount) {
  double& had = Had(account);
  level_ = std::max(level_, had);
  had += amount;
}

void FairShare::Forget(uint32_t account) {
  // Not 0, because a waiting account with 0 would be served before all others until it caught up.
  double& had = Had(account);
  had = std::min(had, level_);
}

void FairShare::Correct(uint32_t account, double amount) { Had(account) += amount; }

}  // namespace b4mrl
