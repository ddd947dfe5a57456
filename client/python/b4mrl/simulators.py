"""Parses perturbations of a simulator, or corruptions of a dataset, from how users write them."""

from __future__ import annotations

import operator
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from b4mrl.errors import InvalidArgumentError
from b4mrl.wire import checks

# "gravity=1.5,hidden=9+10"; {"gravity": 1.5, "hidden": [9, 10]}; ["gravity=1.5", "obs-noise-low"].
Simulator = str | Mapping[str, Any] | Sequence[Any] | None

_ALLOWED = (
    "allowed: 'gravity=1.5,obs-noise-low', {'gravity': 1.5} or ['gravity=1.5', 'obs-noise-low']"
)


@dataclass(frozen=True)
class NamedArgument:
    """A perturbation or corruption; str() is its text, "gravity=1.5".

    Attributes:
        name: name of a preset or of a parametric form.
        argument: argument of the parametric form; "" for a preset.
    """

    name: str
    argument: str = ""

    def __str__(self) -> str:
        return f"{self.name}={self.argument}" if self.argument else self.name


def parse(simulator: Simulator, name: str = "simulator") -> tuple[NamedArgument, ...]:
    """The perturbations of `simulator`, in their order. The daemon checks their names and values.

    `simulator` is a text with commas between perturbations; or a dict from names to values, where a
    value is a number, a text, a list of dimensions by numbers or names, or None or True for a
    preset; or a list of texts, (name, value) pairs and dicts. InvalidArgumentError: `simulator` has
    another form; the message calls it `name`.
    """
    items = _parse(simulator, name)
    for item in items:
        checks.text("perturbation", str(item))
    return items


def plain(simulator: Simulator, name: str = "simulator") -> str | list[list[str | None]] | None:
    """`simulator` as a text; None for None. If a value has a comma: as pairs [name, value].

    What it returns means the same to `parse`, becomes JSON and does not change with the caller's
    dict or list. Raises as `parse`.
    """
    if simulator is None:
        return None
    items = parse(simulator, name)
    text = text_of(items)
    return text if parse(text) == items else [[it.name, it.argument or None] for it in items]


def text_of(items: Iterable[NamedArgument]) -> str:
    """The perturbations as one text, "gravity=1.5,obs-noise-low"."""
    return ",".join(map(str, items))


def _parse(simulator: Simulator, name: str) -> tuple[NamedArgument, ...]:
    if simulator is None:
        return ()
    if isinstance(simulator, str):
        return tuple(_parse_text(item, simulator) for item in simulator.split(",") if simulator)
    if isinstance(simulator, Mapping):
        return tuple(_named(name, value) for name, value in simulator.items())
    if isinstance(simulator, Sequence):
        return tuple(item for entry in simulator for item in _parse_entry(entry))
    raise InvalidArgumentError(f"{name} is {simulator!r}, {_ALLOWED}")


def _parse_entry(entry: Any) -> tuple[NamedArgument, ...]:
    if isinstance(entry, NamedArgument):
        return (entry,)
    if isinstance(entry, str | Mapping):
        return _parse(entry, "simulator")
    if isinstance(entry, Sequence) and len(entry) == 2:
        return (_named(*entry),)
    raise InvalidArgumentError(f"perturbation is {entry!r}, {_ALLOWED}")


def _parse_text(item: str, whole: str) -> NamedArgument:
    name, equals, argument = (part.strip() for part in item.partition("="))
    if not name or (equals and not argument):
        raise InvalidArgumentError(
            f"perturbation is {item!r}, allowed: name or name=argument, separated by commas"
        )
    if re.fullmatch(r"[-+.\d]+", name):
        raise InvalidArgumentError(
            f"perturbation is {item!r} in {whole!r}, allowed: a name; "
            "dimensions are joined by '+', as in hidden=1+2"
        )
    return NamedArgument(name, argument)


def _named(name: Any, value: Any) -> NamedArgument:
    if not isinstance(name, str) or not name:
        raise InvalidArgumentError(f"perturbation is {name!r}, {_ALLOWED}")
    if value is None or value is True:
        return NamedArgument(name)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, str) and value:
        return NamedArgument(name, value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return NamedArgument(name, repr(value))
    if isinstance(value, list | tuple) and value and all(map(_is_dimension, value)):
        return NamedArgument(name, "+".join(map(_dimension, value)))
    raise InvalidArgumentError(
        f"{name} is {value!r}, allowed: a number, text, list of dimensions, None for a preset, "
        "or a range '0.5..2'"
    )


def _is_dimension(value: Any) -> bool:
    """Whether `value` may be a dimension's name or number, also one of list(np.flatnonzero(mask))."""
    if isinstance(value, str):
        return value != ""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _dimension(value: Any) -> str:
    return value if isinstance(value, str) else str(operator.index(value))
