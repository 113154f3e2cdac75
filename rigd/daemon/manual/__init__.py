"""A rig opened by hand: channels are read, nothing is armed, nothing is recorded."""

from rigd.daemon.manual.choice import actions_of, check_action, chosen_channels, only
from rigd.daemon.manual.look import Look, look_at
from rigd.daemon.manual.newest import Newest, Reading

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
