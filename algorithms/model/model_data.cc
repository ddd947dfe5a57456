#include "algorithms/model/model_data.h"

#include <algorithm>
#include <atomic>
#include <deque>
#include <span>
#include <utility>
#include <vector>

#include "algorithms/experience/training_dataset.h"
#include "proto/base/finite.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// As of a rollout: a worker on a small machine must hold all requests under way, with their
// replies, and a slow simulator must answer them within the deadline.
constexpr uint32_t kRowsPerRequest = 1024;
constexpr size_t kRequestsInFlight = 6;
static_assert(kRowsPerRequest <= limits::kMaxQueryRows);

// The columns of a whole dataset. Targets are [o', r] until the predicted o' is subtracted from o'.
class Columns {
 public:
  Columns(const LearnerContext& context, RemoteDataset& dataset)
      : dataset_(dataset), action_scale_(context.ActionScale()), size_(context.observation_size()) {
    const int rows = static_cast<int>(dataset.rows());
    data_.observations = MatrixBuffer<float>(size_, rows);
    data_.actions = MatrixBuffer<float>(context.action_size(), rows);
    data_.targets = MatrixBuffer<float>(size_ + 1, rows);
    valid_.assign(rows, 1);
    has_target_.assign(rows, 1);
  }

  uint64_t rows() const { return dataset_.rows(); }
  // Reads and stores as many rows from `first_row` on as one request holds.
  Result<TransitionRows> Read(uint64_t first_row) {
    const uint32_t most = std::min(kRowsPerRequest, dataset_.max_rows_per_request());
    B4MRL_ASSIGN_OR_RETURN(TransitionRows rows, dataset_.Read(first_row, most));
    if (rows.rows == 0) {
      return Status(StatusCode::kDataLoss, "the dataset ended before its last row");
    }
    B4MRL_RETURN_IF_ERROR(CheckFiniteRows(dataset_, rows, first_row));
    for (size_t i = 0; i < rows.rows; ++i) {
      StoreRow(rows, i, static_cast<int>(first_row + i));
    }
    return rows;
  }

  // Subtracts `predicted`, the row-major o'_sim or o of the rows from `first_row` on, from targets.
  void Subtract(std::span<const float> predicted, int first_row) {
    const int rows = static_cast<int>(predicted.size()) / size_;
    for (int row = 0; row < rows; ++row) {
      float* target = data_.targets.view().column(first_row + row);
      const float* from = predicted.data() + static_cast<size_t>(row) * size_;
      for (int i = 0; i < size_; ++i) target[i] -= from[i];
    }
  }
  std::span<uint8_t> valid(int first_row, int rows) {
    return std::span(valid_).subspan(first_row, rows);
  }

  Result<ModelData> Take() {
    DropInvalid();
    if (data_.rows == 0) {
      return Status(StatusCode::kFailedPrecondition,
                    "no row of the dataset has a target of finite numbers");
    }
    return std::move(data_);
  }

 private:
  void StoreRow(const TransitionRows& rows, size_t from, int to) {
    std::copy_n(rows.observations.data() + from * size_, size_,
                data_.observations.view().column(to));
    for (size_t i = 0; i < action_scale_.size(); ++i) {
      data_.actions.view()(static_cast<int>(i), to) =
          rows.actions[from * action_scale_.size() + i] / action_scale_[i];
    }
    std::copy_n(rows.next_observations.data() + from * size_, size_,
                data_.targets.view().column(to));
    data_.targets.view()(size_, to) = rows.rewards[from];
    // The rule d4rl gives a terminal row the first observation of the next episode.
    if (rows.terminals[from] != 0 && dataset_.in_force().transition_rule() == "d4rl") {
      has_target_[to] = 0;
    }
  }

  bool Valid(int row) const {
    const auto finite = [row](const MatrixBuffer<float>& columns) {
      return AllFinite(std::span(columns.view().column(row), static_cast<size_t>(columns.rows())));
    };
    return valid_[row] != 0 && has_target_[row] != 0 && finite(data_.targets);
  }

  void DropInvalid() {
    for (int row = 0; row < static_cast<int>(valid_.size()); ++row) {
      if (!Valid(row)) {
        ++data_.invalid_rows;
        continue;
      }
      for (MatrixBuffer<float>* columns : {&data_.observations, &data_.actions, &data_.targets}) {
        if (data_.rows == row) break;  // no row was dropped so far: the row is already in place
        std::copy_n(columns->view().column(row), columns->rows(),
                    columns->view().column(data_.rows));
      }
      ++data_.rows;
    }
  }

  RemoteDataset& dataset_;
  const std::vector<float> action_scale_;
  const int size_;
  ModelData data_;
  std::vector<uint8_t> valid_;       // simulated, where a simulator is asked
  std::vector<uint8_t> has_target_;  // the dataset has the row's o'
};

// HyMOPO's pre-pass: queries the simulator for all rows, with several requests in flight.
class PrePass {
 public:
  PrePass(Columns& columns, RemoteEnvironment& simulator, uint64_t query_seed,
          const std::atomic<bool>& stop)
      : columns_(columns), simulator_(simulator), query_seed_(query_seed), stop_(stop) {}

  Status Run(Progress& progress) {
    const uint64_t total = columns_.rows();
    progress.Start("query simulator", "rows", total);
    for (uint64_t row = 0; row < total && !stop_;) {
      B4MRL_RETURN_IF_ERROR(Send(row));
      row += static_cast<uint64_t>(in_flight_.back().rows);
      if (in_flight_.size() >= kRequestsInFlight) B4MRL_RETURN_IF_ERROR(Receive(progress));
    }
    while (!in_flight_.empty()) B4MRL_RETURN_IF_ERROR(Receive(progress));
    progress.Finish();
    return Status();
  }

 private:
  struct Block {
    uint64_t request;
    int first_row;
    int rows;
  };

  Status Send(uint64_t first_row) {
    B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, columns_.Read(first_row));
    Block block = {0, static_cast<int>(first_row), static_cast<int>(rows.rows)};
    B4MRL_ASSIGN_OR_RETURN(block.request, simulator_.SendQuery(rows.observations, rows.actions,
                                                               query_seed_, 0, first_row));
    in_flight_.push_back(block);
    return Status();
  }

  Status Receive(Progress& progress) {
    const Block block = in_flight_.front();
    in_flight_.pop_front();
    next_.resize(block.rows * simulator_.spec().observation.size());
    rewards_.resize(block.rows);
    terminated_.resize(block.rows);
    B4MRL_RETURN_IF_ERROR(simulator_.ReceiveQuery(
        block.request,
        {next_, rewards_, terminated_, columns_.valid(block.first_row, block.rows)}));
    columns_.Subtract(next_, block.first_row);
    progress.Update(static_cast<uint64_t>(block.first_row + block.rows));
    return Status();
  }

  Columns& columns_;
  RemoteEnvironment& simulator_;
  const uint64_t query_seed_;
  const std::atomic<bool>& stop_;
  std::deque<Block> in_flight_;
  std::vector<float> next_;
  std::vector<double> rewards_;
  std::vector<uint8_t> terminated_;
};

}  // namespace

Result<ModelData> ReadChanges(const LearnerContext& context, RemoteDataset& dataset,
                              Progress& progress) {
  Columns columns(context, dataset);
  progress.Start("read dataset", "rows", columns.rows());
  for (uint64_t row = 0; row < columns.rows() && !*context.stop;) {
    B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, columns.Read(row));
    columns.Subtract(rows.observations, static_cast<int>(row));
    row += rows.rows;
    progress.Update(row);
  }
  progress.Finish();
  return columns.Take();
}

Result<ModelData> QueryCorrections(const LearnerContext& context, RemoteDataset& dataset,
                                   RemoteEnvironment& simulator, uint64_t query_seed,
                                   Progress& progress) {
  Columns columns(context, dataset);
  B4MRL_RETURN_IF_ERROR(PrePass(columns, simulator, query_seed, *context.stop).Run(progress));
  return columns.Take();
}

}  // namespace b4mrl
