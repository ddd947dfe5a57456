"""Private daemons: started by a program for itself and stopped when it ends. Linux only."""

from __future__ import annotations

import multiprocessing
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
from b4mrl.errors import InvalidArgumentError, UnavailableError
from b4mrl.wire import checks, farewells

_STOP_SECONDS = 10.0  # after SIGTERM, before SIGKILL
_LONGEST_WAIT_SECONDS = 60.0  # at a time: the kernel takes no more than a C int of milliseconds

# Of sessions without requests; the longest that `b4mrl serve` takes (proto/base/limits.h). A private
# daemon ends with its program, so that sessions need not end before: a notebook may rest overnight.
_LEASE_SECONDS = 30 * 86_400
# Options with which the caller decides on the lease, or lets other machines open sessions.
_LEASE_OPTIONS = ("--lease", "--config", "--insecure")

_MOST_PATH_BYTES = 107  # of an ipc socket
_NAME_BYTES = len("/serve.worker-99")  # the longest name in the daemon's folder

# A fresh interpreter runs this text and then becomes the daemon. It asks the kernel to end the
# daemon when this process dies (PR_SET_PDEATHSIG, option 1 of prctl). This process cannot do that
# between fork and exec, where a program with threads must not run Python code.
_LAUNCHER = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGTERM)
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[2], sys.argv[2:])
"""


class PrivateDaemon(Shown):
    """A private daemon, which serve starts: `with b4mrl.serve() as endpoint: ...`.

    Thread rule: any thread may stop it, also one that has not started it.

    Attributes:
        endpoint: the address for b4mrl.connect.
        process_id: of the daemon's supervisor.
    """

    def __init__(self, command: Sequence[str], folder: str | None, ready_seconds: float) -> None:
        launcher = [sys.executable, "-S", "-E", "-c", _LAUNCHER, str(os.getpid())]
        try:
            self._process, keeper = _start([*launcher, *command])
        except BaseException:
            if folder is not None:
                shutil.rmtree(folder, ignore_errors=True)
            raise
        self.process_id = self._process.pid
        self._owner = os.getpid()
        # The finalizer stops the daemon when this object is collected and when the program ends.
        self._stop = weakref.finalize(self, _stop, self._process, keeper, folder, os.getpid())
        try:
            wanted = "tcp://" if folder is None else f"ipc://{folder}/"  # not the caller's own
            self.endpoint = self._await_ready(command[0], wanted, time.monotonic() + ready_seconds)
        except BaseException:
            self.stop()
            raise

    @property
    def is_running(self) -> bool:
        """False once the daemon has ended. A forked child cannot tell and always gets True."""
        return os.getpid() != self._owner or self._process.poll() is None

    def stop(self) -> int:
        """Ends the daemon by SIGTERM, or by SIGKILL ten seconds later; returns its exit status.

        May be called again. In a forked child, it does nothing.
        """
        due = self._stop.peek()  # kept until it has ended: an interrupted call stops nothing
        if due is not None:
            _, stop, arguments, _ = due
            stop(*arguments)
            self._stop.detach()
        return self._process.returncode or 0

    def _facts(self) -> Mapping[str, Any]:
        return {"endpoint": self.endpoint, "process_id": self.process_id}

    def __enter__(self) -> str:
        return self.endpoint

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _await_ready(self, binary: str, wanted: str, deadline: float) -> str:
        """Reads the daemon's output up to the first "ready ENDPOINT" that is wanted."""
        assert self._process.stdout is not None
        descriptor, text = self._process.stdout.fileno(), b""
        poll = select.poll()  # select.select knows no descriptor beyond 1,023
        poll.register(descriptor, select.POLLIN)
        while (left := deadline - time.monotonic()) > 0 and len(text) < 4096:
            if not poll.poll(min(left, _LONGEST_WAIT_SECONDS) * 1000):
                continue
            received = os.read(descriptor, 256)
            if not received:
                break
            text += received
            for line in text.split(b"\n")[:-1]:
                word, _, address = line.decode(errors="replace").partition(" ")
                if word == "ready" and address.startswith(wanted):
                    return address
        raise UnavailableError(
            f"the server {binary!r} did not get ready; its messages are on stderr"
        )


def _start(command: Sequence[str]) -> tuple[subprocess.Popen[bytes], threading.Event]:
    """Starts `command`; returns its process, and an event to set after the process was stopped.

    The kernel ends the process when the thread that started it ends, and the caller's thread may be
    a short-lived one of a pool. So a new thread starts the process and waits for the event.
    """
    started: queue.SimpleQueue[subprocess.Popen[bytes] | Exception] = queue.SimpleQueue()
    unwanted = threading.Event()
    is_abandoned = False  # Ctrl-C came before anyone had the process

    def start_and_stay() -> None:
        try:
            # In a session of its own, the daemon does not get a terminal's Ctrl-C: that is for this
            # program, which then stops the daemon.
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                start_new_session=True,
                env=_variables(),
            )
        except Exception as error:  # of the system, or of a word that no command can have
            started.put(error)
            return
        started.put(process)
        unwanted.wait()
        if is_abandoned:
            _stop(process, unwanted, None, os.getpid())

    keeper = threading.Thread(target=start_and_stay, name="b4mrl-serve", daemon=True)
    try:
        keeper.start()
        outcome = started.get()
    except BaseException:
        is_abandoned = True
        unwanted.set()
        raise
    if isinstance(outcome, Exception):
        raise UnavailableError(f"cannot start the server: {outcome}") from outcome
    return outcome, unwanted


def _variables() -> dict[str, str]:
    """The daemon's environment variables.

    The launcher `b4mrl` would run the program that B4MRL_SERVER names, but find_server has obeyed
    the variable already, and it may name the launcher itself.
    """
    kept = {name: value for name, value in os.environ.items() if name != "B4MRL_SERVER"}
    return {"SPDLOG_LEVEL": "warn"} | kept


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
    arguments: Sequence[str | os.PathLike[str] | float] = (),
    ready_seconds: float = 20.0,
) -> PrivateDaemon:
    """Starts a private daemon and waits until it is ready.

    The daemon's program is the one that $B4MRL_SERVER names (`b4mrl` stands for the `b4mrl-serve`
    beside it), else `b4mrl-serve` or `b4mrl` in PATH, else `build/release/b4mrl-serve` in the
    checkout that holds this package or the working folder, if that file and its folders are this
    user's or root's and not open to everyone.

    Args:
        tcp: listen on free tcp ports of loopback instead of ipc sockets in a private folder, which
            is made in /tmp where TMPDIR is too long for the paths of sockets.
        data, models, workers, threads: the options of `b4mrl serve` with these names. None: its
            defaults.
        arguments: further options of `b4mrl serve`, ["--lease", 60]. Unless they have --lease,
            --config or --insecure, sessions without requests stay for 30 days.
        ready_seconds: time within which the daemon must be ready.

    Raises:
        UnavailableError: the program is not found, or not ready in time, or there is no folder for
            the ipc sockets.
        InvalidArgumentError: `arguments` is no list, or `ready_seconds` no number above 0.
    """
    if isinstance(arguments, str) or not isinstance(arguments, Sequence):
        raise InvalidArgumentError(
            f"arguments is {arguments!r}, allowed: a list of options, ['--lease', 60]"
        )
    ready_seconds = checks.positive("ready_seconds", ready_seconds)
    command = find_server()
    folder = None if tcp else _make_folder()
    command += ["--bind", "tcp://127.0.0.1:0" if tcp else f"ipc://{folder}/serve"]
    if folder is not None:
        command.append("--own-folder")  # so that it does not stay where this process is killed
    options = {"--data": data, "--models": models, "--workers": workers, "--threads": threads}
    for name, value in options.items():
        if value is not None:
            command += [name, _word(value)]
    words = [_word(each) for each in arguments]
    if not any(word.startswith(_LEASE_OPTIONS) for word in words):
        command += ["--lease", str(_LEASE_SECONDS)]
    return PrivateDaemon([*command, *words], folder, ready_seconds)


def _word(value: Any) -> str:
    """A value as a word of a command."""
    return os.fsdecode(value) if isinstance(value, bytes | os.PathLike) else str(value)


def _make_folder() -> str:
    try:
        folder = tempfile.mkdtemp(prefix="b4mrl-")
        if len(os.fsencode(folder)) + _NAME_BYTES > _MOST_PATH_BYTES:
            os.rmdir(folder)
            folder = tempfile.mkdtemp(prefix="b4mrl-", dir="/tmp")
        return folder
    except OSError as error:
        raise UnavailableError(
            f"no folder for the server's ipc sockets can be made: {error}; let TMPDIR name a folder "
            "that can be written to, or call serve(tcp=True), which needs none"
        ) from None


def find_server() -> list[str]:
    """The daemon's command without options. UnavailableError: the program is not found."""
    for candidate in _candidates():
        if candidate and os.access(candidate, os.X_OK) and not os.path.isdir(candidate):
            return _command_of(os.path.abspath(candidate))
    raise UnavailableError(
        "the program b4mrl-serve is not found: name it in B4MRL_SERVER, add its folder to PATH, or "
        "work in a checkout of yours that was built (build/release) and is not open to everyone"
    )


def _command_of(program: str) -> list[str]:
    """The command of a daemon's program, or of the launcher `b4mrl` that stands before it."""
    if os.path.basename(program) != "b4mrl":
        return [program]
    server = os.path.join(os.path.dirname(program), "b4mrl-serve")
    return [server] if os.access(server, os.X_OK) else [program, "serve"]


def _candidates() -> Iterator[str | None]:
    if named := os.environ.get("B4MRL_SERVER"):
        if not os.access(named, os.X_OK) or os.path.isdir(named):
            raise UnavailableError(f"B4MRL_SERVER is {named!r}, allowed: an executable program")
        yield named
    yield shutil.which("b4mrl-serve")
    yield shutil.which("b4mrl")
    for start in (Path(__file__).resolve(), Path.cwd()):
        for folder in (start, *start.parents):
            built = (folder / "build" / "release" / "b4mrl-serve").resolve()
            if _is_trustworthy(built):
                yield str(built)


def _is_trustworthy(program: Path) -> bool:
    """Whether the program and its two folders are this user's or root's, and not open to others.

    Some folder around the package or the working folder may be open to everyone, as /tmp is.
    """
    try:
        facts = [path.stat() for path in (program, *program.parents[:2])]
    except OSError:
        return False
    return all(fact.st_uid in (0, os.getuid()) and not fact.st_mode & 0o002 for fact in facts)


_default_lock = threading.Lock()
_shared_daemon: PrivateDaemon | None = None


def _renew_lock() -> None:
    """In a forked child: the thread that held the parent's lock does not run here."""
    global _default_lock
    _default_lock = threading.Lock()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no forks and imports this module
    os.register_at_fork(after_in_child=_renew_lock)


def default_endpoint() -> str:
    """$B4MRL_ENDPOINT, else the address of this process's one private daemon, started if needed.

    A child of multiprocessing that was not forked from a process with such a daemon starts a small
    one, with one worker of one thread. So does one that was forked while the daemon started.
    """
    if named := os.environ.get("B4MRL_ENDPOINT"):
        return named
    global _shared_daemon
    with _default_lock:
        if _shared_daemon is None or not _shared_daemon.is_running:
            if multiprocessing.parent_process() is None:
                _shared_daemon = serve()
            else:  # one of several workers, such as AsyncVectorEnv's, which together fill the cores
                _shared_daemon = serve(workers=1, threads=1)
                farewells.call_at_the_end(_shared_daemon.stop)
        return _shared_daemon.endpoint


def is_default(endpoint: str) -> bool:
    """Whether default_endpoint returns `endpoint`; starts no daemon."""
    if named := os.environ.get("B4MRL_ENDPOINT"):
        return endpoint == named
    return _shared_daemon is not None and endpoint == _shared_daemon.endpoint
