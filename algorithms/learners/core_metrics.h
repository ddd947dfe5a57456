// The cores' numbers as named metrics, so that equal things have equal names in every log.
#pragma once

#include "algorithms/base/metrics.h"
#include "algorithms/cores/h2o_core.h"
#include "algorithms/cores/iql_core.h"
#include "algorithms/cores/sac_core.h"
#include "algorithms/cores/td3_core.h"

namespace b4mrl {

inline void AddMetrics(const SacMetrics& values, MetricMeans& metrics) {
  metrics.Add("critic_loss", values.critic_loss);
  metrics.Add("actor_loss", values.actor_loss);
  metrics.Add("alpha_loss", values.alpha_loss);
  metrics.Add("alpha", values.alpha);
  metrics.Add("mean_q", values.mean_q);
  metrics.Add("mean_target", values.mean_target);
  metrics.Add("entropy", values.entropy);
}

inline void AddMetrics(const Td3Metrics& values, MetricMeans& metrics) {
  metrics.Add("critic_loss", values.critic_loss);
  metrics.Add("mean_q", values.mean_q);
  metrics.Add("mean_target", values.mean_target);
  const size_t count = values.actor_step ? 1 : 0;  // each step of the actor counts once
  metrics.AddAll("actor_loss", {&values.actor_loss, count});
  if (values.bc_loss) metrics.AddAll("bc_loss", {&*values.bc_loss, count});
  if (values.lambda) metrics.AddAll("lambda", {&*values.lambda, count});
}

inline void AddMetrics(const IqlMetrics& values, MetricMeans& metrics) {
  metrics.Add("value_loss", values.value_loss);
  metrics.Add("critic_loss", values.critic_loss);
  metrics.Add("actor_loss", values.actor_loss);
  metrics.Add("mean_value", values.mean_value);
  metrics.Add("mean_weight", values.mean_weight);
  metrics.Add("mean_q", values.mean_q);
  metrics.Add("mean_target", values.mean_target);
}

inline void AddMetrics(const H2oMetrics& values, MetricMeans& metrics) {
  AddMetrics(values.sac, metrics);
  metrics.Add("critic_loss_real", values.critic.real_loss);
  metrics.Add("critic_loss_simulated", values.critic.simulated_loss);
  metrics.Add("mean_q_real", values.critic.mean_real_q);
  metrics.Add("mean_q_simulated", values.critic.mean_simulated_q);
  metrics.Add("gap_penalty", values.gap_penalty);
  metrics.Add("mean_gap", values.mean_gap);
  metrics.Add("mean_weight", values.mean_weight);
  metrics.Add("d_sa_loss", values.discriminators.state_action_loss);
  metrics.Add("d_sas_loss", values.discriminators.transition_loss);
}

}  // namespace b4mrl
