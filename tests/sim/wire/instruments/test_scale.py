"""The simulated scale by itself: golden replies, settling, tare, faults that are named."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from rigd_sim.wire.instruments.scale import SimScale
from rigd_sim.wire.instruments.scale_languages import STABILITY_S, AndD, Nameplate, Sics
from rigd_sim.wire.instruments.scale_weighing import Weighing

PLATE = Nameplate("SIM60", "B021002593")


def weighing(load_kg: float = 0.1, unit: str = "g", division_kg: float = 1e-5) -> Weighing:
    found = Weighing(
        capacity_kg=6.0, division_kg=division_kg, noise_kg=0.0, settling_s=0.1, unit=unit, seed=1
    )
    found.advance(0.0, load_kg)
    return found


def test_mt_sics_replies_are_those_of_the_manual() -> None:
    """Mettler-Toledo 11780711: S, SI, SIR, T, Z, @, I4, ES."""
    cell = weighing()
    scale = Sics(cell, PLATE, 0.1)
    assert scale.answer(b"S", 0.0) == [b"S S     100.00 g"]
    assert scale.answer(b"I4", 0.0) == [b'I4 A "B021002593"']
    assert scale.answer(b"@", 0.0) == [b'I4 A "B021002593"']
    assert scale.answer(b"T", 0.0) == [b"T S     100.00 g"]
    assert scale.answer(b"SI", 0.0) == [b"S S       0.00 g"]
    assert scale.answer(b"Z", 0.0) == [b"Z A"]
    assert scale.answer(b"si", 0.0) == [b"ES"]
    *first, last = scale.answer(b"I0", 0.0)
    assert first[0] == b'I0 B 0 "@"'
    assert all(line.startswith(b"I0 B ") for line in first)
    assert last.startswith(b"I0 A ")
    cell.advance(1.0, 3.0)
    assert scale.answer(b"SI", 1.0) == [b"S D    2899.87 g"]
    assert scale.answer(b"Z", 1.0) == []
    cell.advance(3.0, 3.0)
    cell.advance(STABILITY_S - 1, 3.0)
    assert scale.tick(STABILITY_S) == [b"Z +"]
    cell.advance(STABILITY_S, 7.0)
    assert scale.answer(b"SI", STABILITY_S) == [b"S +"]


def test_and_d_replies_are_those_of_manual() -> None:
    """A&D FX-i: ST,+00123.45  g; EK-i: ST,+0001.234 kg; OL,+9999999E+19."""
    assert AndD(weighing(0.12345), PLATE, 0.1).answer(b"Q", 0.0) == [b"ST,+00123.45  g"]
    heavy = weighing(1.234, "kg", 0.001)
    scale = AndD(heavy, PLATE, 0.1)
    assert scale.answer(b"SI", 0.0) == [b"ST,+0001.234 kg"]
    assert scale.answer(b"?SN", 0.0) == [b"SN,B021002593"]
    assert scale.answer(b"XYZ", 0.0) == []
    heavy.beyond = 1
    assert scale.answer(b"Q", 0.0) == [b"OL,+9999999E+19"]


def test_a_stream_lasts_until_another_weight_command() -> None:
    cell = weighing()
    scale = Sics(cell, PLATE, stream_s=0.1)
    line = b"S S     100.00 g"
    assert scale.answer(b"SIR", 0.0) == [line]
    assert scale.tick(0.05) == []
    assert scale.tick(0.11) == [line]
    assert scale.answer(b"I4", 0.2)[0].startswith(b"I4")
    assert scale.tick(0.25) == [line]
    assert scale.answer(b"SI", 0.3) == [line]
    assert scale.tick(9.0) == []


def test_waiting_tare_times_out() -> None:
    cell = weighing()
    cell.never_stable = True
    scale = Sics(cell, PLATE, 0.1)
    assert scale.answer(b"T", 0.0) == []
    assert scale.tick(STABILITY_S - 0.1) == []
    assert scale.tick(STABILITY_S) == [b"T I"]
    assert cell.tare_kg == 0.0


def test_the_pan_settles_and_then_rests() -> None:
    cell = weighing(0.0)
    assert cell.stable
    cell.advance(1.0, 1.0)  # the load came on at some time in this second
    assert not cell.stable
    cell.advance(2.0, 1.0)
    assert not cell.stable  # it has just come to within a division
    cell.advance(2.5, 1.0)
    assert cell.stable
    assert cell.shown() == "1000.00"
    cell.unit = "lb"
    assert cell.shown() == "2.20462"


def test_a_name_is_taken_once_and_freed(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "scale"
        first = SimScale("scale", path, lambda: 1.0)
        assert str(path) in await first.start()
        with pytest.raises(FileExistsError):
            await SimScale("other", path, lambda: 1.0).start()
        await first.stop()
        await first.stop()
        assert not path.is_symlink()
        path.symlink_to(tmp_path / "gone")  # a session that was killed left it
        second = SimScale("scale", path, lambda: 1.0)
        await second.start()
        assert path.exists()
        await second.stop()

    asyncio.run(main())


def test_replugged_scale_keeps_name_with_new_port(tmp_path: Path) -> None:
    async def main() -> None:
        scale = SimScale("scale", tmp_path / "scale", lambda: 1.0)
        await scale.start()
        scale.inject("unplug")
        assert not (tmp_path / "scale").exists()
        assert scale.state()["plugged_in"] is False
        scale.clear("unplug")
        assert (tmp_path / "scale").exists()
        assert scale.state()["plugged_in"] is True
        await scale.stop()

    asyncio.run(main())


def test_faults_are_known_by_name_with_their_options(tmp_path: Path) -> None:
    scale = SimScale("scale", tmp_path / "scale", lambda: 1.0)
    with pytest.raises(ValueError, match="no fault 'garbled'; it has garbage"):
        scale.inject("garbled")
    with pytest.raises(ValueError, match="no option often; it has probability"):
        scale.inject("garbage", often=1)
    with pytest.raises(ValueError, match="cannot show 'stone'; it can show g, kg"):
        scale.inject("unit", unit="stone")
    assert scale.state()["faults"] == ""
    scale.inject("unit")
    assert scale.weighing.unit == "lb"
    scale.clear()
    assert scale.weighing.unit == "kg"
