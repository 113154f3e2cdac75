"""`rigd identify --compare` and `--law` on a recording: terminal, JSON, report, exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.commands.command import rigd

from rigd.model.errors import Exit


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sweep of the paper on PVC, ``pvc.mcap``."""
    folder = tmp_path_factory.mktemp("laws")
    done = rigd(
        "run", "constant_current", "--rig", "lugre-1", "--set", "floor=pvc", "--seed", "11",
        "--output", "pvc.mcap", cwd=folder,
    )  # fmt: skip
    assert done.code == 0, done.err
    return folder


def test_compare_names_law_that_data_support(folder: Path) -> None:
    done = rigd(
        "identify", "pvc.mcap", "--compare", "--starts", "2", "--report", "compared.html",
        cwd=folder,
    )  # fmt: skip
    assert done.code == 0, done.err
    assert "parameters: lugre-4." in done.out
    assert "More parameters are not supported: lugre (6) ΔBIC +" in done.out
    assert "does not fit" in done.out
    page = (folder / "compared.html").read_text()
    assert "Which model the data support" in page
    assert "Generalised Maxwell slip" in page


def test_a_law_of_choice_gives_its_parameters(folder: Path) -> None:
    done = rigd(
        "identify", "pvc.mcap", "--law", "lugre-4", "--json", "--no-report", cwd=folder,
    )  # fmt: skip
    assert done.code == 0, done.err
    found = json.loads(done.out)
    assert found["model"] == "lugre-4"
    assert list(found["parameters"]) == ["mu", "sigma_0", "sigma_1", "sigma_2"]
    assert found["parameters"]["sigma_0"]["estimate"] == pytest.approx(49.933, rel=0.05)
    assert found["parameters"]["sigma_1"]["estimate"] is None
    assert found["gate"]["outcome"] == "fits"


def test_law_that_does_not_fit_gives_exit_code(folder: Path) -> None:
    done = rigd("identify", "pvc.mcap", "--law", "dahl", "--report", "dahl.html", cwd=folder)
    assert done.code == Exit.MISFIT
    assert "The model does not fit these data: its residuals remember" in done.out
    assert "does not fit" in (folder / "dahl.html").read_text()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--law", "lugre4"), "no friction law 'lugre4' is installed"),
        (("--law", "dahl", "--method", "output-error"), "--law dahl: output error simulates"),
        (("--compare", "--robust"), "--compare: BIC needs the least squares"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    folder: Path, options: tuple[str, ...], said: str
) -> None:
    done = rigd("identify", "pvc.mcap", "--no-report", "--starts", "1", *options, cwd=folder)
    assert done.code == Exit.BAD_INPUT
    assert said in done.err
    assert "Traceback" not in done.err
