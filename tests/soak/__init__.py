"""Tests that take longer than CI may, one module each: `make soak` runs them and writes docs/measurements/soak.md."""
