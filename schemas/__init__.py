"""Data formats: records, terms, codec, key expressions, models of missions and manifests. Pure: no bus, no clock."""
