"""B4MRL's Python client: perturbed simulators and corrupted datasets of a daemon.

    import b4mrl

    with b4mrl.serve() as endpoint:  # a private daemon; connect takes a running one's address, too
        client = b4mrl.connect(endpoint)
        env = client.make("HalfCheetah", simulator="gravity")
        observation, info = env.reset(seed=1)
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

`Client` lists and opens environments and datasets; b4mrl.errors has the exceptions; b4mrl.sb3
adapts batches of environments to Stable-Baselines3. Thread rule: one thread at a time may use a
client, an environment or a dataset.
"""

from b4mrl.agent import Policy, load_agent, save_agent
from b4mrl.benchmarks.benchmark import Benchmark
from b4mrl.benchmarks.evaluation import Evaluation
from b4mrl.benchmarks.suites import benchmark, suite
from b4mrl.client import Client
from b4mrl.dataset import Dataset
from b4mrl.descriptions import DatasetStats
from b4mrl.environment import Environment
from b4mrl.errors import B4mrlError
from b4mrl.registration import connect, register
from b4mrl.serve import PrivateDaemon, serve
from b4mrl.spec import EnvironmentSpec, SpaceSpec
from b4mrl.vector_environment import VectorEnvironment
from b4mrl.version import __version__ as __version__

__all__ = [
    "B4mrlError",
    "Benchmark",
    "Client",
    "Dataset",
    "DatasetStats",
    "Environment",
    "EnvironmentSpec",
    "Evaluation",
    "Policy",
    "PrivateDaemon",
    "SpaceSpec",
    "VectorEnvironment",
    "benchmark",
    "connect",
    "load_agent",
    "register",
    "save_agent",
    "serve",
    "suite",
]

register()
