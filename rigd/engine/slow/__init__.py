"""Runs the devices that the control cycle does not call itself: block devices and slow devices.

The cycle is one turn of the control loop. A block device (not a disk) is a device whose library
returns many rows (samples) at once; each block device runs in a process of its own. A slow device
needs longer than a cycle to respond; all slow devices run on one event loop. Each device puts its
rows into a ring of its own (a buffer that holds rows until they are taken), and the newest row into
a table that the cycle reads. This package itself imports nothing, so that neither the cycle nor a
helper process loads an event loop.
"""
