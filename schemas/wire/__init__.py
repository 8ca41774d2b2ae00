"""The wire format: records, terms, their encoding, and key expressions (`keys`)."""
