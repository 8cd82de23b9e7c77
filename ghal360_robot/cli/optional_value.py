"""`--live [HOST:PORT]`: an option whose value may be left out, which Typer does not know."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand

LIVE = "127.0.0.1:9876"
"""Loopback, and the port that Rerun's viewer tries first."""


class LiveCommand(TyperCommand):
    """A command with the option `--live`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        return super().parse_args(ctx, with_address(args))


def with_address(args: list[str]) -> list[str]:
    """`args` with the address that a bare `--live` leaves out."""
    filled = []
    for arg, following in zip(args, [*args[1:], ""], strict=True):
        filled.append(arg)
        if arg == "--live" and (not following or following.startswith("-")):
            filled.append(LIVE)
    return filled
