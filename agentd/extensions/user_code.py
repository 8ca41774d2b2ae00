"""Load users' Python by ``module:Class``."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from commd.process.user_code import MISTAKES, describe_error


class UserCodeError(Exception):
    """Users' code that cannot be used; the text gives the reason and the place."""


def load_class(name: str, base: type) -> type[Any]:
    """Load the class that ``module:Class`` or ``folder/file.py:Class`` names, from the working directory too.

    Raises `UserCodeError`.
    """
    place, colon, attribute = name.rpartition(":")
    if not colon or not place or not attribute:
        raise UserCodeError(f"`{name}` does not name a class; write module:Class or file.py:Class")
    module = _module(place)
    found = getattr(module, attribute, None)
    if found is None:
        classes = sorted(
            key
            for key, value in vars(module).items()
            if isinstance(value, type) and issubclass(value, base) and value is not base
        )
        there = f"; there are {', '.join(classes)}" if classes else ""
        raise UserCodeError(f"{place} has no class {attribute}{there}")
    if not (isinstance(found, type) and issubclass(found, base)):
        raise UserCodeError(
            f"{place}:{attribute} is not a subclass of {base.__name__}; "
            f"derive it from {base.__module__}.{base.__name__}"
        )
    return found


def _module(place: str) -> ModuleType:
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        if place.endswith(".py"):
            return _from_file(Path(place))
        return importlib.import_module(place)
    except UserCodeError:
        raise
    except ModuleNotFoundError as error:
        if error.name is not None and (place == error.name or place.startswith(f"{error.name}.")):
            raise UserCodeError(f"there is no Python module {place} (looked in {here} and on Python's path)") from error
        raise UserCodeError(f"{place} cannot be imported: {describe_error(error)}") from error
    except MISTAKES as error:
        raise UserCodeError(f"{place} cannot be imported: {describe_error(error)}") from error


def _from_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise UserCodeError(f"there is no file {path}")
    folder = str(path.parent.resolve())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)
    spec.loader.exec_module(module)
    return module
