// The measurements, one function a source file. Each reports what it measured, or returns the error
// that kept it from measuring. Names, fields and limits are listed in benchmarks/RESULTS.md.
#pragma once

#include <string>

#include "benchmarks/performance/support/measurement.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

struct Options {
  std::string endpoint;    // of a running daemon; "": a private one
  int turns = 5;           // how often value and limit are measured in turns
  double seconds = 1;      // of one turn of a throughput measurement
  std::string agent_file;  // whose states queries start from; "": HalfCheetah/medium's policy
};

// step-<Environment>, of each MuJoCo task: 64 lanes, one client over tcp, several requests in
// flight.
Status MeasureStep(const Options& options, Reporter& reporter);
// latency-tcp, latency-ipc: one lane, one request at a time.
Status MeasureLatency(const Options& options, Reporter& reporter);
// latency-beside-queries: the same, while another client asks for 50,000 rows at a time.
Status MeasureLatencyBesideQueries(const Options& options, Reporter& reporter);
// query-HalfCheetah: rows from recorded on-policy states, requests in flight.
Status MeasureQuery(const Options& options, Reporter& reporter);
// batch-cold, batch-stream: 256 rows of HalfCheetah data.
Status MeasureBatch(const Options& options, Reporter& reporter);
// highway-bare, highway-socket, highway-socket-cpu: steps of Highway with 15 other cars.
Status MeasureHighway(const Options& options, Reporter& reporter);
// update-sac, update-td3, update-td3-bc, update-ensemble: gradient steps on one thread.
Status MeasureUpdate(const Options& options, Reporter& reporter);
// hymopo-cycle: 1,000 updates beside the 250,000 queries of a rollout.
Status MeasureCycle(const Options& options, Reporter& reporter);

}  // namespace b4mrl::perf
