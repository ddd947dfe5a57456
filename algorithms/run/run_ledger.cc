#include "algorithms/run/run_ledger.h"

#include <string>

namespace b4mrl {
namespace {

std::string CheckpointName(const RunUseEntry& entry) {
  return "run/ledger/" + std::string(entry.name);
}

}  // namespace

RunLedger::RunLedger(Client& client) : client_(&client) { Refresh(); }

void RunLedger::Refresh() {
  Refresh(&learner_);
  Refresh(&evaluations_);
}

void RunLedger::Refresh(Account* account) {
  if (account->number != 0) {
    const Result<LedgerCounts> now = client_->ReadLedger(account->number);
    if (now.ok()) {
      LedgerCounts& total = account->total;
      total.steps += now->steps - account->read.steps;
      total.episodes += now->episodes - account->read.episodes;
      total.query_rows += now->query_rows - account->read.query_rows;
      total.dataset_rows += now->dataset_rows - account->read.dataset_rows;
      account->read = *now;
    }
    if (now.status().code() != StatusCode::kUnknownName) return;
  }
  const Result<uint64_t> opened = client_->OpenLedger();
  account->number = opened.ok() ? *opened : 0;
  account->read = LedgerCounts();
}

RunUse RunLedger::use() const {
  return {learner_.total.steps, learner_.total.query_rows, learner_.total.dataset_rows,
          evaluations_.total.episodes};
}

void RunLedger::Save(CheckpointWriter& writer) const {
  const RunUse saved = use();
  for (const RunUseEntry& entry : kRunUseEntries) {
    writer.Unsigned(CheckpointName(entry), saved.*entry.value);
  }
}

void RunLedger::Load(CheckpointReader& reader) {
  Refresh();
  RunUse saved;
  for (const RunUseEntry& entry : kRunUseEntries) {
    const std::string name = CheckpointName(entry);
    if (reader.Has(name)) saved.*entry.value = reader.Unsigned(name);
  }
  learner_.total = {.steps = saved.simulator_steps,
                    .query_rows = saved.query_rows,
                    .dataset_rows = saved.dataset_rows};
  evaluations_.total = {.episodes = saved.evaluation_episodes};
}

}  // namespace b4mrl
