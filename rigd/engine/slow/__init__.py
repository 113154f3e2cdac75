"""Runs devices outside the control cycle: block devices in processes, slow ones on a loop.

Both push rows into rings of their own, and the newest row into a table that the cycle reads. This
package itself imports nothing, so that neither the cycle nor a helper process loads an event loop.
"""
