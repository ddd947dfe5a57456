// Who goes next among those that want something: whoever has had least of it.
//
// Accounts are small numbers and exist as soon as they are named. One that wanted nothing for a
// while has saved nothing up: it comes back with at least what the last one served had had before.
// Not thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace b4mrl {

class FairShare {
 public:
  // The account wants something from now on, or until now. Each once, in turns.
  void Enter(uint32_t account);
  void Leave(uint32_t account);
  // Whether nobody wants anything.
  bool empty() const { return waiting_.empty(); }

  // Whoever has had least of those whom `admits` (account -> bool) admits; of equals the one that
  // has been waiting longest.
  template <typename Admits>
  std::optional<uint32_t> Next(Admits admits) const {
    std::optional<uint32_t> next;
    for (const uint32_t account : waiting_) {
      if (next && had_[account] >= had_[*next]) continue;
      if (admits(account)) next = account;
    }
    return next;
  }

  // It gets `amount`, about which it may have come to the front of the queue.
  void Serve(uint32_t account, double amount);
  // What it got turned out to be `amount` more, or less, than Serve said.
  void Correct(uint32_t account, double amount);

 private:
  double& Had(uint32_t account);

  std::vector<double> had_;        // by account
  std::vector<uint32_t> waiting_;  // in the order in which they came
  double level_ = 0;               // what the last one served had had before
};

}  // namespace b4mrl
