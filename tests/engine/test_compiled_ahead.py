"""What a rig computes is compiled before its first cycle, which has no time for that."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import warm

TESTS = Path(__file__).resolve().parents[1]
#: Plays three cycles at rest of the rig of the first paper, with derived channels, COUNT
#: controllers, the filter of slip and a linear one, in a process that has compiled or loaded
#: nothing yet. What the simulated plant compiles does not count: a rig in real time has none.
CODE = """\
from numba.core.dispatcher import Dispatcher
from support.engine.bench import ListSink
from support.lugre.slip import observer

from rigd.config.loader import parse_rig
from rigd.engine.clock import VirtualClock
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.cycle.wiring import wire
from rigd.procedure.program import Recorded
from rigd.sdk.shipped_files import shipped_folder

HOLDS = [
    "rim_hold: {measured: rim.speed, output: wheel_servo.current, kp: 5 A s/m, LIMITS}",
    "side_hold: {measured: side.speed, output: lateral_belt.speed, ki: 1 1/s, LIMITS}",
    "belt_hold: {measured: belt.speed, output: longitudinal_belt.speed, ki: 1 1/s, LIMITS}",
]
holds = "\\n  ".join(HOLDS[:COUNT]).replace(
    "LIMITS", "limits: {low: -0.5 m/s, high: 0.5 m/s, rate: 1 m/s^2}"
)
text = f'''\\
derived:
  rim.speed: {{is: derivative(wheel_encoder.angle) * rig.wheel_radius, lowpass: 50 Hz}}
  side.speed: {{is: lateral_belt.speed + 0 m/s}}
  belt.speed: {{is: longitudinal_belt.speed + 0 m/s}}
controllers:
  {holds}
{observer()}
  cart:
    model: linear
    states: {{position: m, speed: m/s}}
    inputs: [accelerometer.acceleration]
    measured: [carriage.position]
    a: [[0, 1], [0, 0]]
    b: [[0], [1]]
    c: [[1, 0]]
    q: [0, 1e-4 m^2/s^3]
    r: [1e-10]
    x0: [0, 0]
    p0: [1e-4, 1e-2]
interlocks:
'''
path = shipped_folder("configs") / "sim_lugre.yaml"
rig = parse_rig(path.read_text().replace("interlocks:\\n", text, 1), path)
clock = VirtualClock(rig.period_ns, 1_790_000_000_000_000_000)
cycle = wire(rig, clock, Control(), 1).cycle
record = {stream.name: Recorded() for stream in cycle.rig.streams}
host = InProcessHost(cycle, clock, virtual=True, sink=ListSink(), record=record)
assert not host.open()

late = []
load = Dispatcher._compile_for_args


def noted(self, *arguments, **named):
    late.append(f"{self.py_func.__module__}.{self.py_func.__name__}")
    return load(self, *arguments, **named)


Dispatcher._compile_for_args = noted
assert host.settle(3) is None
host.close()
here = [name for name in late if not name.startswith("rigd_sim.")]
assert not here, here
assert len(rig.loops) == COUNT
"""


@pytest.mark.parametrize("count", [1, 3])
def test_first_cycle_compiles_nothing(count: int) -> None:
    code, out, errors = warm.run_python(CODE.replace("COUNT", str(count)), TESTS, 120.0)
    assert code == 0, out + errors
