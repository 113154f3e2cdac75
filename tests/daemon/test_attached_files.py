"""A recording keeps the files that the devices of its rig were described by."""

from __future__ import annotations

from rigd.config.loader import load_rig
from rigd.config.shipped_files import find_file
from rigd.daemon.execute import RunRequest, attached_texts
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure


def test_eds_is_attached_beside_the_rig_file() -> None:
    rig, source = load_rig("wire-1"), load_procedure("quick")
    texts = attached_texts(
        RunRequest(compile_procedure(source, rig), source.file.text, rig, seed=1)
    )
    assert {"procedure.yaml", "rig.yaml", "eds/rigd_servo.eds"} <= texts.keys()
    shipped = find_file("wire-1", "configs").parent / "eds" / "rigd_servo.eds"
    assert texts["eds/rigd_servo.eds"] == shipped.read_text("utf-8")
