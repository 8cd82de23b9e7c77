"""Two programs that drive one base would fight; the second is told who the first is."""

from __future__ import annotations

import fcntl
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest

from drivers.rmp110 import CanTransport
from drivers.rmp110.errors import RmpInterfaceError
from drivers.rmp110.transport import bus_lock
from drivers.rmp110.transport.bus_lock import BusLock


def test_the_second_owner_is_refused_until_the_first_is_gone(tmp_path: Path) -> None:
    first = BusLock("socketcan:can0", tmp_path)
    with pytest.raises(RmpInterfaceError, match="CAN bus socketcan:can0 is in use by this very process"):
        BusLock("socketcan:can0", tmp_path)
    BusLock("socketcan:can1", tmp_path).release()
    first.release()
    first.release()
    BusLock("socketcan:can0", tmp_path).release()


HOLDER = """
import sys
from pathlib import Path
from drivers.rmp110.transport.bus_lock import BusLock
lock = BusLock("socketcand:can0:10.0.0.1:29536", Path(sys.argv[1]))
print("held", flush=True)
sys.stdin.read()
"""


def test_the_holder_is_named_and_its_death_frees_the_bus(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        with pytest.raises(RmpInterfaceError, match=rf"in use by process {process.pid}: .*stop the other program"):
            BusLock("socketcand:can0:10.0.0.1:29536", tmp_path)
        process.kill()
        process.wait(5)
    BusLock("socketcand:can0:10.0.0.1:29536", tmp_path).release()


def test_a_file_with_rubbish_in_it_is_a_lock_all_the_same(tmp_path: Path) -> None:
    first = BusLock("x", tmp_path)
    (tmp_path / "rmp110-x.lock").write_bytes(b"\xff" * 1000)
    with pytest.raises(RmpInterfaceError, match="in use by another process"):
        BusLock("x", tmp_path)
    first.release()


def test_names_that_are_no_file_names_stay_inside_the_directory(tmp_path: Path) -> None:
    lock = BusLock("virtual:../../etc/passwd", tmp_path)
    assert [path.parent for path in tmp_path.rglob("*.lock")] == [tmp_path]
    lock.release()


def test_a_link_laid_in_the_way_is_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (tmp_path / "rmp110-x.lock").symlink_to(victim)
    with pytest.raises(RmpInterfaceError, match="give another lock_dir"):
        BusLock("x", tmp_path)
    assert victim.read_text() == "precious"


def test_without_any_directory_one_sentence_says_so(tmp_path: Path) -> None:
    with pytest.raises(RmpInterfaceError, match=r"no lock file for the CAN bus can be had in .*missing"):
        BusLock("x", tmp_path / "missing")


def test_the_shared_directory_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/1000")
    shared, own = Path("/run/lock"), Path("/run/user/1000")
    assert bus_lock.lock_directories() == (shared, own, Path(tempfile.gettempdir()))


async def test_a_transport_holds_its_bus_until_closed_and_a_failed_opening_leaves_it_free(tmp_path: Path) -> None:
    first, second = (CanTransport("virtual", "lock-test", lock_dir=tmp_path) for _ in range(2))
    await first.open(lambda *_: None, lambda _: None)
    with pytest.raises(RmpInterfaceError, match="in use"):
        await second.open(lambda *_: None, lambda _: None)
    await second.close()
    with pytest.raises(RmpInterfaceError, match="in use"):
        await CanTransport("virtual", "lock-test", lock_dir=tmp_path).open(lambda *_: None, lambda _: None)
    watcher = CanTransport("virtual", "lock-test", exclusive=False)
    await watcher.open(lambda *_: None, lambda _: None)
    await watcher.close()
    await first.close()
    for _ in range(2):
        with pytest.raises(RmpInterfaceError, match="can987 not found"):
            await CanTransport("socketcan", "can987", lock_dir=tmp_path).open(lambda *_: None, lambda _: None)
    await second.open(lambda *_: None, lambda _: None)
    await second.close()
    assert list(tmp_path.glob("*")) == [], "nothing is left behind"  # noqa: ASYNC240


def test_a_lock_file_that_was_removed_before_it_was_locked_is_no_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock = fcntl.flock
    first = BusLock("x", tmp_path)
    waited: list[int] = []

    def late(file: int, how: int) -> None:
        if not waited:
            waited.append(file)
            first.release()
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    second = BusLock("x", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["rmp110-x.lock"]
    with pytest.raises(RmpInterfaceError, match="this very process"):
        BusLock("x", tmp_path)
    second.release()


def test_many_threads_that_want_one_bus_have_it_one_at_a_time(tmp_path: Path) -> None:
    held = 0
    most = 0
    had = 0

    def want() -> None:
        nonlocal held, most, had
        for _ in range(200):
            try:
                lock = BusLock("x", tmp_path)
            except RmpInterfaceError:
                continue
            held += 1
            most = max(most, held)
            had += 1
            held -= 1
            lock.release()

    threads = [threading.Thread(target=want) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert most == 1
    assert had > 0
