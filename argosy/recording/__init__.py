"""Recordings (MCAP): `record` writes them, `file` reads them, `replay` plays them and runs recorded minds again."""
