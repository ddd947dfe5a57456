// Chooses who is served next: of the accounts that wait, the one that has been served least so far.
//
// Accounts are small numbers and exist as soon as they are named. An account that did not wait for
// a while has saved nothing up: when it comes back, its sum is raised to what the last account
// served had before it was served. Not thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace b4mrl {

class FairShare {
 public:
  // The account waits from now on, or no longer. Enter and Leave alternate.
  void Enter(uint32_t account);
  void Leave(uint32_t account);
  // Whether no account waits.
  bool empty() const { return waiting_.empty(); }

  // Of the waiting accounts that `admits` (account -> bool) accepts, the one that has been served
  // least; of equal ones, the one that has waited longest.
  template <typename Admits>
  std::optional<uint32_t> Next(Admits admits) const {
    std::optional<uint32_t> next;
    for (const uint32_t account : waiting_) {
      if (next && had_[account] >= had_[*next]) continue;
      if (admits(account)) next = account;
    }
    return next;
  }

  // The account, which waits, is served `amount`.
  void Serve(uint32_t account, double amount);
  // Cancels the account's debt, because the account gets a new owner.
  void Forget(uint32_t account);
  // The account was served `amount` more than Serve said; less where it is negative.
  void Correct(uint32_t account, double amount);

 private:
  double& Had(uint32_t account);

  std::vector<double> had_;        // what each account was served, by account
  std::vector<uint32_t> waiting_;  // accounts, in the order in which they began to wait
  double level_ = 0;               // what the last account served had before
};

}  // namespace b4mrl
