"""Reads the entries of agent files, which may be damaged or crafted.

Refuses what data/d4rl/agent_file.cc and data/hdf5/hdf5_reader.cc refuse, before memory is taken for
it. Reaches entries through hard links alone, so that no other file is opened.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from b4mrl.errors import DataLossError

Vector = NDArray[np.float32]
Layer = tuple[NDArray[np.float32], Vector]  # weight (outputs, inputs) and bias (outputs,)

MAX_HIDDEN_LAYERS = 16
MAX_WIDTH = 4096  # inputs and outputs of a layer
MAX_HISTORY = 64
MAX_UPDATES = 2**53
MAX_TEXT_BYTES = 64 * 1024

# Of `metadata`, which may be absent: C++ takes their bytes as they are.
_TEXTS = ("command", "simulator", "world", "dataset", "dataset_sha256", "corruption")

_MAX_CHUNK_BYTES = 256 * 1024 * 1024
# Deflate's best ratio; the slack covers small arrays, which are stored in headers.
_MAX_INFLATION = 1032
_INFLATION_SLACK_BYTES = 64 * 1024
_FILTERS = (1, 2, 3)  # deflate, shuffle, fletcher32


class AgentFile:
    """The entries of an open HDF5 file. DataLossError names the entry that cannot be read.

    Args:
        file: an h5py.File; owned by the caller.
    """

    def __init__(self, file: Any) -> None:
        self._file = file

    def __contains__(self, path: str) -> bool:
        return self._find(path) is not None

    def text(self, path: str) -> str:
        """A text of at most 64 KiB in UTF-8."""
        value = bytes(self._one(path, "S", "a single text"))
        try:
            return value.decode()
        except UnicodeDecodeError as error:
            raise DataLossError(f"{path} is {value!r}, allowed: UTF-8 ({error})") from None

    def number(self, path: str, high: int) -> int:
        """A whole number in 0..high."""
        value = float(self._one(path, "fiub", "a single number"))
        if not (0 <= value <= high and value.is_integer()):
            raise DataLossError(f"{path} is {value}, allowed: whole numbers in 0..{high}")
        return int(value)

    def vector(self, path: str, size: int, default: float) -> Vector:
        """`size` numbers, float32 (size,); `default` where the entry is absent or empty."""
        found = self._open(path, "fiub", "numbers") if path in self else None
        if found is None or found.size == 0:
            return np.full(size, default, np.float32)
        if found.size != size:
            raise DataLossError(f"{path} has {found.size} entries, allowed: {size}")
        return _numbers(path, found).reshape(-1)

    def layer(self, path: str) -> Layer:
        """A layer of 1..MAX_WIDTH inputs and outputs, of finite numbers."""
        weight = self._open(f"{path}/weight", "fiub", "numbers")
        shape = weight.shape
        if len(shape) != 2 or not 0 < min(shape) <= max(shape) <= MAX_WIDTH:
            raise DataLossError(
                f"{path}/weight has shape {shape}, allowed: (outputs, inputs), both 1..{MAX_WIDTH}"
            )
        bias = self._open(f"{path}/bias", "fiub", "numbers")
        if bias.size != shape[0]:
            raise DataLossError(f"{path}/bias has {bias.size} entries, allowed: {shape[0]}")
        layer = _numbers(f"{path}/weight", weight), _numbers(f"{path}/bias", bias).reshape(-1)
        for name, values in zip(("weight", "bias"), layer):
            if not np.isfinite(values).all():
                raise DataLossError(f"{path}/{name} has a number that is not finite")
        return layer

    def check_provenance(self) -> None:
        """Refuses entries of `metadata` that say how the agent came about, but cannot be read."""
        for name in _TEXTS:
            if f"metadata/{name}" in self:
                self._one(f"metadata/{name}", "S", "a single text")
        seed = self.text("metadata/seed") if "metadata/seed" in self else ""
        if seed and not (re.fullmatch("[0-9]{1,20}", seed) and int(seed) < 2**64):
            raise DataLossError(f"metadata/seed is {seed!r}, allowed: 0..{2**64 - 1}")
        if "metadata/iteration" in self:
            self.number("metadata/iteration", MAX_UPDATES)

    def _one(self, path: str, kinds: str, what: str) -> Any:
        """The only element of a dataset."""
        found = self._open(path, kinds, what)
        if found.size != 1:
            raise DataLossError(f"{path} has shape {found.shape}, allowed: {what}")
        with _reading(path):
            value = np.asarray(found[()]).reshape(-1)[0]
        if kinds == "S" and len(value) > MAX_TEXT_BYTES:
            raise DataLossError(f"{path} has {len(value)} bytes, allowed: {MAX_TEXT_BYTES}")
        return value

    def _find(self, path: str) -> Any:
        """The object at `path`; None if there is none that hard links lead to."""
        import h5py  # only here: HDF5 is slow to import

        found = self._file
        for name in path.split("/"):
            with _reading(path):
                link = found.get(name, getlink=True) if isinstance(found, h5py.Group) else None
                if not isinstance(link, h5py.HardLink):
                    return None
                found = found[name]
        return found

    def _open(self, path: str, kinds: str, what: str) -> Any:
        """The dataset at `path`, of which no element has been read yet.

        Args:
            kinds: allowed kinds of numpy's types; "S": texts of fixed or variable length.
            what: these kinds in words.
        """
        import h5py  # only here: HDF5 is slow to import

        found = self._find(path)
        if found is None:
            raise DataLossError(f"there is no {path}, allowed: {what}")
        if not isinstance(found, h5py.Dataset):
            raise DataLossError(f"{path} is a {type(found).__name__.lower()}, allowed: {what}")
        with _reading(path):
            dtype, shape = found.dtype, found.shape
            is_text = h5py.check_string_dtype(dtype) is not None
            kept = found.id.get_storage_size()
            odd = _oddity(found)
        if (kinds == "S") != is_text or (not is_text and dtype.kind not in kinds):
            raise DataLossError(f"{path} has the type {dtype}, allowed: {what}")
        if shape is None or len(shape) > 2:
            raise DataLossError(f"{path} has shape {shape}, allowed: at most 2 dimensions")
        if dtype.kind == "f" and dtype.itemsize not in (4, 8):
            raise DataLossError(f"{path} has the type {dtype}, allowed: float32, float64")
        if odd:
            raise DataLossError(f"{path} {odd}")
        declared = math.prod(shape) * dtype.itemsize
        if declared > _INFLATION_SLACK_BYTES + kept * _MAX_INFLATION:
            raise DataLossError(
                f"{path} declares {declared} bytes but stores {kept}: it is crafted, or was never "
                "written"
            )
        return found


def _oddity(dataset: Any) -> str:
    """What is unusual about how a dataset is stored, and what is allowed; "" for nothing."""
    import h5py  # only here: HDF5 is slow to import

    creation = dataset.id.get_create_plist()
    if dataset.is_virtual or creation.get_external_count():
        return "keeps its data in another file, allowed: data in this file"
    filters = [creation.get_filter(i)[0] for i in range(creation.get_nfilters())]
    if foreign := [each for each in filters if each not in _FILTERS]:
        return f"uses filter {foreign[0]}, allowed: deflate, shuffle, fletcher32"
    if creation.get_layout() == h5py.h5d.CHUNKED:
        chunk = math.prod(creation.get_chunk()) * dataset.dtype.itemsize
        if chunk > _MAX_CHUNK_BYTES:
            return f"declares chunks of {chunk} bytes, allowed: {_MAX_CHUNK_BYTES}"
    return ""


def _numbers(path: str, dataset: Any) -> NDArray[np.float32]:
    with _reading(path), np.errstate(over="ignore"):
        return np.asarray(dataset[()], np.float32)


@contextlib.contextmanager
def _reading(path: str) -> Iterator[None]:
    """Turns what h5py raises on a damaged entry into DataLossError."""
    try:
        yield
    except (OSError, LookupError, TypeError, ValueError, RuntimeError) as error:
        raise DataLossError(f"{path} cannot be read: {error}") from None
