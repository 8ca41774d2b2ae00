"""Manifests of robots: model, loader, rules, edits, the paper's INI format, JSON schema."""
