"""Recordings of robots of any number of modules, driven in the plant, with sensors of their own.

The plant gives the exact motion (all wheels spin by themselves, each module bears its own weight);
noise, latency and scale of the camera are added here. The plan states constants that are as far off
as their uncertainties have it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from support.articulated.robots import Driven, altered, shipped

from rigd.model.channels import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import RecordingWriter
from rigd_sim.articulated.parameters import ArticulatedParameters

Array = NDArray[np.float64]
START_NS: Final = 1_790_000_000_000_000_000
RATE_HZ, FRAME = 500, 20  #: samples of the motors, and how many are one of the camera
LATE: Final = 10  #: samples
SPEED_NOISE, TORQUE_NOISE = 0.7, 7e-4
CAMERA_NOISE: Final = (2e-3, 2e-3, 8.7e-3)
SCALE: Final = (1.0, 1.01)
#: Stated value and standard uncertainty of what all modules have alike.
SIZES: Final = {
    "wheel_radius": (0.04, 1e-4), "half_track": (0.445 / 3, 5e-4), "half_wheelbase": (0.0507, 5e-4),
    "wheel_mass": (0.1, 1e-3), "wheel_inertia": (8e-5, 2.4e-6), "body_inertia": (0.0302, 9e-4),
    "gravity": (9.81, 0.01), "rotor_inertia": (1e-6, 1e-7),
}  # fmt: skip
GEAR: Final = 25.0
WHEELS: Final = {
    "all": ("right", "left"), "front": ("front_right", "front_left"),
    "rear": ("rear_right", "rear_left"), "none": (),
}  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """Motor speeds in rad/s of the first driven module; others go ``others`` times as fast."""

    right: float
    left: float
    seconds: float
    others: float = 1.0
    ramp_s: float = 0.4


GENTLE: Final = (
    Trial(100.0, 100.0, 4.0), Trial(200.0, 200.0, 4.0), Trial(300.0, 300.0, 4.0),
    Trial(110.0, 80.0, 16.0, 0.93), Trial(80.0, 110.0, 16.0, 0.93),
    Trial(190.0, 160.0, 14.0, 0.95), Trial(160.0, 190.0, 14.0, 0.95),
)  # fmt: skip


@dataclass(frozen=True)
class Chain:
    """A robot: which wheels of each module drive, and its true sizes and contacts.

    ``lengths`` (n, 2) are the distances of the hinges ahead and behind, as ``masses`` (n,) of the
    bodies stated exactly.
    """

    driven: tuple[str, ...]
    contacts: Mapping[str, tuple[float, ...]]
    true: Mapping[str, float]
    lengths: tuple[float, ...]
    masses: tuple[float, ...]
    seed: int

    @property
    def truth(self) -> dict[str, float]:
        """Contacts by rigd's names; of modules that do not drive without k_lon."""
        return {
            f"{kind}_{k + 1}": value
            for kind, values in self.contacts.items()
            for k, value in enumerate(values)
            if kind != "k_lon" or self.driven[k] != "none"
        }

    def parameters(self, changes: Mapping[str, Any] | None = None) -> ArticulatedParameters:
        """Return the plant's parameters, with ``changes`` by path."""
        modules, base = {}, shipped().modules["rear"]
        for k, driven in enumerate(self.driven):
            pairing = "geared" if driven in ("all", "none") else "single"
            modules[f"m{k + 1}"] = altered(
                {
                    "wheels.driven": driven, "wheels.pairing": pairing, "wheels.yaw_inertia": 0.0,
                    "wheels.radius": self.true["wheel_radius"],
                    "wheels.mass": self.true["wheel_mass"],
                    "wheels.spin_inertia": self.true["wheel_inertia"],
                    "half_track": self.true["half_track"],
                    "half_wheelbase": self.true["half_wheelbase"],
                    "body_inertia": self.true["body_inertia"],
                    "body_mass": self.masses[k],
                    "hinge_ahead": self.lengths[k], "hinge_behind": self.lengths[k],
                    "contact.longitudinal": self.contacts["k_lon"][k],
                    "contact.lateral": self.contacts["k_lat"][k],
                    "contact.rolling": self.contacts["k_roll"][k],
                },
                base,
            )  # fmt: skip
        robot = altered({"modules": modules, "gravity": self.true["gravity"]})
        robot = altered({"drive.rotor_inertia": self.true["rotor_inertia"]}, robot)
        found: ArticulatedParameters = altered(changes or {}, robot)
        return found


def drawn(seed: int, driven: Sequence[str]) -> Chain:
    """Return a robot whose contacts and sizes are drawn."""
    random = np.random.default_rng((48, seed))
    n = len(driven)
    spread = {"k_lon": (110.0, 0.15), "k_lat": (180.0, 0.2), "k_roll": (9e-4, 0.25)}
    contacts = {
        kind: tuple((centre * np.exp(sd * random.standard_normal(n))).tolist())
        for kind, (centre, sd) in spread.items()
    }
    true = {name: value + u * float(random.standard_normal()) for name, (value, u) in SIZES.items()}
    lengths = tuple((0.2 + 0.02 * random.standard_normal(n)).round(3).tolist())
    masses = tuple((3.8 + 0.4 * random.standard_normal(n)).round(2).tolist())
    return Chain(tuple(driven), contacts, true, lengths, masses, seed)


@dataclass
class Recorded:
    """What is written: rows of each stream, and the plan. A test may change both."""

    rows: dict[Stream, NDArray[np.void]]
    signals: dict[str, str]
    constants: dict[str, float]
    uncertainties: dict[str, float]
    trials: list[tuple[int, int]] = field(default_factory=list)

    def write(self, path: Path) -> Path:
        """Write the recording."""
        run = {"procedure": "played", "rig": "chain", "seed": "1", "trials": f"{len(self.trials)}",
               "started": "2026-11-01T00:00:00+00:00"}  # fmt: skip
        plan = {
            "model": "articulated-chain", "signals": json.dumps(self.signals),
            "constants": json.dumps(self.constants), "group_by": "[]",
            "uncertainties": json.dumps(
                {name: {"size": u} for name, u in self.uncertainties.items()}
            ),
        }  # fmt: skip
        with RecordingWriter.create(
            path, streams=list(self.rows), start_ns=START_NS, sync_interval_s=None,
            metadata={"run": run, "parameters": {}, "identify": plan}, attachments=(),
        ) as writer:  # fmt: skip
            for number, (begin, _) in enumerate(self.trials, start=1):
                about = {"number": number, "repeat": 1, "parameters": {}, "units": {}}
                writer.event(begin, "trial_start", number, about)
            for device, values in self.rows.items():
                writer.write(device.name, values)
            for number, (_, end) in enumerate(self.trials, start=1):
                writer.event(end, "trial_end", number, {"complete": True, "reason": ""})
            writer.event(self.trials[-1][1], "run_end", -1, {"state": "complete", "reason": ""})
        return path


def recorded(
    chain: Chain, trials: Sequence[Trial] = GENTLE, changes: Mapping[str, Any] | None = None,
    noise_seed: int = 0, seen: Callable[[Array], Array] | None = None,
) -> Recorded:  # fmt: skip
    """Return what the sensors of ``chain`` show; ``changes`` are of the plant, by path.

    ``seen`` changes the true poses (t, 3 n) before the camera shows them.
    """
    random = np.random.default_rng((49, chain.seed, noise_seed))
    n = len(chain.driven)
    motors = [(k, wheels) for k, kind in enumerate(chain.driven) for wheels in WHEELS[kind]]
    devices = [
        Stream(f"motor_{k + 1}_{wheels}", (Channel("speed", "rad/s"), Channel("torque", "N m")))
        for k, wheels in motors
    ]
    axes = (Channel("x", "m"), Channel("y", "m"), Channel("heading", "rad"))
    markers = [Stream(f"marker_{k + 1}", axes) for k in range(n)]
    parts: dict[Stream, list[NDArray[np.void]]] = {device: [] for device in (*devices, *markers)}
    begin_ns, ends = START_NS, []
    for trial in trials:
        t_s, speeds, torques, poses = played(chain, trial, changes)
        if seen is not None:
            poses = seen(poses)
        poses = np.concatenate([np.repeat(poses[:1], LATE, axis=0), poses[:-LATE]])
        turn = 0.03 * float(random.standard_normal())
        x, y = poses[:, 0::3].copy(), poses[:, 1::3].copy()
        poses[:, 0::3] = SCALE[0] * (np.cos(turn) * x - np.sin(turn) * y)
        poses[:, 1::3] = SCALE[1] * (np.sin(turn) * x + np.cos(turn) * y)
        poses[:, 2::3] += turn
        stamps = (begin_ns + np.rint(t_s * 1e9)).astype(np.int64)
        for k, device in enumerate(devices):
            rows = np.zeros(len(t_s), row_dtype(device))
            rows["t_ns"] = stamps
            rows["speed"] = speeds[:, k] + SPEED_NOISE * random.standard_normal(len(t_s))
            rows["torque"] = torques[:, k] + TORQUE_NOISE * random.standard_normal(len(t_s))
            parts[device].append(rows)
        for k, device in enumerate(markers):
            rows = np.zeros(len(t_s[::FRAME]), row_dtype(device))
            rows["t_ns"] = stamps[::FRAME]
            for j, (axis, sd) in enumerate(zip(("x", "y", "heading"), CAMERA_NOISE, strict=True)):
                rows[axis] = poses[::FRAME, 3 * k + j] + sd * random.standard_normal(len(rows))
            parts[device].append(rows)
        ends.append((begin_ns, int(stamps[-1]) + 1))
        begin_ns = int(stamps[-1]) + 1_000_000_000
    signals = {
        f"module_{k + 1}_{wheels}_{name}": f"motor_{k + 1}_{wheels}.{name}"
        for k, wheels in motors
        for name in ("speed", "torque")
    }
    signals |= {
        f"module_{k + 1}_{axis}": f"marker_{k + 1}.{axis}"
        for k in range(n)
        for axis in ("x", "y", "heading")
    }
    constants = {name: value for name, (value, _) in SIZES.items()}
    constants |= {"modules": n, "motors": len(motors), "gear_ratio": GEAR, "certain_grip": 0.7}
    constants |= {"body_mass": 3.8}
    u = {name: u for name, (_, u) in SIZES.items()}
    for k in range(n):
        constants[f"module_{k + 1}_body_mass"], u[f"module_{k + 1}_body_mass"] = (
            chain.masses[k],
            2e-3,
        )
        if n > 1:
            name = f"module_{k + 1}_hinge_distance"
            constants[name], u[name] = chain.lengths[k], 5e-4
    whole = {device: np.concatenate(found) for device, found in parts.items()}
    return Recorded(whole, signals, constants, u, ends)


def played(
    chain: Chain, trial: Trial, changes: Mapping[str, Any] | None
) -> tuple[Array, Array, Array, Array]:
    """Return times in s, true motor speeds and torques (t, motors), and poses (t, 3 n)."""
    robot = Driven(chain.parameters(changes), loads="module")
    first = next(k for k, kind in enumerate(chain.driven) if kind != "none")
    targets = np.concatenate([
        np.array([trial.right, trial.left]) * (1.0 if k == first else trial.others)
        for k, kind in enumerate(chain.driven)
        if kind != "none"
    ])  # fmt: skip
    count = round((trial.seconds + 0.5) * RATE_HZ)
    speeds, torques = np.zeros((count, len(targets))), np.zeros((count, len(targets)))
    poses = np.zeros((count, 3 * robot.n))
    for k in range(count):
        share = min(max((k / RATE_HZ - 0.5) / trial.ramp_s, 0.0), 1.0)
        speeds[k] = robot.state[robot.robot.first_spin :][robot.driven] * GEAR
        torques[k] = robot.torques()
        poses[k] = np.column_stack([robot.centres, robot.headings]).ravel()
        robot.play(1.0 / RATE_HZ, *(share * targets))
    return np.arange(count) / RATE_HZ, speeds, torques, poses
