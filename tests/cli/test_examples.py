"""Every command of README and of ``--help`` does what its reader expects.

A command stands in one of three tables: it is run here, with what it shows; or another test runs
it; or nothing can, and the reason stands there. A command in none of them fails.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from support.commands.asking import ASKING
from support.commands.examples import of_help, of_readme, words_of
from support.recordings.imported import MAP
from support.wire import free_ports

from rigd.cli.main import COMMANDS, build_parser, command_name, main
from rigd.cli.plugins.new_rig.questions import defaults, described
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.engine.run.result import Progress
from rigd.model.severity import Severity
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder

TESTS = Path(__file__).resolve().parents[1]
DAY = "runs/20261121-080000"
PVC = f"{DAY}-constant_current-pvc.mcap"
QUICK = f"{DAY}-quick.mcap"
BREAKAWAY = f"{DAY}-breakaway.mcap"
TORQUE = f"{DAY}-calibrate_torque.mcap"
ANGLES = f"{DAY}-approach_angles.mcap"
RUN_PVC = "run procedures/constant_current.yaml --rig configs/sim_lugre.yaml --set floor=pvc"


@dataclass(frozen=True)
class Shows:
    """What a command shows; ``means`` is what a reader puts in for its placeholders."""

    text: str
    means: Mapping[str, str] = field(default_factory=dict)
    code: int = 0


SHOWN: dict[str, Shows] = {
    "rigd --help": Shows("exit codes:"),
    "rigd identify runs/<that run>.mcap --calibration calibrations/approach_angle.yaml": Shows(
        "clean_0", {"runs/<that run>.mcap": ANGLES}
    ),
    f"rigd identify {PVC}": Shows("sigma_2"),
    "rigd identify runs/*constant_current*.mcap": Shows("sigma_2"),
    "rigd identify FILE --figures figures/": Shows("index.csv says what each is", {"FILE": TORQUE}),
    "rigd identify FILE --json": Shows('"recordings"', {"FILE": ANGLES}),
    "rigd identify runs/*approach_angles*.mcap": Shows("clean_0"),
    "rigd identify FILE --compare": Shows("Fewer do not suffice", {"FILE": PVC}),
    "rigd identify FILE --law lugre-4": Shows("sigma_0", {"FILE": PVC}),
    "rigd identify FILE --calibration new.yaml": Shows("clean_0", {"FILE": ANGLES}),
    'rigd identify FILE --set wheel_radius="50 mm"': Shows(
        "corrected wheel_radius: 50 mm in the recording, 50 mm here", {"FILE": ANGLES}
    ),
    "rigd identify identified.mcap --json > model.json": Shows(
        '"point"', {"identified.mcap": PVC}
    ),
    "rigd validate model.json validation.mcap": Shows("confirmed", {"validation.mcap": PVC}),
    "rigd validate model.json runs/*validation*.mcap": Shows(
        "confirmed", {"runs/*validation*.mcap": PVC}
    ),
    "rigd validate model.json FILE --json": Shows('"outcome"', {"FILE": PVC}),
    "rigd validate model.json FILE --group pvc": Shows("confirmed", {"FILE": PVC}),
    'rigd validate model.json FILE --set torque_constant="29.8 mN m/A"': Shows(
        "corrected torque_constant", {"FILE": PVC}
    ),
    "rigd validate MODEL.json FILE": Shows("confirmed", {"MODEL": "model", "FILE": PVC}),
    f"rigd {RUN_PVC}": Shows("identify:    rigd identify runs/"),
    "rigd run procedures/constant_current.yaml --set floor=pvc": Shows(
        "no --rig: simulated on lugre-1"
    ),
    # Other examples run here, too: what `last` means is in tests/cli/test_chosen_rig.py.
    "rigd identify last": Shows("sigma_2", {"last": PVC}),
    "rigd run procedures/quick.yaml": Shows("1 of 1 trials"),
    "rigd run procedures/quick.yaml --rig configs/sim_lugre.yaml": Shows("1 of 1 trials"),
    "rigd run procedures/quick.yaml --rig lugre-1": Shows("1 of 1 trials"),
    "rigd run procedures/quick.yaml --rig lugre-1 --junit result.xml": Shows("1 of 1 trials"),
    'rigd run procedures/quick.yaml --rig lugre-1 --operator "A. Miller" --specimen W7 '
    "--meta batch=13": Shows("1 of 1 trials"),
    "rigd run procedures/quick.yaml --rig wire-1 --dry-run": Shows(
        "played on the plant of the sibling lugre-1"
    ),
    "rigd run … --dry-run": Shows(
        "every predicted peak is inside its limit", {"…": "procedures/quick.yaml --rig lugre-1"}
    ),
    "rigd run --resume runs/<run>.mcap": Shows("2 of 2 trials", {"<run>": "interrupted"}),
    "rigd run --resume runs/interrupted.mcap": Shows("2 of 2 trials"),
    "rigd check procedures/*.yaml --rig lugre-1": Shows(
        "6 right, 11 for another rig (no contact, daq, first_left, first_right, front_marker, "
        "last_left, last_right, left_motor, marker_first, "
        "marker_last, marker_middle, rear_marker, relay, right_motor, scale, spindle)"
    ),
    "rigd check configs/sim_lugre.yaml": Shows("rig lugre-1, 7 devices"),
    "rigd check my_procedure.yaml": Shows("on lugre-1: right"),
    'rigd calibrate procedures/calibrate_torque.yaml --rig angle-1 --operator "J. Doe"': Shows(
        "new values beside old", code=3  # no terminal to ask at: tests/system/test_calibrate.py
    ),
    f'rigd calibrate --from {TORQUE} --operator "A. Miller"': Shows(
        "new values beside old", code=3
    ),
    'rigd note runs/20261121-080000-quick.mcap "the wheel was worn, as seen later"': Shows("worn"),
    'rigd note FILE "not to be used: wrong floor" --author "A. Miller"': Shows(
        "(A. Miller, ", {"FILE": QUICK}
    ),
    "rigd runs": Shows("4/4"),
    "rigd runs data/ --procedure constant_current --set floor=pvc": Shows("4/4"),
    "rigd runs --state interrupted": Shows("no recordings in runs match"),
    "rigd runs --since 7d --meta batch=13": Shows("recording"),
    """rigd runs --where 'specimen.coating == "PTFE" and started >= 2026-09-01'""": Shows(
        "no recording here has a field 'specimen.coating'", code=2
    ),
    "rigd can eds eds/rigd_servo.eds": Shows("rigd simulated servo"),
    "rigd can eds drive.eds": Shows("rigd simulated servo"),
    "rigd can eds drive.eds --objects": Shows("6041"),
    "rigd can eds drive.eds --json": Shows("{"),
    "rigd info FILE": Shows("lugre-1", {"FILE": QUICK}),
    f"rigd info {QUICK}": Shows("lugre-1"),
    "rigd info runs/*.mcap": Shows("lugre-1"),
    "rigd info FILE --json": Shows('"rig": "lugre-1"', {"FILE": QUICK}),
    "rigd info FILE --attachments folder/": Shows("folder/rig.yaml", {"FILE": QUICK}),
    "rigd import old/*.csv --propose": Shows("push.yaml: to fill in: lines"),
    "rigd import old/*.csv --map map.yaml": Shows("runs/push.mcap: 1 trial"),
    "rigd import old/*.csv --map map.yaml --out imported/": Shows("imported/push.mcap: 1 trial"),
    "rigd import old/*.csv --map map.yaml --out W7/ --specimen W7 --meta batch=13": Shows(
        "W7/push.mcap: 1 trial"
    ),
    "rigd export FILE --to parquet": Shows(".parquet", {"FILE": QUICK}),
    f"rigd export {QUICK} --to parquet": Shows(".parquet"),
    "rigd export FILE --to csv --stream carriage --stream wheel_servo --output tables/": Shows(
        "carriage.csv", {"FILE": QUICK}
    ),
    "rigd export FILE --to mat --trials 7,12-15": Shows(
        ".mat", {"FILE": QUICK, "7,12-15": "1"}
    ),
    "rigd export FILE --to hdf5": Shows("quick.h5", {"FILE": QUICK}),
    "rigd export FILE --to mdf4 --output quick.mf4": Shows("quick.mf4", {"FILE": QUICK}),
    'rigd export FILE --to csv --rate "100 Hz"': Shows("joined.csv", {"FILE": QUICK}),
    "rigd export FILE --to csv --on carriage --between linear": Shows(
        "joined.csv", {"FILE": PVC}
    ),
    "rigd export FILE --to csv --derived friction.yaml": Shows("way.csv", {"FILE": BREAKAWAY}),
    'rigd export FILE --to rocrate --license CC-BY-4.0 --author "Ada Lovelace"': Shows(
        ".crate.zip", {"FILE": QUICK}
    ),
    "rigd layout lugre-1 --to foxglove": Shows("lugre-1.foxglove.json"),
    "rigd layout configs/sim_lugre.yaml --to plotjuggler": Shows("lugre-1.plotjuggler.xml"),
    "rigd layout FILE --to foxglove": Shows("quick.foxglove.json", {"FILE": QUICK}),
    "rigd export runs/*.mcap --to parquet --output tables/": Shows("trials.parquet"),
    "rigd measure FILE --plan breakaway": Shows("accepted", {"FILE": BREAKAWAY}),
    "rigd measure FILE --json": Shows('"verdict": "accepted"', {"FILE": BREAKAWAY}),
    "rigd measure FILE --junit result.xml": Shows("accepted", {"FILE": BREAKAWAY}),
    f"rigd measure {BREAKAWAY}": Shows("repeatability only"),
    "rigd measure runs/*breakaway*.mcap": Shows("accepted"),
    "rigd report FILE": Shows("-quick-run.html", {"FILE": QUICK}),
    f"rigd report {QUICK}": Shows("-quick-run.html"),
    "rigd report FILE --output page.html": Shows("page.html", {"FILE": QUICK}),
    f"rigd verify {PVC}": Shows("whole"),
    "rigd verify FILE": Shows("whole", {"FILE": QUICK}),
    "rigd verify runs/*.mcap": Shows("whole"),
    "rigd verify FILE --json": Shows('"sound": true', {"FILE": QUICK}),
    "rigd recover FILE": Shows("intact", {"FILE": QUICK}),
    f"rigd recover {PVC}": Shows("intact"),
    "rigd recover runs/*.mcap": Shows("intact"),
    "rigd recover": Shows("there is no recording of a killed run to complete"),
    "rigd drivers": Shows("serial-scale"),
    "rigd drivers serial-scale": Shows("tare"),
    "rigd drivers serial-scale --json": Shows('"tare"'),
    "rigd analyses": Shows("lugre"),
    "rigd analyses lugre": Shows("motor_current (A)"),
    "rigd analyses lugre --json": Shows('"motor_current": "A"'),
    "rigd new analysis NAME": Shows("my-analysis", {"NAME": "my-analysis"}),
    "rigd new analysis acme-coast": Shows("acme-coast"),
    "rigd new friction-law acme-rubber": Shows("acme-rubber"),
    "rigd new driver NAME": Shows("my-driver", {"NAME": "my-driver"}),
    "rigd new driver acme-scale --kind slow": Shows("acme-scale"),
    "rigd new driver acme-servo --kind fast": Shows("acme-servo"),
    "rigd new plant acme-sled": Shows("acme-sled"),
    "rigd new rig pin-on-disk": Shows("pin-on-disk"),
    "rigd new rig my-rig --from rig.yaml": Shows("my-rig"),
    "rigd schema procedure": Shows("rigd procedure file"),
    "rigd completion bash": Shows("_shtab_rigd"),
    "rigd remote list": Shows("lugre-9"),
    "rigd remote setup-tls certs --host rig.lab --host 192.168.0.7 --client alice --client panel":
        Shows("alice"),
    "rigd remote setup-tls certs --client bob": Shows("bob"),
    "rigd schema procedure > procedure.schema.json": Shows(""),
    "rigd completion bash > ~/.local/share/bash-completion/completions/rigd": Shows(""),
}  # fmt: skip

#: Commands that need devices at the wire, a daemon or real time, and the file that runs them.
ELSEWHERE: dict[str, tuple[str, ...]] = {
    "cli/test_compare.py": (
        "rigd compare before.mcap after.mcap",
        "rigd compare before/ after/",
        "rigd compare 'runs/*W7*.mcap' 'runs/*W8*.mcap'",
        "rigd compare before.json after.json",
        "rigd compare runs/*constant_current*.mcap --by month",
        "rigd compare runs/*constant_current*.mcap --by meta.batch",
        "rigd compare before.mcap after.mcap --json",
    ),
    "support/wire.py": (
        "rigd sim configs/wire_lugre.yaml",
        "rigd sim wire-1 --faults my_faults.yaml",
    ),
    "sim/lugre/test_wire.py": ("rigd sim wire-1 --profile wheel_servo=maxon-epos4",),
    "system/test_real_rig.py": (
        "rigd run procedures/constant_current.yaml --rig wire-1",
        "rigd jog",
        "rigd jog wheel_servo.current=0.1A --for 2s --rig lugre-1",
        "rigd jog longitudinal_belt.speed=-50mm/s --for '1 s' --rig wire-1",
    ),
    "system/test_manual.py": (
        "rigd read --rig RIG",
        "rigd read --rig wire-1",
        "rigd read --rig wire-1 scale carriage.position",
        "rigd read --rig wire-1 --once --json",
        "rigd read --rig wire-1 --for 10s --json",
        "rigd tare",
        "rigd tare scale --rig wire-1",
        "rigd tare scale --action zero --rig wire-1",
        "rigd doctor",
        "rigd doctor --rig wire-1",
        "rigd doctor --rig wire-1 --json",
    ),
    "system/test_identify_command.py": ("rigd identify",),
    "cli/test_design.py": (
        "rigd design --model oe.json --minutes 1 --rig lugre-1 --for mu_s,g@50mm/s -o mu_s.yaml",
    ),
    "analyses/lugre/test_joint_fit.py": ("rigd identify FILE --joint",),
    "../docs/identification.md": (
        "rigd run constant_current --rig lugre-1 --set floor=pvc",
        "rigd identify FILE --method slip-force",
        "rigd identify identified.mcap --json > oe.json",
        "rigd design --model oe.json --minutes 5 --rig lugre-1",
        "rigd identify FILE --plan constant_current",
    ),
    "analyses/lugre/slip/test_filter.py": (
        "rigd filter runs/20261121-080000-quick.mcap --rig my_rig.yaml",
        "rigd filter FILE --rig my_rig.yaml --observer slip_filter --output slip.mcap",
    ),
    "../docs/lateral.md": ("rigd identify LATERAL --model MODEL.json",),
    "../docs/recordings.md": ("rigd report FILE --trials 7,12-15",),
    "../docs/calibration.md": (
        'rigd calibrate procedures/calibrate_torque.yaml --rig angle-1 --operator "A. Miller"',
    ),
    "system/test_calibrate.py": (
        "rigd calibrate procedures/calibrate_scale.yaml --rig angle-1 "
        '--operator "A. Miller" --valid 180d',
    ),
    "system/test_run_command.py": (
        "rigd run procedures/constant_current.yaml --rig lugre-1 --dry-run",
    ),
    "support/daemon/process.py": (
        "rigd serve",
        "rigd serve --rig lugre-1",
        "rigd serve --rig configs/sim_lugre.yaml",
        "rigd serve --rig wire-1 --no-panel --foxglove",
    ),
    "support/panel/served.py": (
        "rigd panel",
        "rigd panel --rig lugre-1 --port 8500",
        "rigd panel --rig wire-1 --host 0.0.0.0 --name rig.lab --https-certificate certs/panel.crt "
        "--https-key certs/panel.key",
    ),
    "../docs/remote.md": (
        "rigd remote",
        "rigd remote start quick --rig lugre-1 --watch",
        "rigd remote start procedures/mine.yaml --set floor=pvc",
        "rigd remote start quick --yes --watch --json",
        "rigd remote status",
        "rigd remote status --rig lugre-1",
        "rigd remote status --watch",
        'rigd remote stop --reason "wrong floor"',
        "rigd remote lease",
        "rigd remote dry-run procedures/mine.yaml --rig lugre-1",
        "rigd remote dry-run constant_current --set floor=pvc",
        "rigd remote runs --where 'specimen == W7 and started > 2026-09-01'",
        "rigd remote fetch RUN",
        "rigd remote fetch lugre-1_quick_20261121T080000.mcap --to data/",
    ),
    "cli/remote/test_commands.py": (
        "rigd remote events --follow",
        "rigd remote events --since 120 --json",
        "rigd remote answer '1.2 kg'",
        "rigd remote answer yes",
        "rigd remote lease request",
        "rigd remote lease give bob",
        "rigd remote lease take",
        "rigd remote lease seize",
        "rigd remote report RUN",
        "rigd remote report RUN --make",
    ),
    "system/test_articulated.py": (
        "rigd run straight_speeds --rig articulated-1",  # 14 runs, and 5 circles
        "rigd run circles --rig articulated-1",
    ),
    "../scripts/demo": (
        "rigd run approach_angles --rig angle-1",  # 200 runs
        "rigd run procedures/constant_current.yaml --rig lugre-1 --set floor=pvc",
    ),
}

#: Commands that no test runs, and why.
NEVER: dict[str, str] = {
    "make demo": "`.ci/run` does",
    "make test": "this is it",
    "make test-long": "`.ci/run` plays a part of them",
    "make check": "`.ci/run` does",
    "make docs": "`.ci/run` does",
    "make bench": "takes an hour; each of its parts has a test of its own",
    "rigd identify before.mcap after.mcap --group-by recording": (
        "15 s of CPU; tests/analysis/test_several_recordings.py evaluates so, without the command"
    ),
    "python3 -m venv .venv": "the environment of this test",
    "pip install '.[analysis,panel]'": "changes this environment; tests/packaging builds one",
    "pip install .": "changes this environment; tests/packaging builds and installs the package",
    ". .venv/bin/activate": "the environment of this test",
    "pip install -e 'acme-scale[test]' && pytest acme-scale && rigd drivers acme-scale": (
        "changes this environment; tests/cli/test_new.py builds, installs and tests such a package"
    ),
    'rigd completion zsh > "${fpath[1]}/_rigd"': "there is no zsh; tests/cli/test_main.py reads it",
    "rigd completion fish > ~/.config/fish/completions/rigd.fish": (
        "there is no fish; tests/cli/test_main.py reads it"
    ),
}

READERS = list(dict.fromkeys([*of_readme(), *of_help()]))
TABLES = [*SHOWN, *(command for commands in ELSEWHERE.values() for command in commands), *NEVER]


def redirected(command: str) -> tuple[str, str]:
    """Return a command and the file that its output goes to; "" if it goes to none."""
    match = re.search(r" > ([~\w./-]+)$", command)  # a `>` within quotes compares
    return (command, "") if match is None else (command[: match.start()], match[1])


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder as the checkout, with recordings as the commands before would leave them.

    The campaign has four of its ten currents.
    """
    folder = tmp_path_factory.mktemp("desk")
    for kind in ("configs", "procedures"):
        shutil.copytree(shipped_folder(kind), folder / kind)
    shutil.copytree(folder / "configs" / "calibrations", folder / "calibrations")
    shutil.copy(folder / "calibrations" / "approach_angle.yaml", folder / "new.yaml")
    shutil.copy(folder / "procedures" / "quick.yaml", folder / "my_procedure.yaml")
    shutil.copy(folder / "configs" / "eds" / "rigd_servo.eds", folder / "drive.eds")
    (folder / "rig.yaml").write_text(described("my-rig", defaults), "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("runs").mkdir()
        campaign = Path("procedures/constant_current.yaml").read_text("utf-8")
        assert campaign.count("step: 0.15 A") == 1
        few = Path("few.yaml")
        few.write_text(campaign.replace("step: 0.15 A", "step: 0.45 A"), "utf-8")
        assert run(f"run few.yaml --rig lugre-1 --set floor=pvc --output {PVC}") == 0
        few.unlink()  # it would be found by the name of the campaign
        assert run(f"run quick --rig lugre-1 --output {QUICK}") == 0
        assert run(f"run breakaway --rig lugre-1 --output {BREAKAWAY}") == 0
        assert run(f"run calibrate_torque --rig angle-1 --output {TORQUE}") == 0
        found = "--set set=clean_0 --set load=4kg --set voltage=10V --start 2026-11-22"
        assert run(f"run approach_angles --rig angle-1 {found} --output {ANGLES}") == 0
        Path("data").symlink_to("runs")
        Path("old").mkdir()
        Path("old/push.csv").write_text("t,F,v\n0,1,2\n0.001,2,3\n")
        Path("map.yaml").write_text(MAP, "utf-8")
        # A rig elsewhere that is off: what else this machine serves is not known here.
        Path("rigd").mkdir()
        Path("rigd/remotes.yaml").write_text(
            f"remotes:\n  lugre-9: {{endpoint: tcp/127.0.0.1:{free_ports(1)[0]}}}\n"
        )
        Path("asking.yaml").write_text(ASKING, "utf-8")
        Path("friction.yaml").write_text("derived: {way.gone: {is: abs(carriage.position)}}\n")
        rig, source = load_rig("lugre-1"), load_procedure("asking.yaml")
        interrupted = RunRequest(
            compile_procedure(source, rig), source.file.text, rig, 1,
            output=Path("runs/interrupted.mcap"),
        )  # fmt: skip
        control = Control()

        def stop_in_first_trial(progress: Progress) -> None:
            if progress.trial is not None:
                control.request(Severity.STOP, "stopped by a person")

        assert perform(interrupted, control, watch=stop_in_first_trial).result.exit_code == 5
    return folder


def run(line: str) -> int:
    return main(words_of(line, {}))


@pytest.fixture(scope="module")
def model(desk: Path) -> None:
    """Write ``model.json``, which takes as long as all others of these files."""
    with pytest.MonkeyPatch.context() as patch, (desk / "model.json").open("w") as file:
        patch.chdir(desk)
        with redirect_stdout(file):
            assert run(f"identify {PVC} --json --no-report") == 0


def ended(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    """Run a command; return its exit code, and what it printed to both streams."""
    try:
        code = main(words)
    except SystemExit as left:  # argparse, after `--help`
        code = int(left.code or 0)
    return code, *capsys.readouterr()


@pytest.fixture(scope="module")
def told() -> dict[tuple[str, ...], tuple[int, str, str]]:
    """Return what commands have shown: those that mean the same to the letter run once."""
    return {}


@pytest.mark.parametrize("command", SHOWN)
def test_example_command_gives_the_described_result(
    command: str,
    desk: Path,
    told: dict[tuple[str, ...], tuple[int, str, str]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    if " validate " in command:
        request.getfixturevalue("model")
    monkeypatch.chdir(desk)
    monkeypatch.setenv("HOME", str(desk))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(desk))
    shows = SHOWN[command]
    line, file = redirected(command)
    program, *words = words_of(line, shows.means)
    assert program == "rigd"
    code, out, err = told.get(tuple(words)) or ended(words, capsys)
    told[tuple(words)] = code, out, err
    assert code == shows.code, err
    assert shows.text in out + err
    assert file == "" or out


@pytest.mark.parametrize("command", sorted({*READERS} - {*SHOWN, *NEVER}))
def test_command_listed_as_tested_elsewhere_exists(command: str) -> None:
    name = command.split()[1]
    if command == f"rigd {name}":
        assert name in [command_name(module) for module in COMMANDS]
    elif command.startswith("rigd "):
        line, _ = redirected(command)
        build_parser().parse_args(words_of(line, {})[1:])


def test_each_command_is_in_the_table_once() -> None:
    assert len(TABLES) == len(set(TABLES))
    assert {*READERS} - {*TABLES} == set(), "put it in a table, with what it shows"
    assert {*TABLES} - {*READERS} == set(), "no page shows this any more"


@pytest.mark.parametrize(("file", "commands"), ELSEWHERE.items())
def test_command_tested_elsewhere_is_used_there(file: str, commands: tuple[str, ...]) -> None:
    text = (TESTS / file).read_text("utf-8")
    for command in commands:
        words = command.split()
        depth = 2 if words[1] == "remote" and len(words) > 2 else 1
        assert re.search(rf"\b{words[depth]}\b", text), command
