"""CANopen on bytes: CiA 301 frames, SDO, PDO, NMT and EMCY, and the CiA 402 drive states.

Nothing here does I/O; what drives a bus with it is :mod:`rigd_drivers.can_bus` and
:mod:`rigd_drivers.can_node`.
"""
