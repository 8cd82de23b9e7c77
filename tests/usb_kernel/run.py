"""On the host: boot Debian's kernel in QEMU (software emulation, no root) and judge what the guest reports."""

from __future__ import annotations

import argparse
import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from tests.usb_kernel import video
from tests.usb_kernel.guest import RESULT
from tests.usb_kernel.kernel import CACHE, Missing, initramfs, kernel_package, unpacked

ROOT = Path(__file__).parents[2]
KERNEL = "console=ttyS0 quiet panic=-1 mitigations=off no_timer_check"
"""On a busy machine the emulated timer is late, and the kernel would take it for broken and hang."""
CPU = "Nehalem"  # newer ones copy memory by "rep movsb", which software emulation does byte by byte
QUIET = 0.1  # of all processors' time for other programs: above, nobody can tell whose fault a late picture is
LIMIT_S = {"smoke": 240, "full": 900}  # a minute and five on idle cores; a test that hangs must end


def boot(plan: str, out: Path) -> dict[str, Any]:
    """Run the guest; returns its result. Raises Missing, subprocess.TimeoutExpired or ValueError."""
    qemu = shutil.which("qemu-system-x86_64")
    if qemu is None:
        raise Missing("QEMU is missing: apt-get install qemu-system-x86")
    kernel, busybox = unpacked(kernel_package()), unpacked("busybox-static")
    for mode in video.MODES:
        video.prepared(mode, CACHE / "video")
    environment = f"HOME=/run PYTHONDONTWRITEBYTECODE=1 PYTHONPATH={shlex.quote(str(ROOT))}"
    program = shlex.join([sys.executable, "-m", "tests.usb_kernel.guest", plan, str(CACHE / "video")])
    command = f"/bin/sh -c {shlex.quote(f'cd {shlex.quote(str(ROOT))}; exec env {environment} {program}')}"
    archive = out / "initramfs"
    archive.write_bytes(initramfs(kernel, busybox, command))
    (image,) = (kernel / "boot").glob("vmlinuz-*")
    console = out / "console.log"
    words = [
        qemu, "-accel", "tcg,thread=multi", "-machine", "q35", "-cpu", CPU, "-smp", "2", "-m", "1024", "-nodefaults",
        "-display", "none", "-no-reboot", "-kernel", image, "-initrd", archive,
        "-append", KERNEL,
        "-serial", f"file:{console}", "-nic", "none",
        "-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap",
    ]  # fmt: skip
    subprocess.run(words, check=True, timeout=LIMIT_S[plan], stdin=subprocess.DEVNULL)
    for line in console.read_text(errors="replace").splitlines():
        if line.startswith(RESULT):
            found: dict[str, Any] = json.loads(line.removeprefix(RESULT))
            return found
    raise ValueError("the guest ended without a result")


def spent_s() -> tuple[float, float]:
    """What all processors of this machine did so far, and the part of it that was this test's."""
    fields = Path("/proc/stat").read_text(encoding="ascii").split("\n")[0].split()[1:8]
    user, nice, system, _idle, _wait, irq, soft = (int(f) / os.sysconf("SC_CLK_TCK") for f in fields)
    own = resource.getrusage(resource.RUSAGE_CHILDREN)
    return user + nice + system + irq + soft, own.ru_utime + own.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("plan", choices=LIMIT_S, nargs="?", default="full")
    parser.add_argument("--out", type=Path, default=CACHE / "last", help="console and result are kept here")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    started, (busy_s, own_s) = time.monotonic(), spent_s()
    try:
        found = boot(arguments.plan, arguments.out)
    except (Missing, subprocess.SubprocessError, ValueError) as error:
        print(f"{error}\n(see {arguments.out / 'console.log'})", file=sys.stderr)
        sys.exit(1)
    wall_s, spent = time.monotonic() - started, spent_s()
    others = (spent[0] - busy_s - (spent[1] - own_s)) / wall_s / (os.cpu_count() or 1)
    quiet = others < QUIET
    ok = not found["failures"] and not (quiet and found["too_slow"])
    print(json.dumps({"ok": ok} | found | {"wall_s": round(wall_s, 1), "others_cpu": round(others, 3)}))
    for complaint in found["failures"] + found["too_slow"]:
        print(complaint, file=sys.stderr)
    if found["too_slow"] and not quiet:
        print(f"but other programs took {others:.0%} of this machine: its pace is not judged", file=sys.stderr)
    for run in found["runs"].values():
        if "verdict" in run:
            print(run["verdict"], file=sys.stderr)
    sys.exit(not ok)


if __name__ == "__main__":
    main()
