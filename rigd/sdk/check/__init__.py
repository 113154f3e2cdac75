"""Checks that a driver or a plant conforms to the SDK: ``check_driver`` and ``check_plant``.

The author of a driver calls the suite in a test::

    def test_conforms() -> None:
        check_driver(AcmeScale, {"port": "/dev/ttyUSB0"})               # checks without a device
        check_driver(AcmeScale, {"unit": "kg"}, peer=simulated_acme)    # checks with a device

``simulated_acme`` is a function that starts a simulated device, with which the driver communicates;
see :class:`Peer`. The author of a plant does the same::

    def test_physics() -> None:
        check_plant(AcmeRig, devices={"motor": (AcmeMotor, {}), "truth": (AcmeTruth, {})},
                    truth="truth")
"""

from rigd.sdk.check.peer import FAULTS, Observed, Peer, SentReading, background_loop
from rigd.sdk.check.plant.suite import check_plant, examine_plant
from rigd.sdk.check.report import Finding, NonConforming, Report
from rigd.sdk.check.suite import check_driver, examine_driver

__all__ = [
    "FAULTS",
    "Finding",
    "NonConforming",
    "Observed",
    "Peer",
    "Report",
    "SentReading",
    "background_loop",
    "check_driver",
    "check_plant",
    "examine_driver",
    "examine_plant",
]
