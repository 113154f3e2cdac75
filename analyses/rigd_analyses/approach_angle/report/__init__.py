"""Makes the report on a campaign of the approach-angle rig: one HTML page for any browser."""
