// The measurements, one function a source file. Each function reports its figures and their limits,
// or returns the error that prevented the measurement. Names, fields and limits are listed in
// benchmarks/RESULTS.md.
#pragma once

#include <string>

#include "benchmarks/performance/support/measurement.h"
#include "proto/base/status.h"

namespace b4mrl::perf {

struct Options {
  std::string endpoint;    // of a running daemon; "": starts a private daemon
  int turns = 5;           // how often a value and its limit are measured, in turns
  double seconds = 1;      // length of one turn of a throughput measurement
  std::string agent_file;  // its policy visits the states of queries; "": HalfCheetah/medium's
};

// step-<Environment>, for each MuJoCo task: steps a second of 64 lanes, one client over tcp,
// several requests in flight.
Status MeasureStep(const Options& options, Reporter& reporter);
// latency-tcp, latency-ipc: median time of a step, one lane, one request at a time.
Status MeasureLatency(const Options& options, Reporter& reporter);
// latency-door: median time of such a step through shared memory; latency-door-think-<us>: what it
// costs beside its physics, when the client pauses between two steps. Private daemons alone.
Status MeasureLatencyOfDoor(const Options& options, Reporter& reporter);
// latency-beside-queries: 99th percentile of one lane's step time, while another client sends
// queries of 50,000 rows.
Status MeasureLatencyBesideQueries(const Options& options, Reporter& reporter);
// query-HalfCheetah: rows of queries a second, from recorded on-policy states.
Status MeasureQuery(const Options& options, Reporter& reporter);
// batch-cold, batch-stream: time until a client has 256 rows of HalfCheetah data. batch-clients:
// such batches a second that 16 clients get together.
Status MeasureBatch(const Options& options, Reporter& reporter);
// highway-bare, highway-socket, highway-ipc, ...-cpu: steps of Highway with 15 other cars.
Status MeasureHighway(const Options& options, Reporter& reporter);
// update-sac, update-td3, ..., update-ensemble: gradient steps on one thread.
Status MeasureUpdate(const Options& options, Reporter& reporter);
// hymopo-cycle, mopo-cycle: time of 1,000 updates beside rollouts of 250,000 steps; and ...-lag-0,
// the time of both one after the other.
Status MeasureCycle(const Options& options, Reporter& reporter);

// python-single, python-humanoid, python-vec8-sync, ...: steps a second from Python, beside those
// of Gymnasium and EnvPool where they are installed, and of the C++ client. Not among `all`,
// because it needs a python3 with the package b4mrl.
Status MeasurePython(const Options& options, Reporter& reporter);

}  // namespace b4mrl::perf
