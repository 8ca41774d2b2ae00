"""What is said: records, terms, codec, key expressions, and the models of mission and manifest files. Pure: no I/O on the bus, no clock."""
