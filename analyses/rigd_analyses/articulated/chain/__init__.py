"""The robot of 1 to 8 modules, any of which drive: contacts that grip, for each module."""
