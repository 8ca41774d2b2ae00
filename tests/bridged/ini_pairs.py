"""Pairs of the paper's INI manifests for tests."""

from pathlib import Path

from bridged.drivers.registry import check_manifest, load_robot_manifest
from bridged.paper_format.ini_manifests import translate_pair
from schemas.manifest.loader import Manifest

MISSIONS = Path(__file__).parents[2] / "missions"


def of_the_uav() -> Manifest:
    """The shipped pair."""
    return load_robot_manifest(("actions_manifest", "perceptions_manifest"), MISSIONS / "paper_uav")


def pair(actions: str = "", percepts: str = "") -> Manifest:
    manifest = translate_pair(actions, "a", percepts, "p")
    assert check_manifest(manifest) == []
    return manifest


def service(name: str, *params: str, method: str = "service", types: str = "") -> str:
    """A section of an actions manifest."""
    text = f"[act]\nmethod = {method}\nname = {name}\nparams_name = {', '.join(params)}\n"
    return text + (f"params_type = {types}\n" if types else "")
