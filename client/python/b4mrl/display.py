"""How things show themselves: one line at a prompt, a table in a notebook."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

T = TypeVar("T")


class Shown:
    """A thing with facts: `<Name fact='value', ...>` as a line, a row a fact as a table."""

    def _facts(self) -> Mapping[str, Any]:
        """What tells this thing from another of its kind, in few words. Asks no server."""
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
    """A list of dataclasses."""

    def _repr_html_(self) -> str:
        return _rows(self)


class Table(dict[str, T]):
    """Dataclasses by name."""

    def _repr_html_(self) -> str:
        return _rows(self.values())


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """An HTML table, whatever the cells hold."""
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
