"""A whole run of H2O in plain PyTorch, to compare with `b4mrl train --algorithm h2o`.

    pip install torch==2.13.0 ./client/python
    python h2o_pytorch.py DATASET.h5 OUT.csv [--seed 0] [--updates 100000]

Niu et al. 2022 with the constants and the order of the authors' code, on HalfCheetah with doubled
gravity in the simulator. The program shares the simulator, the dataset and the client with b4mrl's
H2O, but no line of the learner. It starts a daemon for the run. OUT.csv has a row for every 1,000
updates with means over them, and every 10,000 updates an evaluation on the true HalfCheetah, as in
the CSV files of the parent folder.
"""

import argparse
import copy
import csv
import pathlib
from collections.abc import Iterable

import h5py
import numpy as np
import torch
from torch import nn
from torch.nn import functional

import b4mrl

OBSERVATION, ACTION, HIDDEN = 17, 6, 256
RATE, GAMMA, TAU = 3e-4, 0.99, 0.005
BATCH, DISCRIMINATOR_BATCH = 128, 256  # rows of each kind, real and simulated
INPUT_NOISE, GAP_SAMPLES, GAP_WEIGHT = 0.1, 10, 0.01
SIMULATED_PER_REAL = 10  # in the authors' array, whose s' give the noise's standard deviation
CYCLE, CYCLES_PER_EVALUATION, EPISODES = 1000, 10, 10
STATE, NEXT_STATE = 0, 3  # in a transition (s, a, r, s', terminated)

Transitions = list[torch.Tensor]


def trunk(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, HIDDEN),
        nn.ReLU(),
        nn.Linear(HIDDEN, HIDDEN),
        nn.ReLU(),
        nn.Linear(HIDDEN, outputs),
    )


def small_head(network: nn.Sequential) -> nn.Sequential:
    nn.init.xavier_uniform_(network[-1].weight, gain=1e-2)
    nn.init.zeros_(network[-1].bias)
    return network


class Policy(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.network = small_head(trunk(OBSERVATION, 2 * ACTION))
        self.scale = nn.Parameter(torch.tensor(1.0))
        self.offset = nn.Parameter(torch.tensor(-1.0))

    def moments(self, s: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        mean, raw = self.network(s).chunk(2, dim=1)
        return mean, (self.scale * raw + self.offset).clamp(-20, 2).exp()

    def forward(self, s: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        normal = torch.distributions.Normal(*self.moments(s))
        tanh = torch.distributions.transforms.TanhTransform(cache_size=1)
        squashed = torch.distributions.TransformedDistribution(normal, tanh)
        a = squashed.rsample()
        return a, squashed.log_prob(a).sum(dim=1)

    @torch.no_grad()
    def act(self, s: np.ndarray, deterministic: bool) -> np.ndarray:
        s = torch.as_tensor(s, dtype=torch.float32)[None]
        a = torch.tanh(self.moments(s)[0]) if deterministic else self(s)[0]
        return a[0].numpy()


class Critics(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.first = small_head(trunk(OBSERVATION + ACTION, 1))
        self.second = small_head(trunk(OBSERVATION + ACTION, 1))

    def forward(self, s: torch.Tensor, a: torch.Tensor) -> list[torch.Tensor]:
        x = torch.cat([s, a], dim=1)
        return [self.first(x).squeeze(1), self.second(x).squeeze(1)]


class Discriminator(nn.Module):
    """A network with bounded logits of the classes "real" and "simulated"."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.network = trunk(inputs, 2)

    def forward(self, *parts: torch.Tensor) -> torch.Tensor:
        return 2 * torch.tanh(self.network(torch.cat(parts, dim=1)))


class Rows:
    """Rows of a run: the real rows first, then room for all simulated ones."""

    def __init__(self, dataset: pathlib.Path, simulated: int) -> None:
        names = ("observations", "actions", "rewards", "next_observations", "terminals")
        with h5py.File(dataset) as file:
            columns = [file[name][:].astype(np.float32) for name in names]
        self.real = self.size = len(columns[0])
        self.columns = [
            np.concatenate([c.reshape(self.real, -1), np.zeros((simulated, c[0].size), c.dtype)])
            for c in columns
        ]
        self.columns[1].clip(-1, 1, out=self.columns[1])

    def append(self, *transition: float | np.ndarray) -> None:
        for column, value in zip(self.columns, transition, strict=True):
            column[self.size] = value
        self.size += 1

    def sample(self, rows: int, real: bool) -> Transitions:
        first, end = (0, self.real) if real else (self.real, self.size)
        chosen = np.random.randint(first, end, rows)
        return [torch.from_numpy(column[chosen]) for column in self.columns]

    def padded_deviation(self) -> torch.Tensor:
        s = self.columns[STATE][: self.real].astype(np.float64)
        rows = 1 + SIMULATED_PER_REAL
        variance = (s**2).mean(axis=0) / rows - (s.mean(axis=0) / rows) ** 2
        return torch.tensor(np.sqrt(variance) + 1e-3, dtype=torch.float32)


def adam(parameters: Iterable[nn.Parameter]) -> torch.optim.Optimizer:
    return torch.optim.Adam(parameters, lr=RATE, fused=True)


class H2o:
    def __init__(self, gap_deviation: torch.Tensor) -> None:
        self.gap_deviation = gap_deviation
        self.policy = Policy()
        self.critics = Critics()
        self.targets = copy.deepcopy(self.critics)
        self.d_sa = Discriminator(OBSERVATION + ACTION)
        self.d_sas = Discriminator(2 * OBSERVATION + ACTION)
        self.log_alpha = nn.Parameter(torch.tensor(0.0))
        self.policy_adam = adam(self.policy.parameters())
        self.critics_adam = adam(self.critics.parameters())
        self.alpha_adam = adam([self.log_alpha])
        self.d_sa_adam = adam(self.d_sa.parameters())
        self.d_sas_adam = adam(self.d_sas.parameters())

    def update_discriminators(self, rows: Rows) -> dict[str, float]:
        sa_loss = sas_loss = torch.tensor(0.0)
        batches = [rows.sample(DISCRIMINATOR_BATCH, real) for real in (True, False)]
        for label, (s, a, _, next_s, _) in enumerate(batches):
            s, a, next_s = (x + INPUT_NOISE * torch.randn(x.shape) for x in (s, a, next_s))
            sa = self.d_sa(s, a)
            classes = torch.full((len(s),), label)
            sa_loss = sa_loss + functional.cross_entropy(sa, classes)
            sas_loss = sas_loss + functional.cross_entropy(self.d_sas(s, a, next_s) + sa, classes)
        self.d_sa_adam.zero_grad()
        self.d_sas_adam.zero_grad()
        (sa_loss + sas_loss).backward()
        self.d_sa_adam.step()
        self.d_sas_adam.step()
        return {"d_sa_loss": sa_loss.item(), "d_sas_loss": sas_loss.item()}

    def log_ratio(self, s: torch.Tensor, a: torch.Tensor, next_s: torch.Tensor) -> torch.Tensor:
        """log p_real(s' | s, a) / p_simulated: what D_sa says cancels in Bayes' rule."""
        real, simulated = self.d_sas(s, a, next_s).unbind(dim=1)
        return real - simulated

    def gaps(self, s: torch.Tensor, a: torch.Tensor, next_s: torch.Tensor) -> torch.Tensor:
        s, a, next_s = (x.repeat_interleave(GAP_SAMPLES, dim=0) for x in (s, a, next_s))
        next_s = next_s + torch.randn(next_s.shape) * self.gap_deviation
        means = -self.log_ratio(s, a, next_s).reshape(-1, GAP_SAMPLES).mean(dim=1)
        return means.clamp(1e-45, 10)

    @torch.no_grad()
    def target_values(self, batch: Transitions) -> torch.Tensor:
        _, _, reward, next_s, terminated = batch
        next_q = torch.minimum(*self.targets(next_s, self.policy(next_s)[0]))
        return reward[:, 0] + GAMMA * (1 - terminated[:, 0]) * next_q

    def update(self, rows: Rows) -> dict[str, float]:
        real, simulated = (rows.sample(BATCH, kind) for kind in (True, False))
        metrics = self.update_discriminators(rows)

        s = torch.cat([real[STATE], simulated[STATE]])
        a, log_prob = self.policy(s)
        alpha = self.log_alpha.detach().exp()
        alpha_loss = -self.log_alpha * (log_prob.detach() - ACTION).mean()
        self.critics.requires_grad_(False)
        policy_loss = (alpha * log_prob - torch.minimum(*self.critics(s, a))).mean()
        self.critics.requires_grad_(True)

        real_y, simulated_y = self.target_values(real), self.target_values(simulated)
        dynamics = simulated[STATE], simulated[1], simulated[NEXT_STATE]
        with torch.no_grad():
            weight = self.log_ratio(*dynamics).exp().clamp(1e-5, 1)
            gap = self.gaps(*dynamics)
        q_real, q_simulated = self.critics(*real[:2]), self.critics(*simulated[:2])
        critics_loss = 0
        for q_d, q_b in zip(q_real, q_simulated):
            pushed = torch.logsumexp(q_b + (gap / gap.sum()).log(), dim=0) - q_d.mean()
            critics_loss += functional.mse_loss(q_d, real_y)
            critics_loss += (weight * (q_b - simulated_y) ** 2).mean()
            critics_loss += GAP_WEIGHT * pushed.clamp(-1000, 1000)

        for optimiser, loss in (
            (self.alpha_adam, alpha_loss),
            (self.policy_adam, policy_loss),
            (self.critics_adam, critics_loss),
        ):
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
        with torch.no_grad():
            for target, online in zip(self.targets.parameters(), self.critics.parameters()):
                target.lerp_(online, TAU)
        return metrics | {
            "q_real": q_real[0].mean().item(),
            "q_simulated": q_simulated[0].mean().item(),
            "weight": weight.mean().item(),
            "gap": gap.mean().item(),
            "alpha": alpha.item(),
        }


class Simulator:
    """The simulator; its episodes continue from one cycle to the next."""

    def __init__(self, environment: b4mrl.Environment, seed: int) -> None:
        self.environment = environment
        self.observation, _ = environment.reset(seed=seed)
        self.running_return, self.last_return = 0.0, 0.0

    def step(self, policy: Policy, rows: Rows) -> None:
        a = policy.act(self.observation, deterministic=False)
        next_s, reward, terminated, truncated, _ = self.environment.step(a)
        rows.append(self.observation, a, reward, next_s, terminated)
        self.observation = next_s
        self.running_return += reward
        if terminated or truncated:
            self.observation, _ = self.environment.reset()
            self.last_return, self.running_return = self.running_return, 0.0


def evaluate(environment: b4mrl.Environment, policy: Policy) -> dict[str, float]:
    returns = []
    for _ in range(EPISODES):
        s, _ = environment.reset()
        total, ended = 0.0, False
        while not ended:
            s, reward, terminated, truncated, _ = environment.step(policy.act(s, True))
            total += reward
            ended = terminated or truncated
        returns.append(total)
    score = environment.session.spec.normalised_score(np.mean(returns))
    return {"return": np.mean(returns), "return_std": np.std(returns), "score": score}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=pathlib.Path, help="dataset file of HalfCheetah")
    parser.add_argument("out", type=pathlib.Path, help="CSV file to write")
    parser.add_argument("--seed", type=int, default=0, help="seed of the run")
    parser.add_argument("--updates", type=int, default=100_000, help="gradient steps")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(arguments.seed)
    np.random.seed(arguments.seed)
    rows = Rows(arguments.dataset, arguments.updates)
    h2o = H2o(rows.padded_deviation())

    with b4mrl.serve() as endpoint, arguments.out.open("w", newline="") as out:
        client = b4mrl.connect(endpoint)
        simulator = Simulator(client.make("HalfCheetah", simulator="gravity"), arguments.seed)
        environment = client.make("HalfCheetah")
        environment.reset(seed=1000 + arguments.seed)
        table = None
        for cycle in range(1, arguments.updates // CYCLE + 1):
            for _ in range(CYCLE):
                simulator.step(h2o.policy, rows)
            metrics = [h2o.update(rows) for _ in range(CYCLE)]
            row = {"update": cycle * CYCLE, "environment_steps": cycle * CYCLE}
            row |= dict.fromkeys(("return", "return_std", "score"), "")
            if cycle % CYCLES_PER_EVALUATION == 0:
                row |= evaluate(environment, h2o.policy)
            row |= {name: np.mean([m[name] for m in metrics]) for name in metrics[0]}
            row["simulator_return"] = simulator.last_return
            if table is None:
                table = csv.DictWriter(out, row)
                table.writeheader()
            table.writerow({k: f"{v:.9g}" if v != "" else v for k, v in row.items()})
            out.flush()


if __name__ == "__main__":
    main()
