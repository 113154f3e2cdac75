"""Checks what `rigd design` writes and prints of a small design, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.lugre.model import saved_model

from rigd.cli.main import main


def test_designed_procedure_states_promise_and_passes_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, output = saved_model(tmp_path), tmp_path / "mu_s.yaml"
    words = f"design --model {model} --minutes 0.45 --rig lugre-1 --for mu_s,g@50mm/s -o {output}"
    assert main(words.split()) == 0
    shown = capsys.readouterr().out
    assert "constant_current, equal time" in shown
    head = output.read_text("utf-8").splitlines()[:8]
    assert head[0].startswith("# Designed by `rigd design` for mu_s,g@50mm/s in 0.45 min")
    promised = [line for line in head if line.startswith("#   pvc")]
    assert [line.split()[2] for line in promised] == ["mu_s", "g@50mm/s"]
    assert all("±" in line for line in promised)
    assert "yaml-language-server" not in output.read_text("utf-8")
    assert main(["check", str(output), "--rig", "lugre-1"]) == 0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("there.yaml", "exists already"),
        ("new.txt", "must end in .yaml"),
        ("PVC.yaml", "'PVC' is not a valid name"),
        ("2_tests.yaml", "'2_tests' is not a valid name"),
    ],
)
def test_file_that_must_not_be_written_is_refused(
    tmp_path: Path, name: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "there.yaml").write_text("mine")
    output = tmp_path / name
    words = ["design", "--model", "none.json", "--minutes", "1", "--rig", "lugre-1"]
    assert main([*words, "-o", str(output)]) == 2
    assert message in capsys.readouterr().err
    assert (tmp_path / "there.yaml").read_text() == "mine"
