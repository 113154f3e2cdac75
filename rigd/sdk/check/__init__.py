"""``check_driver`` and ``check_plant``: conformance suites, one line in an author's tests.

::

    def test_conforms() -> None:
        check_driver(AcmeScale, {"port": "/dev/ttyUSB0"})               # what needs no device
        check_driver(AcmeScale, {"unit": "kg"}, peer=simulated_acme)    # and what does

``simulated_acme`` is a function that makes a simulated device to talk to; see :class:`Peer`.

    def test_physics() -> None:
        check_plant(AcmeRig, devices={"motor": (AcmeMotor, {}), "truth": (AcmeTruth, {})},
                    truth="truth")
"""

from rigd.sdk.check.peer import FAULTS, Peer, background_loop
from rigd.sdk.check.plant_suite import check_plant, examine_plant
from rigd.sdk.check.report import Finding, NonConforming, Report
from rigd.sdk.check.suite import check_driver, examine_driver

__all__ = [
    "FAULTS",
    "Finding",
    "NonConforming",
    "Peer",
    "Report",
    "background_loop",
    "check_driver",
    "check_plant",
    "examine_driver",
    "examine_plant",
]
