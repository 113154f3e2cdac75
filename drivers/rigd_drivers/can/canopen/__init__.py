"""Encodes and decodes CANopen: CiA 301 frames, SDO, PDO, NMT and EMCY, and CiA 402 drive states.

The modules here do no I/O. :mod:`rigd_drivers.can.bus` and :mod:`rigd_drivers.can.node` use them
to operate a bus.
"""
