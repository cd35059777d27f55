"""The charts, each from rows of measurements, with the plotted data as CSV beside it."""

import math

import summary
from chart_measures import CELLS, PLAIN, write
from svg import Axis, Chart, Style, nice_log

STYLES = {
    "interpolating+rans": Style("circle", "", True),
    "interpolating+gamma": Style("square", "7 3", True),
    "lifted+rans": Style("up", "2 3", True),
    "lifted+gamma": Style("left", "1 5", True),
    "two-stage+rans": Style("down", "9 3 2 3", True),
    "two-stage+gamma": Style("diamond", "9 3 2 3 2 3", True),
    "interpolating": Style("circle", "", True),
    "lifted": Style("up", "2 3", True),
    "two-stage": Style("down", "9 3 2 3", True),
    PLAIN: Style("square", "5 4", False),
    "JPEG XL e7": Style("circle", "", False),
    "JPEG-LS": Style("square", "6 3", False),
    "JPEG 2000": Style("up", "2 2", False),
    "HTJ2K": Style("down", "9 3 2 3", False),
    "SZ3": Style("diamond", "", False),
    "SPERR": Style("star", "4 2", False),
    "LERC": Style("hexagon", "1 3", False),
    "LERC+zstd": Style("right", "10 3", False),
    "zfp": Style("cross", "3 3 1 3", False),
}

TICKS = [m * f for f in (0.01, 0.1, 1, 10, 100) for m in (1, 1.5, 2, 3, 4, 5, 6, 8)]
"""Ticks of logarithmic axes."""


def by_codec(rows):
    """Rows of each codec that has a style, in the order of STYLES."""
    found = {codec: [row for row in rows if row["codec"] == codec] for codec in STYLES}
    return {codec: rows for codec, rows in found.items() if rows}


def save(out, name, chart, rows):
    (out / f"{name}.svg").write_text(chart.render())
    write(out / f"{name}.csv", rows)


def error_of(row):
    """Where a row stands on the axis of max errors: at its bound, or at what was measured where none was promised."""
    return row["max_error"] if row["within"] == "not promised" else row["bound"]


def rate(out, raster, rows, unit):
    """Bits a sample against max error, one curve a codec."""
    rows = [row for row in rows if row["within"] != "no"]
    plotted = [
        {"codec": codec, "max_error": error_of(row), "bits_per_sample": row["bits_per_sample"]}
        for codec, of_codec in by_codec(rows).items()
        for row in sorted(of_codec, key=error_of)
    ]
    errors = [row["max_error"] for row in plotted if row["max_error"] > 0]
    lossless = any(row["max_error"] == 0 for row in plotted)
    ticks = sorted({row["bound"] for row in rows})
    x = Axis(f"max error, {unit['symbol']}", min(errors), max(errors), True, lossless, ticks)
    bits = [row["bits_per_sample"] for row in plotted]
    low, high = nice_log(bits)
    y = Axis("bits a valid sample, whole file", low, high, True, ticks=[m for m in TICKS if low <= m <= high])
    chart = Chart(f"Size against max error: {raster}", "lower is better; thick: ours; both axes logarithmic, 0: lossless", x, y)
    for codec, of_codec in by_codec(plotted).items():
        chart.curve([(row["max_error"], row["bits_per_sample"]) for row in of_codec], codec, STYLES[codec])
    save(out, f"rate_{raster}", chart, plotted)


def speed(out, raster, rows, unit):
    """Decode speed against bits at one bound."""
    bound = unit["bounds"][1]
    rows = [row for row in rows if row["bound"] == bound and row["within"] != "no" and row["decode_msamples_per_s"] > 0]
    keys = ("codec", "bits_per_sample", "decode_msamples_per_s", "encode_msamples_per_s")
    plotted = [{key: row[key] for key in keys} for rows in by_codec(rows).values() for row in rows]
    if not plotted:
        return
    bits = [row["bits_per_sample"] for row in plotted]
    low, high = 0.8 * min(bits), 1.3 * max(bits)
    x = Axis("bits a valid sample, whole file", low, high, True, ticks=[m for m in TICKS if low <= m <= high])
    ends = nice_log([row["decode_msamples_per_s"] for row in plotted])
    y = Axis("decoded Msamples/s, one core", *ends, log=True)
    y.ticks = [m * f for f in (1, 10, 100) for m in (1, 2, 5) if ends[0] <= m * f <= ends[1]]
    title = f"Decoding speed against size: {raster}, max error {bound:g} {unit['symbol']}"
    chart = Chart(title, "better: up and to the left; filled: ours, with random access to every diamond", x, y, 30)
    for row in plotted:
        chart.point(row["bits_per_sample"], row["decode_msamples_per_s"], row["codec"], STYLES[row["codec"]])
    save(out, f"speed_{raster}", chart, plotted)


def at_bits(rows, bits):
    """Max and RMS error of a codec where its curve has so many bits: between the two nearest rows, in logarithms of the errors;
    None where the curve does not reach."""
    known = sorted((row for row in rows if row["max_error"] > 0), key=lambda row: row["bits_per_sample"])
    for a, b in zip(known, known[1:]):
        if a["bits_per_sample"] <= bits <= b["bits_per_sample"]:
            width = b["bits_per_sample"] - a["bits_per_sample"]
            share = (bits - a["bits_per_sample"]) / width if width else 0.0
            mix = [
                math.exp((1 - share) * math.log(a[key]) + share * math.log(b[key])) for key in ("max_error", "rms_error")
            ]
            return mix
    return None


def errors(out, raster, rows, unit):
    """RMS against max error, all codecs at the bits that ours needs for the last bound, which most curves reach."""
    our = summary.our_row([row for row in rows if row["bound"] == unit["bounds"][-1]])
    if our is None:
        return
    bits = our["bits_per_sample"]
    plotted = []
    for codec, of_codec in by_codec(rows).items():
        found = at_bits(of_codec, bits)
        if found:
            plotted.append({"codec": codec, "bits_per_sample": bits, "max_error": found[0], "rms_error": found[1]})

    def axis(label, key):
        low, high = nice_log([row[key] for row in plotted])
        low, high = low / 1.3, high * 1.3
        return Axis(label, low, high, True, ticks=[m for m in TICKS if low <= m <= high])

    x = axis(f"max error, {unit['symbol']}", "max_error")
    y = axis(f"RMS error, {unit['symbol']}", "rms_error")
    title = f"Errors at equal size: {raster}, {bits:.2f} bits a sample"
    chart = Chart(title, "better: down and to the left; interpolated between measured sizes, left out beyond; filled: ours", x, y, 30)
    for row in plotted:
        chart.point(row["max_error"], row["rms_error"], row["codec"], STYLES[row["codec"]])
    save(out, f"errors_{raster}", chart, plotted)


def levels(out, rows, units):
    """Distance of the coarse levels to the full surface, one curve a transform, in parts of the distance of a surface through
    every n-th sample of the input, which any transform could do without a filter."""
    for raster in dict.fromkeys(row["raster"] for row in rows):
        unit = units[raster]
        here = [row for row in rows if row["raster"] == raster]
        plain = {row["spacing"]: row["surface_rms"] for row in here if row["codec"] == PLAIN}
        ratios = {id(row): row["surface_rms"] / plain[row["spacing"]] for row in here}
        spacings = sorted(plain)
        low, high = min(ratios.values()), max(ratios.values())
        x = Axis("spacing of the level, samples of the input", spacings[0], spacings[-1], True, ticks=spacings)
        y = Axis("RMS distance to the full surface; every n-th sample: 1", low - 0.03, high + 0.03)
        subtitle = f"built at {unit['bounds'][1]:g} {unit['symbol']}; bilinear between a level's samples; lower is better"
        chart = Chart(f"Coarse levels: {raster}", subtitle, x, y)
        for codec, of_codec in by_codec(here).items():
            chart.curve([(row["spacing"], ratios[id(row)]) for row in of_codec], codec, STYLES[codec])
        (out / f"levels_{raster}.svg").write_text(chart.render())


def cells(out, rows, units):
    """Decode speed against patch size, one curve a pair of transform and coder."""
    for raster in dict.fromkeys(row["raster"] for row in rows):
        unit = units[raster]
        here = [row for row in rows if row["raster"] == raster]
        x = Axis("cells along a diamond's side", CELLS[0], CELLS[-1], True, ticks=CELLS)
        y = Axis("decoded Msamples/s, one core", 0, 1.1 * max(row["decode_msamples_per_s"] for row in here))
        subtitle = f"max error {unit['bounds'][1]:g} {unit['symbol']}; higher is better"
        chart = Chart(f"Decoding speed against patch size: {raster}", subtitle, x, y)
        for codec, of_codec in by_codec(here).items():
            points = [(row["cells"], row["decode_msamples_per_s"]) for row in of_codec]
            chart.curve(points, codec, STYLES[codec])
        (out / f"cells_{raster}.svg").write_text(chart.render())


def depth(out, rows):
    """Growth of the max error with the levels of refinement, in parts of the quantiser's bound: one curve a bound of lifted, and
    what the others keep. `rows` are those that the test of it prints."""
    bounds = sorted({int(row["e"]) for row in rows})
    growth = {e: [(row["level"], row["max_error"] / e) for row in rows if row["e"] == e] for e in bounds}
    deepest = max(level for points in growth.values() for level, _ in points)
    highest = max(ratio for points in growth.values() for _, ratio in points)
    x = Axis("levels of refinement", 0, deepest)
    y = Axis("max error, parts of the quantiser's bound e", 0, 1.05 * highest)
    chart = Chart("Max error against depth", "a synthetic strip of diamonds of 16 cells; lower is better", x, y)
    for e, style in zip(bounds, (STYLES["lifted+rans"], STYLES["lifted+gamma"], STYLES["JPEG 2000"])):
        chart.curve(growth[e], f"lifted, e = {e}", style)
    chart.curve([(0, 1), (deepest, 1)], "interpolating, two-stage", STYLES["interpolating"])
    (out / "depth.svg").write_text(chart.render())
