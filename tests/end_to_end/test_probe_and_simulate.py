"""`ghal360 simulate` in one process, `ghal360 probe` in another: the two ends of each wire."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from tests.end_to_end.conftest import ghal360

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path


@contextlib.contextmanager
def simulated(*words: str) -> Iterator[str]:
    """A simulated device as HOST:PORT; ended by SIGTERM, and expected to end well."""
    process = subprocess.Popen(
        [sys.executable, "-m", "ghal360_robot", "simulate", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        try:
            assert process.stdout is not None
            sentence = process.stdout.readline()
            found = re.search(r"127\.0\.0\.1:(\d+)", sentence)
            assert found, sentence + (process.communicate(timeout=10)[1] if process.poll() is not None else "")
            yield found.group(0)
            process.terminate()
            assert process.wait(timeout=20) == 0, process.communicate()[1]
        finally:
            process.kill()


@pytest.mark.parametrize("dialect", ["a", "b"])
def test_a_simulated_lidar_is_probed(dialect: str) -> None:
    with simulated("tim571", "--port", "0", "--dialect", dialect) as address:
        ran = ghal360("probe", "tim571", "--host", "127.0.0.1", "--port", address.split(":")[1], "--json")
    assert ran.status == 0, ran.err
    found = ran.json
    assert found["type"].startswith("TiM57")
    assert found["dialect"].lower().endswith(dialect)
    assert found["beams"] == 811
    assert found["lost"] == found["damaged"] == 0
    assert 14 < found["rate_hz"] < 16


def test_a_simulated_base_is_probed_and_told_nothing_that_moves() -> None:
    with simulated("rmp110", "--address", "127.0.0.1:0", "--boot", "0.2") as address:
        ran = ghal360("probe", "rmp110", "--address", address, "--seconds", "1", "--json")
    assert ran.status == 0, ran.err
    found = ran.json
    assert found["dialect"] == "B2"
    assert found["mode"] == "STANDBY"
    assert found["stored"]["max_velocity"] == 0.5
    assert found["faults"] == []
    assert found["v_mps"] == found["w_radps"] == 0.0


def test_a_simulated_camera_is_probed_and_its_stream_saved(tmp_path: Path) -> None:
    saved = tmp_path / "readings"
    with simulated("theta-v", "--usbip", "127.0.0.1:0", "--rate", "10") as address:
        ran = ghal360("probe", "theta-v", "--usbip", address, "--seconds", "2", "--save", saved, "--json")
    assert ran.status == 0, ran.err
    found = ran.json
    assert (found["width"], found["height"]) == (1920, 960)
    assert found["model"].startswith("RICOH THETA V")
    assert found["damaged"] == 0
    assert 8 < found["rate_hz"] < 12
    assert (saved / "stream.h264").read_bytes()[:4] == b"\x00\x00\x00\x01"
    readings = json.loads((saved / "readings.json").read_text())
    assert readings["survey"]["faces"][0]["configuration"].startswith("0902b001")
    assert readings["survey"]["negotiation"]["PROBE GET_LEN"] == "3000"
    (properties,) = readings["survey"]["properties"].values()  # of one of the camera's two faces: it was live already
    assert len(properties) == 49
    assert len((saved / "units.csv").read_text().splitlines()) >= found["pictures"]
    assert (saved / "health.csv").read_text().splitlines()[1].endswith(",98,1,0x00000000")
    headers = [row.split(",") for row in (saved / "headers.csv").read_text().splitlines()[1:]]
    assert {head[:2] for _, _, size, head in headers if size != "0"} == {"02"}  # some microframes are empty


def test_a_port_that_is_taken_is_one_sentence() -> None:
    with simulated("tim571", "--port", "0") as address:
        ran = ghal360("simulate", "tim571", "--port", address.split(":")[1])
    assert ran.status == 1
    assert "Traceback" not in ran.err
    assert "cannot listen" in ran.err
