"""Each figure of README and index is one that `make bench` prints, or stands in a shipped file."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/index.md")
#: A number with its unit, or in words how often.
QUANTITY = re.compile(
    r"\b(?:\d[\d.]*|two|five|ten|twenty|fifty|hundred|thousand)[ -]"
    r"(?:times|fold|runs|[mkM]?Hz|[numµ]?s|[mkuµ]?m|[kMG]?B|%|seconds?|minutes?|hours?|cycles?)(?!\w)"
)
#: What we measured, by the benchmark and the name of the line that it prints.
MEASURED = {"30 ms": ("simulated_run", "simulated run, CPU time of a second of the rig")}
#: What is set or published, by the file that states it and its text there.
STATED = {
    "twenty times": ("README.md", "`--pace 20` twenty times as fast"),
    "200 runs": ("docs/approach_angle.md", "it has 200 runs"),
    "9600 Hz": ("configs/sim_approach_angle.yaml", "rate: 9600 Hz"),
    "1 kHz": ("configs/sim_articulated.yaml", "cycle: 1 kHz"),
    "25 Hz": ("configs/plants/articulated.yaml", "rate: 25 Hz"),
    "0.466 m": ("procedures/circles.yaml", "the paper's model gives 0.466 m"),
    "100 Hz": ("docs/rigs.md", "100 Hz to 5 kHz"),
    "5 kHz": ("docs/rigs.md", "100 Hz to 5 kHz"),
}


def words(file: str) -> str:
    """Return the text of a file on one line."""
    return " ".join((ROOT / file).read_text("utf-8").split())


def figures(page: str) -> set[str]:
    """Return the figures of a page, without those in its commands."""
    return set(QUANTITY.findall(re.sub(r"```.*?```|`[^`]*`", "", words(page))))


def printed(benchmark: str) -> set[str]:
    """Return the names of the figures that a benchmark prints."""
    tree = ast.parse((ROOT / "benchmarks" / f"{benchmark}.py").read_text("utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args]
    lines = [
        call.args[0]
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id in ("noted", "at_least", "at_most")
    ]
    return {line.value for line in lines if isinstance(line, ast.Constant)}  # type: ignore[misc]


def benches() -> tuple[str, ...]:
    """Return the benchmarks that `make bench` plays."""
    tree = ast.parse((ROOT / "benchmarks" / "all.py").read_text("utf-8"))
    (found,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "BENCHES"
    )
    names: tuple[str, ...] = ast.literal_eval(found)
    return names


@pytest.mark.parametrize("page", PAGES)
def test_figures_of_page_are_those_known(page: str) -> None:
    assert figures(page) <= MEASURED.keys() | STATED.keys()


def test_known_figures_stand_in_readme() -> None:
    assert figures("README.md") == MEASURED.keys() | STATED.keys()


@pytest.mark.parametrize(("benchmark", "line"), MEASURED.values())
def test_make_bench_prints_the_measured_figure(benchmark: str, line: str) -> None:
    assert benchmark in benches()
    assert line in printed(benchmark)


@pytest.mark.parametrize(("file", "text"), STATED.values())
def test_shipped_file_states_the_figure(file: str, text: str) -> None:
    assert text in words(file)
