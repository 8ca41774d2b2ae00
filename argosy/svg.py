"""Small SVG pictures by hand: text, shapes, and frames with axes, ticks and units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

INK, FAINT, GRID, PAPER = "#24292f", "#6e7781", "#e7eaee", "#ffffff"
FONT = "ui-sans-serif, system-ui, 'Helvetica Neue', 'DejaVu Sans', sans-serif"


@dataclass
class Svg:
    """A picture that grows part by part."""

    width: float
    height: float
    title: str
    parts: list[str] = field(default_factory=list)

    def add(self, tag: str, /, **attributes: object) -> None:
        """Add an element; `stroke_width=2` becomes `stroke-width="2"`, numbers get two decimals."""
        self.parts.append(f"<{tag}{_written(attributes)}/>")

    def text(self, x: float, y: float, text: str, size: float = 12, fill: str = INK, **more: object) -> None:
        """Add a line of text."""
        attributes = {"x": x, "y": y, "font_size": size, "fill": fill, **more}
        self.parts.append(f"<text{_written(attributes)}>{escape(printable_xml(text))}</text>")

    def line(self, x1: float, y1: float, x2: float, y2: float, stroke: str = GRID, **more: object) -> None:
        """Add a straight line."""
        self.add("line", x1=x1, y1=y1, x2=x2, y2=y2, stroke=stroke, **more)

    def polyline(self, points: Sequence[tuple[float, float]], stroke: str, **more: object) -> None:
        """Add a line through points."""
        joined = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.add("polyline", points=joined, fill="none", stroke=stroke, stroke_linejoin="round", **more)

    def __str__(self) -> str:
        size = f'width="{self.width:g}" height="{self.height:g}" viewBox="0 0 {self.width:g} {self.height:g}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="{FONT}" role="img">'
        body = "\n".join(self.parts)
        return f"{head}\n<title>{escape(printable_xml(self.title))}</title>\n{body}\n</svg>\n"


@dataclass(frozen=True)
class Frame:
    """A rectangle of the picture that stands for ranges of two quantities; y grows upwards."""

    left: float
    top: float
    width: float
    height: float
    x_range: tuple[float, float]
    y_range: tuple[float, float]

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return where a pair of values stands in the picture."""
        (x0, x1), (y0, y1) = self.x_range, self.y_range
        across = (x - x0) / (x1 - x0) * self.width
        return self.left + across, self.top + self.height - (y - y0) / (y1 - y0) * self.height

    def draw_axes(self, svg: Svg, x_label: str, y_label: str) -> None:
        """Draw the frame's grid, ticks and labels."""
        bottom, right = self.top + self.height, self.left + self.width
        for value in ticks(*self.x_range, self.width / 90):
            x, _ = self.at(value, self.y_range[0])
            svg.line(x, self.top, x, bottom)
            svg.text(x, bottom + 17, number(value), 11, FAINT, text_anchor="middle")
        for value in ticks(*self.y_range, self.height / 55):
            _, y = self.at(self.x_range[0], value)
            svg.line(self.left, y, right, y)
            svg.text(self.left - 8, y + 4, number(value), 11, FAINT, text_anchor="end")
        svg.add("rect", x=self.left, y=self.top, width=self.width, height=self.height, fill="none", stroke="#c8ccd1")
        svg.text(right, bottom + 34, x_label, 11, FAINT, text_anchor="end")
        svg.text(self.left, self.top - 9, y_label, 11, FAINT)


def equal_frame(left: float, top: float, width: float, height: float, points: Sequence[tuple[float, float]]) -> Frame:
    """Return a frame around points whose two axes have the same scale; at least 20 units wide."""
    xs, ys = [x for x, _ in points], [y for _, y in points]
    middle = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    scale = max((max(xs) - min(xs)) / width, (max(ys) - min(ys)) / height, 20.0 / width) * 1.16
    half = width * scale / 2, height * scale / 2
    x_range = (middle[0] - half[0], middle[0] + half[0])
    return Frame(left, top, width, height, x_range, (middle[1] - half[1], middle[1] + half[1]))


def ticks(low: float, high: float, wanted: float) -> list[float]:
    """Return about `wanted` round values between two values."""
    raw = (high - low) / max(2.0, wanted)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [index * step for index in range(first, math.floor(high / step + 1e-9) + 1)]


def number(value: float) -> str:
    """Return a tick's label."""
    return f"{round(value, 6):g}".replace("-", "−")


def printable_xml(text: str) -> str:
    """Return text without what XML cannot hold."""
    return "".join(char if char.isprintable() else " " for char in text)


def _written(attributes: Mapping[str, object]) -> str:
    return "".join(f' {name.replace("_", "-")}="{_value(value)}"' for name, value in attributes.items())


def _value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.2f}".rstrip("0").rstrip(".")
    return escape(str(value), {'"': "&quot;"})
