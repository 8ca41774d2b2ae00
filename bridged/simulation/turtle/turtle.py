"""A simulated turtle like turtlesim's of ROS: a velocity command holds for a second; the field has walls. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

FIELD = 500 / 45
"""Side of the square field in metres: turtlesim's window of 500 pixels, 45 to the metre."""
STEP = 0.016
"""Seconds between two steps, and two poses: 62.5 Hz."""
HELD = 1.0
"""Seconds for which a command of velocity holds."""
MAX_STROKES = 10_000
"""Strokes of the pen that are kept; beyond that the oldest is dropped."""
STRAIGHT = 1e-9
"""Strokes that differ in direction by no more than this (as a cross product, m2) are one."""


@dataclass(frozen=True)
class Pen:
    """The turtle's pen."""

    r: int = 179
    g: int = 184
    b: int = 255
    width: int = 3
    """Pixels, 45 to the metre; a pen of 0 draws the thinnest line there is, of one pixel."""
    off: bool = False


@dataclass
class Stroke:
    """A straight line that was drawn, in metres."""

    pen: Pen
    start: tuple[float, float]
    end: tuple[float, float]


@dataclass
class Turtle:
    """The turtle and its field; x and y in metres from the lower left corner, theta in radians from the x axis."""

    x: float = FIELD / 2
    y: float = FIELD / 2
    theta: float = 0.0
    linear: tuple[float, float] = (0.0, 0.0)
    """Metres per second ahead and to the left, while the command holds."""
    angular: float = 0.0
    """Radians per second to the left."""
    pen: Pen = Pen()
    strokes: list[Stroke] = field(default_factory=list)
    _left: float = 0.0
    """Seconds for which the command still holds."""

    def command(self, ahead: float, left: float, angular: float) -> None:
        """Move `ahead` and `left` (m/s), and turn (`angular`, rad/s, left is positive), for `HELD` seconds."""
        self.linear, self.angular, self._left = (ahead, left), angular, HELD

    def step(self) -> None:
        """Let `STEP` seconds pass."""
        if self._left <= STEP / 2:
            self.linear, self.angular = (0.0, 0.0), 0.0
            return
        self._left -= STEP
        ahead, left = self.linear
        self.theta = math.remainder(self.theta + self.angular * STEP, math.tau)
        x = self.x + (math.cos(self.theta) * ahead - math.sin(self.theta) * left) * STEP
        y = self.y + (math.sin(self.theta) * ahead + math.cos(self.theta) * left) * STEP
        self._move(x, y)

    def pose(self) -> dict[str, float]:
        """Return the fields of turtlesim's Pose."""
        return {
            "x": self.x,
            "y": self.y,
            "theta": self.theta,
            "linear_velocity": math.hypot(*self.linear),
            "angular_velocity": self.angular,
        }

    def teleport(self, x: float, y: float, theta: float) -> None:
        """Move to `x` and `y` (metres), draw the way, and turn to `theta` (radians).

        Raises ValueError outside the field.
        """
        for name, value in (("x", x), ("y", y)):
            if not 0 <= value <= FIELD:
                raise ValueError(f"{name}: {value:g} is outside the field, 0..{FIELD:.2f}")
        self._move(x, y)
        self.theta = math.remainder(theta, math.tau)

    def teleport_by(self, linear: float, angular: float) -> None:
        """Turn by `angular` (radians), then move `linear` metres ahead.

        Raises ValueError for a place outside the field.
        """
        theta = self.theta + angular
        self.teleport(self.x + math.cos(theta) * linear, self.y + math.sin(theta) * linear, theta)

    def clear(self) -> None:
        """Clear the drawing."""
        self.strokes.clear()

    def reset(self) -> None:
        """Clear the drawing, and stop in the middle of the field."""
        self.strokes.clear()
        self.x = self.y = FIELD / 2
        self.theta, self.pen = 0.0, Pen()
        self.linear, self.angular, self._left = (0.0, 0.0), 0.0, 0.0

    def _move(self, x: float, y: float) -> None:
        inside = min(max(x, 0.0), FIELD), min(max(y, 0.0), FIELD)
        start, (self.x, self.y) = (self.x, self.y), inside
        if start != inside and not self.pen.off:
            self._draw(start, inside)

    def _draw(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        last = self.strokes[-1] if self.strokes else None
        if last is not None and last.pen is self.pen and last.end == start:
            (x0, y0), (x1, y1), (x2, y2) = last.start, start, end
            ahead = (x1 - x0) * (x2 - x1) + (y1 - y0) * (y2 - y1)
            if ahead > 0 and abs((x1 - x0) * (y2 - y1) - (y1 - y0) * (x2 - x1)) < STRAIGHT:
                last.end = end
                return
        if len(self.strokes) >= MAX_STROKES:
            del self.strokes[0]
        self.strokes.append(Stroke(self.pen, start, end))


def svg(turtle: Turtle) -> str:
    """Return the drawing and the turtle's pose as SVG."""
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {FIELD:.3f} {FIELD:.3f}" width="500" height="500">',
        f'<rect width="{FIELD:.3f}" height="{FIELD:.3f}" fill="#4556ff"/>',
    ]
    for stroke in turtle.strokes:
        (x0, y0), (x1, y1), pen = stroke.start, stroke.end, stroke.pen
        lines.append(
            f'<line x1="{x0:.3f}" y1="{FIELD - y0:.3f}" x2="{x1:.3f}" y2="{FIELD - y1:.3f}" stroke-linecap="round" '
            f'stroke="rgb({pen.r},{pen.g},{pen.b})" stroke-width="{max(pen.width, 1) / 45:.3f}"/>'
        )
    at = f"translate({turtle.x:.3f} {FIELD - turtle.y:.3f}) rotate({-math.degrees(turtle.theta):.1f})"
    lines.append(f'<path d="M0.3,0 L-0.2,0.2 L-0.2,-0.2 Z" fill="#fff" transform="{at}"/>')
    return "\n".join([*lines, "</svg>", ""])
