#include "server/gateway/status_report.h"

#include <algorithm>
#include <string>
#include <string_view>

#include "proto/base/limits.h"
#include "proto/wire/named_arguments.h"
#include "proto/wire/utf8.h"
#include "server/shared_memory/open_record.h"

namespace b4mrl {
namespace {

// Limit on the listed sessions, so that a status fits an envelope with room to spare.
constexpr uint32_t kMaxListedSessions = 256;
constexpr size_t kMaxFolderBytes = 4096;

// `text` with a question mark for each byte that is not UTF-8: no client could read a message with
// such a byte. A path may have any bytes, and a text that was cut may end within a character.
std::string AsUtf8(std::string text) {
  for (size_t i = 0; i < text.size();) {
    const size_t bytes = FirstUtf8Character(std::string_view(text).substr(i)).bytes;
    if (bytes == 0) text[i] = '?';
    i += std::max<size_t>(bytes, 1);
  }
  return text;
}

}  // namespace

StatusReport::StatusReport(SharedState& shared, DataFolder& data_folder)
    : shared_(shared),
      data_folder_(data_folder),
      rates_(kFirstWorkerChild + shared.worker_count()),
      opened_(limits::kMaxSessions),
      sampled_ms_(MonotonicMs()) {
  for (uint32_t child = 0; child < rates_.size(); ++child) {
    rates_[child].steps = shared_.child(child).steps;
  }
}

void StatusReport::Sample() {
  const int64_t now = MonotonicMs();
  if (now <= sampled_ms_) return;
  const double seconds = 1e-3 * static_cast<double>(now - sampled_ms_);
  sampled_ms_ = now;
  for (uint32_t child = 0; child < rates_.size(); ++child) {
    const uint64_t steps = shared_.child(child).steps;
    rates_[child].per_second = static_cast<double>(steps - rates_[child].steps) / seconds;
    rates_[child].steps = steps;
  }
}

void StatusReport::Fill(pb::ServerStatusReply* out) {
  out->set_uptime_ms(static_cast<uint64_t>(MonotonicMs() - shared_.header().start_ms));
  for (uint32_t child = 0; child < rates_.size(); ++child) FillChild(child, out->add_workers());
  FillSessions(out);
  if (data_folder_.path().size() > kMaxFolderBytes) return;
  out->set_data_folder(AsUtf8(data_folder_.path()));
  out->set_data_folder_id(data_folder_.Identity());
}

void StatusReport::FillChild(uint32_t child, pb::WorkerStatus* out) const {
  const ChildRecord& record = shared_.child(child);
  out->set_role(ChildName(child));
  out->set_process_id(record.process_id);
  out->set_restarts(record.restarts);
  out->set_steps(record.steps);
  out->set_query_rows(record.query_rows);
  out->set_requests(record.requests);
  out->set_errors(record.errors);
  out->set_steps_per_second(rates_[child].per_second);
}

const StatusReport::Opened& StatusReport::OpenedOf(uint32_t index) {
  const SessionRecord& record = shared_.session(index);
  Opened& opened = opened_[index];
  if (opened.generation == record.generation) return opened;
  opened = {.generation = record.generation};
  const Result<pb::OpenRequest> request = OpenRequestOf(record);
  opened.is_whole = request.ok();
  if (!opened.is_whole) return opened;
  opened.environment = request->environment();
  // A long list is cut, so that 256 sessions fit the envelope.
  opened.perturbations =
      AsUtf8(FormatNamedArguments(NamedArgumentsOf(request->perturbations())).substr(0, 96));
  return opened;
}

void StatusReport::FillSessions(pb::ServerStatusReply* out) {
  const int64_t now = MonotonicMs();
  uint32_t count = 0;
  for (uint32_t index = 0; index < limits::kMaxSessions; ++index) {
    const SessionRecord& record = shared_.session(index);
    if (record.state() != SessionState::kLive) continue;
    const Opened& opened = OpenedOf(index);
    if (!opened.is_whole) continue;
    const uint32_t child = kFirstWorkerChild + record.worker;
    if (child < rates_.size()) {
      pb::WorkerStatus* worker = out->mutable_workers(static_cast<int>(child));
      worker->set_sessions(worker->sessions() + 1);
    }
    if (++count > kMaxListedSessions) continue;
    pb::SessionStatus* session = out->add_sessions();
    session->set_environment(opened.environment);
    session->set_perturbations(opened.perturbations);
    session->set_num_envs(record.lane_count);
    session->set_worker(record.worker);
    session->set_steps(record.steps);
    session->set_idle_ms(
        static_cast<uint64_t>(std::max<int64_t>(0, now - record.last_activity_ms)));
  }
  out->set_session_count(count);
}

}  // namespace b4mrl
