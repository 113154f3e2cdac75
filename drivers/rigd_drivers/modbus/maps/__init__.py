"""Register maps of devices, made from their manuals: one TOML file each."""
