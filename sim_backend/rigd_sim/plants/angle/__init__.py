"""The approach-angle rig: motor, shaft, omni-wheel, contact, platform and their sensors."""
