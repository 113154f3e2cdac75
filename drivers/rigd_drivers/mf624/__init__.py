"""Humusoft MF624, a PCI data acquisition card reached by its registers."""
