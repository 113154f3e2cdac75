"""Modbus devices over TCP and RTU: a load-cell transmitter and a speed servo.

From the wire up: ``pdu`` (requests and their right answers), ``framing`` (TCP and RTU frames),
``exchange`` (one request at a time, every reply that is not its answer refused and counted; no
I/O up to here), ``transport`` (a socket, a serial port), ``client`` (the two together, waiting or
not). ``registers`` and ``maps`` say what stands where in a device.
"""
