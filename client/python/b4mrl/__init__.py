"""B4MRL's Python client: perturbed simulators and corrupted datasets of a daemon.

    import b4mrl

    with b4mrl.serve() as endpoint:  # or a daemon that runs already
        client = b4mrl.connect(endpoint)
        env = client.make("HalfCheetah", simulator="gravity")
        observation, info = env.reset(seed=1)
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

`Client` says what there is; b4mrl.errors what can go wrong; b4mrl.sb3 adapts to Stable-Baselines3.
Thread rule: every client, environment and dataset is for one thread at a time.
"""

from b4mrl.agent import Policy, load_agent
from b4mrl.client import Client
from b4mrl.dataset import Dataset, DatasetStats
from b4mrl.environment import Environment
from b4mrl.errors import B4mrlError
from b4mrl.registration import connect, register
from b4mrl.serve import PrivateDaemon, serve
from b4mrl.spec import EnvironmentSpec, SpaceSpec
from b4mrl.vector_environment import VectorEnvironment
from b4mrl.version import __version__ as __version__

__all__ = [
    "B4mrlError",
    "Client",
    "Dataset",
    "DatasetStats",
    "Environment",
    "EnvironmentSpec",
    "Policy",
    "PrivateDaemon",
    "SpaceSpec",
    "VectorEnvironment",
    "connect",
    "load_agent",
    "register",
    "serve",
]

register()
