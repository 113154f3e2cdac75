"""Opens a rig without a run to read its channels; nothing is armed and nothing is recorded."""

from rigd.daemon.manual.choice import actions_of, check_action, chosen_channels, only
from rigd.daemon.manual.newest import Newest, Reading
from rigd.daemon.manual.unarmed_rig import UnarmedSession, open_unarmed

__all__ = [
    "Newest",
    "Reading",
    "UnarmedSession",
    "actions_of",
    "check_action",
    "chosen_channels",
    "only",
    "open_unarmed",
]
