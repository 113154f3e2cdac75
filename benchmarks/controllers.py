"""What controllers cost: four of them that act, in a cycle, beside the same rig without.

Both rigs play the same trial in turn, in CPU time. The peer of the arithmetic is simple-pid, with
the same gains on the same errors, and limits that neither reaches: they treat limits differently.
"""

from __future__ import annotations

import math
import time
from functools import partial

import numpy as np
from derived import ROUNDS, SECONDS, Nowhere
from figures import at_most, in_turn, noted
from simple_pid import PID

from rigd.computed.controllers.bank import Bank
from rigd.computed.controllers.driver import ControllerConfig
from rigd.config.loader import parse_rig
from rigd.config.rig import RigConfig
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.wiring import wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.model.limits import SetpointLimit
from rigd.model.tables import Tables
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import CycleProgram, Recorded, Segment
from rigd.sdk.shipped_files import shipped_folder

DERIVED = """\
derived:
  rim.speed: {is: derivative(wheel_encoder.angle) * rig.wheel_radius, lowpass: 50 Hz}
  side.speed: {is: lateral_belt.speed + 0 m/s}
  belt.speed: {is: longitudinal_belt.speed + 0 m/s}
"""
LIMITS = "limits: {low: -0.5 m/s, high: 0.5 m/s, rate: 1 m/s^2}, stuck_after: 60 s"
#: Three that command devices, and one that commands the first.
FOUR = f"""\
controllers:
  rim_hold: {{measured: rim.speed, output: wheel_servo.current, kp: 5 A s/m, ki: 300 A/m,
    {LIMITS}}}
  side_hold: {{measured: side.speed, output: lateral_belt.speed, ki: 1 1/s, {LIMITS}}}
  belt_hold: {{measured: belt.speed, output: longitudinal_belt.speed, ki: 1 1/s, {LIMITS}}}
  turn_hold: {{measured: wheel_encoder.angle, output: rim_hold, kp: 0.1 m/rad/s, kd: 0.001 m/rad,
    filter: 20 Hz, output_limits: [-0.3 m/s, 0.3 m/s], limits: {{low: -9 rad, high: 9 rad}},
    stuck_after: 60 s}}
"""


def rig_with(controllers: str) -> RigConfig:
    """Return the rig of the first paper with three derived channels and ``controllers``."""
    path = shipped_folder("configs") / "sim_lugre.yaml"
    text = f"{DERIVED}{controllers}interlocks:\n"
    return parse_rig(path.read_text().replace("interlocks:\n", text, 1), path)


def play(rig: RigConfig) -> float:
    """Return the CPU time of a cycle in us; controllers act, if there are any."""
    clock = VirtualClock(rig.period_ns, 1_790_000_000_000_000_000)
    cycle = wire(rig, clock, Control(), 1).cycle
    record = {stream.name: Recorded() for stream in cycle.rig.streams}
    host = InProcessHost(cycle, clock, virtual=True, sink=Nowhere(), record=record)
    host.open()
    host.arm()
    goals = {
        "turn_hold.angle": 1.0, "side_hold.speed": 0.01, "belt_hold.speed": 0.0,
        "wheel_servo.current": 0.1,
    }  # fmt: skip
    if rig.loops:
        del goals["wheel_servo.current"]
    profiles = {
        name: ConstantProfile(value) for name, value in goals.items() if name in cycle.rig.setpoints
    }
    began = time.process_time()
    outcome = host.play(CycleProgram((Segment("go", profiles, duration_s=SECONDS),)))
    host.drain()
    spent = time.process_time() - began
    if outcome.reason:
        raise RuntimeError(outcome.reason)
    return 1e6 * spent / (1e3 * SECONDS)


def beside_simple_pid(count: int) -> tuple[float, float, float]:
    """Return the CPU time of four in simple-pid and in rigd, in us, and the largest difference."""
    kp, ki = 0.5, 4.0
    rng = np.random.default_rng(1)
    measured = (0.3 * np.sin(np.arange(count) / 50) + rng.normal(0, 0.01, count)).tolist()
    peers = [PID(kp, ki, 0.0, setpoint=0.1, sample_time=None) for _ in range(4)]
    theirs = []
    began = time.process_time()
    for value in measured:
        first, *_ = [peer(value, dt=1e-3) for peer in peers]
        theirs.append(first or 0.0)
    peer_us = 1e6 * (time.process_time() - began) / count
    given = {"unit": "N", "output_unit": "A", "needs": frozenset(), "low": -1e3, "high": 1e3}
    configs = [
        ControllerConfig.model_validate(
            {**given, "name": f"c{n}", "measured": "load.force", "output": f"press{n}.current",
             "kp": kp, "ki": ki, "stuck_s": 60.0}
        )
        for n in range(4)
    ]  # fmt: skip
    names = [item.output for item in configs] + [item.setpoint for item in configs]
    limit = SetpointLimit(-1e3, 1e3, math.inf)
    bank = Bank(configs, dict.fromkeys(names, limit), 1e-3)
    places = {name: place for place, name in enumerate(names)}
    values, stamps, wanted, applied = [0.0], [0], [0.0] * 4 + [0.1] * 4, [0.0] * 8
    tables = Tables(values, stamps, applied, wanted, {"load.force": 0}, [0], [0], places)
    bank.bind(tables)
    active = frozenset(names[4:])
    # simple-pid begins with its proportional term and a first integral; rigd at what is set.
    applied[:4] = [kp * (0.1 - measured[0]) + ki * 1e-3 * (0.1 - measured[0])] * 4
    values[0] = measured[0]
    tables.take(0)
    bank.step(0, ())
    wanted[4:] = [0.1] * 4
    apart, ours = 0.0, []
    began = time.process_time()
    for index, value in enumerate(measured):
        values[0], stamps[0] = value, (index + 1) * 1_000_000
        tables.take(stamps[0])
        bank.step(stamps[0], active)
        applied[:4] = wanted[:4]
        ours.append(wanted[0])
    own_us = 1e6 * (time.process_time() - began) / count
    start = ours[0] - theirs[0]  # the change of the setpoint at the start acts on rigd alone
    apart = max(abs(a - b - start) for a, b in zip(ours, theirs, strict=True))
    return peer_us, own_us, apart


def main() -> None:
    """Play both rigs in turn and report what the controllers add."""
    rigs = [rig_with(text) for text in ("", FOUR)]
    for rig in rigs:
        play(rig)
    (bare, _, _), (four, added, ratio) = in_turn([partial(play, rig) for rig in rigs], ROUNDS)
    print(f"a cycle in virtual time, in us: {bare:.1f}, with four controllers {four:.1f}")
    at_most("4 controllers, added to a cycle", added, 40, "us")
    at_most("4 controllers, virtual time longer by", 100 * (ratio - 1), 20, "%")
    peer, own, apart = beside_simple_pid(5000)
    noted("4 controllers by simple-pid, arithmetic alone", peer, "us per cycle")
    noted("4 controllers by rigd, limits, checks and terms included", own, "us per cycle")
    at_most("PI of rigd and of simple-pid apart by", apart, 1e-9, "A")
    noted("simple-pid / rigd", peer / own, "x")


if __name__ == "__main__":
    main()
