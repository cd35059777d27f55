"""Bytes of cities against their likeness to the triangles that they were built from, and a flight within a budget of bytes.

    cities.py measure KMB FOLDER IN...   builds and renders each input at K = 32, 64 and 128; writes FOLDER/cities.csv
    cities.py draw FOLDER                draws the tables of FOLDER as SVG beside them
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile

from svg import Axis, Chart, Style, nice_log

SIDES = 32, 64, 128
RINGS = {"far": ("far", Style("circle", "", True)), "middle": ("middle", Style("square", "7 3", True)), "near": ("near", Style("up", "2 3", True))}
SEED = "7"
VIEWS = "64"
COLUMNS = "city,k,leaves,blocks,bytes,bytes_per_leaf,seconds_per_leaf,unassigned,wall_texels,hidden_share,holes".split(",")
COLUMNS += [f"{figure}_{ring}" for figure in ("psnr", "depth") for ring in RINGS]
TICKS = [m * 10**d for d in range(-3, 9) for m in (1, 2, 5)]


def run(*command):
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def measure(kmb, folder, inputs):
    rows = []
    with tempfile.TemporaryDirectory() as work:
        for source in inputs:
            name = pathlib.Path(source).name.split(".")[0]
            for k in SIDES:
                city = f"{work}/{name}_{k}.kmb"
                built = run(kmb, "build-city", source, "-o", city, "--k", str(k), "--facades", SEED, "--json")
                against = ["--against", source, "--facades", SEED]
                seen = run(kmb, "render-city", city, "--views", VIEWS, *against, "-o", f"{work}/views", "--json")
                row = [name, k, built["leaves"], built["blocks"], built["bytes"], built["bytes"] / built["leaves"]]
                row += [built["seconds"] / built["leaves"], built["unassigned_wall_texels"], built["wall_texels"]]
                row += [built["hidden_share"], seen["holes"], *seen["psnr_rings"], *seen["depth_error_rings"]]
                rows.append([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row])
                print(*rows[-1], sep=",", flush=True)
    with open(folder / "cities.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


def read(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def likeness(folder):
    """Two charts a city: PSNR and depth error against bytes, one curve a ring of views."""
    rows = read(folder / "cities.csv")
    for city in dict.fromkeys(row["city"] for row in rows):
        own = [row for row in rows if row["city"] == city]
        sizes = [float(row["bytes"]) / 1024 for row in own]
        low, high = nice_log(sizes)
        x = Axis("KiB of the city's file, at K = 32, 64 and 128", low, high, True, ticks=[t for t in TICKS if low <= t <= high])
        for figure, label, better in (("psnr", "PSNR, dB", "higher"), ("depth", "mean depth error, m", "lower")):
            values = [float(row[f"{figure}_{ring}"]) for row in own for ring in RINGS]
            y = Axis(label, 0.9 * min(values), 1.1 * max(values))
            subtitle = f"{VIEWS} views on three rings, against the triangles with the same shading; {better} is better"
            chart = Chart(f"Likeness of BlockMaps: {city}", subtitle, x, y, 120)
            for ring, (name, style) in RINGS.items():
                chart.curve([(size, float(row[f"{figure}_{ring}"])) for size, row in zip(sizes, own)], name, style)
            (folder / f"cities_{city}_{figure}.svg").write_text(chart.render())


def flight(folder):
    """Time of an update, and quarters of parents among what is drawn, along a flight."""
    rows = read(folder / "city_flight.csv")
    frames = [float(row["frame"]) for row in rows]
    x = Axis("frame", 0, frames[-1] + 1)
    times = [max(float(row["microseconds"]), 1.0) for row in rows]
    low, high = nice_log(times)
    y = Axis("microseconds of an update", low, high, True, ticks=[t for t in TICKS if low <= t <= high])
    chart = Chart("A flight through a generated city", "decoding by a thread; within a budget of bytes; lower is better", x, y, 120)
    chart.curve(list(zip(frames, times)), "update", Style("circle", "", False), 60)
    (folder / "city_flight_time.svg").write_text(chart.render())
    shares = [100 * float(row["partial"]) / max(float(row["drawn"]), 1) for row in rows]
    chart = Chart("A flight through a generated city", "BlockMaps of which only quarters are drawn, for children that have not come", x, Axis("%", 0, max(*shares, 1) * 1.05), 120)
    chart.curve(list(zip(frames, shares)), "partial", Style("circle", "", False), 60)
    (folder / "city_flight_partial.svg").write_text(chart.render())


def main():
    match sys.argv[1:]:
        case ["measure", kmb, folder, *inputs] if inputs:
            measure(kmb, pathlib.Path(folder), inputs)
        case ["draw", folder]:
            folder = pathlib.Path(folder)
            for name, draw in (("cities.csv", likeness), ("city_flight.csv", flight)):
                if (folder / name).exists():
                    draw(folder)
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
