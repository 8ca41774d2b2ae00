"""What is said: records, terms, codec, key expressions, models of mission and manifest. Pure: no bus, no clock."""
