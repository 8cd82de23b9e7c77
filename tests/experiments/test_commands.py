"""`ghal360 train`, `evaluate` and `figures`, from the outside."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from ghal360_robot.cli.main import app
from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.experiments import figures as drawing
from ghal360_robot.experiments.real_stack import (
    GHAL360,
    PLANNER,
    RLGS,
    StackTrial,
    do_trial,
    gather,
    rendered_trials,
    stack_trials,
    trials_csv,
)
from ghal360_robot.experiments.tally import Difference, Sums, Tally
from ghal360_robot.experiments.work import config_hash, do_all
from ghal360_robot.policy_file import load_policy


def ghal360(*arguments: str) -> Any:
    """The last line of stdout as JSON."""
    result = CliRunner().invoke(app, [*arguments, "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    return json.loads(result.stdout.splitlines()[-1])


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small training and two small evaluations, kept in one folder."""
    folder = tmp_path_factory.mktemp("results")
    ghal360("train", "--learner", "paper", "--learner", "mirror", "--seeds", "2", "--episodes", "400",
            "--jobs", "1", "--save", str(folder / "policy.json"), "--out", str(folder))  # fmt: skip
    ghal360("evaluate", "--runs", "2", "--trials", "3", "--environment", "open-0", "--jobs", "1", "--out", str(folder))
    ghal360("evaluate", "--beyond", "--runs", "1", "--trials", "2", "--environment", "office-0", "--jobs", "1",
            "--out", str(folder))  # fmt: skip
    return folder


def test_training_reports_values_and_saves_a_policy_with_its_origin(results: Path) -> None:
    saved = json.loads((results / "train.json").read_text())
    assert saved["learners"]["paper"]["episodes"] == [0, 100, 200, 300, 400]
    assert len(saved["learners"]["paper"]["curves"]) == 2
    assert (results / "train.csv").read_text().startswith("learner,episodes,mean,sd,p5")
    policy = load_policy(results / "policy.json")
    assert policy.provenance["learner"] == "paper"
    assert policy.provenance["seeds"] == [0]
    assert policy.provenance["value"] == saved["learners"]["paper"]["curves"][0][-1]


def test_many_seeds_are_timed_beside_a_plain_learner(tmp_path: Path) -> None:
    result = ghal360("train", "--seeds", "3", "--episodes", "500", "--compare", "--jobs", "1", "--out", str(tmp_path))
    assert result["speed"]["plain_seconds_per_seed"] > result["speed"]["plain_seconds_per_seed_untested"] > 0
    assert result["speed"]["speedup"] > 1


def test_an_evaluation_has_what_its_readers_ask_for(results: Path) -> None:
    paper = json.loads((results / "paper.json").read_text())
    names = {"MFO", "ADV", "FGS", "RLGS", "GHAL360"}
    assert set(paper["accuracy"]) == set(paper["accuracy_se"]) == set(paper["paper_accuracy"]) == names
    assert set(paper["mean_time_s"]["FGS"]) == {"2", "4", "6", "8", "10", "12"}
    assert paper["trials"] == 5 * 2 * 6 * 2 * 3
    assert len((results / "paper.csv").read_text().splitlines()) == 1 + 2 * 5 * 7
    beyond = json.loads((results / "beyond.json").read_text())
    assert set(beyond["success"]) == {"given"}
    assert len(beyond["noisy_detector"]) == 4


def test_an_interrupted_evaluation_goes_on_and_says_the_same(results: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: object) -> None:
        raise AssertionError("this piece was kept")

    arguments = ("evaluate", "--runs", "2", "--trials", "3", "--environment", "open-0", "--out", str(results))
    before = json.loads((results / "paper.json").read_text())
    monkeypatch.setattr("ghal360_robot.experiments.evaluation.do_piece", refuse)
    again = ghal360(*arguments)
    assert again["rows"] == before["rows"]
    with pytest.raises(AssertionError, match="kept"):
        CliRunner().invoke(app, [*arguments, "--fresh", "--jobs", "1"], catch_exceptions=False)


def test_options_and_policies_can_be_exchanged(results: Path, tmp_path: Path) -> None:
    result = ghal360("evaluate", "--runs", "1", "--trials", "5", "--environment", "open-1", "--option",
                     "notice_clear=1", "--option", "hold=true", "--policy", str(results / "policy.json"),
                     "--out", str(tmp_path))  # fmt: skip
    changed = result["rows"]["notice_clear=1, hold=true"]
    assert changed["options"] == {"notice_clear": 1.0, "hold": True}
    # Four hundred episodes teach next to nothing; the plan needs four seconds at two metres.
    assert result["mean_time_s"]["RLGS"]["2"] > 6


@pytest.mark.parametrize(
    "arguments",
    [
        ("train", "--learner", "genius"),
        ("train", "--paper", "--learner", "dyna"),
        ("train", "--learner", "factored", "--save", "x.json", "--seeds", "1"),
        ("evaluate", "--paper", "--beyond"),
        ("evaluate", "--option", "speed=9"),
        ("evaluate", "--option", "follow=much"),
        ("evaluate", "--option", "hold=maybe"),
        ("evaluate", "--environment", "nowhere.json"),
        ("evaluate", "--policy", "nowhere.json"),
        ("figures", "nowhere.json"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(arguments: tuple[str, ...], tmp_path: Path) -> None:
    out = () if arguments[0] == "figures" else ("--out", str(tmp_path))
    with pytest.raises(UsageError):
        CliRunner().invoke(app, [*arguments, *out], catch_exceptions=False)


def test_figures_are_the_same_bytes_from_the_same_results(results: Path, tmp_path: Path) -> None:
    files = [str(results / name) for name in ("train.json", "paper.json", "beyond.json")]
    first = ghal360("figures", *files, "--out", str(tmp_path / "a"))["figures"]
    again = ghal360("figures", *files[1:], "--no-rerun", "--out", str(tmp_path / "b"))["figures"]
    assert len([path for path in first if path.endswith((".png", ".svg"))]) == 14
    assert (tmp_path / "a" / "experiments.rrd").stat().st_size > 1000
    assert len(again) >= 6
    for path in map(Path, again):
        assert path.read_bytes() == (tmp_path / "a" / path.name).read_bytes()


def test_a_figure_says_what_it_was_made_from(results: Path) -> None:
    paper = json.loads((results / "paper.json").read_text())
    for figure in drawing.draw(paper).values():
        svg_text = figure.get_supxlabel()
        assert paper["config_hash"] in svg_text
    axes = drawing.draw(paper)["time-against-distance"].axes[0]
    assert "m" in axes.get_xlabel()
    assert "s" in axes.get_ylabel()


def test_results_that_cannot_be_drawn_are_named(tmp_path: Path) -> None:
    (tmp_path / "odd.json").write_text('{"kind": "train", "config_hash": "x"}')
    with pytest.raises(UsageError, match=r"odd\.json"):
        CliRunner().invoke(app, ["figures", str(tmp_path / "odd.json"), "--out", str(tmp_path)], catch_exceptions=False)


def test_pieces_are_done_once_by_any_number_of_processes(tmp_path: Path) -> None:
    done: list[int] = []
    once = do_all(range(5), square, int, jobs=2, keep_in=tmp_path, on_done=done.append)
    assert once == [0, 1, 4, 9, 16]
    assert done[0] == 0
    assert done[-1] == 5
    (tmp_path / f"{config_hash(3)}.json").write_text("{torn")
    assert do_all(range(5), square, int, jobs=1, keep_in=tmp_path) == once


def square(n: int) -> int:
    return n * n


def test_results_that_cannot_be_kept_are_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(GhalError, match="cannot keep"):
        do_all([1], square, int, jobs=1, keep_in=tmp_path / "file")


def test_tallies_add_up() -> None:
    seconds = np.array([10.0, np.inf, 30.0, -1.0])
    distance, run = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    one = Tally()
    one.add(seconds, distance, run, 100.0)
    twice = Tally.from_json(json.loads(json.dumps(one.to_json())))
    twice.merge(one)
    report = twice.report()
    assert report["n"] == 8
    assert report["success"] == 0.5
    assert report["wrong"] == 0.25
    assert report["mean_time_s"] == (10 + 100 + 30 + 100) / 4
    assert report["found_only_mean_time_s"] == 20
    assert report["by_distance"]["2"]["mean_time_s"] == 55
    assert report["success_by_run"] == [1.0, 0.0]
    assert Sums().report()["success"] is None


def test_standard_errors_are_those_of_the_mean() -> None:
    rng = np.random.default_rng(1)
    seconds = rng.uniform(0, 50, 400)
    sums = Sums()
    sums.add(seconds, 100.0)
    assert sums.report()["mean_time_se_s"] == pytest.approx(seconds.std(ddof=1) / 20, abs=0.01)
    gap = Difference()
    gap.add(seconds, seconds + 5, np.zeros(400, int), 100.0)
    assert gap.report()["2"] == {"mean_s": -5.0, "se_s": 0.0}


def test_rendered_searches_pair_a_detector_of_pictures_with_the_ideal_one_from_six_distances() -> None:
    pieces = rendered_trials(1, "painted")
    assert len(pieces) == (6 + 2 + 2) * 2
    near = [piece for piece in pieces if piece.system == RLGS.name and piece.distance_m == 2.0]
    results = [do_trial(piece) for piece in near]
    assert [result["eyes"] for result in results] == ["ideal", "painted"]
    assert results[0]["world"] == results[1]["world"]
    assert all(result["distance_m"] == pytest.approx(2.0, abs=0.3) for result in results)
    systems = gather(near, results)["systems"]
    assert list(systems) == ["RLGS, ideal", "RLGS, painted"]


def test_a_search_goes_through_the_real_stack_and_the_tables() -> None:
    piece = StackTrial(15, PLANNER)
    result = do_trial(piece)
    assert result["found"]
    assert result["collisions"] == 0
    assert result["tables_success"] > 0.95
    assert sum(result["time_s"].values()) == pytest.approx(result["stack_s"], abs=0.1)
    report = gather([piece], [result])
    assert report["systems"][PLANNER]["n"] == 1
    assert trials_csv(report).count("\n") == 2
    names = [trial.system for trial in stack_trials(60)]
    assert names.count(PLANNER) == 60
    assert GHAL360.name in names
