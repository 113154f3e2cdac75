"""Contains the friction laws that come with rigd, each found by its entry point."""
