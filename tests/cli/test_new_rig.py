"""``rigd new rig``: the folder runs as made, and what is wrong is shown in the description."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML
from support.commands.command import rigd

from rigd.cli.main import build_parser
from rigd.cli.plugins.new_rig.folder import write_rig
from rigd.cli.plugins.new_rig.questions import QUESTIONS, BenchQuestion, defaults, described
from rigd.cli.plugins.new_rig.yaml_text import yaml_text
from rigd.computed.controllers.driver import ControllerConfig
from rigd.config.document import parse_document
from rigd.config.loader import load_rig
from rigd.config.rig import Supervision
from rigd.model.errors import ConfigError
from rigd_drivers.can.cia402_servo.config import ServoConfig

TEXT = described("bench", defaults)


def made(folder: Path, text: str = TEXT, name: str = "bench") -> Path:
    write_rig(name, text, Path("rig.yaml"), folder / name)
    return folder / name


def spoilt(old: str, new: str) -> str:
    assert old in TEXT
    return TEXT.replace(old, new, 1)


def with_first(line: str) -> str:
    """Return the description with another first procedure."""
    head, _, rest = TEXT.partition("first:")
    return f"{head}{line}\n\nconstants:{rest.partition('constants:')[2]}"


def piped(lines: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rigd", "new", "rig", "mine"]
    return subprocess.run(
        command, cwd=folder, input=lines, capture_output=True, text=True, check=False
    )


def refused(folder: Path, text: str) -> str:
    """Return the refusal; nothing must be left."""
    with pytest.raises(ConfigError) as caught:
        made(folder, text)
    assert list(folder.iterdir()) == []
    return str(caught.value)


def test_commands_of_the_readme_are_commands(tmp_path: Path) -> None:
    text = (made(tmp_path) / "README.md").read_text("utf-8")
    shell = "\n".join(re.findall(r"^```sh\n(.*?)^```", text, re.M | re.S))
    commands = re.findall(r"^rigd .*", shell, re.M) + re.findall(r"`(rigd [^`]*)`", text)
    assert len(commands) > 5
    for command in commands:
        build_parser().parse_args(shlex.split(command, comments=True)[1:])


def test_folder_runs_and_checks_as_made(tmp_path: Path) -> None:
    done = rigd("new", "rig", "pin-on-disk", cwd=tmp_path)
    assert done.code == 0, done.err
    lab = tmp_path / "pin-on-disk"
    for command in (
        ("check", "real.yaml", "sim.yaml", "procedures/first.yaml"),
        ("run", "procedures/first.yaml", "--rig", "sim.yaml", "--output", "first.mcap"),
        ("run", "procedures/first.yaml", "--rig", "real.yaml", "--dry-run"),
    ):
        done = rigd(*command, cwd=lab)
        assert done.code == 0, done.out + done.err
    assert "played on the plant of the sibling" in done.out
    assert "daq.temperature" in done.out
    assert ".. 250  degC" in done.out
    assert "0 K" not in done.out  # no range in the unit of the recording
    done = rigd("measure", "first.mcap", cwd=lab)
    assert done.code == 0, done.out  # accepted: around the friction that was asked for
    assert "0.102 to 0.138" in done.out
    assert "rests on constants: the stated 'u' of rig.load" in done.out
    done = rigd("identify", "first.mcap", cwd=lab)
    assert "`rigd measure first.mcap`" in done.err
    done = rigd("info", "first.mcap", cwd=lab)
    assert "temperature [degC]" in done.out


def test_clean_environment_plays_new_job_green(tmp_path: Path) -> None:
    home, programs = tmp_path / "home", tmp_path / "bin"
    home.mkdir()
    programs.mkdir()
    command = programs / "rigd"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -m rigd "$@"\n')
    command.chmod(0o755)
    environment = {"HOME": str(home), "PATH": f"{programs}:/usr/bin:/bin"}

    def run(line: str, folder: Path) -> None:
        done = subprocess.run(
            ["sh", "-c", line], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr

    run("rigd new rig pin-on-disk", tmp_path)
    lab = tmp_path / "pin-on-disk"
    load = YAML(typ="safe").load
    of_gitlab = load((lab / ".gitlab-ci.yml").read_text("utf-8"))["try"]["script"]
    job = load((lab / ".github/workflows/try.yml").read_text("utf-8"))["jobs"]["try"]
    assert [step["run"] for step in job["steps"] if "run" in step] == of_gitlab
    install, *rest = of_gitlab
    assert install.startswith("pip install --find-links wheels 'rigd[analysis]==")
    for line in rest:
        run(line, lab)
    found = ElementTree.parse(lab / "results" / "first.xml").getroot()
    assert len(list(found.iter("testcase"))) > 1
    assert not [*found.iter("failure"), *found.iter("error"), *found.iter("skipped")]


def test_siblings_have_the_same_names_limits_and_interlocks(tmp_path: Path) -> None:
    lab = made(tmp_path)
    real, sim = load_rig(lab / "real.yaml"), load_rig(lab / "sim.yaml")
    assert real.devices.keys() == sim.devices.keys()
    for name, device in sim.devices.items():
        names = {channel.name for channel in device.channels}
        assert names <= {channel.name for channel in real.devices[name].channels}
        assert device.limits == real.devices[name].limits
    assert [item.name for item in real.interlocks] == [item.name for item in sim.interlocks]
    assert (lab / "rig.yaml").read_text("utf-8") == TEXT


def test_siblings_show_channels_in_the_same_units(tmp_path: Path) -> None:
    """The real drive also has a torque, which the mechanism does not measure here."""
    old = ", torque: torque}\n    setpoints: {speed: spindle}\n"
    new = "}\n    setpoints: {speed: spindle}\n    display: {speed: rpm, torque: mN m}\n"
    lab = made(tmp_path, spoilt(old, new))
    real, sim = load_rig(lab / "real.yaml"), load_rig(lab / "sim.yaml")
    for name in ("spindle.speed", "spindle.angle"):
        shown = [rig.channel(name).shown_in for rig in (real, sim)]  # type: ignore[union-attr]
        assert shown[0] == shown[1]
    assert sim.channel("spindle.speed").shown_in == "rpm"  # type: ignore[union-attr]


def test_rigs_without_hardware_stand_stalls(tmp_path: Path) -> None:
    press = Path(__file__).parents[2] / "examples" / "press" / "press.yaml"
    text = press.read_text("utf-8").replace("watchdog: 100 ms", "watchdog: 60 ms")
    lab = made(tmp_path, text, "press")
    wire, sim = load_rig(lab / "wire.yaml"), load_rig(lab / "sim.yaml")
    assert wire.supervision == sim.supervision == Supervision(0.25, 1.0)
    held = [d.config for d in wire.devices.values() if isinstance(d.config, ControllerConfig)]
    assert {item.stale_s for item in held} == {0.25}
    assert {item.stale_after_s for item in wire.interlocks} == {0.25}
    drives = [d.config for d in wire.devices.values() if isinstance(d.config, ServoConfig)]
    assert {item.watchdog for item in drives} == {0.25}


def test_folder_is_under_version_control_once(tmp_path: Path) -> None:
    lab = made(tmp_path)
    listed = subprocess.run(
        ["git", "-C", str(lab), "ls-files"], capture_output=True, text=True, check=True
    ).stdout.split()
    assert {"real.yaml", "sim.yaml", ".gitlab-ci.yml", ".github/workflows/try.yml"} <= set(listed)
    inner = made(lab, name="other")
    assert not (inner / ".git").exists()


def test_answers_from_a_pipe_are_written_down(tmp_path: Path) -> None:
    done = piped("25 mm\n\n100 rpm\n", tmp_path)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "mine" / "rig.yaml").read_text("utf-8")
    assert "radius: 25 mm" in text
    assert "speed_limit: 100 rpm" in text
    assert "load: 1 kg" in text
    # Lines that are missing are named with what was taken for them.
    assert "no further answers: taken were largest torque of the drive at the disk 4 N m" in (
        done.stderr
    )
    assert "inertia of the disk" not in done.stderr  # an empty line is an answer


@pytest.mark.parametrize(
    ("answer", "words"),
    [("25 kg", "'25 kg' is in kg, expected m"), ("30", "30 has no unit: write '30 mm'")],
)
def test_wrong_answer_from_a_pipe_is_refused(tmp_path: Path, answer: str, words: str) -> None:
    done = piped(f"{answer}\n", tmp_path)
    assert done.returncode == 2
    assert f"radius of the track on the disk: {words}" in done.stderr
    assert not (tmp_path / "mine").exists()


def test_answers_that_do_not_fit_name_no_file(tmp_path: Path) -> None:
    done = piped("30 mm\n6e-3 kg m^2\n60 rad/s\n10 mN m\n", tmp_path)
    assert done.returncode == 2
    assert "the answers make no rig: the drive cannot reach 60 rad/s" in done.stderr
    assert "rig.yaml" not in done.stderr


def test_every_default_answer_is_accepted() -> None:
    for question in QUESTIONS:
        question.accepted("")
        with pytest.raises(ValueError, match="not within"):
            question.accepted(f"1e30 {question.unit}")


@pytest.mark.parametrize("friction", ["0.05", "0.8"])
def test_accepted_range_is_around_friction_asked_for(tmp_path: Path, friction: str) -> None:
    def answer(question: BenchQuestion) -> str:
        return question.accepted(friction if question.key == "friction" else "")

    lab = made(tmp_path, described("bench", answer))
    done = rigd("run", "procedures/first.yaml", "--rig", "sim.yaml", "--output", "a.mcap", cwd=lab)
    assert done.code == 0, done.out
    assert done.out.count("accepted") == 3  # both speeds, and all


def test_interlock_sees_every_setpoint_of_first_procedure(tmp_path: Path) -> None:
    lab = made(tmp_path)
    done = rigd("check", "procedures/first.yaml", "--rig", "real.yaml", cwd=lab)
    assert "does not notice" not in done.out
    done = rigd("check", "real.yaml", cwd=lab)
    assert "does not notice" not in done.out


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("title: Pin", "titel: Pin", "5:1", "unknown key 'titel'"),
        ("pin: {mass: 0.4 kg}", "pin: {}", "11:10", "pin has no mass"),
        ("body: disk", "body: dics", "32:13", "no body 'dics'; did you mean 'disk'?"),
        ("limit: 4 N m", "limit: 40 mN m", "35:20", "the drive cannot reach 60 rad/s"),
        ("low: -50 N\n", "low: 5 N\n", "45:7", "load_cell reads 0 N at rest, outside its range"),
        ("driver: ni-daq", "driver: ni-dac", "82:13", "ni-dac"),
        ("node: 1 ", "nodes: 1 ", "70:7", "unknown key 'nodes'"),
        ("{angle: encoder, speed", "{angles: encoder, speed", "75:16",
         "cia402-rotary has no channel 'angles'"),
        ("angle: encoder", "angle: encodr", "75:23", "no sensor 'encodr'"),
        ("{angle: encoder, speed: tachometer", "{angle: tachometer, speed: encoder", "75:23",
         "'angle' of cia402-rotary is in rad, that of the mechanism in rad/s"),
        ("setpoints: {speed: spindle}", "setpoints: {speeds: spindle}", "76:17",
         "cia402-rotary has no setpoint 'speeds'"),
        ("    setpoints: {speed: spindle}\n", "", "67:5", "also takes the setpoint 'speed'"),
        ("high: 48 rad/s", "high: 70 rad/s", "78:35", "70 rad/s"),
        ("source: daq.force", "source: daq.forse", "115:13", "forse"),
        ("type: can", "type: cann", "61:11", "cann"),
        # the unit that is meant, and what the sensor can reach
        ("high: 250 degC", "high: 250", "123:11", "250 has no unit: write '250 degC'"),
        ("high: 250 degC", "high: 400 degC", "123:11", "400 degC is above 350 degC"),
        ("high: 45 N", "high: 60 N", "117:11", "60 N is above 50 N, the limit of what"),
        ("high: 350 degC", "high: 350", "55:13", "write '350 degC' or '350 K'"),
        ("scale: 5 N/V # from", "scale: 5 V/N # from", "91:18", "write '0.2 N/V'"),
        ("scale: 5 N/V}", "scale: 5 V/N}", "101:41", "it is upside down: write '0.2 N/V'"),
        ("unit: degC\n", "unit: C\n", "94:11", "did you mean 'degC'?"),
        ("load: 1 kg", "load: 2 N m", "18:13", "a mass or a force, such as '2 kg' or '20 N'"),
        ("static: 0.16", "static: 0.1", "22:17", "'static', 0.1, is below 'coulomb', 0.12"),
        ("last 2 s of hold", "last 20 s of hold", "138:3", "step 'hold' takes 5 s at most"),
    ],
)  # fmt: skip
def test_wrong_description_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, place: str, words: str
) -> None:
    said = refused(tmp_path, spoilt(old, new))
    assert f"rig.yaml:{place}: " in said
    assert words in said


@pytest.mark.parametrize(
    ("first", "words"),
    [
        ("{setpoint: spindle.sped, values: [1 rad/s]}", "no setpoint 'spindle.sped'"),
        ("{setpoint: spindle.speed, values: [90 rad/s]}", "the first procedure cannot be played"),
        ("{setpoint: spindle.speed, values: []}", "values"),
    ],
)
def test_wrong_first_procedure_is_refused(tmp_path: Path, first: str, words: str) -> None:
    said = refused(tmp_path, with_first(f"first: {first}"))
    assert words in said or "at least 1" in said
    assert said.startswith("rig.yaml:137:")


def test_first_procedure_is_what_is_described(tmp_path: Path) -> None:
    first = "first: {setpoint: spindle.speed, values: [5 rad/s], for: 1 s}"
    lab = made(tmp_path, with_first(first))
    assert "value: [5 rad/s]" in (lab / "procedures" / "first.yaml").read_text("utf-8")


@pytest.mark.parametrize(
    "text", ["", "title: x\n", "- 1\n", "devices: [\n", TEXT.split("devices:")[0]]
)
def test_half_a_description_is_refused(tmp_path: Path, text: str) -> None:
    assert refused(tmp_path, text).startswith("rig.yaml:")


def test_options_of_other_kinds_are_refused(tmp_path: Path) -> None:
    for arguments, words in (
        (("driver", "x-y", "--from", "rig.yaml"), "--from is for rigs only"),
        (("rig", "X"), "'X' is not a valid name"),
        (("rig", "x", "--from", "none.yaml"), "cannot read none.yaml"),
        (("rig", "x", "--kind", "slow"), "--kind is for drivers only"),
    ):
        done = rigd("new", *arguments, cwd=tmp_path)
        assert done.code == 2
        assert words in done.err
    (tmp_path / "x").mkdir()
    assert "exists already" in rigd("new", "rig", "x", cwd=tmp_path).err


@pytest.mark.parametrize(
    "value",
    ["1 kg", "a: b", "a #b", "'q'", "{x}", "-1 N", "a, b", " x", "", "x\ny", "50 %", "[a", "|x|",
     "a\\b", "- a", "°C", "é: \"ü\"", "x:"],
)  # fmt: skip
def test_written_yaml_reads_as_the_same_data(value: str) -> None:
    data = {"a": value, "b": {"c": value, "d": [value, {"e": value, "f": [value]}]}, "g": [value]}
    assert parse_document(yaml_text(data), Path("x")).data == data
