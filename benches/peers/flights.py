"""Draws the figures of `make flights` that lie in a folder, as SVG beside them, and compares them in flights.md.

    flights.py FOLDER
"""

import csv
import math
import pathlib
import sys

from svg import Axis, Chart, Style, nice_log

CUTS = {
    "geometric": ("geometric", "circle", ""),
    "sampling": ("sampling", "square", "7 3"),
    "uniform": ("one level", "up", "2 3"),
}
"""Label, marker and dash."""
BUDGETS = {
    "500": ("0.5 ms a frame", Style("circle", "", True)),
    "1000": ("1 ms a frame", Style("square", "7 3", True)),
    "4000": ("4 ms a frame", Style("up", "2 3", True)),
    "unlimited": ("without a limit", Style("diamond", "", False)),
}
FLIGHTS = {
    "mixed": "over flat and steep land",
    "low": "low along steep land",
    "overview": "circling high above",
}
ERRORS = 0.01, 64
"""Ends of the axis of errors in pixels; what is beyond is left out, but that less than 10^-6 is a rounding error, and stands at 0."""
TICKS = [m * 10**d for d in range(-3, 9) for m in (1, 2, 5)]


def read(path):
    """Rows by column name, numbers as floats."""

    def value(text):
        try:
            return float(text)
        except ValueError:
            return text

    with open(path, newline="") as file:
        return [{key: value(text) for key, text in row.items()} for row in csv.DictReader(file)]


def log_axis(label, values):
    low, high = nice_log(values)
    return Axis(label, low, high, True, ticks=[mark for mark in TICKS if low <= mark <= high])


def flight(path, name, terrain):
    """Triangles against error: one curve a cut of the 99.9th percentile, and a thin one of the largest."""
    rows = read(path)
    low, high = ERRORS
    curves = []
    for cut, (label, marker, dash) in CUTS.items():
        for column, ending, bold in (("error_p999", ", 99.9 %", True), ("error_max", ", largest", False)):
            points = [(row[column] if row[column] >= 1e-6 else 0.0, row["triangles"] / 1000) for row in rows if row["cut"] == cut]
            points = [point for point in points if point[0] == 0 or low <= point[0] <= high]
            if points:
                curves.append((points, label + ending, Style(marker, dash, bold)))
    x = Axis("error on the screen, pixels", low, high, True, True)
    x.ticks = [0, 0.01, 0.1, 0.5, 1, 2, 4, 10, 50]
    y = log_axis("thousand triangles a frame, mean", [triangles for points, _, _ in curves for _, triangles in points])
    title = f"Triangles against error: {terrain}, {FLIGHTS[name]}"
    subtitle = "measured at 1280 x 1024 pixels; thick: what 99.9 % of the screen are within; both axes logarithmic; better: down and to the left"
    chart = Chart(title, subtitle, x, y, 160)
    for points, label, style in curves:
        chart.curve(points, label, style)
    path.with_suffix(".svg").write_text(chart.render())


def triangles_at(rows, column, error):
    """Triangles of a rule at an error, between the two settings around it, in logarithms; None beyond its settings."""
    for a, b in zip(rows, rows[1:]):
        low, high = a[column], b[column]
        if 1e-6 < low <= error <= high and low < high:
            share = math.log(error / low) / math.log(high / low)
            return math.exp((1 - share) * math.log(a["triangles"]) + share * math.log(b["triangles"]))
    return None


def comparison(path, name, terrain):
    """The geometric metric as a table in Markdown: what it keeps of its tolerances, and its triangles against the other rules'."""
    rows = read(path)
    lines = [
        f"\n## {terrain}, {FLIGHTS[name]}\n",
        "| tolerance | largest error | kept | 99.9 % | triangles | / sampling, equal 99.9 % | equal largest | / one level, equal 99.9 % | equal largest |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    others = [[row for row in rows if row["cut"] == "sampling"], [row for row in rows if row["cut"] == "uniform"][::-1]]
    for row in rows:
        if row["cut"] != "geometric":
            continue
        ratios = []
        for other in others:
            for column in ("error_p999", "error_max"):
                triangles = triangles_at(other, column, row[column])
                ratios.append(f"{row['triangles'] / triangles:.2f}" if triangles else "")
        kept = "cut short" if row["cut_short"] else "yes" if row["error_max"] <= row["setting"] else "no"
        figures = [f"{row['setting']:g}", f"{row['error_max']:.4f}", kept, f"{row['error_p999']:.4f}", f"{row['triangles']:.0f}"]
        lines.append("| " + " | ".join(figures + ratios) + " |")
    return "\n".join(lines) + "\n"


def recovery(path):
    """Time to full quality by budget, as a line in Markdown."""
    rows = read(path)
    last = {str(row["budget"]).removesuffix(".0"): row for row in reversed(rows) if row["refined"] == rows[-1]["refined"]}
    times = [f"{BUDGETS[budget][0]}: {row['milliseconds']:.0f} ms, in frame {row['frame']:.0f}" for budget, row in last.items()]
    return "\nFull quality after the jump: " + "; ".join(reversed(times)) + ".\n"


def frame(path, terrain):
    """Time of an update against the patches that it draws."""
    rows = read(path)
    patches = [row["patches"] for row in rows]
    columns = {
        "update_p99": ("whole, 99 %", Style("down", "9 3 2 3", False)),
        "update_p50": ("whole, median", Style("circle", "", True)),
        "fixed_p50": ("fixed, median", Style("square", "7 3", True)),
    }
    times = [row[column] for row in rows for column in columns]
    asked = [(100, 100), (1000, 1000)]
    x = log_axis("patches drawn", patches + [100, 1000])
    y = log_axis("microseconds", times + [100, 1000])
    subtitle = "a slow flight around the terrain; fixed: judging and listing what is there; one core; lower is better"
    chart = Chart(f"Time of an update: {terrain}", subtitle, x, y, 160)
    for column, (label, style) in columns.items():
        chart.curve([(row["patches"], row[column]) for row in rows], label, style)
    chart.curve(asked, "asked", Style("cross", "1 4", False))
    path.with_suffix(".svg").write_text(chart.render())


def jump(path, terrain):
    """What is left, and what was refined, against the time since a jump: two charts."""
    rows = read(path)
    for row in rows:
        row["budget"] = row["budget"] if isinstance(row["budget"], str) else f"{row['budget']:.0f}"
    rows = [row for row in rows if row["largest_error"] < math.inf]
    errors = log_axis("", [row["largest_error"] for row in rows if row["largest_error"] > 0])
    if any(row["largest_error"] == 0 for row in rows):
        errors.zero, errors.ticks = True, [0, *errors.ticks]
    x = Axis("milliseconds since the jump, at 60 frames a second", 0, 1.02 * max(row["milliseconds"] for row in rows))
    charts = {
        "error": ("largest_error", "What is left", "largest projected error, pixels", errors),
        "refined": ("refined", "What is refined", "diamonds refined", Axis("", 0, 1.05 * max(row["refined"] for row in rows))),
    }
    for ending, (column, title, label, y) in charts.items():
        y.label = label
        subtitle = "from an overview to the ground, tolerance of 1 pixel; one curve for each budget of time for an update"
        chart = Chart(f"{title} after a jump: {terrain}", subtitle, x, y, 160)
        for budget, (label, style) in BUDGETS.items():
            points = [(row["milliseconds"], row[column]) for row in rows if row["budget"] == budget]
            chart.curve(points, label, style, max(1, round(len(points) / 12)))
        path.with_name(f"{path.stem}_{ending}.svg").write_text(chart.render())


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    pages = {}
    for path in sorted(folder.glob("*.csv")):
        kind, _, terrain = path.stem.partition("_")
        if kind == "flight":
            name, _, terrain = terrain.partition("_")
            flight(path, name, terrain)
            pages.setdefault(terrain, []).append(comparison(path, name, terrain))
        elif kind == "frame":
            frame(path, terrain)
        elif kind == "jump":
            jump(path, terrain)
            pages.setdefault(terrain, []).append(recovery(path))
    text = "# Flights\n\nWritten by `make flights`: the geometric metric in figures. Ratios of triangles are at equal measured errors, interpolated.\n"
    (folder / "flights.md").write_text(text + "".join(part for parts in pages.values() for part in parts))


if __name__ == "__main__":
    main()
