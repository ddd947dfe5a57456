"""The Python side of `b4mrl perf python`, without its peers."""

from __future__ import annotations

import runpy
import socket
import threading
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[4] / "benchmarks/performance/python_rates.py"


def test_each_loop_of_the_client_has_a_rate(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    script = runpy.run_path(str(SCRIPT))
    asking, answering = socket.socketpair()
    monkeypatch.setitem(script["answer"].__globals__, "has", lambda *modules: False)  # no peers
    thread = threading.Thread(target=script["answer"], args=(answering, endpoint))
    thread.start()
    lines = asking.makefile()
    ready, *names = next(lines).split()
    assert ready == "ready" and len(names) == 5
    for name in names:
        asking.sendall(f"{name} 0.01\n".encode())
        assert float(next(lines)) > 0
    asking.shutdown(socket.SHUT_WR)
    thread.join()
    lines.close()
    asking.close()
    answering.close()
