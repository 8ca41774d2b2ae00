"""The manifest that a robot runs by, and how it changes while the robot works: checked first, and as a whole.

Pure: changes go in, the manifest in effect comes out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from bridged.drivers.registry import check_manifest
from schemas.files.findings import Finding, Findings
from schemas.manifest.document import changed, document
from schemas.manifest.loader import Manifest, read_document
from schemas.wire.records import LiveManifest, ManifestChange

RESTART = "cannot change while the bridge runs: change the file and restart it"
MIXED = "a change was refused and the manifest before it was not taken back, restart the bridge"
MAY_CHANGE = frozenset({"link_loss"})
"""Fields of `[robot]` that may; all others say which robot it is."""


class RunningManifest:
    """The manifest of one bridge."""

    def __init__(
        self,
        manifest: Manifest,
        adopt: Callable[[Manifest], None],
        objections: Callable[[Manifest], Iterable[Finding]] = lambda manifest: (),
    ) -> None:
        """`adopt` puts a manifest into effect; it may raise Findings, ValueError or OSError.

        `objections` says what the mission needs of the robot and a manifest takes away.
        """
        self.manifest = manifest
        self.version = 1
        self.mixed = ""
        """Why the drivers may work by parts of two manifests, for people; empty = they work by this one."""
        self._adopt, self._objections = adopt, objections
        self._drivers = manifest.drivers()
        self._files = " and ".join(file for file in (manifest.file, manifest.percepts_file) if file)

    def told(self, robot: str, problems: Iterable[str] = ()) -> LiveManifest:
        """Return the manifest for the bus."""
        return LiveManifest(
            robot=robot,
            version=self.version,
            file=self._files,
            manifest=document(self.manifest),
            problems=tuple(problems),
        )

    def change(self, change: ManifestChange) -> list[str]:
        """Put a change into effect, as a whole or not at all. Returns everything that is wrong with it."""
        if change.version not in (None, self.version):
            return [f"the manifest is at version {self.version}, the change is for version {change.version}"]
        made, problems = changed(document(self.manifest), change)
        try:
            manifest = read_document(made, "", check=check_manifest)
        except Findings as found:
            return problems + _messages(found.findings)
        problems += [
            *self._fixed(manifest),
            *_messages(check_manifest(manifest)),
            *_messages(self._objections(manifest)),
        ]
        if problems:
            return problems
        if problems := self._put_into_effect(manifest):
            kept = self._put_into_effect(self.manifest)
            self.mixed = f"{MIXED}: {'; '.join(kept)}" if kept else ""
            return [*problems, *filter(None, [self.mixed])]
        self.manifest, self.mixed = manifest, ""
        self.version += 1
        return []

    def _put_into_effect(self, manifest: Manifest) -> list[str]:
        """Return why the drivers do not work by a manifest, empty if they do."""
        try:
            self._adopt(manifest)
        except (Findings, ValueError, OSError) as error:
            return _messages(error.findings) if isinstance(error, Findings) else [str(error)]
        return []

    def _fixed(self, manifest: Manifest) -> Iterable[str]:
        """Yield what would make it another robot, or need a driver that does not run."""
        old, new = self.manifest.robot, manifest.robot
        for field in old.__struct_fields__:
            if field not in MAY_CHANGE and getattr(old, field) != getattr(new, field):
                yield f"robot.{field}: {RESTART}"
        tables: dict[str, Any] = {"percepts": manifest.percepts, "actions": manifest.actions}
        for table, entries in tables.items():
            for name, entry in entries.items():
                if entry.driver and entry.driver not in self._drivers:
                    there = f"`{entry.driver}` does not run for this robot, {', '.join(self._drivers)} does"
                    yield f"{table}.{name}.driver: {there}; {RESTART}"


def _messages(findings: Iterable[Finding]) -> list[str]:
    return [finding.message for finding in findings]
