"""`ghal360 tls`: certificates for the telepresence page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from ghal360_robot.telepresence import certificates

app = typer.Typer(help="Certificates for the telepresence page.", no_args_is_help=True)

FOLDER = Path("~/.config/ghal360/tls")

INSTALL = """
Tell each device once to trust {authority} (it is no secret; {folder}/ca.key is):
  laptop    Chrome, Edge: Settings, Privacy and security, Security, Manage certificates, import as an authority
            Firefox: Settings, Privacy & Security, View Certificates, Authorities, Import
  Android   copy it over; Settings, Security, More, Encryption & credentials, Install a certificate, CA certificate
  iPhone    send it by AirDrop or mail; Settings, Profile downloaded, Install; then General, About,
            Certificate Trust Settings, switch it on
  Quest     has no menu for that: open the page in its browser once and choose Advanced, Proceed; as page and
            sockets have the same address, that is enough. With developer mode, `adb push` it and install as on Android.
"""


@app.callback()
def _group() -> None:
    """Certificates for the telepresence page."""


@app.command()
def init(
    name: Annotated[
        list[str] | None, typer.Option(help="A host name or address under which browsers reach the robot; repeat")
    ] = None,
    folder: Annotated[Path, typer.Option(help="Where the four files go")] = FOLDER,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on the last line of stdout")] = False,
) -> None:
    """Make an authority of the robot's own, and a certificate for its page; again, for new names or a new year.

    Example: ghal360 tls init --name robot.local --name 192.168.1.20
    """
    made = certificates.make(folder.expanduser().absolute(), (*(name or ()), *certificates.own_names()))
    if as_json:
        print(
            json.dumps(
                {
                    "authority": str(made.authority),
                    "certificate": str(made.certificate),
                    "key": str(made.key),
                    "names": list(made.names),
                    "new_authority": made.new_authority,
                }
            )
        )
        return
    out = Console(highlight=False, soft_wrap=True)
    out.print(f"a certificate for {', '.join(made.names)}, good for {certificates.PAGE_DAYS} days", markup=False)
    out.print("\nWrite into robot.toml:\n\n[page]", markup=False)
    out.print('listen = "0.0.0.0"', markup=False)
    out.print(f"names = {json.dumps(list(made.names))}", markup=False)
    out.print(f'certificate = "{made.certificate}"\nkey = "{made.key}"', markup=False)
    if made.new_authority:
        out.print(INSTALL.format(authority=made.authority, folder=made.authority.parent), markup=False)
    else:
        out.print("\nThe authority is the old one: devices that trust it need nothing new.", markup=False)
