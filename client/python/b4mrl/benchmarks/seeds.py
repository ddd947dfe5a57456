"""Seeds for the purposes of a run, equal to those of `b4mrl train` and `b4mrl evaluate`."""

from __future__ import annotations

_ALL_BITS = 2**64 - 1


def role_seed(seed: int, role: str, index: int = 0) -> int:
    """The 64-bit seed of use `index` of `role` in a run with `seed` (proto/base/role_seed.h)."""
    return _mix(_mix(seed, hash_name(role)), index)


def hash_name(name: str) -> int:
    """The 64-bit FNV-1a hash of a name (proto/base/rng.h)."""
    found = 0xCBF29CE484222325
    for byte in name.encode():
        found = (found ^ byte) * 0x100000001B3 & _ALL_BITS
    return found


def _mix(a: int, b: int) -> int:
    return _finalize(_finalize(a + 0x9E3779B97F4A7C15) + b + 0x9E3779B97F4A7C15)


def _finalize(z: int) -> int:
    """splitmix64's finaliser."""
    z &= _ALL_BITS
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & _ALL_BITS
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB & _ALL_BITS
    return z ^ (z >> 31)
