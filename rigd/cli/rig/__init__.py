"""Contains the commands that check, open or move a rig."""
