"""A proposed map gives the numbers of other readers; what files do not show is to be filled in."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsFile, TdmsWriter
from numpy.typing import NDArray
from support.commands.command import rigd

from rigd.importing import Proposal, import_files, parse_map, propose
from rigd.model import ConfigError
from rigd.record import Recording

COUNT = 500
TIMES_S = np.arange(COUNT) / 1000.0
FORCE = np.random.default_rng(5).normal(size=COUNT)
TABLE = pd.DataFrame({"t [s]": TIMES_S, "Force [kN]": FORCE})
Numbers = tuple[NDArray[np.float64], NDArray[np.float64]]


def imported(
    proposal: Proposal, files: Sequence[Path], units: Mapping[str, str] | None = None
) -> list[Recording]:
    """Import by a proposed map, with the units of columns filled in."""
    text = proposal.text
    for column, unit in (units or {}).items():
        pattern = rf'(column: "?{re.escape(column)}"?,?\s+unit: )"\?"'
        text, count = re.subn(pattern, rf'\1"{unit}"', text)
        assert count == 1, text
    what = parse_map(text, Path("proposed.yaml"))
    return [Recording.open(m.path) for m in import_files(what, files, files[0].parent / "runs")]


def as_pandas(path: Path, **options: object) -> Numbers:
    read = pd.read_csv(path, **options)  # type: ignore[call-overload]
    return read.iloc[:, 0].to_numpy(), read.iloc[:, 1].to_numpy()


def read_parquet(path: Path) -> Numbers:
    read = pd.read_parquet(path)
    return read["t [s]"].to_numpy(), read["Force [kN]"].to_numpy()


def write_german(path: Path) -> None:
    body = TABLE.rename(columns={"t [s]": "Zeit [s]", "Force [kN]": "Kraft µ [kN]"})
    text = body.to_csv(sep=";", decimal=",", index=False)
    path.write_text(f"Versuch 7\n\n{text}", encoding="latin-1")


def write_units(path: Path) -> None:
    path.write_text("t,Force\n[s],[kN]\n" + TABLE.to_csv(index=False, header=False))


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["run/t"] = TIMES_S
        file["run/t"].attrs["unit"] = "s"
        file["run/force"] = FORCE
        file["run/force"].attrs["unit"] = "kN"
        file["other"] = np.zeros((7, 2))


def read_hdf5(path: Path) -> Numbers:
    with h5py.File(path) as file:
        return file["run/t"][:], file["run/force"][:]


def write_mat(path: Path) -> None:
    run = {"t": TIMES_S, "force": FORCE, "units": {"t": "s", "force": "kN"}, "note": "old"}
    scipy.io.savemat(path, {"run": run})


def read_mat(path: Path) -> Numbers:
    run = scipy.io.loadmat(path, simplify_cells=True)["run"]
    return run["t"], run["force"]


def write_mat_of_version_7_3(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["force"] = TIMES_S[None, :], FORCE[None, :]
    with path.open("r+b") as head:
        head.write(b"MATLAB 7.3 MAT-file")


def read_mat_of_version_7_3(path: Path) -> Numbers:
    with h5py.File(path) as file:
        return file["t"][0], file["force"][0]


def write_tdms(path: Path) -> None:
    about = {"unit_string": "kN", "wf_increment": 0.001, "wf_start_offset": 0.0}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("run", "force", FORCE, properties=about)])


def read_tdms(path: Path) -> Numbers:
    channel = TdmsFile.read(path)["run"]["force"]
    return channel.time_track(), channel[:]


def write_mdf(path: Path) -> None:
    with MDF() as file:
        file.append([Signal(FORCE, TIMES_S, unit="kN", name="force")])
        file.save(path)


def read_mdf(path: Path) -> Numbers:
    with MDF(path) as file:
        signal = file.get("force")
        return signal.timestamps, signal.samples


def write_npy(path: Path) -> None:
    rows = np.zeros(COUNT, [("t", "<f8"), ("force", "<f8")])
    rows["t"], rows["force"] = TIMES_S, FORCE
    np.save(path, rows)


def write_lvm(path: Path) -> None:
    """As LabVIEW writes a measurement file: two heads, a comment in the first row."""
    head = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab",
        "Decimal_Separator\t.", "Multi_Headings\tNo", "X_Columns\tOne", "Time_Pref\tRelative",
        "Operator\tme", "Date\t2016/03/04", "Time\t10:00:00.0000000", "***End_of_Header***\t", "",
        "Channels\t1\t\t", "Samples\t500\t\t", "Date\t2016/03/04\t\t",
        "Time\t10:00:00.0000000\t\t", "Y_Unit_Label\tKilonewton\t\t", "X_Dimension\tTime\t\t",
        "X0\t0.0000000000000000E+0\t\t", "Delta_X\t0.001000\t\t", "***End_of_Header***\t\t",
        "X_Value\tForce\tComment",
    ]  # fmt: skip
    rows = [f"{t:.6f}\t{f!r}" for t, f in zip(TIMES_S.tolist(), FORCE.tolist(), strict=True)]
    rows[0] += "\tbegin"
    path.write_text("\n".join([*head, *rows]) + "\n")


def read_lvm(path: Path) -> Numbers:
    return as_pandas(path, sep="\t", skiprows=22, usecols=[0, 1])


#: File -> what writes it, what reads it, and the units that it does not state.
KINDS: dict[str, tuple[Callable[[Path], object], Callable[[Path], Numbers], dict[str, str]]] = {
    "comma.csv": (lambda p: TABLE.to_csv(p, index=False), as_pandas, {}),
    "tab.tsv": (
        lambda p: TABLE.to_csv(p, index=False, sep="\t"), lambda p: as_pandas(p, sep="\t"), {}
    ),
    "german.txt": (
        write_german,
        lambda p: as_pandas(p, sep=";", decimal=",", skiprows=2, encoding="latin-1"), {},
    ),
    "units.dat": (write_units, lambda p: as_pandas(p, skiprows=[1]), {}),
    "spaces.asc": (
        lambda p: TABLE.to_csv(p, index=False, header=False, sep=" "),
        lambda p: as_pandas(p, sep=" ", header=None), {"1": "s", "2": "kN"},
    ),
    "wide.csv": (
        lambda p: TABLE.to_csv(p, index=False, encoding="utf-16"),
        lambda p: as_pandas(p, encoding="utf-16"), {},
    ),
    "a.lvm": (write_lvm, read_lvm, {"X_Value": "s", "Force": "kN"}),
    "a.parquet": (
        lambda p: TABLE.to_parquet(p), read_parquet, {}
    ),
    "a.h5": (write_hdf5, read_hdf5, {}),
    "a.mat": (write_mat, read_mat, {}),
    "new.mat": (write_mat_of_version_7_3, read_mat_of_version_7_3, {"t": "s", "force": "kN"}),
    "a.tdms": (write_tdms, read_tdms, {}),
    "a.mf4": (write_mdf, read_mdf, {}),
    "a.npz": (
        lambda p: np.savez(p, t=TIMES_S, force=FORCE, note=np.array("old")),
        lambda p: (np.load(p)["t"], np.load(p)["force"]), {"t": "s", "force": "kN"},
    ),
    "a.npy": (
        write_npy, lambda p: (np.load(p)["t"], np.load(p)["force"]), {"t": "s", "force": "kN"}
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_proposed_map_gives_numbers_of_another_reader(tmp_path: Path, name: str) -> None:
    write, read, units = KINDS[name]
    path = tmp_path / name
    write(path)
    times, force = read(path)
    proposal = propose([path])
    assert len(proposal.blanks) == len(units), proposal.text
    (recording,) = imported(proposal, [path], units)
    (stream,) = recording.streams.values()
    (channel,) = stream.channels
    rows = recording.read(stream.name)
    assert channel.unit == "N"
    assert rows[channel.name].tolist() == (force * 1000.0).tolist()
    since = (rows["t_ns"] - rows["t_ns"][0]).tolist()
    assert since == np.rint((times - times[0]) * 1e9).astype(int).tolist()


def text_file(folder: Path, text: str, name: str = "a.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def rows_of(times: Sequence[object], head: str = "t [s],F [N]") -> str:
    return f"{head}\n" + "".join(f"{t},{i * 0.5}\n" for i, t in enumerate(times))


def test_blank_value_is_refused_at_its_line(tmp_path: Path) -> None:
    proposal = propose([text_file(tmp_path, rows_of(range(40), "t,F"))])
    with pytest.raises(ConfigError, match="`unit:` is still to be filled in") as raised:
        parse_map(proposal.text, Path("p.yaml"))
    places = [raised.value.place, *(other.place for other in raised.value.others)]
    assert [place.line for place in places if place is not None] == proposal.blanks
    lines = proposal.text.splitlines()
    assert all("# to fill in: the file states no unit" in lines[at - 1] for at in proposal.blanks)


WRITTEN = pd.date_range("2016-03-04T10:00", periods=40, freq="100ms")
UNIX = WRITTEN.to_numpy().astype("datetime64[ns]").astype(np.int64)
#: Name and cells of the times -> lines that the map must have.
CLOCKS: dict[str, tuple[str, Sequence[object], Sequence[str]]] = {
    "unix s": ("timestamp", (UNIX / 1e9).tolist(), ["unit: s ", "since: 1970-01-01"]),
    "unix ms": ("stamp", (UNIX // 10**6).tolist(), ["unit: ms ", "since: 1970-01-01"]),
    "unix ns by name": ("t_ns", UNIX.tolist(), ["unit: ns ", "since: 1970-01-01"]),
    "labview": ("time", (UNIX / 1e9 + 2082844800).tolist(), ["unit: s ", "since: 1904-01-01"]),
    "excel": ("date", (UNIX / 86.4e12 + 25569).tolist(), ["unit: d ", "since: 1899-12-30"]),
    "matlab": ("time", [f"{x:.9f}" for x in UNIX / 86.4e12 + 719529],
               ["unit: d ", "since: 0000-01-00"]),
    "iso": ("time", [x.isoformat(timespec="milliseconds") for x in WRITTEN], ["format: iso"]),
    "german": ("Zeit", [x.strftime("%d.%m.%Y %H:%M:%S.%f") for x in WRITTEN],
               ['format: "%d.%m.%Y %H:%M:%S.%f"']),
}  # fmt: skip


@pytest.mark.parametrize("case", CLOCKS)
def test_clock_that_shows_its_day_is_stated(tmp_path: Path, case: str) -> None:
    name, cells, lines = CLOCKS[case]
    path = text_file(tmp_path, rows_of(cells, f"{name},F [N]"))
    proposal = propose([path])
    assert not proposal.blanks, proposal.text
    assert all(line in proposal.text for line in lines), proposal.text
    (recording,) = imported(proposal, [path])
    late = recording.read("samples")["t_ns"] - UNIX
    assert np.abs(late).max() < (2_000_000 if case in ("excel", "matlab") else 1_000)


#: Text of the file -> the line of the map that asks, and words of the reason.
ASKED = {
    "counter": (rows_of([2**32 - 2_000_000 + i * 100_000 if i < 20 else (i - 20) * 100_000
                         for i in range(40)], "t [us],F [N]"), "wraps", "counter of 32 bits"),
    "day": (rows_of([f"10:00:{i:02d}.000" for i in range(40)], "t,F [N]"), "since", "the day"),
    "two forms": (rows_of([f"03/04/2016 10:00:{i:02d}" for i in range(40)], "t,F [N]"), "format",
                  "%d/%m/%Y %H:%M:%S or %m/%d/%Y %H:%M:%S"),
    "no times": ("F [N]\n" + "1\n3\n2\n" * 9, "rate", "no column looks like times"),
    "word": (rows_of([i / 10 for i in range(40)]).replace("\n1.2,6.0", "\n1.2,OVER"), "missing",
             "'OVER' is no number"),
    "cut off": (rows_of([i / 10 for i in range(40)])[:-1], "open_end", "cut off"),
    "gap": (rows_of([i / 10 + (i > 20) * 60 for i in range(40)]), "gaps", "jumps by 60.1 s"),
    "two tables": (rows_of(range(9), "t [s],x [N]") + "\n" + rows_of(range(40)), "header",
                   "9 lines above are rows of numbers, too"),
    "ragged": ("0.0,1\n0.1,1\n" + rows_of(range(40)).partition("\n")[2].replace(",", ",1,"),
               "first", "2 lines above are rows of numbers, too"),
    "unknown unit": (rows_of([i / 10 for i in range(40)], "t [s],F [Pfund/x]"), "unit",
                     "'Pfund/x', which rigd does not know"),
}  # fmt: skip


@pytest.mark.parametrize("case", ASKED)
def test_what_the_file_does_not_show_is_asked(tmp_path: Path, case: str) -> None:
    text, key, reason = ASKED[case]
    proposal = propose([text_file(tmp_path, text)])
    lines = proposal.text.splitlines()
    (line,) = (line for line in lines if f'{key}: "?"' in line and "  # to fill in: " in line)
    assert len(proposal.blanks) == (1 if case != "ragged" else 4), proposal.text
    assert reason in line
    with pytest.raises(ConfigError, match=f"`{key}:` is still to be filled in"):
        parse_map(proposal.text, Path("p.yaml"))


def test_usual_words_for_no_value_are_taken(tmp_path: Path) -> None:
    times = [f"{i / 10:.1f}" for i in range(40)]
    text = rows_of(times).replace("\n1.2,6.0", "\n1.2,").replace("\n1.5,7.5", "\n1.5,NaN")
    path = text_file(tmp_path, text)
    proposal = propose([path])
    (recording,) = imported(proposal, [path])
    expected = pd.read_csv(path)["F [N]"].to_numpy()
    np.testing.assert_array_equal(recording.read("samples")["f"], expected)


def test_column_of_trials_shows_them(tmp_path: Path) -> None:
    rows = [(f"{i % 20 / 10}", i // 20 + 1, i * 0.5, "plate") for i in range(60)]
    text = "t [s],trial,F [N],floor\n" + "".join(f"{','.join(map(str, r))}\n" for r in rows)
    path = text_file(tmp_path, text)
    proposal = propose([path])
    (recording,) = imported(proposal, [path])
    assert len(recording.trials) == 3
    assert "floor, such as plate" in proposal.text


def test_loggers_of_one_test_are_sources(tmp_path: Path) -> None:
    files = [
        text_file(tmp_path, rows_of([i / 10 for i in range(20)], f"t [s],{what}"), name)
        for what, name in (
            *[("F [N]", "a_force.csv"), ("v [m/s]", "a_speed.csv")],
            *[("F [N]", "b_force.csv"), ("v [m/s]", "b_speed.csv")],
        )
    ]
    proposal = propose(files)
    recordings = imported(proposal, files)
    assert [r.path.stem for r in recordings] == ["a", "b"]
    assert [sorted(r.streams) for r in recordings] == [["force", "speed"]] * 2


def test_groups_of_a_file_are_sources(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        for group, step in (("fast", 0.001), ("slow", 0.1)):
            about = {"unit_string": "N", "wf_increment": step}
            writer.write_segment([ChannelObject(group, "force", FORCE, properties=about)])
    proposal = propose([path])
    (recording,) = imported(proposal, [path])
    assert [recording.read(name)["t_ns"][-1] - recording.start_ns for name in ("fast", "slow")] == [
        499_000_000,
        49_900_000_000,
    ]


def test_odd_names_of_columns_keep_the_map_whole(tmp_path: Path) -> None:
    names = ["t [s]", 'a "b" # c [N]', "ü: {x} [N]", "on [N]", "a\tb [N]", "7 [N]", "a b [N]"]
    table = pd.DataFrame({name: TIMES_S + i for i, name in enumerate(names)})
    path = tmp_path / "a.csv"
    table.to_csv(path, index=False, sep=";")
    proposal = propose([path])
    (recording,) = imported(proposal, [path])
    rows = recording.read("samples")
    for i, channel in enumerate(recording.streams["samples"].channels, 1):
        assert rows[channel.name].tolist() == (TIMES_S + i).tolist()


def test_long_name_goes_by_its_number(tmp_path: Path) -> None:
    path = text_file(tmp_path, rows_of([i / 10 for i in range(40)], f"t [s],{'x' * 300} [N]"))
    (recording,) = imported(propose([path]), [path])
    (channel,) = recording.streams["samples"].channels
    assert recording.read("samples")[channel.name].tolist() == [i * 0.5 for i in range(40)]


def test_constant_column_is_no_time(tmp_path: Path) -> None:
    path = text_file(tmp_path, "time [s],F [N]\n" + "7,1\n7,3\n7,2\n" * 9)
    assert 'rate: "?"' in propose([path]).text


def test_command_writes_a_map_that_imports(tmp_path: Path) -> None:
    text_file(tmp_path, rows_of([i / 10 for i in range(40)]), "pull.csv")
    written = rigd("import", "pull.csv", "--propose", cwd=tmp_path)
    assert (written.code, written.out) == (0, "pull.yaml: nothing is left to fill in\n")
    again = rigd("import", "pull.csv", "--propose", cwd=tmp_path)
    assert again.code == 2
    assert "there is a file pull.yaml already" in again.err
    assert rigd("import", "pull.csv", cwd=tmp_path).code == 2
    assert rigd("import", "pull.csv", "--map", "pull.yaml", cwd=tmp_path).code == 0


def test_file_without_a_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no two lines"):
        propose([text_file(tmp_path, "a story\nof two lines\n")])
    with pytest.raises(ConfigError, match="the file is empty"):
        propose([text_file(tmp_path, "")])
