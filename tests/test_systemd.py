from __future__ import annotations

import socket
from pathlib import Path

import pytest

from ghal360_robot.systemd import Notifier

SECOND = 1_000_000_000


@pytest.fixture
def listener(tmp_path: Path) -> socket.socket:
    server = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    server.bind(str(tmp_path / "notify"))
    server.setblocking(False)
    yield server
    server.close()


def received(server: socket.socket) -> list[str]:
    out = []
    while True:
        try:
            out.append(server.recv(4096).decode())
        except BlockingIOError:
            return out


def notifier(tmp_path: Path, usec: str) -> Notifier:
    return Notifier.from_environment({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": usec})


def test_the_loop_pings_at_half_the_watchdog_deadline(tmp_path: Path, listener: socket.socket) -> None:
    systemd = notifier(tmp_path, "2000000")
    for tick in range(50 * 5):
        systemd.beat(SECOND + tick * SECOND // 50)
    assert received(listener) == ["WATCHDOG=1"] * 5
    systemd.close()


def test_readiness_status_and_stopping_reach_systemd_on_one_line(tmp_path: Path, listener: socket.socket) -> None:
    systemd = notifier(tmp_path, "")
    systemd.ready()
    systemd.status("lidar lost\nREADY=0" + "x" * 500)
    systemd.stopping()
    ready, status, stopping = received(listener)
    assert (ready, stopping) == ("READY=1", "STOPPING=1")
    assert "\n" not in status
    assert len(status) < 250
    systemd.close()


def test_without_systemd_nothing_happens() -> None:
    systemd = Notifier.from_environment({})
    systemd.ready()
    systemd.beat(SECOND)
    systemd.close()


def test_a_vanished_systemd_does_not_raise(tmp_path: Path) -> None:
    systemd = notifier(tmp_path, "2000000")
    systemd.ready()
    systemd.beat(SECOND)
    systemd.close()
