"""A small writer of charts as SVG: readable in black and white, the same bytes for the same data."""

import math
from dataclasses import dataclass, field
from xml.sax.saxutils import escape

WIDTH, HEIGHT = 860, 560
LEFT, TOP, BOTTOM = 66, 62, 56
LINE_HEIGHT = 15
CHARACTER_WIDTH = 7.2
TEXT = 'font-family="Helvetica,Arial,sans-serif" font-size="12"'


@dataclass
class Style:
    """How one codec looks in every chart."""

    marker: str
    """One of MARKERS."""
    dash: str
    """Of stroke-dasharray; empty for a full line."""
    bold: bool
    """Thick, black and filled; else thin, grey and hollow."""


@dataclass
class Axis:
    label: str
    low: float
    high: float
    log: bool = False
    zero: bool = False
    """Logarithmic, with a place for 0 before `low`."""
    ticks: list = field(default_factory=list)

    def place(self, value):
        """0 at the axis' beginning, 1 at its end."""
        if not self.log:
            return (value - self.low) / (self.high - self.low)
        reserved = 0.1 if self.zero else 0.0
        if value <= 0:
            return 0.0
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return reserved + (1 - reserved) * share

    def marks(self):
        if self.ticks:
            return self.ticks
        if self.log:
            decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
            few = self.high / self.low > 300
            marks = [m * 10.0**d for d in decades for m in ((1,) if few else (1, 2, 5))]
            marks = [m for m in marks if self.low * 0.999 <= m <= self.high * 1.001]
            return ([0.0] if self.zero else []) + marks
        step = 10.0 ** math.floor(math.log10((self.high - self.low) / 4))
        step = next(step * m for m in (1, 2, 5, 10) if (self.high - self.low) / (step * m) <= 8)
        first = math.ceil(self.low / step - 1e-9)
        return [i * step for i in range(first, math.floor(self.high / step + 1e-9) + 1)]


def nice_log(values):
    """Ends of a logarithmic axis a little beyond the values."""
    return min(values) / 1.15, max(values) * 1.15


def number(value):
    return f"{value:.1f}".removesuffix(".0")


def polygon(points):
    return '<polygon points="' + " ".join(f"{number(x)},{number(y)}" for x, y in points) + '"/>'


def around(x, y, radius, count, turn, inner=1.0):
    """Corners on a circle; with `inner` below 1 every other one lies within: a star."""
    corners = []
    for i in range(count):
        angle = turn + 2 * math.pi * i / count
        r = radius * (inner if i % 2 else 1.0)
        corners.append((x + r * math.sin(angle), y - r * math.cos(angle)))
    return corners


MARKERS = {
    "circle": lambda x, y: f'<circle cx="{number(x)}" cy="{number(y)}" r="4"/>',
    "square": lambda x, y: polygon(around(x, y, 5, 4, math.pi / 4)),
    "diamond": lambda x, y: polygon(around(x, y, 5.5, 4, 0)),
    "up": lambda x, y: polygon(around(x, y, 5.5, 3, 0)),
    "down": lambda x, y: polygon(around(x, y, 5.5, 3, math.pi)),
    "right": lambda x, y: polygon(around(x, y, 5.5, 3, math.pi / 2)),
    "left": lambda x, y: polygon(around(x, y, 5.5, 3, -math.pi / 2)),
    "star": lambda x, y: polygon(around(x, y, 6.5, 10, 0, 0.45)),
    "four": lambda x, y: polygon(around(x, y, 6.5, 8, 0, 0.4)),
    "cross": lambda x, y: polygon(around(x, y, 6.5, 8, math.pi / 4, 0.3)),
    "hexagon": lambda x, y: polygon(around(x, y, 5, 6, 0)),
}


class Chart:
    """Curves and points over two axes, labelled directly."""

    def __init__(self, title, subtitle, x, y, labels=205):
        """`labels`: room to the right, for the curves' labels."""
        self.x, self.y, self.right = x, y, WIDTH - labels
        self.body, self.ends, self.points = [], [], []
        self.head = (title, subtitle)

    def at(self, x, y):
        across = LEFT + self.x.place(x) * (self.right - LEFT)
        return across, HEIGHT - BOTTOM - self.y.place(y) * (HEIGHT - TOP - BOTTOM)

    def marker(self, place, style):
        colour = "#000" if style.bold else "#555"
        fill = colour if style.bold else "#fff"
        self.body.append(f'<g stroke="{colour}" fill="{fill}">{MARKERS[style.marker](*place)}</g>')

    def curve(self, points, label, style, every=1):
        """`points` (x, y) in order, a marker at the first of `every` so many; the label stands to the right of the last."""
        places = [self.at(x, y) for x, y in points]
        dash = f' stroke-dasharray="{style.dash}"' if style.dash else ""
        look = 'stroke="#000" stroke-width="2.2"' if style.bold else 'stroke="#555" stroke-width="1.2"'
        line = " ".join(f"{number(x)},{number(y)}" for x, y in places)
        self.body.append(f'<polyline points="{line}" fill="none" {look}{dash}/>')
        for place in places[::every]:
            self.marker(place, style)
        self.ends.append((*places[-1], label, style))

    def point(self, x, y, label, style):
        """A point with its label beside it."""
        place = self.at(x, y)
        self.marker(place, style)
        self.points.append((*place, label, style))

    def render(self):
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}"'
            f' viewBox="0 0 {WIDTH} {HEIGHT}" {TEXT}>',
            f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#fff"/>',
            text(LEFT, 24, self.head[0], 'font-size="15" font-weight="bold"'),
            text(LEFT, 43, self.head[1], 'fill="#444"'),
            *self._axes(),
            *self.body,
            *self._end_labels(),
            *self._point_labels(),
            "</svg>",
        ]
        return "\n".join(parts) + "\n"

    def _axes(self):
        right, bottom = self.right, HEIGHT - BOTTOM
        for mark in self.x.marks():
            across = number(LEFT + self.x.place(mark) * (right - LEFT))
            yield f'<path d="M{across} {TOP}V{bottom}" stroke="#ddd"/>'
            yield text(across, bottom + 18, f"{mark:g}", 'text-anchor="middle"')
        for mark in self.y.marks():
            down = bottom - self.y.place(mark) * (bottom - TOP)
            yield f'<path d="M{LEFT} {number(down)}H{right}" stroke="#ddd"/>'
            yield text(LEFT - 8, number(down + 4), f"{mark:g}", 'text-anchor="end"')
        yield f'<path d="M{LEFT} {TOP}V{bottom}H{right}" stroke="#000" fill="none"/>'
        middle = (TOP + bottom) / 2
        yield text((LEFT + right) / 2, HEIGHT - 14, self.x.label, 'text-anchor="middle"')
        turned = f'text-anchor="middle" transform="rotate(-90 18 {number(middle)})"'
        yield text(18, number(middle), self.y.label, turned)

    def _end_labels(self):
        """In a column to the right, in the order of the ends, moved apart, each with a thin line to its end."""
        ends = sorted(self.ends, key=lambda end: end[1])
        heights = spread([end[1] for end in ends], LINE_HEIGHT, TOP - 6, HEIGHT - BOTTOM + 6)
        column = self.right + 24
        for (x, y, label, style), down in zip(ends, heights):
            line = f"M{number(x + 7)} {number(y)}L{column - 4} {number(down)}"
            yield f'<path d="{line}" stroke="#aaa" stroke-width="0.7" fill="none"/>'
            yield text(column, number(down + 4), label, weight(style))

    def _point_labels(self):
        """Beside the points, where they overlap neither a marker nor another label."""
        taken = [(x - 6, y - 6, x + 6, y + 6) for x, y, _, _ in self.points]
        for x, y, label, style in sorted(self.points, key=lambda point: not point[3].bold):
            width = CHARACTER_WIDTH * len(label) * (1.14 if style.bold else 1)
            box = next(
                (box for box in label_boxes(x, y, width) if inside(box) and not any(overlap(box, t) for t in taken)),
                label_boxes(x, y, width)[0],
            )
            taken.append(box)
            near = min(max(x, box[0]), box[2]), min(max(y, box[1]), box[3])
            if math.dist(near, (x, y)) > 14:
                line = f"M{number(x)} {number(y)}L{number(near[0])} {number(near[1])}"
                yield f'<path d="{line}" stroke="#aaa" stroke-width="0.7"/>'
            yield text(number(box[0]), number(box[3] - 3), label, weight(style))


def weight(style):
    return 'font-weight="bold"' if style.bold else ""


def text(x, y, content, attributes=""):
    return f'<text x="{x}" y="{y}" {attributes}>{escape(content)}</text>'.replace(" >", ">")


def spread(wanted, gap, low, high):
    """Ascending places at least `gap` apart, near the wanted ascending ones, within low and high where they fit."""
    places = []
    for place in wanted:
        places.append(max(place, places[-1] + gap if places else low))
    limit = high
    for i in range(len(places) - 1, -1, -1):
        places[i] = min(places[i], limit)
        limit = places[i] - gap
    # Halfway back up, so that a crowd lies around its middle.
    for i, place in enumerate(wanted):
        floor = places[i - 1] + gap if i else low
        drift = (places[i] - place) / 2
        places[i] = max(floor, places[i] - max(drift, 0.0))
    return places


def label_boxes(x, y, width):
    """Places for a label, best first, as left, top, right, bottom."""
    boxes = []
    for distance in (9, 20, 32, 46, 62):
        for turn in (0, -0.4, 0.4, -0.9, 0.9, math.pi, math.pi - 0.5, math.pi + 0.5, -1.5, 1.5):
            across, down = x + distance * math.cos(turn), y + distance * math.sin(turn)
            left = across if math.cos(turn) > 0.1 else across - width if math.cos(turn) < -0.1 else across - width / 2
            boxes.append((left, down - 7, left + width, down + 7))
    return boxes


def inside(box):
    return box[0] > LEFT and box[2] < WIDTH - 4 and box[1] > TOP - 14 and box[3] < HEIGHT - BOTTOM


def overlap(a, b):
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
