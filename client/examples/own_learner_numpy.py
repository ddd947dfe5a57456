"""A learner of one's own, in twenty lines of numpy: behaviour cloning by ridge regression.

    b4mrl benchmark run 'HalfCheetah/confounding/*' \
        --learner 'python client/examples/own_learner_numpy.py' --name ridge

trains and scores it on each of these benchmarks. The runner starts this program once for each
benchmark and seed.
"""

import b4mrl
import numpy as np

bench = b4mrl.benchmark()  # the one that the runner asks for
data = bench.dataset.load()
mean, std = data["observations"].mean(axis=0), data["observations"].std(axis=0) + 1e-3
inputs = (data["observations"] - mean) / std * bench.mask.reshape(-1)  # rows are flat
inputs = np.column_stack([inputs, np.ones(len(inputs))])
targets = np.arctanh(np.clip(data["actions"], -0.99, 0.99))  # a saved agent ends with tanh
penalty = 10.0 * np.eye(inputs.shape[1])
weights = np.linalg.solve(inputs.T @ inputs + penalty, inputs.T @ targets).T
b4mrl.save_agent(
    bench.out / "agent.h5",
    [(weights[:, :-1], weights[:, -1])],
    environment=bench.environment,
    mask=bench.mask,
    observation_mean=mean,
    observation_std=std,
    seed=bench.seed,
    updates=1,  # that many steps it took
)
