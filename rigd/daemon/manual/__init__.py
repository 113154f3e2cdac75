"""A rig by hand: opened and looked at, never armed, nothing recorded."""

from rigd.daemon.manual.choice import actions_of, check_action, chosen_channels
from rigd.daemon.manual.look import Look, look_at
from rigd.daemon.manual.newest import Newest, Reading
from rigd.daemon.manual.part import only

__all__ = [
    "Look",
    "Newest",
    "Reading",
    "actions_of",
    "check_action",
    "chosen_channels",
    "look_at",
    "only",
]
