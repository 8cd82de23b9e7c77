"""A request and its answer as a clause, for whoever watches the simulated lidar."""

from __future__ import annotations

from drivers.tim571.codec.answers import Refusal, understand
from drivers.tim571.codec.scandata import is_scan
from drivers.tim571.codec.telegram import Telegram

_ASKS = {
    "sRN": "reads",
    "sRI": "reads index",
    "sWN": "writes",
    "sMN": "calls",
    "sMI": "calls index",
    "sEN": "subscribes to",
}


def in_words(request: Telegram, answer: Telegram) -> str:
    """Parameters of a request are left out: one of them is a password's hash."""
    asks = f"{_ASKS.get(request.kind, f'sends {request.kind}')} {request.name}"
    if is_scan(answer):
        return f"{asks}: a scan"
    told = understand(answer)
    if isinstance(told, Refusal):
        return f"{asks}: refused, {told.words} (sFA {int(told.code):X})"
    if answer.kind == "sWA":
        return f"{asks}: done"
    if answer.kind == "sEA":
        return f"{asks}: {'on' if told else 'off'}"
    if answer.kind == "sAN":
        return f"{asks}: {'done' if told else 'not done'}"
    if request.name in ("DeviceIdent", "0"):
        return f"{asks}: {told.type} {told.version}"
    return f"{asks}: {told}"
