"""The same table in every format gives the same rows; what is wrong is named."""

from __future__ import annotations

import io
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter

from rigd.importing import import_files, parse_map
from rigd.model import ConfigError
from rigd.record import Recording

START_NS = 1_457_085_600_000_000_000
TIMES_S = np.arange(500) / 1000.0
FORCE = np.random.default_rng(5).normal(size=500)
MAP = """\
map: bench
rig: old_bench
started: 2016-03-04T10:00:00Z
sources:
  samples:
    GROUP
    time: {column: TIME, unit: s}
    channels: {force: {column: force, unit: kN}}
"""


def write_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["run/t"] = TIMES_S
        file["run/force"] = FORCE
        file["run/force"].attrs["unit"] = "kN"
        file["other"] = np.zeros((7, 2))


def write_compound(path: Path) -> None:
    rows = np.zeros(500, [("t", "<f8"), ("force", "<f8")])
    rows["t"], rows["force"] = TIMES_S, FORCE
    with h5py.File(path, "w") as file:
        file["run"] = rows


def write_mat(path: Path) -> None:
    content = {"t": TIMES_S, "force": FORCE, "units": {"force": "kN"}, "note": "old"}
    scipy.io.savemat(path, {"run": content})


def write_mat_of_version_7_3(path: Path) -> None:
    """As MATLAB does: a head of 512 bytes, vectors that lie."""
    with h5py.File(path, "w", userblock_size=512) as file:
        file["run/t"] = TIMES_S[None, :]
        file["run/force"] = FORCE[None, :]
    with path.open("r+b") as head:
        head.write(b"MATLAB 7.3 MAT-file")


def write_tdms(path: Path) -> None:
    about = {"unit_string": "kN", "wf_increment": 0.001, "wf_start_offset": 0.0}
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("run", "force", FORCE, properties=about)])


def write_mdf(path: Path) -> None:
    with MDF() as file:
        file.append([Signal(FORCE, TIMES_S, unit="kN", name="force")])
        file.save(path)


def write_parquet(path: Path) -> None:
    pq.write_table(pa.table({"t": TIMES_S, "force [kN]": FORCE}), path)


def write_npz(path: Path) -> None:
    np.savez_compressed(path, t=TIMES_S, force=FORCE, other=np.zeros((7, 2)), note=np.array("old"))


def write_npy(path: Path) -> None:
    rows = np.zeros(500, [("t", "<f8"), ("force", "<f8")])
    rows["t"], rows["force"] = TIMES_S, FORCE
    np.save(path, rows)


FORMATS = {
    "a.h5": (write_hdf5, "group: run", "t"),
    "compound.h5": (write_compound, "group: run", "t"),
    "a.mat": (write_mat, "group: run", "t"),
    "new.mat": (write_mat_of_version_7_3, "group: run", "t"),
    "a.tdms": (write_tdms, "group: run", "(time)"),
    "a.mf4": (write_mdf, "group: '0'", "(time)"),
    "a.parquet": (write_parquet, "sparse: false", "t"),
    "a.npz": (write_npz, "sparse: false", "t"),
    "a.npy": (write_npy, "sparse: false", "t"),
}


def bring_in(path: Path, group: str, time: str) -> Recording:
    FORMATS[path.name][0](path)
    what = parse_map(MAP.replace("GROUP", group).replace("TIME", time), Path("map.yaml"))
    (made,) = import_files(what, [path], path.parent / "runs")
    return Recording.open(made.path)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_rows(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.importing.tables.array_table.BATCH_ROWS", 128)
    rows = bring_in(tmp_path / name, *FORMATS[name][1:]).read("samples")
    assert rows["t_ns"].tolist() == [START_NS + i * 1_000_000 for i in range(500)]
    assert rows["force"].tolist() == (FORCE * 1000.0).tolist()


#: Formats of one table.
ONE = ("a.parquet", "a.npz", "a.npy")


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in ONE])
def test_unknown_group_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"has no (group|structure|channel group) 'rum'"):
        bring_in(tmp_path / name, "group: rum", FORMATS[name][2])


@pytest.mark.parametrize("name", ["a.h5", "a.mat", "a.tdms", "a.mf4", "a.npz", "a.npy"])
def test_file_that_is_cut_off_is_named(tmp_path: Path, name: str) -> None:
    write, group, time = FORMATS[name]
    path = tmp_path / name
    write(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])
    what = parse_map(MAP.replace("GROUP", group).replace("TIME", time), Path("map.yaml"))
    with pytest.raises(ConfigError, match=r"cut off|has no |rows"):
        import_files(what, [path], tmp_path / "runs")
    assert list((tmp_path / "runs").iterdir()) == []


@pytest.mark.parametrize("ending", ["h5", "mat", "tdms", "mf4", "parquet", "npz", "npy"])
def test_file_of_another_format_is_named(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_text("t,force\n" * 200)
    what = parse_map(MAP.replace("GROUP", "sparse: false").replace("TIME", "t"), Path("map.yaml"))
    with pytest.raises(ConfigError, match="cut off, damaged or no "):
        import_files(what, [path], tmp_path / "runs")


class Trap:
    """Opens a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str, str]]:
        return open, (str(self.path), "w")


def test_pickled_objects_are_not_read(tmp_path: Path) -> None:
    path, trap = tmp_path / "a.npz", np.array([Trap(tmp_path / "opened")], object)
    what = parse_map(MAP.replace("GROUP", "sparse: false").replace("TIME", "t"), Path("map.yaml"))
    np.savez(path, t=trap)
    with pytest.raises(ConfigError, match=r"'t' in .* has pickled objects"):
        import_files(what, [path], tmp_path / "runs")
    np.savez(path, t=TIMES_S, force=FORCE, more=trap)
    (made,) = import_files(what, [path], tmp_path / "runs")
    assert len(Recording.open(made.path).read("samples")) == 500
    assert not (tmp_path / "opened").exists()


def test_start_that_a_file_states_counts(tmp_path: Path) -> None:
    begun = np.datetime64("2016-03-04T10:00:00.25", "us")
    about = {"wf_increment": 0.001, "wf_start_time": begun}
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([ChannelObject("run", "force", FORCE, properties=about)])
    text = MAP.replace("started: 2016-03-04T10:00:00Z\n", "").replace("TIME", "(time)")
    what = parse_map(text.replace("GROUP", "group: run"), Path("map.yaml"))
    (made,) = import_files(what, [tmp_path / "a.tdms"], tmp_path / "runs")
    recording = Recording.open(made.path)
    assert recording.start_ns == START_NS + 250_000_000
    assert recording.metadata["import"]["started_from"] == "the start that the file states"


def test_columns_of_different_lengths_are_named(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["force"] = TIMES_S, FORCE[:-1]
    what = parse_map(MAP.replace("GROUP", "sparse: false").replace("TIME", "t"), Path("map.yaml"))
    with pytest.raises(ConfigError, match="'force' has 499 rows, 't' 500"):
        import_files(what, [tmp_path / "a.h5"], tmp_path / "runs")


TWO_CLOCKS = """\
map: bench
rig: old_bench
sources:
  samples:
    time: {column: (time)}
    channels: {slow: {column: slow}MORE}
"""


@pytest.fixture
def two_clocks(tmp_path: Path) -> Path:
    """A group with two waveforms: one begins 10 s later, with an offset and a longer step."""
    began = np.datetime64("2016-03-04T10:00:00", "us")
    fast = {"wf_increment": 0.001, "wf_start_time": began, "unit_string": "N"}
    slow = {
        "wf_increment": 0.01,
        "wf_start_offset": 0.5,
        "wf_start_time": began + np.timedelta64(10, "s"),
        "unit_string": "N",
    }
    path = tmp_path / "a.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject("run", "fast", FORCE, properties=fast),
                ChannelObject("run", "slow", FORCE, properties=slow),
            ]
        )
    return path


def test_waveform_has_its_own_times(two_clocks: Path) -> None:
    what = parse_map(TWO_CLOCKS.replace("MORE", ""), Path("map.yaml"))
    (made,) = import_files(what, [two_clocks], two_clocks.parent / "runs")
    rows = Recording.open(made.path).read("samples")
    since = START_NS + 10_500_000_000
    assert rows["t_ns"].tolist() == [since + i * 10_000_000 for i in range(500)]


def test_waveforms_of_different_times_are_refused(two_clocks: Path) -> None:
    what = parse_map(TWO_CLOCKS.replace("MORE", ", fast: {column: fast}"), Path("map.yaml"))
    with pytest.raises(ConfigError, match=r"'slow' begin at 10\.5 s in steps of 0\.01 s, .*'fast'"):
        import_files(what, [two_clocks], two_clocks.parent / "runs")


def test_samples_marked_invalid_are_nan(tmp_path: Path) -> None:
    marked = np.arange(500) % 7 == 3
    with MDF(version="4.10") as file:
        bad = np.where(marked, -9999.0, FORCE)
        signals = [
            Signal(bad, TIMES_S, unit="kN", name="force", invalidation_bits=marked),
            Signal(np.arange(500), TIMES_S, unit="1", name="count", invalidation_bits=marked),
        ]
        file.append(signals)
        file.save(tmp_path / "a.mf4")
    text = MAP.replace("GROUP", "group: '0'").replace("TIME", "(time)")
    text = text.replace("unit: kN}}", "unit: kN}, count: {column: count, unit: '1'}}")
    (made,) = import_files(parse_map(text, Path("map.yaml")), [tmp_path / "a.mf4"], tmp_path)
    rows = Recording.open(made.path).read("samples")
    for name, expected in (("force", FORCE * 1000.0), ("count", np.arange(500.0))):
        np.testing.assert_array_equal(rows[name], np.where(marked, np.nan, expected))


@pytest.mark.parametrize(("column", "factor"), [("2", 1.0), ("3", 2.0)])
def test_parquet_column_of_one_name_goes_by_number(
    tmp_path: Path, column: str, factor: float
) -> None:
    arrays = [pa.array(TIMES_S), pa.array(FORCE), pa.array(2.0 * FORCE)]
    pq.write_table(pa.Table.from_arrays(arrays, names=["t", "x", "x"]), tmp_path / "a.parquet")
    text = MAP.replace("GROUP", "sparse: false").replace("TIME", "t")
    what = parse_map(text.replace("column: force", f"column: '{column}'"), Path("map.yaml"))
    (made,) = import_files(what, [tmp_path / "a.parquet"], tmp_path)
    rows = Recording.open(made.path).read("samples")
    np.testing.assert_array_equal(rows["force"], factor * FORCE * 1000.0)


@pytest.fixture(scope="module")
def segments() -> bytes:
    """A TDMS file of 9 segments, as the reference writer makes it."""
    stream = io.BytesIO()
    begun = np.datetime64("2016-03-04T10:00:00", "us")
    about = {"unit_string": "kN", "wf_increment": 0.001, "wf_start_time": begun}
    with TdmsWriter(stream) as writer:
        for part in range(9):
            data = FORCE[part * 40 : (part + 1) * 40]
            about = {**about, "part": part}  # each has a head of its own
            writer.write_segment([ChannelObject("run", "force", data, properties=about)])
    return stream.getvalue()


@pytest.mark.parametrize("lost", range(1, 500, 25))
def test_tdms_cut_anywhere_in_segment_is_refused(
    tmp_path: Path, segments: bytes, lost: int, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.tdms"
    path.write_bytes(segments[: len(segments) - lost])
    text = MAP.replace("GROUP", "group: run").replace("TIME", "(time)")
    with pytest.raises(ConfigError, match="the file is cut off"):
        import_files(parse_map(text, Path("map.yaml")), [path], tmp_path / "runs")
    assert "nptdms" not in capfd.readouterr().err


def test_whole_tdms_of_segments_is_read(tmp_path: Path, segments: bytes) -> None:
    (tmp_path / "a.tdms").write_bytes(segments)
    text = MAP.replace("GROUP", "group: run").replace("TIME", "(time)")
    (made,) = import_files(parse_map(text, Path("map.yaml")), [tmp_path / "a.tdms"], tmp_path)
    rows = Recording.open(made.path).read("samples")
    assert rows["force"].tolist() == (FORCE[:360] * 1000.0).tolist()


def write_unknown_scale(path: Path) -> None:
    """A scale of a kind that npTDMS does not know: it warns, and gives values without it."""
    about = {
        "unit_string": "kN", "wf_increment": 0.001, "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": "Spiral", "NI_Scaling_Status": "unscaled",
    }  # fmt: skip
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("run", "force", FORCE, properties=about)])


def write_double_variable(path: Path) -> None:
    """Two variables of one name, of which scipy takes the last."""
    scipy.io.savemat(path, {"t": TIMES_S, "force": FORCE})
    other = path.with_suffix(".other")
    scipy.io.savemat(other, {"force": 2.0 * FORCE}, appendmat=False)
    path.write_bytes(path.read_bytes() + other.read_bytes()[128:])


WARNED = {
    "a.tdms": (write_unknown_scale, "group: run", "(time)", "nptdms: Unsupported scale type"),
    "a.mat": (write_double_variable, "sparse: false", "t", "Duplicate variable name"),
}


@pytest.mark.parametrize("name", WARNED)
def test_warning_of_a_library_is_an_error(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    write, group, time, words = WARNED[name]
    write(tmp_path / name)
    text = MAP.replace("GROUP", group).replace("TIME", time)
    with pytest.raises(ConfigError, match=f"a library warns.*{words}") as raised:
        import_files(parse_map(text, Path("map.yaml")), [tmp_path / name], tmp_path / "runs")
    assert "`warnings: accept`" in str(raised.value.hint)
    what = parse_map(f"warnings: accept\n{text}", Path("map.yaml"))
    (made,) = import_files(what, [tmp_path / name], tmp_path / "runs")
    assert words in Recording.open(made.path).metadata["import"]["warnings"]
    assert capfd.readouterr().err == ""


def bring_mat(path: Path, group: str = "") -> Recording:
    text = MAP.replace("    GROUP\n", group and f"    group: {group}\n").replace("TIME", "t")
    (made,) = import_files(parse_map(text, Path("map.yaml")), [path], path.parent / "runs")
    return Recording.open(made.path)


def test_structure_of_an_array_goes_by_number(tmp_path: Path) -> None:
    array = np.zeros(3, [("t", object), ("force", object)])
    for index in range(3):
        array[index] = (TIMES_S, FORCE * index)
    scipy.io.savemat(tmp_path / "a.mat", {"all_results": array})
    with pytest.raises(ConfigError, match="structures and no arrays") as raised:
        bring_mat(tmp_path / "a.mat")
    assert "one of all_results(1), all_results(2), all_results(3)" in str(raised.value.hint)
    with pytest.raises(ConfigError, match=r"no structure 'all_results\(4\)'"):
        bring_mat(tmp_path / "a.mat", "all_results(4)")
    rows = bring_mat(tmp_path / "a.mat", "all_results(3)").read("samples")
    assert rows["force"].tolist() == (FORCE * 2 * 1000.0).tolist()


def write_object_of_version_7_3(path: Path) -> None:
    """As MATLAB writes an object: numbers that say where its content lies."""
    with h5py.File(path, "w", userblock_size=512) as file:
        item = file.create_dataset("logs", data=np.zeros((1, 6), np.uint32))
        item.attrs["MATLAB_class"] = np.bytes_("timeseries")
        item.attrs["MATLAB_object_decode"] = np.int32(3)
        file["#refs#/a"] = np.zeros(4)
    with path.open("r+b") as head:
        head.write(b"MATLAB 7.3 MAT-file")


def test_object_of_matlab_is_named(tmp_path: Path) -> None:
    write_object_of_version_7_3(tmp_path / "a.mat")
    with pytest.raises(ConfigError, match=r"'logs' in .* is an object of MATLAB") as raised:
        bring_mat(tmp_path / "a.mat")
    assert "save('new.mat', '-struct', 's')" in str(raised.value.hint)


def test_object_of_older_matlab_is_named(tmp_path: Path) -> None:
    """What scipy gives for one; scipy cannot write such a file."""
    scipy.io.savemat(tmp_path / "a.mat", {"note": "old"})
    opaque = [("s0", "O"), ("s1", "O"), ("s2", "O"), ("arr", "O")]
    item = scipy.io.matlab.MatlabOpaque(np.zeros(1, opaque))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("scipy.io.loadmat", lambda *_, **__: {"logs": item})
        with pytest.raises(ConfigError, match=r"'logs' in .* is an object of MATLAB"):
            bring_mat(tmp_path / "a.mat", "logs")


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
@pytest.mark.parametrize("given", ["", ", unit: ns, since: 1970-01-01"])
def test_timestamps_of_parquet_are_moments(
    tmp_path: Path, unit: str, zone: str | None, given: str
) -> None:
    moments = np.arange(500) * 1_000_000 + START_NS
    column = pa.array(moments, pa.timestamp("ns")).cast(pa.timestamp(unit))
    typed = column.cast(pa.timestamp(unit, zone)) if zone else column
    pq.write_table(pa.table({"t": typed, "force": FORCE}), tmp_path / "a.parquet")
    text = MAP.replace("GROUP", "sparse: false").replace("TIME, unit: s", f"t{given}")
    (made,) = import_files(parse_map(text, Path("map.yaml")), [tmp_path / "a.parquet"], tmp_path)
    recording = Recording.open(made.path)
    assert recording.read("samples")["t_ns"].tolist() == moments.tolist()
    assert recording.metadata["import"]["started_from"] == "the times in the file"
