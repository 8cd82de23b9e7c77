"""Builds the telepresence page with Node while the package is installed; without Node it is left out, in words."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PAGE = Path("ghal360_robot/telepresence/page")
OLDEST_NODE = 20
BUILD_S = 600
"""Fetching 100 packages over a slow line."""

NO_NODE = (
    f"Node {OLDEST_NODE} or newer with npm is not there: ghal360-robot is installed without its telepresence page. "
    "Everything else works; install Node and run `make page` for the page."
)


class PageBuildHook(BuildHookInterface[Any]):
    """`npm ci` and `vite build`, unless the built page is newer than everything it is made of."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        page = Path(self.root) / PAGE
        build_data["artifacts"].append(f"{PAGE}/dist/**")
        if is_built(page):
            return
        if not has_node():
            self.app.display_warning(NO_NODE)
            return
        for command in (("npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"), ("npm", "run", "build")):
            done = subprocess.run(  # noqa: S603 - our own words
                command, cwd=page, capture_output=True, text=True, timeout=BUILD_S, check=False
            )
            if done.returncode:
                tail = "\n".join((done.stdout + done.stderr).strip().splitlines()[-5:])
                self.app.display_warning(
                    f"`{' '.join(command)}` failed, so ghal360-robot is installed without its telepresence page; "
                    f"`make page` tries again:\n{tail}"
                )
                return


def is_built(page: Path) -> bool:
    """Whether the built page is newer than its sources; a source distribution may bring it along without them."""
    built = page / "dist" / "index.html"
    if not built.is_file():
        return False
    sources = [page / "index.html", page / "package-lock.json", *(page / "src").glob("*")]
    return all(source.stat().st_mtime <= built.stat().st_mtime for source in sources if source.is_file())


def has_node() -> bool:
    node = shutil.which("node")
    if node is None or shutil.which("npm") is None:
        return False
    said = subprocess.run((node, "--version"), capture_output=True, text=True, check=False, env=os.environ)  # noqa: S603
    major = said.stdout.strip().lstrip("v").split(".")[0]
    return major.isdigit() and int(major) >= OLDEST_NODE
