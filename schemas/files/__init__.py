"""Files as users write them: positions of YAML, TOML and INI, units, validation, findings with a caret."""
