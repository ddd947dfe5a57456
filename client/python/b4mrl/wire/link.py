"""What a connection needs of its transport: messages in both directions, each whole or lost."""

from __future__ import annotations

from typing import Protocol

Message = tuple[bytes, bytearray]  # envelope, and payload: the bytes of the arrays, empty without

LONGEST_BLOCK_MS = 20  # longest wait in one call, after which a connection looks around

# What a link returns for bytes that are no message: its envelope names request 0, which none has.
NOISE: Message = (b"", bytearray())


class Link(Protocol):
    """A way to one process of the daemon, which outlives a replacement of the process.

    Messages may be lost while the process is replaced. Ctrl-C in a call loses at most one message,
    and never the boundary between two.

    Thread rule: one thread at a time. A forked child cannot use the link; close frees there what
    the child has of it, and the parent's link stays as it is.
    """

    @property
    def transport(self) -> str:
        """How messages travel: "door", "ipc" or "tcp"."""

    @property
    def address(self) -> str:
        """Where the process listens: "door://NAME", "ipc://PATH" or "tcp://HOST:PORT"."""

    @property
    def process_id(self) -> int:
        """The process that opened the link."""

    @property
    def is_refused(self) -> bool:
        """Whether the link has given up, so that no message will come through it any more."""

    def send(self, envelope: bytes, payload: bytearray) -> bool:
        """Sends a message without waiting for the peer; False if the queue towards it is full.

        The link keeps `payload` until it is sent, so the caller must not change it.
        UnavailableError: the link failed.
        """

    def receive(self, wait_ms: int) -> Message | None:
        """The next message; None if there is none within `wait_ms` or LONGEST_BLOCK_MS.

        UnavailableError: the link failed.
        """

    def take_handshakes(self) -> int:
        """The number of connections to the process that were made since the last call."""

    def await_handshake(self, wait_ms: int) -> None:
        """Waits until there may be a handshake to take, at most `wait_ms`."""

    def close(self, linger_ms: int = 0) -> None:
        """Closes the link; queued messages may be sent on for up to `linger_ms`."""
