"""Recordings (MCAP): `recorder` writes, `reader` reads, `player` plays them, `mind_verification` runs minds again."""
