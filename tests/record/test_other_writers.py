"""Files of the writers of others: what rigd reads of them is what they wrote, the rest is named."""

from __future__ import annotations

import base64
import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
import pytest
from foxglove.channels import Vector3Channel
from foxglove.messages import Vector3
from mcap.writer import Writer
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.rosbag2.enums import StoragePlugin
from rosbags.typesys import Stores, get_typestore
from support.recordings.odd_mcap import messages_in

from rigd.cli.main import main
from rigd.model import RecordingError
from rigd.record import Recording, recover, verify
from rigd.record.read.condition import FileCondition

COUNT = 300
START_NS = 1_790_000_000_000_000_000
TIMES = [START_NS + number * 1_000_000 for number in range(COUNT)]
JSON_SCHEMA = {
    "type": "object",
    "properties": {
        "x": {"type": "number", "description": "a place"},
        "pose": {"type": "object", "properties": {"z": {"type": "number"}}},
        "name": {"type": "string"},
    },
}
#: What rigd cannot decode: topic, encoding of the messages, name and encoding of the schema.
OTHERS = (
    ("/protobuf", "protobuf", "a.P", "protobuf"),
    ("/ros1", "ros1", "a/R", "ros1msg"),
    ("/idl", "cdr", "a::I", "ros2idl"),
    ("/flat", "flatbuffer", "a.F", "flatbuffer"),
    ("/cbor", "cbor", "", ""),
    ("/bytes", "", "", ""),
    ("/text", "cdr", "std_msgs/msg/String", "ros2msg"),
)


def write_all_encodings(path: Path, *, decodable: bool = True) -> None:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4_000)
        writer.start("", "another")
        numbers = []
        if decodable:
            schema = writer.register_schema("J", "jsonschema", json.dumps(JSON_SCHEMA).encode())
            numbers += [writer.register_channel("/json", "json", schema)]
            numbers += [writer.register_channel("/events", "json", 0)]
        for topic, encoding, name, schema_encoding in OTHERS:
            schema = writer.register_schema(name, schema_encoding, b"\x00\xff") if name else 0
            numbers.append(writer.register_channel(topic, encoding, schema))
        for sequence, t_ns in enumerate(TIMES):
            text = {"x": sequence / 4, "pose": {"z": -sequence}, "name": "n", "ok": sequence > 4}
            for number in numbers:
                is_json = decodable and number <= 2
                data = json.dumps(text).encode() if is_json else bytes([sequence % 251]) * 9
                writer.add_message(number, t_ns, data, t_ns, sequence)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped


def test_json_is_columns_and_others_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_all_encodings(path := tmp_path / "all.mcap")
    recording = Recording.open(path)
    assert list(recording.streams) == ["json", "other_events"]
    rows = recording.read("json")
    assert rows["t_ns"].tolist() == TIMES
    assert rows["x"].tolist() == [number / 4 for number in range(COUNT)]
    assert rows["pose.z"].tolist() == [-number for number in range(COUNT)]
    assert recording["json"].docs["x"] == "a place"
    assert recording.read("other_events")["ok"].sum() == COUNT - 5
    assert recording.events() == []
    found = {(topic.topic, topic.encoding, topic.messages) for topic in verify(path).topics}
    assert found == {(topic, encoding, COUNT) for topic, encoding, _, _ in OTHERS}
    assert main(["export", str(path), "--to", "csv", "--output", str(tmp_path / "out")]) == 0
    assert len((tmp_path / "out" / "json.csv").read_text().splitlines()) == COUNT + 1
    assert f"/protobuf (protobuf a.P, {COUNT} messages)" in capsys.readouterr().err


def test_file_without_any_column_exports_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_all_encodings(path := tmp_path / "all.mcap", decodable=False)
    assert main(["export", str(path), "--to", "csv", "--output", str(tmp_path / "out")]) == 7
    assert f"/cbor (cbor, {COUNT} messages)" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert verify(path).condition is FileCondition.VALID
    assert Recording.open(path).info.state == "no run"


def test_repair_keeps_what_rigd_cannot_decode(tmp_path: Path) -> None:
    write_all_encodings(path := tmp_path / "all.mcap", decodable=False)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    before = messages_in(path.read_bytes())
    assert recover(path).rows_kept == {topic: len(found) for topic, found in before.items()}
    after = messages_in(path.read_bytes())
    assert after == before
    assert min(map(len, after.values())) > COUNT // 4


def test_recordings_in_one_file_become_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As `cat a b c > all` makes it: each recording is kept whole, with its own numbers."""
    names = ("a", "b", "c")
    for name in names:
        write_all_encodings(tmp_path / f"{name}.mcap", decodable=name != "b")
    path = tmp_path / "all.mcap"
    whole = [(tmp_path / f"{name}.mcap").read_bytes() for name in names]
    path.write_bytes(b"".join(whole))
    assert verify(path).condition is FileCondition.DAMAGED
    assert main(["recover", str(path)]) == 0
    assert "all-2.mcap is the second" in capsys.readouterr().out
    for name, data in zip(("all", "all-2", "all-2-2"), whole, strict=True):
        assert messages_in((tmp_path / f"{name}.mcap").read_bytes()) == messages_in(data)
    assert (tmp_path / "all.mcap.orig").read_bytes() == b"".join(whole)


def test_file_of_foxglove_sdk_is_read(tmp_path: Path) -> None:
    path, context = tmp_path / "fox.mcap", foxglove.Context()
    with foxglove.open_mcap(path, context=context):
        values = foxglove.Channel("/values", message_encoding="json", context=context)
        places = Vector3Channel("/places", context=context)
        for number, t_ns in enumerate(TIMES):
            values.log({"v": number / 8}, log_time=t_ns)
            places.log(Vector3(x=number, y=1, z=2), log_time=t_ns)
    recording = Recording.open(path)
    assert recording.condition is FileCondition.VALID
    assert recording.read("values")["v"].tolist() == [number / 8 for number in range(COUNT)]
    assert [str(topic) for topic in recording.topics.others] == [
        f"/places (protobuf foxglove.Vector3, {COUNT} messages)"
    ]
    assert verify(path).rows == {"/values": COUNT, "/places": COUNT}


def test_bag_of_rosbags_is_read(tmp_path: Path) -> None:
    types = get_typestore(Stores.ROS2_HUMBLE)
    number, text = types.types["std_msgs/msg/Float64"], types.types["std_msgs/msg/String"]
    folder = tmp_path / "bag"
    with BagWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        force = writer.add_connection("/force", number.__msgtype__, typestore=types)
        words = writer.add_connection("/words", text.__msgtype__, typestore=types)
        for at in reversed(range(COUNT)):
            writer.write(force, TIMES[at], types.serialize_cdr(number(at), number.__msgtype__))
            writer.write(words, TIMES[at], types.serialize_cdr(text("x" * at), text.__msgtype__))
    (path,) = folder.glob("*.mcap")
    recording = Recording.open(path)
    assert recording.condition is FileCondition.VALID
    assert recording.read("force")["data"].tolist() == list(range(COUNT))
    assert recording.other_topics == ("/words",)
    assert verify(path).rows == {"/force": COUNT, "/words": COUNT}


@pytest.mark.parametrize("chunks", [True, False])
def test_file_of_foxglove_core_is_read(
    tmp_path: Path, node_packages: tuple[str, Path], *, chunks: bool
) -> None:
    node, packages = node_packages
    floats = [b"\x00\x01\x00\x00" + np.array([n, -n], "<f8").tobytes() for n in range(COUNT)]
    texts = [json.dumps({"v": n}).encode() for n in range(COUNT)]
    topics = [
        {"topic": "/p", "encoding": "cdr", "schema": "a/msg/P", "schemaEncoding": "ros2msg",
         "text": "float64 x\nfloat64 y\n"},
        {"topic": "/j", "encoding": "json", "schema": "", "schemaEncoding": "", "text": ""},
    ]  # fmt: skip
    messages: list[Sequence[Any]] = []
    for n, t_ns in enumerate(TIMES):
        for channel, data in ((0, floats[n]), (1, texts[n])):
            messages.append((channel, str(t_ns), n, base64.b64encode(data).decode()))
    given = json.dumps({"topics": topics, "messages": messages, "useChunks": chunks})
    script = Path(__file__).parent / "strict" / "write.mjs"
    done = subprocess.run(
        [node, str(script), str(packages)], input=given.encode(), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr.decode()
    path = tmp_path / "core.mcap"
    path.write_bytes(done.stdout)
    recording = Recording.open(path)
    assert recording.condition is FileCondition.VALID
    assert recording.read("p")["y"].tolist() == [-n for n in range(COUNT)]
    assert recording.read("j")["v"].tolist() == list(range(COUNT))
    assert {topic: len(found) for topic, found in messages_in(done.stdout).items()} == {
        "/p": COUNT, "/j": COUNT,
    }  # fmt: skip


def test_list_names_files_of_other_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_all_encodings(path := tmp_path / "all.mcap")
    assert main(["runs", str(tmp_path)]) == 0
    listed = capsys.readouterr().out
    assert "condition" in listed
    assert "valid" in listed
    assert "no run" in listed
    assert main(["verify", str(path)]) == 0
    assert "valid, written by 'another'" in capsys.readouterr().out
    assert main(["info", str(path)]) == 0
    assert "file        valid, written by 'another'" in capsys.readouterr().out
    path.write_bytes(path.read_bytes()[:-3_000])
    assert main(["runs", str(tmp_path)]) == 0
    assert f"{path} is damaged" in capsys.readouterr().err
    assert main(["verify", str(path)]) == 7
    assert "damaged, written by 'another'" in capsys.readouterr().out


def test_repair_offers_no_empty_file(tmp_path: Path) -> None:
    write_all_encodings(path := tmp_path / "all.mcap")
    first = Recording.open(path).contents.chunks[0]
    data = path.read_bytes()[: first.chunk_start_offset + 60]
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="no message that can be read"):
        recover(path)
    assert [item.name for item in tmp_path.iterdir()] == ["all.mcap"]
    assert path.read_bytes() == data


def test_odd_times_topics_and_numbers_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Times that no int64 holds, topics with and without a slash, a number that is no object."""
    path = tmp_path / "odd.mcap"
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start("", "another")
        for topic in ("/load", "Load", "/late"):
            channel = writer.register_channel(topic, "json", 0)
            for row in range(3):
                t_ns = 1_000 * row + (2**63 if topic == "/late" and row else 0)
                writer.add_message(channel, t_ns, b"5", t_ns, row)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    recording = Recording.open(path)
    assert (recording.start_ns, recording.end_ns) == (0, 2_000)
    assert recording.read("load")["value"].tolist() == [5.0, 5.0, 5.0]
    assert (recording.count("late"), len(recording.read("late"))) == (1, 1)
    assert main(["verify", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "3 of late, 3 of load, 3 of Load" in shown
    assert "not read, and kept: 2 of /late with times after the year 2262" in shown
    assert main(["export", str(path), "--to", "csv", "--output", str(tmp_path / "out")]) == 0
    assert recover(path).intact


def test_topic_longer_than_file_name_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, target = tmp_path / "long.mcap", tmp_path / "out"
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start("", "another")
        writer.add_message(writer.register_channel("/" + "x" * 300, "json", 0), 1, b"5", 1, 0)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
    target.mkdir()
    options = ["--to", "csv", "--output", str(target), "--overwrite"]
    assert main(["export", str(path), *options]) == 7
    assert "is longer than the name of a file may be" in capsys.readouterr().err
    assert not list(target.iterdir())
