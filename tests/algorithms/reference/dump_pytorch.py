#!/usr/bin/env python3
"""Writes the reference files beside this script: updates of SAC, TD3, TD3-BC, IQL, an ensemble.

    pip install torch==2.13.0 numpy && python dump_pytorch.py

Everything is computed by autograd and torch.optim.Adam in float64, from weights, a batch and noise
that are exact in float32. The networks are small so that the files stay small; they are not square
anywhere, so that a transposed weight cannot pass. tests/algorithms/reference_file.h reads the files:
"B4MRLREF", the number of arrays, then for each its name, shape and float64 numbers, little-endian,
every integer an unsigned 32-bit one.
"""
import copy
import pathlib
import struct

import numpy
import torch
import torch.nn.functional as F

torch.set_default_dtype(torch.float64)
torch.set_num_threads(1)
FOLDER = pathlib.Path(__file__).parent
OBSERVATION, ACTION, BATCH, HIDDEN = 17, 6, 12, (20, 14)
GAMMA, TAU, RATE = 0.99, 0.005, 3e-4
# Narrower than the algorithm's -20..2: there PyTorch's (u - mean)^2 / variance loses eight digits,
# and tanh saturates in float32.
LOG_STD_RANGE = (-5, 0.5)


def exact(tensor):
    """Rounded to float32, so that the C++ side may load it as either type."""
    return tensor.to(torch.float32).to(torch.float64)


class File:
    def __init__(self):
        self.arrays = []

    def add(self, name, tensor):
        self.arrays.append((name, numpy.ascontiguousarray(tensor.detach().numpy(), "<f8").copy()))

    def write(self, path):
        with open(path, "wb") as out:
            out.write(b"B4MRLREF" + struct.pack("<I", len(self.arrays)))
            for name, values in self.arrays:
                out.write(struct.pack("<I", len(name)) + name.encode())
                out.write(struct.pack("<I", values.ndim))
                out.write(struct.pack(f"<{values.ndim}I", *values.shape))
                out.write(values.tobytes())


def network(*sizes):
    layers = [torch.nn.Linear(i, o) for i, o in zip(sizes[:-1], sizes[1:])]
    for layer in layers:
        layer.weight.data = exact(layer.weight.data)
        layer.bias.data = exact(layer.bias.data)
    return torch.nn.ModuleList(layers)


def forward(layers, x, activation=F.relu):
    for layer in layers[:-1]:
        x = activation(layer(x))
    return layers[-1](x)


def add_networks(file, prefix, members, read):
    """`read` takes the number out of a parameter: itself or its gradient."""
    for i in range(len(members[0])):
        for part in ("weight", "bias"):
            values = [read(getattr(member[i], part)) for member in members]
            stacked = values[0] if len(values) == 1 else torch.stack(values)
            file.add(f"{prefix}/layer{i}/{part}", stacked)


def polyak(online, target):
    for p, t in zip(online.parameters(), target.parameters()):
        t.data.copy_(TAU * p.data + (1 - TAU) * t.data)


def make_batch(file, name="batch", rows=BATCH):
    batch = {
        "observations": exact(torch.randn(rows, OBSERVATION)),
        "actions": exact(torch.rand(rows, ACTION) * 2 - 1),
        "rewards": exact(torch.randn(rows)),
        "next_observations": exact(torch.randn(rows, OBSERVATION)),
        "not_terminated": (torch.arange(rows) % 4 != 0).to(torch.float64),
    }
    for part, tensor in batch.items():
        file.add(f"{name}/{part}", tensor)
    return batch


def value(parameter):
    return parameter


def gradient(parameter):
    return parameter.grad


def sac():
    torch.manual_seed(1)
    file = File()
    batch = make_batch(file)
    actor = network(OBSERVATION, *HIDDEN, 2 * ACTION)
    # Some log_std beyond both clamps, where no gradient may pass.
    actor[-1].bias.data[ACTION] = 4.0
    actor[-1].bias.data[ACTION + 1] = -30.0
    critics = torch.nn.ModuleList(network(OBSERVATION + ACTION, *HIDDEN, 1) for _ in range(2))
    targets = copy.deepcopy(critics)
    log_alpha = torch.zeros(1, requires_grad=True)
    actor_adam = torch.optim.Adam(actor.parameters(), lr=RATE)
    critic_adam = torch.optim.Adam(critics.parameters(), lr=RATE)
    alpha_adam = torch.optim.Adam([log_alpha], lr=RATE)
    add_networks(file, "initial/actor", [actor], value)
    add_networks(file, "initial/critic", critics, value)

    def sample(observations, noise):
        mean, log_std = forward(actor, observations).chunk(2, dim=1)
        normal = torch.distributions.Normal(mean, log_std.clamp(*LOG_STD_RANGE).exp())
        u = mean + normal.scale * noise
        action = torch.tanh(u)
        log_prob = normal.log_prob(u).sum(1) - torch.log(1 - action**2 + 1e-6).sum(1)
        return action, log_prob

    def q_values(networks, observations, actions):
        x = torch.cat([observations, actions], 1)
        return [forward(q, x).squeeze(1) for q in networks]

    for step in (1, 2):
        noise = exact(torch.randn(BATCH, ACTION))
        next_noise = exact(torch.randn(BATCH, ACTION))
        file.add(f"step{step}/noise", noise)
        file.add(f"step{step}/next_noise", next_noise)
        action, log_prob = sample(batch["observations"], noise)
        alpha = log_alpha.detach().exp()
        alpha_loss = -(log_alpha * (log_prob - ACTION).detach()).mean()
        alpha_adam.zero_grad()
        alpha_loss.backward()
        alpha_adam.step()
        with torch.no_grad():
            next_action, next_log_prob = sample(batch["next_observations"], next_noise)
            next_q = torch.minimum(*q_values(targets, batch["next_observations"], next_action))
            y = batch["rewards"] + batch["not_terminated"] * GAMMA * (next_q - alpha * next_log_prob)
        q = q_values(critics, batch["observations"], batch["actions"])
        critic_loss = 0.5 * sum(F.mse_loss(one, y) for one in q)
        critic_adam.zero_grad()
        critic_loss.backward()
        add_networks(file, f"step{step}/gradient/critic", critics, gradient)
        critic_adam.step()
        q_pi = torch.minimum(*q_values(critics, batch["observations"], action))
        actor_loss = (alpha * log_prob - q_pi).mean()
        actor_adam.zero_grad()
        actor_loss.backward()
        add_networks(file, f"step{step}/gradient/actor", [actor], gradient)
        actor_adam.step()
        polyak(critics, targets)
        losses = torch.stack([critic_loss, actor_loss, alpha_loss, alpha[0]])
        file.add(f"step{step}/critic_actor_alpha_losses_and_alpha", losses)
        file.add(f"step{step}/gradient/log_alpha", log_alpha.grad)
        file.add(f"step{step}/log_alpha", log_alpha)
    add_networks(file, "final/actor", [actor], value)
    add_networks(file, "final/critic", critics, value)
    add_networks(file, "final/critic_target", targets, value)
    file.write(FOLDER / "sac.ref")


def td3(name, seed, bc_alpha=None):
    """TD3, or with `bc_alpha` TD3-BC."""
    torch.manual_seed(seed)
    file = File()
    batch = make_batch(file)
    actor = network(OBSERVATION, *HIDDEN, ACTION)
    actor_target = copy.deepcopy(actor)
    critics = torch.nn.ModuleList(network(OBSERVATION + ACTION, *HIDDEN, 1) for _ in range(2))
    targets = copy.deepcopy(critics)
    actor_adam = torch.optim.Adam(actor.parameters(), lr=RATE)
    critic_adam = torch.optim.Adam(critics.parameters(), lr=RATE)
    add_networks(file, "initial/actor", [actor], value)
    add_networks(file, "initial/critic", critics, value)

    def act(layers, observations):
        return torch.tanh(forward(layers, observations))

    def q_value(layers, observations, actions):
        return forward(layers, torch.cat([observations, actions], 1)).squeeze(1)

    for step in (1, 2, 3, 4):
        noise = exact(torch.randn(BATCH, ACTION) * 2)
        file.add(f"step{step}/noise", noise)
        with torch.no_grad():
            smoothing = (noise * 0.2).clamp(-0.5, 0.5)
            next_action = (act(actor_target, batch["next_observations"]) + smoothing).clamp(-1, 1)
            next_q = torch.minimum(
                *[q_value(q, batch["next_observations"], next_action) for q in targets])
            y = batch["rewards"] + batch["not_terminated"] * GAMMA * next_q
        critic_loss = sum(
            F.mse_loss(q_value(q, batch["observations"], batch["actions"]), y) for q in critics)
        critic_adam.zero_grad()
        critic_loss.backward()
        add_networks(file, f"step{step}/gradient/critic", critics, gradient)
        critic_adam.step()
        losses = [critic_loss]
        if step % 2 == 0:
            pi = act(actor, batch["observations"])
            q = q_value(critics[0], batch["observations"], pi)
            if bc_alpha is None:
                actor_loss = -q.mean()
                losses += [actor_loss]
            else:
                weight = bc_alpha / q.abs().mean().detach()
                bc_loss = F.mse_loss(pi, batch["actions"])
                actor_loss = -weight * q.mean() + bc_loss
                losses += [actor_loss, bc_loss, weight]
            actor_adam.zero_grad()
            actor_loss.backward()
            add_networks(file, f"step{step}/gradient/actor", [actor], gradient)
            actor_adam.step()
            polyak(critics, targets)
            polyak(actor, actor_target)
        kinds = "critic_actor_losses" if bc_alpha is None else "critic_actor_bc_losses_and_lambda"
        file.add(f"step{step}/{kinds}", torch.stack(losses))
    for network_name, members in (("actor", [actor]), ("actor_target", [actor_target]),
                                  ("critic", critics), ("critic_target", targets)):
        add_networks(file, f"final/{network_name}", members, value)
    file.write(FOLDER / f"{name}.ref")


def iql(gaussian, name):
    """Both actors of cores/iql_core.h; the schedule is so short that two updates show it."""
    torch.manual_seed(4)
    file = File()
    batch = make_batch(file)
    observations, actions = batch["observations"], batch["actions"]
    value_network = network(OBSERVATION, *HIDDEN, 1)
    actor = network(OBSERVATION, *HIDDEN, ACTION)
    critics = torch.nn.ModuleList(network(OBSERVATION + ACTION, *HIDDEN, 1) for _ in range(2))
    for critic in critics:  # advantages of either sign
        critic[-1].weight.data *= 8
        critic[-1].bias.data = exact(critic[-1].bias.data + 1)
    targets = copy.deepcopy(critics)
    # The first and last are beyond the clamps to -5..2, where no gradient may pass.
    log_std = torch.nn.Parameter(exact(torch.tensor([-5.5, -1.0, -0.3, 0.0, 0.4, 2.5])))
    add_networks(file, "initial/value", [value_network], value)
    add_networks(file, "initial/actor", [actor], value)
    add_networks(file, "initial/critic", critics, value)
    if gaussian:
        file.add("initial/log_std", log_std)
    # A largest weight that some rows reach and some do not.
    expectile, temperature, weight_max = 0.7, 3.0, 2.0
    file.add("cosine_updates_and_weight_max", torch.tensor([3.0, weight_max]))

    value_adam = torch.optim.Adam(value_network.parameters(), lr=RATE)
    actor_adam = torch.optim.Adam([*actor.parameters()] + [log_std] * gaussian, lr=RATE)
    critic_adam = torch.optim.Adam(critics.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(actor_adam, T_max=3)

    def q_values(networks):
        x = torch.cat([observations, actions], 1)
        return [forward(q, x).squeeze(1) for q in networks]

    def step_on(loss, adam):
        adam.zero_grad()
        loss.backward()
        adam.step()

    for step in (1, 2):
        prefix = f"step{step}/gradient"
        with torch.no_grad():
            target_q = torch.minimum(*q_values(targets))
        difference = target_q - forward(value_network, observations).squeeze(1)
        asymmetry = torch.where(difference > 0, expectile, 1 - expectile)
        value_loss = (asymmetry * difference**2).mean()
        step_on(value_loss, value_adam)
        add_networks(file, f"{prefix}/value", [value_network], gradient)

        with torch.no_grad():
            advantage = target_q - forward(value_network, observations).squeeze(1)
            weights = torch.exp(temperature * advantage).clamp(max=weight_max)
        pi = torch.tanh(forward(actor, observations))
        if gaussian:
            density = torch.distributions.Normal(pi, log_std.clamp(-5, 2).exp())
            actor_loss = -(weights * density.log_prob(actions).sum(1)).mean()
        else:
            actor_loss = (weights[:, None] * (pi - actions)**2).mean()
        step_on(actor_loss, actor_adam)
        schedule.step()
        add_networks(file, f"{prefix}/actor", [actor], gradient)
        if gaussian:
            file.add(f"{prefix}/log_std", log_std.grad)

        with torch.no_grad():
            next_value = forward(value_network, batch["next_observations"]).squeeze(1)
            y = batch["rewards"] + GAMMA * batch["not_terminated"] * next_value
        critic_loss = sum(F.mse_loss(q, y) for q in q_values(critics))
        step_on(critic_loss, critic_adam)
        add_networks(file, f"{prefix}/critic", critics, gradient)
        polyak(critics, targets)
        file.add(f"step{step}/value_actor_critic_losses_and_mean_weight",
                 torch.stack([value_loss, actor_loss, critic_loss, weights.mean()]))

    for prefix, members in (("value", [value_network]), ("actor", [actor]), ("critic", critics),
                            ("critic_target", targets)):
        add_networks(file, f"final/{prefix}", members, value)
    if gaussian:
        file.add("final/log_std", log_std)
    file.write(FOLDER / name)


def ensemble():
    torch.manual_seed(3)
    file = File()
    outputs, members_count, hidden = OBSERVATION + 1, 3, (11, 10, 9, 13)
    decay = (2.5e-5, 5e-5, 7.5e-5, 7.5e-5, 1e-4)
    inputs = exact(torch.randn(BATCH, OBSERVATION + ACTION))
    target = exact(torch.randn(BATCH, outputs))
    file.add("batch/inputs", inputs)
    file.add("batch/targets", target)
    members = torch.nn.ModuleList(
        network(OBSERVATION + ACTION, *hidden, 2 * outputs) for _ in range(members_count))
    for member in members:  # raw log-variances on both sides of both bounds
        member[-1].bias.data[outputs:] = exact(torch.linspace(-14, 4, outputs))
    upper = torch.full((outputs,), 0.5, requires_grad=True)
    lower = torch.full((outputs,), -10.0, requires_grad=True)
    adam = torch.optim.Adam([*members.parameters(), upper, lower], lr=1e-3)
    add_networks(file, "initial/ensemble", members, value)
    for step in (1, 2):
        loss = 0.01 * upper.sum() - 0.01 * lower.sum()
        for member in members:
            mean, log_var = forward(member, inputs, F.silu).chunk(2, dim=1)
            log_var = upper - F.softplus(upper - log_var)
            log_var = lower + F.softplus(log_var - lower)
            loss = loss + ((mean - target)**2 * torch.exp(-log_var)).mean() + log_var.mean()
            loss = loss + sum(c * (l.weight**2).sum() for c, l in zip(decay, member))
        adam.zero_grad()
        loss.backward()
        add_networks(file, f"step{step}/gradient/ensemble", members, gradient)
        file.add(f"step{step}/gradient/max_log_var", upper.grad)
        file.add(f"step{step}/gradient/min_log_var", lower.grad)
        file.add(f"step{step}/loss", loss)
        adam.step()
    add_networks(file, "final/ensemble", members, value)
    file.add("final/max_log_var", upper)
    file.add("final/min_log_var", lower)
    file.write(FOLDER / "ensemble.ref")


if __name__ == "__main__":
    sac()
    td3("td3", seed=4)
    td3("td3_bc", seed=2, bc_alpha=2.5)
    iql(False, "iql_deterministic.ref")
    iql(True, "iql_gaussian.ref")
    ensemble()
