"""Defines what the articulated plant shares with its devices and with the check of a rig file.

It imports no physics, so that rigd can check a rig file without loading it.
"""

from __future__ import annotations

from typing import Final

#: Step of the integrator in ns: the fastest rate of the shipped robot is 2900 1/s, and Runge-Kutta
#: of order 4 is stable up to 2.785 / step (articulated.md 4).
STEP_NS: Final = 500_000
#: Steps whose poses the plant keeps for the camera: 2 s.
HISTORY_STEPS: Final = 4096

#: The wheels of a module in the order of the paper's k = 1 to 4.
WHEELS: Final = ("front_right", "front_left", "rear_right", "rear_left")
#: Whether a wheel is at +d (front) and at +b (left).
AT_FRONT: Final = (True, True, False, False)
ON_LEFT: Final = (False, True, False, True)

#: (name, unit, what it is) of a module; the hidden state that verification compares with.
MODULE_TRUTH: Final = (
    ("x", "m", "position of the module's centre in the inertial frame, x_j"),
    ("y", "m", "position of the module's centre in the inertial frame, y_j"),
    ("heading", "rad", "heading, th_j, not wrapped"),
    ("forward_speed", "m/s", "speed of the centre along the heading"),
    ("lateral_speed", "m/s", "speed of the centre to the left"),
    ("yaw_rate", "rad/s", "rate of the heading"),
    ("hinge_angle", "rad", "heading of the module ahead less this one's; 0 for the first"),
)
#: (suffix, unit, what it is) of each wheel of a module.
WHEEL_TRUTH: Final = (
    ("speed", "rad/s", "angular speed of the wheel, phi'"),
    ("slip", "m/s", "longitudinal slip, r phi' - rho'"),
    ("lateral_slip", "m/s", "lateral speed of the contact, eta'"),
    ("f_lon", "N", "longitudinal contact force, f_lon"),
    ("f_lat", "N", "lateral contact force, f_lat"),
    ("load", "N", "normal force, f_n"),
    ("sliding", "1", "1 while the contact is beyond mu_s f_n, else 0"),
)
#: All of a module: what the device ``sim-articulated-truth`` shows.
TRUTH: Final = (
    *MODULE_TRUTH,
    *(
        (f"{wheel}_{name}", unit, f"{doc}; {wheel.replace('_', ' ')} wheel")
        for wheel in WHEELS
        for name, unit, doc in WHEEL_TRUTH
    ),
)

#: Contact laws: that of the paper with its jump, the smooth one, and the one without saturation.
LAWS: Final = ("paper", "smooth", "linear")
#: Where normal forces come from: equal for all wheels (the paper), the weight of each module, that
#: with quasi-static load transfer, and vertical dynamics with the normal force as a state.
LOADS: Final = ("equal", "module", "transfer", "vertical")
