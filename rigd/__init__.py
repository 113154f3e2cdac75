"""rigd: controller and data-acquisition daemon for friction and traction test rigs."""

__version__ = "0.1.0"
