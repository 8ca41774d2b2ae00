"""The present percept set of an agent, kept at both ends of the bus.

The bridge has one per agent and publishes its digest with its health; the agent keeps a copy from what it receives, and
fetches the whole set again when `needs_repair`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from itertools import accumulate

import msgspec
from msgspec.structs import replace

from schemas.wire.records import Perception

Family = tuple[str, int]
"""Name and number of parameters; `replace` and `remove` without a key concern the whole family."""

_ENCODE = msgspec.msgpack.Encoder().encode
_DIGITS = 20
"""Digits of a seq at most."""
MOST_BYTES = 16 * 2**20
"""Bytes of a set, with `_EACH` for each belief: some 10,000 of them. A bridge of ours has a tenth."""
_EACH = 1_600


class PerceptSet:
    """Beliefs by name and arity, in order of arrival, of one process (`boot`) of one publisher."""

    def __init__(self) -> None:
        self.boot = ""
        """The publisher's process to which the seqs belong."""
        self.seq = 0
        """Seq of the last applied perception."""
        self.missed = 0
        """Number of skipped seqs: lost perceptions."""
        self.left_out = 0
        """Number of beliefs for which there was no room: the set is not the publisher's then."""
        self._bytes = 0
        self._families: dict[Family, dict[bytes, Perception]] = {}
        self.in_doubt = False
        """Whether the whole set must be fetched, whatever its bridge reports: after a gap."""
        self._digest = ""
        self._reported: int | None = None
        """The seq that the bridge reported when it was behind ours, so that ours is not the bridge's."""

    def __len__(self) -> int:
        return sum(map(len, self._families.values()))

    def apply(self, perception: Perception) -> bool:
        """Apply one perception. Returns False for an old one, and one for which there is no room: nothing changes."""
        boot, seq, identity = perception.header.boot, perception.header.seq, _identity(perception)
        if boot != self.boot:
            self.in_doubt = self.in_doubt or len(self) > 0
            self.boot, self.seq = boot, 0
        if seq <= self.seq:
            return False
        if seq > self.seq + 1:
            self.missed += seq - self.seq - 1
            self.in_doubt = True
        self.seq = seq
        if not self._has_room(perception, identity):
            self.left_out += 1
            return False
        self._alter(perception, identity)
        return True

    def _has_room(self, perception: Perception, identity: bytes) -> bool:
        """Return whether the set stays below `MOST_BYTES` with a perception."""
        more = self._bytes + len(identity) + _EACH - MOST_BYTES
        if more <= 0 or perception.update == "remove":
            return True
        beliefs = self._families.get((perception.name, len(perception.parameters)), {})
        if perception.update == "add":
            return identity in beliefs
        return sum(len(known) + _EACH for known in self._concerned(perception, identity, beliefs)) >= more

    def alter(self, perception: Perception) -> list[Perception]:
        """Apply a perception without a stream. Returns the changes, removals first."""
        identity = _identity(perception)
        gone, come = self._alter(perception, identity)
        changes = [_removal(one) for at, one in gone.items() if at != identity or perception.update == "remove"]
        return [*changes, replace(perception, update="add", key=())] if come else changes

    def concerned(self, perception: Perception) -> list[Perception]:
        """Return the beliefs that a `replace` or `remove` concerns."""
        beliefs = self._families.get((perception.name, len(perception.parameters)), {})
        return [beliefs[at] for at in self._concerned(perception, _identity(perception), beliefs)]

    def names(self) -> list[str]:
        """Return the families such as `altitude/1`, sorted."""
        return [f"{name}/{arity}" for name, arity in sorted(self._families)]

    def arities(self, name: str) -> list[int]:
        """Return the arities of the beliefs of a name."""
        return [arity for known, arity in self._families if known == name]

    def _alter(self, perception: Perception, identity: bytes) -> tuple[dict[bytes, Perception], bool]:
        """Apply a perception. Returns the beliefs that it concerned, and whether its own was not there before."""
        family = (perception.name, len(perception.parameters))
        beliefs = self._families.setdefault(family, {})
        gone: dict[bytes, Perception] = {}
        if perception.update != "add":
            for known in self._concerned(perception, identity, beliefs):
                gone[known] = beliefs.pop(known)
                self._bytes -= len(known) + _EACH
        self._digest = ""
        if perception.update == "remove":
            if not beliefs:
                del self._families[family]
            return gone, False
        if new := identity not in beliefs:
            self._bytes += len(identity) + _EACH
        beliefs[identity] = perception
        return gone, new and identity not in gone

    def _concerned(self, change: Perception, identity: bytes, beliefs: dict[bytes, Perception]) -> list[bytes]:
        if not change.key:
            return list(beliefs)
        if change.key == tuple(range(len(change.parameters))):
            return [identity] if identity in beliefs else []
        return [at for at, belief in beliefs.items() if _concerns(change, belief)]

    def present(self) -> list[Perception]:
        """Return the present beliefs as perceptions, in the order of names and arrival."""
        return [belief for family in sorted(self._families) for belief in self._families[family].values()]

    def named(self, name: str) -> list[Perception]:
        """Return the present beliefs of a name, by arity in the order of arrival."""
        families = (family for (of, _), family in self._families.items() if of == name)
        return [belief for family in families for belief in family.values()]

    def family(self, name: str, arity: int) -> list[Perception]:
        """Return the present beliefs of a family."""
        return list(self._families.get((name, arity), {}).values())

    def holds(self, belief: Perception) -> bool:
        """Whether a belief is present."""
        return _identity(belief) in self._families.get((belief.name, len(belief.parameters)), {})

    def snapshot(self) -> list[Perception]:
        """Return `present`, each with the set's seq: the bridge's reply to a repair query."""
        return [replace(one, header=replace(one.header, seq=self.seq)) for one in self.present()]

    def digest(self) -> str:
        """Return `BOOT:SEQ:HASH`; sets with equal beliefs have equal hashes, whatever their history."""
        if not self._digest:
            total = 0
            for beliefs in self._families.values():
                for identity in beliefs:
                    total += int.from_bytes(hashlib.blake2b(identity, digest_size=8).digest())
            self._digest = f"{self.boot}:{self.seq}:{total % 2**64:016x}"
        return self._digest

    def needs_repair(self, reported: str = "") -> bool:
        """Whether the whole set must be fetched: after a gap, or when the bridge's digest differs.

        `reported` is the digest in the bridge's health, which follows its percepts. If its seq is behind ours, somebody
        else has published in the bridge's name.
        """
        at = place_of(reported)
        if at is not None and at[0] == self.boot and at[1] < self.seq:
            self._reported = at[1]
            return True
        if self.in_doubt or at is None:
            return self.in_doubt
        full = self.left_out and self._bytes > MOST_BYTES // 2
        return not full and reported.rpartition(":")[2] != self.digest().rpartition(":")[2]

    def restore(self, snapshot: Iterable[Perception], asked_at: int | None = None) -> list[Perception] | None:
        """Become the reply to a repair query that was asked at our seq `asked_at` (now by default).

        Returns the differences, removals first. Returns None, and changes nothing, if a newer perception came
        meanwhile: ask again. A reply older than our seq at the query is taken: ours was not the bridge's.
        """
        whole = list(snapshot)
        present = [one for one, size in zip(whole, accumulate(map(_size, whole)), strict=True) if size <= MOST_BYTES]
        boot = present[0].header.boot if present else self.boot
        seq = max((one.header.seq for one in present), default=self.seq if self._reported is None else self._reported)
        was_ahead = asked_at is not None and seq < asked_at <= self.seq
        meanwhile = self.seq > seq and not was_ahead
        if any(one.header.boot != boot for one in present) or (boot == self.boot and meanwhile):
            return None
        self._reported = None
        changes = differences(self.present(), present)
        self._families.clear()
        for one in present:
            self._families.setdefault((one.name, len(one.parameters)), {})[_identity(one)] = one
        self.boot, self.seq, self.in_doubt, self._digest = boot, seq, False, ""
        self.left_out, self._bytes = len(whole) - len(present), sum(map(_size, present))
        return changes

    def clear(self) -> list[Perception]:
        """Remove everything, as the bridge is gone. Returns the removals."""
        gone = [_removal(one) for one in self.present()]
        self._families.clear()
        self.boot, self.seq, self.in_doubt, self._digest, self._reported = "", 0, False, "", None
        self.left_out = self._bytes = 0
        return gone


def differences(before: Iterable[Perception], after: Iterable[Perception]) -> list[Perception]:
    """Return the perceptions that turn some beliefs into others, removals first."""
    old = {_identity(one): one for one in before}
    new = {_identity(one): one for one in after}
    gone = [_removal(one) for at, one in old.items() if at not in new]
    return gone + [replace(one, update="add") for at, one in new.items() if at not in old]


def place_of(digest: str) -> tuple[str, int] | None:
    """Return the boot and the seq of a digest; None if it is not readable."""
    boot, _, seq = digest.rpartition(":")[0].rpartition(":")
    return (boot, int(seq)) if seq.isascii() and seq.isdigit() and len(seq) <= _DIGITS else None


def tells_of_none(digest: str) -> bool:
    """Whether a digest is that of an empty set."""
    return digest.rpartition(":")[2] == "0" * 16


def key_problem(perception: Perception) -> str:
    """Return why the key of a percept names none of its parameters, or one twice; empty if it names each once."""
    key, size = perception.key, len(perception.parameters)
    if not key or (min(key) >= 0 and max(key) < size and len(set(key)) == len(key)):
        return ""
    return f"`key` holds different positions from 0 to below {size}, got {list(key)}"


def _concerns(change: Perception, belief: Perception) -> bool:
    """Whether a `replace` or `remove` concerns a belief of its family."""
    return all(_ENCODE(belief.parameters[place]) == _ENCODE(change.parameters[place]) for place in change.key)


def _identity(perception: Perception) -> bytes:
    """Return the belief without header, update and key, encoded."""
    return _ENCODE((perception.name, perception.parameters))


def _size(perception: Perception) -> int:
    """Return the bytes that a belief takes of `MOST_BYTES`."""
    return len(_identity(perception)) + _EACH


def _removal(belief: Perception) -> Perception:
    return replace(belief, update="remove", key=tuple(range(len(belief.parameters))))
