"""How something of the daemon was opened, so that it can be opened again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gymnasium.envs.registration import EnvSpec


@dataclass(frozen=True)
class Origin:
    """What pickle and copy keep of an environment or a dataset, as Gymnasium's EzPickle does.

    What they give is a new one, opened with the same arguments; the state of the old one stays
    where it is.

    Attributes:
        opener: takes endpoint, deadline_ms and the arguments; a function of a module.
        endpoint, deadline_ms: of the client.
    """

    opener: Callable[..., Any]
    endpoint: str
    deadline_ms: float | None
    arguments: Mapping[str, Any]

    def open_again(self) -> Any:
        return self.opener(self.endpoint, self.deadline_ms, **self.arguments)

    def gym_spec(self) -> EnvSpec:
        """The spec by which gym.make and gym.make_vec make the same."""
        given = dict(self.arguments)
        return EnvSpec(
            id=f"b4mrl/{given['environment']}-v0",
            entry_point="b4mrl.registration:make",
            vector_entry_point="b4mrl.registration:make_vec",
            kwargs=given | {"endpoint": self.endpoint},
            order_enforce=False,
            disable_env_checker=True,
        )
