"""How an environment or a dataset was opened, so that pickle and copy can open it again."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gymnasium.envs.registration import EnvSpec

from b4mrl.serve import is_default


@dataclass(frozen=True)
class Origin:
    """The arguments of an environment or a dataset, kept by pickle and copy instead of its state.

    The copy is a new environment or dataset, opened with the same arguments, as with Gymnasium's
    EzPickle.

    Attributes:
        opener: called with endpoint, deadline_ms and the arguments; can be pickled.
        endpoint, deadline_ms: of the client that opened the environment or dataset.
        arguments: of Client.make, make_vec or dataset, by name, as `opening.plain` makes them.
    """

    opener: Callable[..., Any]
    endpoint: str
    deadline_ms: float | None
    arguments: Mapping[str, Any]

    def open_again(self) -> Any:
        return self.opener(self.endpoint, self.deadline_ms, **self.arguments)

    def gym_spec(self) -> EnvSpec:
        """The spec from which gym.make or gym.make_vec makes the same environment.

        It names the daemon, unless that is the process's default one: a spec that is saved may be
        used by another process, which has a default of its own, after a private daemon's end.
        """
        given = copy.deepcopy(dict(self.arguments))  # the caller may change the spec
        if not is_default(self.endpoint):
            given["endpoint"] = self.endpoint
        return EnvSpec(
            id=f"b4mrl/{given['environment']}-v0",
            entry_point="b4mrl.registration:make",
            vector_entry_point="b4mrl.registration:make_vec",
            kwargs=given,
            order_enforce=False,
            disable_env_checker=True,
        )
