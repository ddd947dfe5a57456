"""A daemon of one's own: started for one program, stopped with it. Linux only."""

from __future__ import annotations

import os
import queue
import select
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from b4mrl.display import Shown
from b4mrl.errors import UnavailableError

_STOP_SECONDS = 10.0  # after SIGTERM, before SIGKILL

# Runs in a fresh interpreter between this process and the daemon: the kernel shall end the daemon
# when this process dies (PR_SET_PDEATHSIG is 1), and no other code may run between fork and exec
# in a process that may have threads.
_LAUNCHER = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGTERM)
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[2], sys.argv[2:])
"""


class PrivateDaemon(Shown):
    """What serve returns: `with b4mrl.serve() as endpoint: ...`, or `endpoint` and `stop()`.

    Attributes:
        endpoint: where clients connect.
        process_id: of the supervisor.
    """

    def __init__(self, command: Sequence[str], folder: str | None, ready_seconds: float) -> None:
        launcher = [sys.executable, "-S", "-E", "-c", _LAUNCHER, str(os.getpid())]
        self._process, keeper = _start([*launcher, *command])
        self.process_id = self._process.pid
        self._owner = os.getpid()
        # Also when the object is collected, or the program ends.
        self._stop = weakref.finalize(self, _stop, self._process, keeper, folder, os.getpid())
        try:
            self.endpoint = self._await_ready(command[0], time.monotonic() + ready_seconds)
        except BaseException:
            self.stop()
            raise

    @property
    def is_running(self) -> bool:
        """False once the daemon has ended. A forked child cannot tell, and believes that it runs."""
        return os.getpid() != self._owner or self._process.poll() is None

    def stop(self) -> int:
        """Ends the daemon with SIGTERM, after ten seconds with SIGKILL; returns its exit status.

        May be called again. In a forked child it does nothing.
        """
        self._stop()
        return self._process.returncode or 0

    def _facts(self) -> Mapping[str, Any]:
        return {"endpoint": self.endpoint, "process_id": self.process_id}

    def __enter__(self) -> str:
        return self.endpoint

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _await_ready(self, binary: str, deadline: float) -> str:
        """Reads the daemon's output up to "ready ENDPOINT"; the rest goes nowhere."""
        assert self._process.stdout is not None
        descriptor, text = self._process.stdout.fileno(), b""
        while (left := deadline - time.monotonic()) > 0 and len(text) < 4096:
            if not select.select([descriptor], [], [], left)[0]:
                continue
            received = os.read(descriptor, 256)
            if not received:
                break
            text += received
            for line in text.split(b"\n")[:-1]:
                if line.startswith(b"ready "):
                    return line.removeprefix(b"ready ").decode()
        raise UnavailableError(
            f"the server {binary!r} did not get ready; its messages are on stderr"
        )


def _start(command: Sequence[str]) -> tuple[subprocess.Popen[bytes], threading.Event]:
    """The process of `command`, and what to set when it is not wanted any more.

    The kernel ties the process to the thread that starts it, and the caller's may be one of a
    pool's: a thread of its own starts it and stays.
    """
    started: queue.SimpleQueue[subprocess.Popen[bytes] | OSError] = queue.SimpleQueue()
    unwanted = threading.Event()

    def start_and_stay() -> None:
        try:
            # A session of its own: a terminal's Ctrl-C is for this program, which ends the daemon.
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                start_new_session=True,
                env={"SPDLOG_LEVEL": "warn"} | dict(os.environ),
            )
        except OSError as error:
            started.put(error)
            return
        started.put(process)
        unwanted.wait()

    threading.Thread(target=start_and_stay, name="b4mrl-serve", daemon=True).start()
    outcome = started.get()
    if isinstance(outcome, OSError):
        raise outcome
    return outcome, unwanted


def _stop(
    process: subprocess.Popen[bytes], keeper: threading.Event, folder: str | None, owner: int
) -> None:
    if os.getpid() != owner:
        return
    process.terminate()
    try:
        process.wait(_STOP_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    keeper.set()
    if process.stdout is not None:
        process.stdout.close()
    if folder is not None:
        shutil.rmtree(folder, ignore_errors=True)


def serve(
    *,
    tcp: bool = False,
    data: str | os.PathLike[str] | None = None,
    models: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    threads: int | None = None,
    arguments: Sequence[str] = (),
    ready_seconds: float = 20.0,
) -> PrivateDaemon:
    """Starts a private daemon and waits until it is ready.

    The program is $B4MRL_SERVER, else `b4mrl-serve` or `b4mrl` in PATH, else in `build/release` of
    the checkout that this package or the working folder lies in.

    Args:
        tcp: listen on loopback with free ports; otherwise on an ipc socket in a private folder.
        data, models, workers, threads: the options of `b4mrl serve`. None: its defaults.
        arguments: further options of `b4mrl serve`.

    Raises:
        UnavailableError: the program is not found, or not ready in time.
    """
    command = find_server()
    folder = None if tcp else tempfile.mkdtemp(prefix="b4mrl-")
    command += ["--bind", "tcp://127.0.0.1:0" if tcp else f"ipc://{folder}/serve"]
    options = {"--data": data, "--models": models, "--workers": workers, "--threads": threads}
    for name, value in options.items():
        if value is not None:
            command += [name, os.fspath(value) if isinstance(value, os.PathLike) else str(value)]
    try:
        return PrivateDaemon([*command, *arguments], folder, ready_seconds)
    except OSError as error:
        raise UnavailableError(f"cannot run the server {command[0]!r}: {error}") from None


def find_server() -> list[str]:
    """The command that runs the daemon, without its options. UnavailableError: there is none."""
    for candidate in _candidates():
        if candidate and os.access(candidate, os.X_OK) and not os.path.isdir(candidate):
            path = os.path.abspath(candidate)
            return [path, "serve"] if os.path.basename(path) == "b4mrl" else [path]
    raise UnavailableError(
        "the program b4mrl-serve is not found: name it in B4MRL_SERVER, add its folder to PATH, or "
        "work in a checkout that was built (build/release)"
    )


def _candidates() -> Iterator[str | None]:
    if named := os.environ.get("B4MRL_SERVER"):
        if not os.access(named, os.X_OK):
            raise UnavailableError(f"B4MRL_SERVER is {named!r}, which is no program")
        yield named
    yield shutil.which("b4mrl-serve")
    yield shutil.which("b4mrl")
    for start in (Path(__file__).resolve(), Path.cwd()):
        for folder in (start, *start.parents):
            yield str(folder / "build" / "release" / "b4mrl-serve")


_default_lock = threading.Lock()
_shared_daemon: PrivateDaemon | None = None


def default_endpoint() -> str:
    """$B4MRL_ENDPOINT, or a private daemon that this process shares and stops when it ends."""
    if named := os.environ.get("B4MRL_ENDPOINT"):
        return named
    global _shared_daemon
    with _default_lock:
        if _shared_daemon is None or not _shared_daemon.is_running:
            _shared_daemon = serve()
        return _shared_daemon.endpoint
