"""Ten whole searches in real time, through all wires, as `ghal360 demo` runs them: about ten minutes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.end_to_end.conftest import ghal360


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(10))
def test_the_demo_finds_its_target_and_hits_nothing(seed: int, tmp_path: Path) -> None:
    ran = ghal360("demo", "--seed", seed, "--json", "--record", tmp_path, timeout_s=300)
    assert ran.status == 0, ran.err
    report = ran.json
    assert report["found"]
    assert report["simulation"]["target_in_view"]
    assert report["simulation"]["collisions"] == 0
    assert report["tick_lateness_ms"]["p99"] <= 10
    for device in ("theta", "rmp110", "tim571"):
        assert report[device]["damaged"] == 0
        # A simulated base that has to wait for a core answers a poll too late now and then.
        assert report[device]["lost"] <= 0.01 * report[device]["received"]
