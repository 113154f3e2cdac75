"""What goes wrong at a robot, in two sizes, and the words that count as its right name.

The words were written before any result was seen: those that a person beside the robot would
accept. If the data cannot tell two causes apart, either is right: the gain of a torque and a mass,
a slope and a force along one direction, a late camera and a clock.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from blind.kind import Kind
from blind.robot import WHEEL, Robot, draw

Apply = Callable[[Robot, float, np.random.Generator], None]

ALL_LENGTHS: Final = r"scale|unit of length|lengths"
TORQUE: Final = r"torque"
FORCE: Final = r"drag|drive|motor|rub|force|resistance|roll"
FLOOR: Final = r"floor|place|along|position|where|slope|travel"
TIME: Final = r"time|warm|drift|trial|order|wear|clock|record"
CAMERA: Final = r"camera|marker|scale|lens|image|axis|axes|pose"


def robot_kinds() -> dict[str, Kind[Robot]]:
    """Return every kind by its name."""
    found = [*_constants(), *_contacts(), *_mechanics(), *_camera(), *_motors(), *_procedure()]
    assert len({kind.name for kind in found}) == len(found)
    return {kind.name: kind for kind in found}


def robot_world(name: str, size: int, seed: int) -> Robot:
    """Return the right robot of that seed with the kind in it."""
    known = robot_kinds()
    number = list(known).index(name)
    robot = draw(1000 + 10 * number + seed)
    known[name].apply(
        robot, known[name].sizes[size], np.random.default_rng([8, number, size, seed])
    )
    return robot


def _state(*names: str) -> Apply:
    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        for name in names:
            value, u = robot.stated[name]
            robot.stated[name] = (value * size, u)

    return apply


def _true(name: str, *undefined: str) -> Apply:
    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        robot.true[name] = size
        robot.undefined = undefined

    return apply


def _seen(name: str) -> Apply:
    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        setattr(robot.camera, name, size)

    return apply


def _measured(name: str, of: Callable[[float], Any] = lambda size: size) -> Apply:
    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        setattr(robot.motors, name, of(size))

    return apply


def _wheels(name: str, which: list[int]) -> Apply:
    """Multiply a quantity of these wheels."""

    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        robot.wheels[which, WHEEL.index(name)] *= size

    return apply


def _module(name: str, which: int, value: float = 0.0) -> Apply:
    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        robot.module(name)[which] = value + size

    return apply


def _marker(which: int, direction: complex) -> Apply:
    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        robot.camera.offsets[which] = direction * size

    return apply


def _turned(which: int) -> Apply:
    def apply(robot: Robot, size: float, _: np.random.Generator) -> None:
        robot.camera.turned[which] = np.radians(size)

    return apply


def _constants() -> list[Kind[Robot]]:
    return [
        Kind(
            "wheel_radius stated low",
            "constants",
            (0.985, 0.96),
            rf"radius|gear|{ALL_LENGTHS}",
            _state("wheel_radius"),
        ),
        Kind(
            "half_track stated high",
            "constants",
            (1.02, 1.05),
            r"half_track|track",
            _state("half_track"),
        ),
        Kind(
            "half_wheelbase stated low",
            "constants",
            (0.93, 0.85),
            r"half_wheelbase|wheelbase|k_lat",
            _state("half_wheelbase"),
        ),
        Kind(
            "hinge_distance stated high",
            "constants",
            (1.03, 1.08),
            r"hinge|link|marker",
            _state("hinge_distance"),
        ),
        Kind(
            "body_mass stated low: a battery forgotten",
            "constants",
            (0.94, 0.85),
            rf"mass|{TORQUE}",
            _state("body_mass"),
        ),
        Kind(
            "body_inertia stated low", "constants", (0.8, 0.5), r"inertia", _state("body_inertia")
        ),
        Kind(
            "rotor_inertia stated low", "constants", (0.5, 0.2), r"inertia", _state("rotor_inertia")
        ),
        Kind(
            "gear_ratio wrong",
            "constants",
            (0.96, 0.8),
            rf"gear|radius|{ALL_LENGTHS}",
            _state("gear_ratio"),
        ),
        Kind(
            "all lengths wrong",
            "constants",
            (1.015, 1.05),
            rf"{ALL_LENGTHS}|radius",
            _state("wheel_radius", "half_track", "half_wheelbase", "hinge_distance"),
        ),
        Kind(
            "torques and masses high",
            "constants",
            (1.05, 1.1),
            r"torque|mass",
            _both_high,
            documented=True,
        ),
    ]


def _both_high(robot: Robot, size: float, _: np.random.Generator) -> None:
    for name in ("body_mass", "wheel_mass", "body_inertia", "wheel_inertia", "rotor_inertia"):
        value, u = robot.stated[name]
        robot.stated[name] = (value * size, u)
    robot.motors.torque_gain = (size, size)


def _contacts() -> list[Kind[Robot]]:
    lon, lat = "k_lon", "k_lat"
    return [
        Kind(
            "rear module grips less aside",
            "contacts",
            (0.9, 0.7),
            r"rear|k_lat|load",
            _wheels(lat, [4, 5, 6, 7]),
        ),
        Kind(
            "rear module rolls worse",
            "contacts",
            (1.3, 2.0),
            rf"rear|k_roll|{FORCE}|{TORQUE}",
            _wheels("k_roll", [4, 5, 6, 7]),
        ),
        Kind(
            "one wheel grips less",
            "contacts",
            (0.75, 0.4),
            r"side|wheel|left|right|load|k_l",
            _one_wheel,
        ),
        Kind("left wheels grip less", "contacts", (0.9, 0.7), r"side|left|right|sense", _left_grip),
        Kind(
            "force bends with slip",
            "contacts",
            (-0.1, -0.3),
            r"proportion|slip|bend|linear|law",
            _true("power", lon, lat, "mu_s"),
        ),
        Kind(
            "lets go gradually",
            "contacts",
            (0.08, 0.25),
            r"mu_s|gradual|let|slid",
            _true("gradual", "mu_s"),
        ),
        Kind(
            "sliding friction falls with speed",
            "contacts",
            (0.15, 0.4),
            r"slid|mu_d|mu_s|slip|speed",
            _true("falling", "mu_d"),
        ),
        Kind(
            "rolling rises with speed",
            "contacts",
            (0.1, 0.4),
            rf"speed|{FORCE}",
            _true("rolling_speed", "k_roll"),
        ),
        Kind("k warms in a trial", "contacts", (-0.08, -0.25), rf"{TIME}", _true("warming")),
        Kind(
            "pile of a carpet",
            "contacts",
            (0.08, 0.25),
            rf"heading|direction|{FLOOR}",
            _true("pile", lon, lat),
        ),
        Kind("another floor beyond a line", "contacts", (-0.1, -0.3), rf"{FLOOR}", _true("patch")),
        Kind(
            "loads shift with acceleration",
            "contacts",
            (1.0, 3.0),
            r"load|shift|transfer|height",
            _true("transfer"),
        ),
        Kind(
            "front heavier than rear",
            "contacts",
            (0.08, 0.25),
            r"load|shift|front|rear|mass",
            _heavier,
        ),
        Kind(
            "mu_s and mu_d differ by trial",
            "contacts",
            (0.04, 0.12),
            rf"{TIME}|mu_|slid",
            _sliding_differs,
        ),
        Kind("k falls from trial to trial", "contacts", (-0.01, -0.03), rf"{TIME}", _wear),
    ]


def _one_wheel(robot: Robot, size: float, random: np.random.Generator) -> None:
    wheel = int(random.integers(4))
    for name in ("k_lon", "k_lat"):
        robot.wheel(name)[wheel] *= size


def _left_grip(robot: Robot, size: float, _: np.random.Generator) -> None:
    for name in ("k_lon", "k_lat"):
        robot.wheel(name)[[1, 3, 5, 7]] *= size


def _heavier(robot: Robot, size: float, _: np.random.Generator) -> None:
    """Carry a load on the front; coefficients are in proportion to the load."""
    robot.module("mass")[:] *= [1 + size, 1 - size]
    robot.module("inertia")[:] *= [1 + size, 1 - size]
    robot.wheel("load")[:4] *= 1 + size
    robot.wheel("load")[4:] *= 1 - size
    for name in ("k_lon", "k_lat"):
        robot.wheel(name)[:4] *= 1 + size
        robot.wheel(name)[4:] *= 1 - size


def _sliding_differs(robot: Robot, size: float, random: np.random.Generator) -> None:
    for trial in robot.trials:
        trial.sliding = float(np.exp(size * random.uniform(-1.7, 1.7)))


def _wear(robot: Robot, size: float, _: np.random.Generator) -> None:
    for number, trial in enumerate(robot.trials):
        trial.level = 1 + size * number


def _mechanics() -> list[Kind[Robot]]:
    return [
        Kind(
            "right front wheels larger",
            "mechanics",
            (1.01, 1.04),
            r"radius|side|left|right|scale",
            _wheels("radius", [0, 2]),
        ),
        Kind(
            "rear wheels smaller",
            "mechanics",
            (0.95, 0.8),
            r"rear|radius",
            _wheels("radius", [4, 5, 6, 7]),
        ),
        Kind(
            "front wheels eccentric",
            "mechanics",
            (0.02, 0.06),
            r"eccentric|turn|revolution|round|runout",
            _eccentric,
        ),
        Kind(
            "toe of the front wheels",
            "mechanics",
            (0.01, 0.04),
            r"toe|align|parallel|turned|marker|aside|heading",
            _toe,
        ),
        Kind(
            "floor slopes along x",
            "mechanics",
            (0.003, 0.015),
            rf"slope|level|{FLOOR}|force|direction|heading",
            _true("slope_x"),
        ),
        Kind(
            "floor slopes along y",
            "mechanics",
            (0.005, 0.02),
            rf"slope|level|{FLOOR}|force|direction|heading",
            _true("slope_y"),
        ),
        Kind(
            "cable pulls the rear",
            "mechanics",
            (0.3, 1.5),
            rf"cable|{FLOOR}|{FORCE}",
            _true("tether"),
        ),
        Kind(
            "rear scrapes on the floor",
            "mechanics",
            (0.4, 2.0),
            r"drag|scrape|rear|rub|force|resistance",
            _true("scrape"),
        ),
        Kind(
            "scrapes at one side",
            "mechanics",
            (0.4, 2.0),
            r"drag|scrape|rear|rub|side|force|resistance",
            _scrape_aside,
        ),
        Kind(
            "air resists",
            "mechanics",
            (1.0, 5.0),
            rf"drag|air|speed|{FORCE}",
            _true("drag_squared"),
        ),
        Kind(
            "hinge springs back",
            "mechanics",
            (0.05, 0.4),
            r"hinge|spring|cable",
            _true("hinge_spring"),
        ),
        Kind("hinge rubs", "mechanics", (0.03, 0.2), r"hinge|rub", _true("hinge_dry")),
        Kind("hinge damped", "mechanics", (0.1, 0.8), r"hinge|damp|rub", _true("hinge_damping")),
        Kind("hinge stops early", "mechanics", (38.0, 25.0), r"hinge|stop", _stop),
        Kind(
            "hinge aside on the front",
            "mechanics",
            (0.005, 0.02),
            r"hinge",
            _module("behind_aside", 0),
        ),
        Kind(
            "hinge aside on the rear",
            "mechanics",
            (0.005, 0.02),
            r"hinge",
            _module("ahead_aside", 1),
        ),
        Kind(
            "front's mass ahead",
            "mechanics",
            (0.02, 0.06),
            r"mass|centre|load|inertia",
            _module("mass_ahead", 0),
        ),
        Kind(
            "rear not declutched",
            "mechanics",
            (5e-4, 3e-3),
            rf"rear|clutch|{FORCE}",
            _not_declutched,
        ),
        Kind(
            "right gear rubs",
            "mechanics",
            (5e-4, 3e-3),
            rf"{TORQUE}|{FORCE}|right|left|side|friction",
            _gear_rubs,
        ),
        Kind(
            "torque ripples",
            "mechanics",
            (2e-3, 8e-3),
            rf"ripple|turn|{TORQUE}|cogging|angle",
            _true("torque_ripple"),
        ),
    ]


def _eccentric(robot: Robot, size: float, random: np.random.Generator) -> None:
    robot.wheel("eccentric")[:4] = size
    robot.wheel("phase")[:4] = random.uniform(0, 6.28, 4)


def _toe(robot: Robot, size: float, _: np.random.Generator) -> None:
    robot.wheel("toe")[:4] = size


def _scrape_aside(robot: Robot, size: float, _: np.random.Generator) -> None:
    robot.true["scrape"] = size
    robot.true["scrape_aside"] = 0.1


def _stop(robot: Robot, size: float, _: np.random.Generator) -> None:
    robot.true["hinge_stop"] = np.radians(size)


def _not_declutched(robot: Robot, size: float, _: np.random.Generator) -> None:
    robot.unit("rotor")[2:] = robot.unit("rotor")[0]
    robot.unit("dry")[2:] = size


def _gear_rubs(robot: Robot, size: float, _: np.random.Generator) -> None:
    robot.unit("dry")[0] = size


def _camera() -> list[Kind[Robot]]:
    return [
        Kind("front marker aside", "camera", (0.004, 0.015), r"marker|hinge", _marker(0, 1j)),
        Kind("front marker ahead", "camera", (0.005, 0.02), r"marker|hinge", _marker(0, 1)),
        Kind("rear marker aside", "camera", (0.004, 0.015), r"marker|hinge", _marker(1, 1j)),
        Kind("rear marker ahead", "camera", (0.005, 0.02), r"marker|hinge", _marker(1, 1)),
        Kind("front marker turned", "camera", (1.5, 5.0), r"marker|heading|turned", _turned(0)),
        Kind("rear marker turned", "camera", (1.5, 5.0), r"marker|heading|turned", _turned(1)),
        Kind(
            "axes of the camera not square",
            "camera",
            (0.01, 0.03),
            rf"{CAMERA}|square|skew",
            _seen("skew"),
        ),
        Kind("lens bends", "camera", (0.01, 0.04), rf"{CAMERA}|{FLOOR}", _seen("barrel")),
        Kind("camera tilted", "camera", (0.01, 0.04), rf"{CAMERA}|{FLOOR}", _seen("perspective")),
        Kind(
            "clock of the camera",
            "camera",
            (1.001, 1.005),
            r"clock|time|latency|late",
            _seen("clock"),
        ),
        Kind(
            "frames jitter",
            "camera",
            (0.005, 0.02),
            rf"jitter|time|{CAMERA}|noise",
            _seen("jitter"),
        ),
        Kind(
            "headings late",
            "camera",
            (0.02, 0.08),
            rf"late|delay|{CAMERA}|heading",
            _seen("heading_late"),
        ),
        Kind(
            "rear marker late",
            "camera",
            (0.02, 0.08),
            rf"late|delay|{CAMERA}|rear",
            _seen("rear_late"),
        ),
        Kind(
            "camera moved half way",
            "camera",
            (0.01, 0.04),
            rf"{CAMERA}|trial|order|turned|place",
            _seen("moved"),
        ),
        Kind("poses drift", "camera", (3e-4, 2e-3), rf"drift|{CAMERA}|time", _seen("drift")),
        Kind("camera shakes", "camera", (0.003, 0.01), rf"{CAMERA}|shak|hum|hz|noise|vibrat", _hum),
        Kind(
            "outliers of poses",
            "camera",
            (0.01, 0.05),
            rf"{CAMERA}|outlier|noise",
            _seen("outliers"),
        ),
        Kind(
            "coarse pixels",
            "camera",
            (0.004, 0.015),
            rf"{CAMERA}|step|pixel|noise|resolution",
            _seen("step"),
        ),
        Kind(
            "long exposure",
            "camera",
            (0.08, 0.25),
            rf"{CAMERA}|exposure|time|late|smooth|filter",
            _seen("exposure"),
        ),
    ]


def _hum(robot: Robot, size: float, _: np.random.Generator) -> None:
    robot.camera.hum = (size, 1.7)


def _motors() -> list[Kind[Robot]]:
    return [
        Kind(
            "both torques low",
            "motors",
            (0.96, 0.88),
            rf"{TORQUE}|mass|gear|drive",
            _measured("torque_gain", lambda s: (s, s)),
        ),
        Kind(
            "right torque low",
            "motors",
            (0.96, 0.88),
            rf"{TORQUE}|side|right|left|drive",
            _measured("torque_gain", lambda s: (s, 1.0)),
        ),
        Kind(
            "right torque has a zero",
            "motors",
            (2e-4, 1e-3),
            rf"{TORQUE}|zero|side|right|left",
            _measured("torque_zero", lambda s: (s, 0.0)),
        ),
        Kind(
            "both torques have a zero",
            "motors",
            (2e-4, 1e-3),
            rf"{TORQUE}|zero|{FORCE}",
            _measured("torque_zero", lambda s: (s, s)),
        ),
        Kind(
            "torques filtered",
            "motors",
            (5.0, 1.0),
            rf"{TORQUE}|filter|late|lag|slow|delay",
            _measured("torque_filter"),
        ),
        Kind(
            "torques late",
            "motors",
            (0.02, 0.1),
            rf"{TORQUE}|late|delay|lag|slow|time",
            _measured("torque_late"),
        ),
        Kind(
            "torques clip",
            "motors",
            (0.03, 0.012),
            rf"{TORQUE}|clip|range|saturat|limit",
            _measured("torque_clip"),
        ),
        Kind(
            "torques drift",
            "motors",
            (3e-5, 2e-4),
            rf"{TORQUE}|drift|{TIME}",
            _measured("torque_drift"),
        ),
        Kind(
            "gain of torques fades",
            "motors",
            (-0.004, -0.015),
            rf"{TORQUE}|{TIME}|fade",
            _measured("torque_fade"),
        ),
        Kind(
            "right speed low",
            "motors",
            (0.99, 0.96),
            r"speed|radius|side|right|left|encoder|gear|scale",
            _measured("speed_gain", lambda s: (s, 1.0)),
        ),
        Kind(
            "speeds late",
            "motors",
            (0.01, 0.05),
            r"late|delay|latency|time|clock|lag|speed",
            _measured("speed_late"),
        ),
        Kind(
            "speeds filtered",
            "motors",
            (10.0, 2.0),
            r"late|delay|filter|lag|speed|slow",
            _measured("speed_filter"),
        ),
        Kind(
            "disk of the encoders eccentric",
            "motors",
            (0.01, 0.04),
            r"eccentric|turn|revolution|speed|encoder|angle",
            _measured("eccentric"),
        ),
        Kind(
            "hum of the mains on torques",
            "motors",
            (2e-3, 8e-3),
            rf"{TORQUE}|hum|mains|50|noise",
            _measured("hum", lambda s: (s, 50.0)),
        ),
        Kind(
            "spikes of torques",
            "motors",
            (0.003, 0.03),
            rf"{TORQUE}|spike|outlier|noise",
            _measured("spikes"),
        ),
    ]


def _procedure() -> list[Kind[Robot]]:
    return [
        Kind(
            "torques exchanged",
            "procedure",
            (1.0,),
            r"torque|exchang|side|swap|cable|right|left",
            _measured("exchanged", bool),
        ),
        Kind(
            "torques without sign",
            "procedure",
            (1.0,),
            rf"{TORQUE}|sign",
            _measured("absolute", bool),
        ),
        Kind(
            "markers exchanged often",
            "procedure",
            (0.03, 0.2),
            r"marker|exchang",
            _seen("exchanged"),
        ),
        Kind(
            "rear marker not seen for a while",
            "procedure",
            (0.6, 3.0),
            r"marker|seen|silent|rear",
            _seen("gap"),
        ),
        Kind("one trial with another grip", "procedure", (0.9, 0.7), rf"{TIME}", _one_trial),
        Kind(
            "starts folded",
            "procedure",
            (8.0, 25.0),
            r"begin|start|rest|hinge|heading|place",
            _folded,
        ),
    ]


def _one_trial(robot: Robot, size: float, random: np.random.Generator) -> None:
    robot.trials[int(random.integers(len(robot.trials)))].level = size


def _folded(robot: Robot, size: float, _: np.random.Generator) -> None:
    for trial in robot.trials:
        x, y, front, rear = trial.begin
        trial.begin = (x, y, front, rear + np.radians(size))
