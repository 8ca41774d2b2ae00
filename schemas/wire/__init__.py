"""What travels: records, terms, their encoding, and key expressions (`keys`)."""
