from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ghal360_robot.telepresence import typescript
from ghal360_robot.telepresence.protocol import FROM_SERVER, MAX_TEXT_BYTES, MalformedError, Operate, parse

PAGE = Path(typescript.__file__).parent / "page"
OPERATE: dict[str, Any] = {
    "kind": "operate", "conn": "abc", "seq": 1, "sent_us": 5_000_000, "yaw": 0.1, "pitch": 0.0, "fov_h": 1.8,
    "fov_v": 1.3, "mode": "screen", "deadman": True, "stick": {"v": 0.5, "w": -1}, "arm": 0, "disarm": 0, "found": 0,
}  # fmt: skip

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
FRACTIONS = st.floats(allow_nan=False, allow_infinity=False).filter(lambda value: not value.is_integer())
"""JavaScript cannot tell 5.0 from 5."""

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | FRACTIONS | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)


def test_a_wish_is_read_as_it_was_written() -> None:
    wish = parse(json.dumps(OPERATE))
    assert isinstance(wish, Operate)
    assert wish.model_dump() == OPERATE


@given(st.text(max_size=200) | VALUES.map(json.dumps))
def test_whatever_comes_is_a_message_or_malformed(text: str) -> None:
    with pytest.raises(MalformedError):
        parse(text)


@pytest.mark.parametrize("text", ["[" * 1000, '{"kind":' * 200, '"' + "x" * MAX_TEXT_BYTES + '"', "\ud800", "\0"])
def test_hostile_texts_are_malformed(text: str) -> None:
    with pytest.raises(MalformedError) as refused:
        parse(text)
    assert len(str(refused.value)) <= 300


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "drive"}, {"more": 1}, {"seq": -1}, {"seq": 1.5}, {"seq": "1"}, {"seq": True}, {"yaw": 1e9},
        {"yaw": "0"}, {"deadman": 1}, {"deadman": "true"}, {"stick": {"v": 1.01, "w": 0}}, {"stick": {"v": 0}},
        {"stick": [0, 0]}, {"stick": {"v": 0, "w": 0, "x": 0}}, {"fov_h": 0}, {"fov_h": 7}, {"mode": "tank"},
        {"conn": "x" * 65}, {"sent_us": 2**53}, {"arm": 10**9},
    ],
)  # fmt: skip
def test_a_wish_with_one_thing_wrong_is_malformed(change: dict[str, Any]) -> None:
    with pytest.raises(MalformedError):
        parse(json.dumps({**OPERATE, **change}))


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_a_number_that_is_none_is_malformed(word: str) -> None:
    with pytest.raises(MalformedError):
        parse(json.dumps(OPERATE).replace('"yaw": 0.1', f'"yaw": {word}'))


@pytest.mark.parametrize("field", OPERATE)
def test_nothing_may_be_missing(field: str) -> None:
    with pytest.raises(MalformedError):
        parse(json.dumps({key: value for key, value in OPERATE.items() if key != field}))


def test_the_pages_side_of_the_protocol_is_made_of_ours() -> None:
    """`python -m ghal360_robot.telepresence.typescript` makes it anew."""
    assert typescript.TARGET.read_text(encoding="utf-8") == typescript.source()


def mutated(draw: st.DrawFn, message: dict[str, Any]) -> dict[str, Any]:
    key = draw(st.sampled_from(sorted(message)))
    match draw(st.integers(0, 3)):
        case 0:
            return {name: value for name, value in message.items() if name != key}
        case 1:
            return {**message, "unexpected": 1}
        case 2:
            return {**message, key: draw(VALUES)}
        case _:
            return message


@st.composite
def attempts(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    """Good and bad messages of both sides."""
    side = draw(st.sampled_from(("FromPage", "FromServer")))
    return side, mutated(draw, draw(st.sampled_from(EXAMPLES[side])))


EXAMPLES: dict[str, list[dict[str, Any]]] = {
    "FromPage": [
        OPERATE, {**OPERATE, "stick": None}, {"kind": "stop", "level": "estop", "press": 1},
        {"kind": "lease", "wish": "ask"}, {"kind": "shown", "seq": 3, "dropped": 0}, {"kind": "echo", "nonce": 7},
        {"kind": "ping", "t0": 12.5}, {"kind": "bookmark"}, {"kind": "bookmark", "note": "the door is locked"},
    ],
    "FromServer": [
        {"kind": "pong", "t0": 1.0, "received_us": 1, "sent_us": 2}, {"kind": "probe", "nonce": 1},
        {"kind": "scan", "t_us": 1, "first": -3.1, "step": 0.1, "cm": [0, 10_000, 5]},
        {"kind": "floor", "png": "", "resolution_m": 0.1, "x": 0.0, "y": 1.0, "path": [[0.0, 1.0], [2.0, 3.0]]},
        {"kind": "refused", "what": "a", "why": "b"},
        {"kind": "hello", "version": 1, "conn": "a", "name": "b", "role": "driver", "robot": "c", "target": "",
         "v_max": 0.5, "w_max": 0.8, "camera_yaw": 0.0, "picture_hold_s": 0.7, "blind": [2.3, -2.3],
         "streams": ["camera", "stills"]},
        {"kind": "right", "driver": None, "yours": False, "asking": "x", "may_take": True, "words": "nobody"},
        {"kind": "quality", "round_trip_ms": None, "loop_ms": 1.5, "picture_ms": 3, "dropped": 0, "bit_rate": 4e7,
         "lock": "", "viewers": 1},
    ],
}  # fmt: skip


def test_the_page_takes_and_refuses_exactly_what_the_server_does(tmp_path: Path) -> None:
    """Its validator, bundled as for the browser and run by Node, against pydantic."""
    node, bundler = shutil.which("node"), PAGE / "node_modules" / "rolldown" / "bin" / "cli.mjs"
    if node is None or not bundler.is_file():
        pytest.skip("Node or the page's packages are missing: `make page`")
    bundle = tmp_path / "validate.mjs"
    subprocess.run(
        [node, str(bundler), str(PAGE / "src" / "validate.ts"), "--file", str(bundle), "--format", "esm"],
        check=True, capture_output=True, cwd=PAGE, timeout=60,
    )  # fmt: skip
    tried: list[tuple[str, dict[str, Any]]] = []

    @settings(max_examples=400, database=None, derandomize=True)
    @given(attempts())
    def collect(attempt: tuple[str, dict[str, Any]]) -> None:
        tried.append(attempt)

    collect()
    script = (
        f"import {{ whyNot }} from {json.dumps(bundle.as_uri())};"
        "let text = ''; for await (const part of process.stdin) text += part;"
        "console.log(JSON.stringify(JSON.parse(text).map(([side, value]) => whyNot(side, value))));"
    )
    ran = subprocess.run(
        [node, "--input-type=module", "-e", script], input=json.dumps(tried), capture_output=True, text=True, check=True
    )
    verdicts = json.loads(ran.stdout)
    differ = [
        (attempt, verdict)
        for attempt, verdict in zip(tried, verdicts, strict=True)
        if (verdict == "") != accepted(*attempt)
    ]
    assert differ == []
    assert 20 < sum(verdict == "" for verdict in verdicts) < len(verdicts) - 20


def accepted(side: str, message: dict[str, Any]) -> bool:
    text = json.dumps(message)
    try:
        if side == "FromPage":
            parse(text)
        else:
            FROM_SERVER.validate_json(text)
    except ValueError:
        return False
    return True
