"""The front door for programs: rigd.open, rigd.run and rigd.identify do what the commands do."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

import rigd
from rigd.cli.main import main
from rigd.model.errors import ConfigError, DataError, RecordingError


@pytest.fixture(scope="module")
def pvc(tmp_path_factory: pytest.TempPathFactory) -> rigd.Recording:
    """Ten currents on PVC, played by the front door."""
    path = tmp_path_factory.mktemp("runs") / "pvc.mcap"
    return rigd.run("constant_current", rig="lugre-1", out=path, set={"floor": "pvc"})


@pytest.fixture(scope="module")
def result(pvc: rigd.Recording) -> rigd.Result:
    return rigd.identify(pvc, method="slip-force", starts=1)


def test_every_public_name_is_found() -> None:
    for name in rigd.__all__:
        assert getattr(rigd, name).__doc__
    assert {*rigd.__all__} <= {*dir(rigd)}
    with pytest.raises(AttributeError, match="no attribute 'lode'"):
        rigd.lode  # type: ignore[attr-defined]  # noqa: B018


def test_run_gives_recording_of_the_command(tmp_path: Path) -> None:
    played = rigd.run("quick", rig="lugre-1", out=tmp_path / "played.mcap", set={"current": "1 A"})
    file = tmp_path / "command.mcap"
    command = ["run", "quick", "--rig", "lugre-1", "--set", "current=1 A", "--quiet"]
    assert main([*command, "--output", str(file)]) == 0
    assert file.read_bytes() == played.path.read_bytes()


def test_recording_states_its_run(pvc: rigd.Recording) -> None:
    assert (pvc.rig, pvc.procedure, pvc.state) == ("lugre-1", "constant_current", "complete")
    assert pvc.complete and not pvc.losses
    assert pvc.started == datetime(2020, 1, 2, tzinfo=UTC)
    assert pvc.parameters["floor"] == "pvc"
    assert pvc.trial(3).verdict == "complete"


def test_cut_recording_states_what_it_lacks(pvc: rigd.Recording, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(pvc.path.read_bytes()[: pvc.size // 2])
    with pytest.raises(RecordingError, match="is damaged: the file has no end"):
        rigd.open(cut)
    intact = rigd.open(cut, partial=True)
    assert intact.state == "interrupted"
    assert not intact.complete
    assert "damaged" in intact.losses[0]
    assert len(intact.trial(1)["carriage"]) == len(pvc.trial(1)["carriage"])


def test_samples_are_same_in_every_form(pvc: rigd.Recording) -> None:
    table = pvc.trial(3)["carriage"]
    frame, arrow, rows = table.to_pandas(), table.to_arrow(), table.to_numpy()
    for name in table.columns:
        np.testing.assert_array_equal(frame[name].to_numpy(), table[name])
        assert arrow[name].to_pylist() == list(table[name])
        np.testing.assert_array_equal(rows[name], table[name])
    assert arrow.schema.field("position").metadata == {
        b"unit": b"m",
        b"doc": table.docs["position"].encode(),
    }


def test_run_takes_start_and_description(tmp_path: Path) -> None:
    found = rigd.run(
        Path("procedures/quick.yaml"), rig=Path("configs/sim_lugre.yaml"), out=tmp_path / "q.mcap",
        start=datetime(2026, 11, 21, 8), seed=3, operator="A. Miller", meta={"batch": 13},
    )  # fmt: skip
    assert found.started == datetime(2026, 11, 21, 8, tzinfo=UTC)
    assert found.metadata["meta"] == {"batch": "13"}
    assert found.info.seed == "3"


def test_run_in_a_thread_is_recorded(tmp_path: Path) -> None:
    done: list[rigd.Recording] = []
    play = threading.Thread(
        target=lambda: done.append(rigd.run("quick", rig="lugre-1", out=tmp_path / "q.mcap"))
    )
    play.start()
    play.join()
    assert done[0].complete


def test_run_of_real_rig_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"wire-1 is not simulated in process: rigd\.run plays"):
        rigd.run("quick", rig="wire-1", out=tmp_path / "q.mcap")
    assert not list(tmp_path.iterdir())


def test_wrong_value_raises_the_commands_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = {"floor": "ice"}
    with pytest.raises(ConfigError) as caught:
        rigd.run("constant_current", rig="lugre-1", out=tmp_path / "q.mcap", set=wrong)
    main(["run", "constant_current", "--rig", "lugre-1", "--set", "floor=ice"])
    assert capsys.readouterr().err == f"rigd: {caught.value}\n"


def test_control_character_in_note_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="the note"):
        rigd.run("quick", rig="lugre-1", out=tmp_path / "q.mcap", note="a\x1bb")


def test_identified_numbers_are_those_of_json(result: rigd.Result, pvc: rigd.Recording) -> None:
    told = result.to_json()
    assert json.loads(json.dumps(told, allow_nan=False))["recordings"] == [str(pvc.path)]
    parameters = told["parameters"]
    assert isinstance(parameters, dict)
    for name, entry in parameters.items():
        found = result[name]
        assert (found.value, found.low, found.high, found.unit, found.determined) == (
            entry["estimate"], entry["low"], entry["high"], entry["unit"], entry["identifiable"],
        )  # fmt: skip
        assert entry["sentence"] in found.reason
    assert result.fits
    assert result["sigma_0"].determined


def test_undetermined_parameter_has_reason_and_no_number(result: rigd.Result) -> None:
    missing = [item for item in result.parameters if item.value is None]
    assert missing, "slip-force determines all of PVC now: take another recording"
    frame = result.to_pandas().set_index("parameter")
    for item in missing:
        assert (item.low, item.high, item.determined) == (None, None, False)
        assert len(item.reason) > 20
        assert frame["value"].isna()[item.name]
        assert not frame.loc[item.name, "determined"]
        assert item.verdict in repr(result)
    assert frame.loc["sigma_0", "value"] == result["sigma_0"].value


def test_unknown_parameter_names_those_there_are(result: rigd.Result) -> None:
    with pytest.raises(KeyError, match="sigma_0"):
        result["sigma_9"]
    assert result["pvc", "sigma_0"] == result["sigma_0"]


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"law": "ice"}, ConfigError, "ice"),
        ({"starts": 0}, ConfigError, "between 1 and 1000"),
        ({"set": {"torque_konstant": "1 N"}}, ConfigError, "no such constant"),
        ({"plan": "nowhere.yaml"}, ConfigError, "nowhere"),
    ],
)
def test_wrong_option_raises_the_commands_error(
    pvc: rigd.Recording, options: dict[str, object], error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says):
        rigd.identify([pvc], **options)  # type: ignore[arg-type]


def test_nothing_to_identify_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no recording"):
        rigd.identify([])
    with pytest.raises(RecordingError, match="nothing"):
        rigd.identify("nothing.mcap")


def test_report_never_overwrites_a_recording(result: rigd.Result, pvc: rigd.Recording) -> None:
    with pytest.raises(ConfigError, match="would overwrite a recording"):
        result.report(pvc.path)


def test_result_is_compared_without_identifying_again(result: rigd.Result) -> None:
    (origin,) = result.origins
    other = replace(result, origins=(replace(origin, recording="other.mcap"),))
    found = rigd.compare(result, other, names=("before", "after"))
    assert found.parameters and not found.different
    assert found["mu_c"].changes["after"][0] == 0.0
    with pytest.raises(DataError, match="is in both"):
        rigd.compare(result, result)
