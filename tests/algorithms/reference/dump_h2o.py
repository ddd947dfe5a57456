#!/usr/bin/env python3
"""Writes h2o.ref beside this script: two updates of H2O.

    pip install torch==2.13.0 numpy && python dump_h2o.py

Follows Niu et al. 2022 and the order of the authors' code with probabilities, weighted errors and
torch.logsumexp, where algorithms/cores/h2o_core.h works with log-ratios. Format, conventions and
helpers are those of dump_pytorch.py.
"""
import copy

import torch
import torch.nn.functional as F
from dump_pytorch import (ACTION, FOLDER, GAMMA, HIDDEN, LOG_STD_RANGE, OBSERVATION, RATE, File,
                          add_networks, exact, forward, gradient, make_batch, network, polyak,
                          value)

# All different, so that no count can stand for another.
REAL, SIMULATED = 7, 5
DISCRIMINATOR_REAL, DISCRIMINATOR_SIMULATED = 6, 4
SAMPLES = 3
INPUT_NOISE, GAP_WEIGHT = 0.1, 0.01


def transitions(batch):
    return batch["observations"], batch["actions"], batch["next_observations"]


def logits(layers, *parts):
    return 2 * torch.tanh(forward(layers, torch.cat(parts, 1)))


def make_discriminators():
    """Larger heads than PyTorch's, so that ratios and gaps fall on both sides of their clamps."""
    d_sa = network(OBSERVATION + ACTION, *HIDDEN, 2)
    d_sas = network(2 * OBSERVATION + ACTION, *HIDDEN, 2)
    for layers in (d_sa, d_sas):
        layers[-1].weight.data = exact(layers[-1].weight.data * 4)
    return d_sa, d_sas


def discriminator_losses(d_sa, d_sas, batch, noise):
    rows = torch.cat(transitions(batch), 1) + INPUT_NOISE * noise
    s_a = rows[:, :OBSERVATION + ACTION]
    sa_logits, sas_logits = logits(d_sa, s_a), logits(d_sas, rows)
    losses = []
    for probabilities in (F.softmax(sa_logits, 1), F.softmax(sas_logits + sa_logits, 1)):
        real = -probabilities[:DISCRIMINATOR_REAL, 0].log().mean()
        simulated = -probabilities[DISCRIMINATOR_REAL:, 1].log().mean()
        losses.append(real + simulated)
    return losses


def dynamics_ratio(d_sa, d_sas, s, a, next_s):
    """Real over simulated, by Bayes' rule from both classifiers."""
    sa_logits = logits(d_sa, s, a)
    sa = F.softmax(sa_logits, 1)
    sas = F.softmax(logits(d_sas, s, a, next_s) + sa_logits, 1)
    return sas[:, 0] * sa[:, 1] / (sas[:, 1] * sa[:, 0])


def gap_shares(d_sa, d_sas, s, a, next_s, noise, deviation):
    estimates = [
        -dynamics_ratio(d_sa, d_sas, s, a, next_s + deviation * sample).log() for sample in noise
    ]
    u = torch.stack(estimates).mean(0).clamp(1e-45, 10)
    return u / u.sum(), u.mean()


def main():
    torch.manual_seed(7)
    file = File()
    batch = make_batch(file, "batch", REAL + SIMULATED)
    discriminator_batch = make_batch(file, "discriminator_batch",
                                    DISCRIMINATOR_REAL + DISCRIMINATOR_SIMULATED)
    deviation = exact(torch.rand(OBSERVATION) + 0.1)
    file.add("gap_deviation", deviation)
    file.add("rows", torch.tensor([REAL, DISCRIMINATOR_REAL, SAMPLES], dtype=torch.float64))

    actor = network(OBSERVATION, *HIDDEN, 2 * ACTION)
    # Some log_std beyond both clamps, where no gradient may pass.
    actor[-1].bias.data[ACTION] = 6.0
    actor[-1].bias.data[ACTION + 1] = -30.0
    scale = torch.tensor([1.25, -0.75], requires_grad=True)  # m and b of log_std
    critics = torch.nn.ModuleList(network(OBSERVATION + ACTION, *HIDDEN, 1) for _ in range(2))
    targets = copy.deepcopy(critics)
    d_sa, d_sas = make_discriminators()
    log_alpha = torch.zeros(1, requires_grad=True)
    actor_adam = torch.optim.Adam([*actor.parameters(), scale], lr=RATE)
    critic_adam = torch.optim.Adam(critics.parameters(), lr=RATE)
    alpha_adam = torch.optim.Adam([log_alpha], lr=RATE)
    d_sa_adam = torch.optim.Adam(d_sa.parameters(), lr=RATE)
    d_sas_adam = torch.optim.Adam(d_sas.parameters(), lr=RATE)
    file.add("initial/actor/log_std_scale", scale)

    def add_all(prefix, read):
        add_networks(file, f"{prefix}/actor", [actor], read)
        add_networks(file, f"{prefix}/critic", critics, read)
        add_networks(file, f"{prefix}/d_sa", [d_sa], read)
        add_networks(file, f"{prefix}/d_sas", [d_sas], read)

    def sample(observations, noise):
        mean, raw = forward(actor, observations).chunk(2, dim=1)
        log_std = (scale[0] * raw + scale[1]).clamp(*LOG_STD_RANGE)
        base = torch.distributions.Normal(mean, log_std.exp())
        squashed = torch.distributions.TransformedDistribution(
            base, torch.distributions.transforms.TanhTransform(cache_size=1))
        action = torch.tanh(mean + base.scale * noise)
        u = mean + base.scale * noise
        jacobian = squashed.transforms[0].log_abs_det_jacobian(u, action)
        return action, (base.log_prob(u) - jacobian).sum(1)

    def q_values(networks, observations, actions):
        x = torch.cat([observations, actions], 1)
        return [forward(q, x).squeeze(1) for q in networks]

    add_all("initial", value)
    for step in (1, 2):
        discriminator_noise = exact(
            torch.randn(DISCRIMINATOR_REAL + DISCRIMINATOR_SIMULATED, 2 * OBSERVATION + ACTION))
        gap_noise = exact(torch.randn(SAMPLES, SIMULATED, OBSERVATION))
        noise = exact(torch.randn(REAL + SIMULATED, ACTION))
        next_noise = exact(torch.randn(REAL + SIMULATED, ACTION))
        file.add(f"step{step}/discriminator_noise", discriminator_noise)
        file.add(f"step{step}/gap_noise", gap_noise.reshape(SAMPLES * SIMULATED, OBSERVATION))
        file.add(f"step{step}/noise", noise)
        file.add(f"step{step}/next_noise", next_noise)

        sa_loss, sas_loss = discriminator_losses(d_sa, d_sas, discriminator_batch,
                                                 discriminator_noise)
        d_sa_adam.zero_grad()
        d_sas_adam.zero_grad()
        sa_loss.backward(retain_graph=True)
        sas_loss.backward()  # reaches D_sa as well
        d_sa_adam.step()
        d_sas_adam.step()

        action, log_prob = sample(batch["observations"], noise)
        alpha = log_alpha.detach().exp()
        alpha_loss = -(log_alpha * (log_prob - ACTION).detach()).mean()
        q_pi = torch.minimum(*q_values(critics, batch["observations"], action))
        actor_loss = (alpha * log_prob - q_pi).mean()

        with torch.no_grad():
            next_action, _ = sample(batch["next_observations"], next_noise)
            next_q = torch.minimum(*q_values(targets, batch["next_observations"], next_action))
            y = batch["rewards"] + batch["not_terminated"] * GAMMA * next_q
            s, a, next_s = (part[REAL:] for part in transitions(batch))
            weight = dynamics_ratio(d_sa, d_sas, s, a, next_s).clamp(1e-5, 1).sqrt()
            omega, mean_gap = gap_shares(d_sa, d_sas, s, a, next_s, gap_noise, deviation)
        critic_loss, gap_penalty = 0, 0
        for q in q_values(critics, batch["observations"], batch["actions"]):
            real, simulated = q[:REAL], q[REAL:]
            critic_loss = critic_loss + F.mse_loss(real, y[:REAL])
            critic_loss = critic_loss + F.mse_loss(weight * simulated, weight * y[REAL:])
            pushed = torch.logsumexp(simulated + omega.log(), 0) - real.mean()
            gap_penalty = gap_penalty + GAP_WEIGHT * pushed.clamp(-1000, 1000)

        alpha_adam.zero_grad()
        alpha_loss.backward()
        alpha_adam.step()
        actor_adam.zero_grad()
        actor_loss.backward()
        actor_adam.step()
        critic_adam.zero_grad()  # the actor's loss left its own there
        (critic_loss + gap_penalty).backward()
        critic_adam.step()
        polyak(critics, targets)

        add_all(f"step{step}/gradient", gradient)
        file.add(f"step{step}/gradient/actor/log_std_scale", scale.grad)
        file.add(f"step{step}/gradient/log_alpha", log_alpha.grad)
        file.add(f"step{step}/losses", torch.stack([
            sa_loss, sas_loss, critic_loss, gap_penalty, actor_loss, alpha_loss,
            (weight**2).mean(), mean_gap]))
    add_all("final", value)
    add_networks(file, "final/critic_target", targets, value)
    file.add("final/actor/log_std_scale", scale)
    file.add("final/log_alpha", log_alpha)
    file.write(FOLDER / "h2o.ref")


if __name__ == "__main__":
    main()
