"""A daemon of one's own, and the registry that starts one."""

from __future__ import annotations

import errno
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import b4mrl
import gymnasium as gym
import pytest
from b4mrl import errors
from b4mrl.serve import find_server

PROGRAM = find_server()[0]


def is_running(process_id: int) -> bool:
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return False
    return True


def test_it_runs_as_long_as_the_block() -> None:
    daemon = b4mrl.serve()
    with daemon as endpoint:
        assert endpoint.startswith("ipc://")
        with b4mrl.connect(endpoint) as client, client.make("HalfCheetah") as env:
            env.reset()
        folder = Path(endpoint.removeprefix("ipc://")).parent
        assert folder.is_dir()
    assert not is_running(daemon.process_id)
    assert not folder.exists()
    assert daemon.stop() == 0


def test_a_stop_that_was_interrupted_is_made_again() -> None:
    daemon = b4mrl.serve(ready_seconds=1e7)  # more than the kernel waits at a time
    _, stop, arguments, _ = daemon._stop.peek()
    daemon._stop.detach()

    def interrupted_once(*arguments: object) -> None:
        nonlocal calls
        calls += 1
        if calls == 1:
            raise KeyboardInterrupt
        stop(*arguments)

    calls = 0
    daemon._stop = weakref.finalize(daemon, interrupted_once, *arguments)
    with pytest.raises(KeyboardInterrupt):
        daemon.stop()
    assert daemon.is_running
    assert daemon.stop() == daemon.stop() == 0
    assert calls == 2
    assert not is_running(daemon.process_id)


def test_it_starts_in_a_program_with_more_than_a_thousand_open_files() -> None:
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = limits[1] if limits[1] != resource.RLIM_INFINITY else 4096
    if most < 2048:
        pytest.skip("so many files may not be open here")
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, 4096), limits[1]))
    files = [os.open(os.devnull, os.O_RDONLY) for _ in range(1100)]  # select takes 1,024
    try:
        with b4mrl.serve() as endpoint, b4mrl.connect(endpoint) as client:
            assert client.environments()
    finally:
        for file in files:
            os.close(file)
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


def test_it_outlives_the_thread_that_started_it() -> None:
    with ThreadPoolExecutor() as pool:
        daemon = pool.submit(b4mrl.serve).result()
    with daemon as endpoint, b4mrl.connect(endpoint) as client, client.make("HalfCheetah") as env:
        env.reset()
        assert daemon.is_running
    assert not daemon.is_running


def test_its_options_are_those_of_the_command() -> None:
    options = {"workers": 3, "threads": 1, "arguments": ["--lease", 60]}
    with b4mrl.serve(tcp=True, **options) as endpoint, b4mrl.connect(endpoint) as client:
        roles = [worker.role for worker in client.server_status().workers]
        assert sum(role.startswith("worker-") for role in roles) == 3


@pytest.mark.parametrize(
    ("arguments", "seconds"),
    [
        ([], 30 * 86_400),
        (["--lease", 60], 60),
        (["--lease=61"], 61),
        (["--config", "serve.toml"], 62),
    ],
)
def test_its_sessions_last_as_long_as_it_does_unless_the_caller_sets_a_lease(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: list, seconds: int
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("serve.toml").write_text("lease = 62\n")
    with b4mrl.serve(workers=1, arguments=arguments) as endpoint:
        with b4mrl.connect(endpoint) as client:
            assert client.hello.limits.session_lease_ms == 1000 * seconds


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"arguments": "--no-door"}, "^arguments is '--no-door', allowed: a list of options"),
        ({"arguments": 3}, "^arguments is 3, allowed"),
        ({"ready_seconds": "20"}, "^ready_seconds is '20', allowed: a finite number above 0$"),
        ({"data": "a\0b"}, "^cannot start the server: embedded null byte$"),
        ({"arguments": ["x" * 3_000_000]}, "^cannot start the server: .*too long"),
    ],
)
def test_options_that_no_command_can_have_are_refused_and_leave_no_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, options: dict, complaint: str
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(b4mrl.B4mrlError, match=complaint):
        b4mrl.serve(**options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_it_dies_with_the_program_that_started_it_and_its_folder_too(end: signal.Signals) -> None:
    code = (
        "import b4mrl, signal; daemon = b4mrl.serve(); print(daemon.process_id); "
        "print(daemon.endpoint, flush=True); signal.pause()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as program:
        daemon = int(program.stdout.readline())
        address = program.stdout.readline().decode().strip()
        watched = os.pidfd_open(daemon)
        program.send_signal(end)
    assert select.select([watched], [], [], 20)[0], "the daemon outlived its program"
    assert not Path(address.removeprefix("ipc://")).parent.exists()


@pytest.mark.parametrize(
    ("variable", "complaint"),
    [
        ("/does/not/exist", "executable program"),
        ("/bin", "executable program"),
        ("/bin/false", "^the server '/bin/false' did not"),
    ],
)
def test_a_program_that_does_not_serve_is_named(
    monkeypatch: pytest.MonkeyPatch, variable: str, complaint: str
) -> None:
    monkeypatch.setenv("B4MRL_SERVER", variable)
    with pytest.raises(errors.UnavailableError, match=complaint):
        b4mrl.serve()


def test_a_machine_without_a_folder_for_sockets_is_told_what_to_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(prefix: str) -> str:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found")

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    with pytest.raises(errors.UnavailableError, match="No usable.*TMPDIR.*tcp=True"):
        b4mrl.serve()
    with b4mrl.serve(tcp=True) as endpoint:
        assert endpoint.startswith("tcp://")


@pytest.mark.parametrize("length", [70, 99, 150])
def test_a_folder_whose_path_is_too_long_for_sockets_is_not_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, length: int
) -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as short:
        long = Path(short, "x" * (length - len(short) - 1))
        long.mkdir()
        monkeypatch.setattr("tempfile.tempdir", str(long))
        with b4mrl.serve(workers=1) as endpoint, b4mrl.connect(endpoint) as client:
            is_kept = endpoint.startswith(f"ipc://{long}/b4mrl-")
            assert is_kept or endpoint.startswith("ipc:///tmp/b4mrl-")
            assert is_kept == (length == 70)
            with client.make("HalfCheetah") as env:
                env.reset()
        assert list(long.iterdir()) == []


PROGRAM_WITH_WORKERS = """
import multiprocessing, os, sys
import gymnasium as gym
from gymnasium.vector import AsyncVectorEnv

def make():
    import b4mrl
    if multiprocessing.parent_process():  # AsyncVectorEnv makes one in its own process, too
        roles = [worker.role for worker in b4mrl.connect().server_status().workers]
        with open(os.path.join(sys.argv[1], str(os.getpid())), "w") as file:
            file.write(" ".join(role for role in roles if role.startswith("worker-")))
    return gym.make("b4mrl:b4mrl/HalfCheetah-v0")

if __name__ == "__main__":
    vec = AsyncVectorEnv([make] * 2, context=sys.argv[2])
    vec.reset(seed=1)
    if sys.argv[3] == "closed":
        vec.close()
    elif sys.argv[3] == "abandoned":  # multiprocessing sends SIGTERM to its daemonic children
        type(vec).__del__ = lambda vec: None
"""


@pytest.mark.parametrize("context", ["spawn", "forkserver"])
@pytest.mark.parametrize("end", ["closed", "abandoned"])
def test_worker_processes_start_small_daemons_and_leave_nothing(
    tmp_path: Path, context: str, end: str
) -> None:
    program, said = tmp_path / "program.py", tmp_path / "said"
    said.mkdir()
    program.write_text(PROGRAM_WITH_WORKERS)
    clean = {name: value for name, value in os.environ.items() if name != "B4MRL_ENDPOINT"}
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:  # a short path, for sockets
        done = subprocess.run(
            [sys.executable, program, said, context, end],
            env=clean | {"TMPDIR": folder},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert (done.returncode, done.stderr) == (0, "")
        assert [file.read_text() for file in said.iterdir()] == ["worker-0"] * 2
        assert list(Path(folder).glob("b4mrl-*")) == []


def test_the_program_is_found_in_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("B4MRL_SERVER", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    (tmp_path / "b4mrl").symlink_to(PROGRAM)
    assert find_server() == [str(tmp_path / "b4mrl"), "serve"]


def test_the_launcher_may_be_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    launcher = Path(PROGRAM).with_name("b4mrl")
    monkeypatch.setenv("B4MRL_SERVER", str(launcher))
    assert find_server() == [str(launcher.with_name("b4mrl-serve"))]
    alone = tmp_path / "b4mrl"
    alone.symlink_to(launcher)
    monkeypatch.setenv("B4MRL_SERVER", str(alone))  # which the launcher itself would obey
    assert find_server() == [str(alone), "serve"]
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        assert client.environments()


@pytest.mark.parametrize("inside", ["the package", "the working folder"])
def test_the_program_is_found_in_a_checkout_to_which_no_one_else_may_write(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, inside: str
) -> None:
    monkeypatch.delenv("B4MRL_SERVER", raising=False)
    monkeypatch.setenv("PATH", "")
    program = tmp_path / "checkout" / "build" / "release" / "b4mrl-serve"
    program.parent.mkdir(parents=True)
    shutil.copy("/bin/true", program)
    folder = tmp_path / "checkout" / "sub"
    folder.mkdir()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    package = folder if inside == "the package" else elsewhere
    monkeypatch.setitem(find_server.__globals__, "__file__", str(package / "serve.py"))
    monkeypatch.chdir(folder if inside == "the working folder" else elsewhere)
    assert find_server() == [str(program)]
    for path in (program, program.parent, program.parent.parent):
        mode = path.stat().st_mode
        path.chmod(mode | 0o002)
        with pytest.raises(errors.UnavailableError, match="not open to everyone"):
            find_server()
        path.chmod(mode)
    assert find_server() == [str(program)]
    # Files of another user: root can make them so, and others can be another user.
    if os.getuid() == 0:
        os.chown(program, 12345, -1)
    else:
        monkeypatch.setattr(os, "getuid", lambda: 12345)
    with pytest.raises(errors.UnavailableError):
        find_server()


def test_environments_without_an_endpoint_share_a_private_daemon() -> None:
    code = """
import gymnasium as gym
one = gym.make("b4mrl:b4mrl/HalfCheetah-v0", simulator="gravity")
two = gym.make_vec("b4mrl:b4mrl/HalfCheetah-v0", num_envs=2)
one.reset(seed=1), two.reset(seed=1)
import b4mrl.serve
print(b4mrl.connect().server_status().session_count)
spec = b4mrl.connect().make("HalfCheetah").spec.to_json()
one.close(), two.close()
from b4mrl.serve import _shared_daemon
_shared_daemon.stop()
gym.make("b4mrl:b4mrl/HalfCheetah-v0").reset()  # of another daemon
gym.make(gym.envs.registration.EnvSpec.from_json(spec)).reset()
"""
    clean = {name: value for name, value in os.environ.items() if name != "B4MRL_ENDPOINT"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=clean, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "2\n", "")


def test_a_child_that_is_forked_while_the_shared_daemon_starts_has_a_daemon_of_its_own() -> None:
    code = """
import multiprocessing, sys, threading
import b4mrl
module = sys.modules["b4mrl.serve"]
starting, forked = threading.Event(), threading.Event()
serve = module.serve

def serve_after_the_fork(**options):
    starting.set()
    forked.wait()
    return serve(**options)

def work():
    module.serve = serve
    print(len(b4mrl.connect().environments()) > 0, flush=True)

module.serve = serve_after_the_fork
first = threading.Thread(target=b4mrl.connect)
first.start()
starting.wait()
child = multiprocessing.get_context("fork").Process(target=work)
child.start()
forked.set()
child.join(30)
print(child.exitcode)
child.kill()
first.join()
"""
    clean = {name: value for name, value in os.environ.items() if name != "B4MRL_ENDPOINT"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=clean, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout) == (0, "True\n0\n"), done.stderr


def test_every_environment_of_the_catalogue_is_registered(client: b4mrl.Client) -> None:
    ids = {name for name in gym.registry if name.startswith("b4mrl/")}
    assert ids == {f"b4mrl/{name}-v0" for name in client.environments()}
    for names in (["Own"], "Own"):
        b4mrl.register(names)
        assert gym.registry.pop("b4mrl/Own-v0").kwargs == {"environment": "Own"}
    assert {name for name in gym.registry if name.startswith("b4mrl/")} == ids


def test_the_endpoint_of_the_environment_is_taken(
    monkeypatch: pytest.MonkeyPatch, endpoint: str
) -> None:
    monkeypatch.setenv("B4MRL_ENDPOINT", endpoint)
    with b4mrl.connect() as client:
        assert client.endpoint == endpoint


def test_the_package_is_imported_where_there_are_no_forks() -> None:
    """As on Windows, where programs use a daemon that runs elsewhere."""
    program = "\n".join(
        [
            "import os",
            "for name in ('fork', 'register_at_fork', 'getuid', 'sched_yield'):",
            "    delattr(os, name)",
            "import b4mrl",
            "print(b4mrl.__name__)",
        ]
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "b4mrl\n", "")


def test_addresses_that_a_caller_adds_do_not_take_the_place_of_its_own() -> None:
    with b4mrl.serve(arguments=["--bind", "tcp://127.0.0.1:0"]) as endpoint:
        assert endpoint.startswith("ipc://")
        b4mrl.connect(endpoint).close()
