"""The recording holds what the simulator gave: replayed on a fresh plant, bit for bit.

The setpoints in the file, written at the times in the file, must give the readings in the file.
Nothing may be lost, doubled, shifted by a cycle or rounded on the way to the disk.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.engine.run.preflight import PREFLIGHT_CYCLES
from rigd.model.channels import STATUS_FIELD
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.record import Recording
from rigd.record.mcap.compression import Compression
from rigd.sdk import Driver


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_replaying_the_setpoints_gives_the_readings(
    tmp_path: Path, compression: Compression
) -> None:
    rig = load_rig("lugre-1")
    source = load_procedure("quick")
    path = tmp_path / "run.mcap"
    execute(
        RunRequest(
            compile_procedure(source, rig),
            source.file.text,
            rig,
            seed=42,
            output=path,
            compression=compression,
        )
    )
    recording = Recording.open(path)
    rows = {name: recording.read(name) for name in rig.devices}

    assert rig.plant is not None
    plant = rig.plant.plant_class(rig.plant.config, period_ns=rig.period_ns, seed=42)
    drivers: dict[str, Driver] = {}
    for name, device in rig.devices.items():
        driver = device.driver_class(device.config, plant)
        assert isinstance(driver, Driver)
        drivers[name] = driver
    seeds = {
        event.t_ns: event.data["seed"]
        for event in recording.events()
        if event.kind == "trial_start"
    }
    count = len(rows["truth"])
    assert count > 4000
    for index in range(count):
        if index == PREFLIGHT_CYCLES:
            for driver in drivers.values():
                driver.arm()
        t_ns = int(rows["truth"]["t_ns"][index])
        if t_ns - rig.period_ns in seeds:
            plant.begin_trial(seeds[t_ns - rig.period_ns])
        for name, driver in drivers.items():
            row = rows[name][index]
            assert int(row["t_ns"]) == t_ns
            recorded = [row[channel.name] for channel in driver.declaration.channels]
            if driver.declaration.has_status:
                recorded.append(row[STATUS_FIELD])
            assert np.array_equal(recorded, driver.read(t_ns) or ()), (name, index)
        for name, driver in drivers.items():
            setpoints = driver.declaration.setpoints
            if setpoints:
                driver.write([float(rows[name][f"{s.name}_setpoint"][index]) for s in setpoints])
