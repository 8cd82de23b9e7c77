"""Debian's kernel and busybox, unpacked without root, and the small initramfs that starts the guest."""

from __future__ import annotations

import lzma
import os
import re
import subprocess
from pathlib import Path

CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ghal360-robot" / "usb-kernel"
MODULES = ("virtio_pci", "9pnet_virtio", "9p", "vhci-hcd", "uvcvideo")
DOWNLOAD_S = 600

INIT = """#!/bin/busybox sh
export PATH=/bin
/bin/busybox mkdir -p /proc /sys /dev /host
/bin/busybox mount -t devtmpfs dev /dev
/bin/busybox mount -t proc proc /proc
/bin/busybox mount -t sysfs sysfs /sys
for module in {modules}; do /bin/busybox insmod /modules/$module || echo "insmod $module failed"; done
/bin/busybox mount -t 9p -o trans=virtio,version=9p2000.L,ro,msize=1048576,cache=loose host /host || exit 1
/bin/busybox mount -t proc proc /host/proc
/bin/busybox mount -t sysfs sysfs /host/sys
/bin/busybox mount -t devtmpfs dev /host/dev
/bin/busybox mount -t tmpfs tmpfs /host/run
/bin/busybox ip link set lo up
cd /host
/bin/busybox chroot /host {command} </dev/null
/bin/busybox poweroff -f
"""


class Missing(Exception):  # noqa: N818 said to the person who runs the test
    """Something has to be installed first; the text says what."""


def unpacked(package: str) -> Path:
    """A Debian package's files in the cache, downloaded at the first call. Raises Missing."""
    place = CACHE / package
    done = place / ".complete"
    if done.exists():
        return place / "files"
    place.mkdir(parents=True, exist_ok=True)
    for old in place.glob("*.deb"):
        old.unlink()
    try:
        subprocess.run(["apt-get", "download", "-q", package], cwd=place, check=True, timeout=DOWNLOAD_S)
        (archive,) = place.glob("*.deb")
        subprocess.run(["dpkg-deb", "-x", archive, place / "files"], check=True, timeout=DOWNLOAD_S)
        archive.unlink()
    except (OSError, subprocess.SubprocessError, ValueError) as error:
        raise Missing(f"cannot get Debian's package {package} (apt-get download): {error}") from error
    done.touch()
    return place / "files"


def kernel_package() -> str:
    """The name of Debian's current kernel image. Raises Missing."""
    found = sorted(CACHE.glob("linux-image-*/.complete"))
    if found:
        return found[-1].parent.name
    try:
        text = subprocess.run(
            ["apt-cache", "depends", "linux-image-amd64"], check=True, capture_output=True, text=True, timeout=60
        ).stdout
    except (OSError, subprocess.SubprocessError) as error:
        raise Missing(f"cannot ask apt for Debian's kernel: {error}") from error
    match = re.search(r"Depends: (linux-image-\d\S*)", text)
    if match is None:
        raise Missing("apt knows no linux-image-amd64: this test needs Debian's package lists (apt-get update)")
    return match[1]


def with_dependencies(tree: Path, names: tuple[str, ...]) -> list[Path]:
    """Module files in the order in which they must be loaded."""
    known = {re.split(r"\.ko", p.name)[0].replace("_", "-"): p for p in tree.rglob("*.ko*")}
    ordered: list[Path] = []

    def add(name: str) -> None:
        path = known.get(name.replace("_", "-"))
        if path is None or path in ordered:
            return  # built into the kernel, or there already
        depends = re.search(rb"\0depends=([^\0]*)\0", b"\0" + content(path))
        for other in depends[1].decode().split(",") if depends else []:
            if other:
                add(other)
        ordered.append(path)

    for name in names:
        add(name)
    return ordered


def content(path: Path) -> bytes:
    raw = path.read_bytes()
    return lzma.decompress(raw) if path.suffix == ".xz" else raw


def initramfs(kernel: Path, busybox: Path, command: str) -> bytes:
    """A cpio archive: busybox, the modules, and an init that runs `command` in the host's own file system."""
    modules = with_dependencies(kernel / "lib" / "modules", MODULES)
    files = {
        "init": INIT.format(modules=" ".join(p.name for p in modules), command=command).encode(),
        "bin/busybox": (busybox / "bin" / "busybox").read_bytes(),
    } | {f"modules/{p.name}": content(p) for p in modules}
    entries = [(name, 0o040755, b"") for name in ("bin", "modules")]
    entries += [(name, 0o100755, data) for name, data in files.items()]
    entries.append(("TRAILER!!!", 0, b""))
    return b"".join(_cpio(number, *entry) for number, entry in enumerate(entries, 1))


def _cpio(number: int, name: str, mode: int, data: bytes) -> bytes:
    """One entry of the kernel's "newc" archive format."""
    fields = (number, mode, 0, 0, 1, 0, len(data), 0, 0, 0, 0, len(name) + 1, 0)
    head = b"070701" + b"".join(b"%08X" % field for field in fields) + name.encode() + b"\0"
    return head + bytes(-len(head) % 4) + data + bytes(-len(data) % 4)
