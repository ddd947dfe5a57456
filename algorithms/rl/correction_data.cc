#include "algorithms/rl/correction_data.h"

#include <algorithm>
#include <deque>
#include <limits>
#include <utility>
#include <vector>

#include "proto/base/limits.h"

namespace b4mrl {
namespace {

constexpr uint32_t kRowsPerRequest = limits::kMaxQueryRows;
constexpr size_t kRequestsInFlight = 8;

// A block of rows at the daemon.
struct Block {
  uint64_t request;
  int first_row;
  int rows;
};

class PrePass {
 public:
  PrePass(const LearnerContext& context, RemoteDataset& dataset, RemoteEnvironment& simulator,
          uint64_t query_seed)
      : dataset_(dataset),
        simulator_(simulator),
        query_seed_(query_seed),
        action_scale_(context.ActionScale()),
        size_(context.observation_size()) {
    const int rows = static_cast<int>(dataset.rows());
    data_.observations = MatrixBuffer<float>(size_, rows);
    data_.actions = MatrixBuffer<float>(context.action_size(), rows);
    data_.targets = MatrixBuffer<float>(size_ + 1, rows);
    valid_.resize(rows);
  }

  Status Run(Progress& progress) {
    const uint64_t total = dataset_.rows();
    progress.Start("query simulator", "rows", total);
    for (uint64_t row = 0; row < total;) {
      B4MRL_RETURN_IF_ERROR(Send(row));
      row += static_cast<uint64_t>(in_flight_.back().rows);
      if (in_flight_.size() >= kRequestsInFlight) B4MRL_RETURN_IF_ERROR(Receive(progress));
    }
    while (!in_flight_.empty()) B4MRL_RETURN_IF_ERROR(Receive(progress));
    progress.Finish();
    DropInvalid();
    return Status();
  }

  CorrectionData Take() { return std::move(data_); }

 private:
  Status Send(uint64_t first_row) {
    B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, dataset_.Read(first_row, kRowsPerRequest));
    if (rows.rows == 0) {
      return Status(StatusCode::kDataLoss, "the dataset ended before its last row");
    }
    Block block = {0, static_cast<int>(first_row), static_cast<int>(rows.rows)};
    for (int i = 0; i < block.rows; ++i) StoreRow(rows, i, block.first_row + i);
    B4MRL_ASSIGN_OR_RETURN(block.request, simulator_.SendQuery(rows.observations, rows.actions,
                                                               query_seed_, 0, first_row));
    in_flight_.push_back(block);
    return Status();
  }

  // The target holds o' until the simulator's answer is subtracted.
  void StoreRow(const TransitionRows& rows, int from, int to) {
    std::copy_n(rows.observations.data() + static_cast<size_t>(from) * size_, size_,
                data_.observations.view().column(to));
    for (size_t i = 0; i < action_scale_.size(); ++i) {
      data_.actions.view()(static_cast<int>(i), to) =
          rows.actions[from * action_scale_.size() + i] / action_scale_[i];
    }
    std::copy_n(rows.next_observations.data() + static_cast<size_t>(from) * size_, size_,
                data_.targets.view().column(to));
    data_.targets.view()(size_, to) = rows.rewards[from];
  }

  Status Receive(Progress& progress) {
    const Block block = in_flight_.front();
    in_flight_.pop_front();
    next_.resize(static_cast<size_t>(block.rows) * size_);
    rewards_.resize(block.rows);
    terminated_.resize(block.rows);
    const std::span<uint8_t> valid(valid_.data() + block.first_row, block.rows);
    B4MRL_RETURN_IF_ERROR(
        simulator_.ReceiveQuery(block.request, {next_, rewards_, terminated_, valid}));
    for (int row = 0; row < block.rows; ++row) {
      float* target = data_.targets.view().column(block.first_row + row);
      const float* simulated = next_.data() + static_cast<size_t>(row) * size_;
      for (int i = 0; i < size_; ++i) target[i] -= simulated[i];
    }
    progress.Update(static_cast<uint64_t>(block.first_row + block.rows));
    return Status();
  }

  void DropInvalid() {
    for (int row = 0; row < static_cast<int>(valid_.size()); ++row) {
      if (valid_[row] == 0) {
        ++data_.invalid_rows;
        continue;
      }
      for (MatrixBuffer<float>* columns : {&data_.observations, &data_.actions, &data_.targets}) {
        if (data_.rows == row) break;  // nothing dropped so far: already in place
        std::copy_n(columns->view().column(row), columns->rows(),
                    columns->view().column(data_.rows));
      }
      ++data_.rows;
    }
  }

  RemoteDataset& dataset_;
  RemoteEnvironment& simulator_;
  const uint64_t query_seed_;
  const std::vector<float> action_scale_;
  const int size_;
  CorrectionData data_;
  std::vector<uint8_t> valid_;
  std::deque<Block> in_flight_;
  std::vector<float> next_;
  std::vector<double> rewards_;
  std::vector<uint8_t> terminated_;
};

}  // namespace

Result<CorrectionData> QueryCorrections(const LearnerContext& context, RemoteDataset& dataset,
                                        RemoteEnvironment& simulator, uint64_t query_seed,
                                        Progress& progress) {
  PrePass pre_pass(context, dataset, simulator, query_seed);
  B4MRL_RETURN_IF_ERROR(pre_pass.Run(progress));
  CorrectionData data = pre_pass.Take();
  if (data.rows == 0) {
    return Status(StatusCode::kFailedPrecondition,
                  "the simulator answered no row of the dataset with finite numbers");
  }
  return data;
}

}  // namespace b4mrl
