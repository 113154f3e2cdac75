"""Operates the Humusoft MF624, a PCI data acquisition card, through its registers."""
