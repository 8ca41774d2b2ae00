"""Manifests of robots: model, loader, rules, plain data (`document`), the paper's INI format, JSON schema."""
