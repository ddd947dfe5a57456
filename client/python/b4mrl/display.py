"""How objects are displayed: as one line at a prompt, as a table in a notebook."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

T = TypeVar("T")


class Shown:
    """An object displayed by its facts: as `<Class fact='value', ...>`, or a table row for each."""

    def _facts(self) -> Mapping[str, Any]:
        """Name -> value of what tells this object from others. Must not ask the daemon."""
        raise NotImplementedError

    def __repr__(self) -> str:
        facts = ", ".join(f"{name}={value!r}" for name, value in self._facts().items())
        return f"<{type(self).__name__} {facts}>"

    def _repr_html_(self) -> str:
        return table((type(self).__name__, ""), self._facts().items())


class Record(Shown):
    """A dataclass whose facts are its fields."""

    def _facts(self) -> Mapping[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]


class Listing(list[T]):
    """A list of Shown objects; a notebook shows a table with a row for each."""

    def _repr_html_(self) -> str:
        return _rows(self)


class Table(dict[str, T]):
    """Shown objects by name; a notebook shows a table with a row for each."""

    def _repr_html_(self) -> str:
        return _rows(self.values())


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """An HTML table; all texts are escaped."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in header)
    body = "".join(
        f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row)}</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _rows(items: Iterable[Any]) -> str:
    facts = [item._facts() for item in items]
    return table(tuple(facts[0]) if facts else ("nothing",), (row.values() for row in facts))


def _cell(value: Any) -> str:
    if isinstance(value, tuple) and value and isinstance(value[0], Shown):
        return _rows(value)
    if isinstance(value, tuple):
        return html.escape(", ".join(map(str, value)))
    return html.escape(str(value))
