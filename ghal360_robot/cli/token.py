"""`ghal360 token`: the addresses with which the telepresence page is opened."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from ghal360_robot.config import load_config
from ghal360_robot.telepresence.access import in_address, load_tokens
from ghal360_robot.telepresence.settings import PageSettings


def addresses(
    config_path: Annotated[Path | None, typer.Option("--config", "-c", help="robot.toml; defaults without")] = None,
    new: Annotated[bool, typer.Option("--new", help="Make new tokens: whoever has an old one is locked out")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Print the addresses that open the page, with the tokens of a driver and of a viewer.

    The token stands behind the #: it is never sent as part of an address, and the page takes it out at once.

    Example: ghal360 token -c robot.toml
    """
    settings = PageSettings.of(load_config(config_path))
    file = Path(settings.token_file)
    if new:
        file.unlink(missing_ok=True)
    tokens = load_tokens(file)
    scheme = "https" if settings.tls else "http"
    hosts = settings.names or (settings.listen,)
    urls = {
        role.value: [f"{scheme}://{in_address(host)}:{settings.port}/#token={token}" for host in hosts]
        for role, token in tokens.items()
    }
    if as_json:
        print(json.dumps({"token_file": str(file), "needed": settings.need_token, "addresses": urls}))
        return
    out = Console(highlight=False, soft_wrap=True)
    for role, each in urls.items():
        out.print(f"{role}:")
        for url in each:
            out.print(f"  {url}", markup=False)
    if not settings.need_token:
        out.print("on this machine no token is needed", markup=False)
    if new:
        out.print("a robot that is running takes the new tokens when it is started again", markup=False)
