"""Off-cycle devices: block devices in helper processes, slow devices on an event loop.

Both push rows into rings of their own, and the newest row into a table that the cycle reads.
"""

from rigd.engine.slow.beside import Beside, StandIns
from rigd.engine.slow.block_helper import BlockHelper
from rigd.engine.slow.devices import SlowDevices
from rigd.engine.slow.latest import Latest
from rigd.engine.slow.table import LatestTable, Slot

__all__ = ["Beside", "BlockHelper", "Latest", "LatestTable", "Slot", "SlowDevices", "StandIns"]
