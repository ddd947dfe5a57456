"""The curve of a run: its evaluations in the order of updates, and the episodes that they took."""

from __future__ import annotations

from b4mrl.benchmarks.result_file import Point


class Curve:
    """The evaluations that a result of a run will have.

    Attributes:
        points: of the result's entry `curve`.
    """

    def __init__(self) -> None:
        self.points: list[Point] = []
        self._episodes: list[int] = []  # of each point

    @property
    def episodes(self) -> int:
        """The episodes of all points, as the runner counts those of a learner's curve.

        Evaluations that are no points count for nothing: those of points that were dropped, those
        that a learner makes for itself, and a result's further scorings.
        """
        return sum(self._episodes)

    def append(self, point: Point, episodes: int) -> None:
        """Adds a point; drops those at its updates and beyond, from which the run began again."""
        kept = sum(updates < point[0] for updates, *_ in self.points)
        self.points = [*self.points[:kept], point]
        self._episodes = [*self._episodes[:kept], episodes]
