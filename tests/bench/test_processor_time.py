from __future__ import annotations

import os
import subprocess
import sys
import time

from ghal360_robot.bench.processor_time import HERE, OTHERS, cores_between, seconds_used

BUSY = "import time\nwhile time.process_time() < 0.3: pass\nprint(flush=True)\ninput()  # page_process"


def test_what_a_process_and_its_children_took_is_told_apart() -> None:
    before = seconds_used(os.getpid())
    with subprocess.Popen([sys.executable, "-c", BUSY], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        used_until = time.process_time() + 0.1
        while time.process_time() < used_until:
            pass
        after = seconds_used(os.getpid())
        child.communicate(b"\n")
    assert after["page server"] >= 0.25
    assert after[HERE] - before[HERE] >= 0.05
    assert after[OTHERS] >= before[OTHERS] - 0.1


def test_cores_are_named_busiest_first() -> None:
    before, after = {HERE: 1.0, OTHERS: 5.0}, {HERE: 2.0, "robot": 4.0, OTHERS: 4.99}
    assert list(cores_between(before, after, 4.0).items()) == [("robot", 1.0), (HERE, 0.25), (OTHERS, 0.0)]
