"""``rigd new rig``: from the description of a rig to a folder that runs in virtual time."""
