"""A learned policy as bytes: values, follow rates and where they come from, checked when read. Pure."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ghal360_robot.guidance.follow_rates import PRIOR, FollowRates
from ghal360_robot.guidance.mdp import N_ONE_TARGET
from ghal360_robot.guidance.online import Learnt

FORMAT = "ghal360-policy"
VERSION = 1
MAX_BYTES = 1_000_000
"""Values take 66 kB; the rest is what somebody wrote about their origin."""
SHAPE = (N_ONE_TARGET, 3)


class PolicyFormatError(ValueError):
    """The bytes are no policy, or a damaged one."""


@dataclass(frozen=True, slots=True, eq=False)
class SavedPolicy:
    """Values (2048, 3) by `mdp.one_target_codes`, and how they came about."""

    q: NDArray[np.float64]
    provenance: dict[str, Any] = field(default_factory=dict)
    """Whatever JSON can hold: settings, seeds, episodes, version of the code."""
    rates: FollowRates = FollowRates()
    epochs: int = 0

    @property
    def learnt(self) -> Learnt:
        """As the learner on the robot goes on with it."""
        q = self.q.copy()
        q.flags.writeable = False
        return Learnt(q, self.rates, self.epochs)


def to_bytes(policy: SavedPolicy) -> bytes:
    """One JSON object with a checksum over everything else in it. Raises ValueError for values of a wrong shape."""
    if policy.q.shape != SHAPE or not np.isfinite(policy.q).all():
        raise ValueError(f"A policy to save has {SHAPE} finite values, not {policy.q.shape}.")
    body = {
        "format": FORMAT,
        "version": VERSION,
        "provenance": policy.provenance,
        "follow": {"left": list(policy.rates.left), "right": list(policy.rates.right)},
        "epochs": policy.epochs,
        "q": base64.b64encode(np.ascontiguousarray(policy.q, "<f8").tobytes()).decode("ascii"),
    }
    return (json.dumps(body | {"sha256": _checksum(body)}, indent=1, sort_keys=True) + "\n").encode()


def from_bytes(data: bytes) -> SavedPolicy:
    """Raises PolicyFormatError for anything that `to_bytes` would not have written."""
    if len(data) > MAX_BYTES:
        raise PolicyFormatError(f"A policy has at most {MAX_BYTES} bytes, not {len(data)}.")
    try:
        body = json.loads(data)
    except (ValueError, RecursionError):
        raise PolicyFormatError("This is not a policy: it is no JSON.") from None
    if not isinstance(body, dict) or body.get("format") != FORMAT:
        raise PolicyFormatError("This is not a policy saved by ghal360.")
    if body.get("version") != VERSION:
        raise PolicyFormatError(f"This policy has format version {body.get('version')!r}; known is {VERSION}.")
    if body.pop("sha256", None) != _checksum(body):
        raise PolicyFormatError("This policy is damaged: its checksum is not that of its contents.")
    return SavedPolicy(_values(body), _provenance(body), _rates(body), _epochs(body))


def _checksum(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _values(body: dict[str, Any]) -> NDArray[np.float64]:
    try:
        raw = base64.b64decode(body.get("q", ""), validate=True)
        q = np.frombuffer(raw, "<f8").reshape(SHAPE).astype(np.float64)
    except (TypeError, ValueError, binascii.Error):
        raise PolicyFormatError(f"The values of this policy are not {SHAPE[0]} times {SHAPE[1]} numbers.") from None
    if not np.isfinite(q).all():
        raise PolicyFormatError("A policy's values have to be finite numbers.")
    return q


def _provenance(body: dict[str, Any]) -> dict[str, Any]:
    found = body.get("provenance", {})
    if not isinstance(found, dict):
        raise PolicyFormatError("The provenance of this policy is no JSON object.")
    return found


def _rates(body: dict[str, Any]) -> FollowRates:
    follow = body.get("follow", {})
    try:
        left, right = (tuple(float(n) for n in follow.get(side, PRIOR)) for side in ("left", "right"))
        (a, b), (c, d) = left, right
        return FollowRates((a, b), (c, d))
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise PolicyFormatError("The follow rates of this policy are not two positive counts for each arrow.") from None


def _epochs(body: dict[str, Any]) -> int:
    epochs = body.get("epochs", 0)
    if not isinstance(epochs, int) or epochs < 0:
        raise PolicyFormatError("The number of epochs of this policy is no count.")
    return epochs
