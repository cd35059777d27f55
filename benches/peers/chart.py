"""Measures and draws docs/charts/: SVGs, with the data of each as CSV beside it, and summary.md.

    chart.py [--redraw] [--data FOLDER] [--only PATTERN] [--out FOLDER]
"""

import argparse
import os
import pathlib
import platform

import chart_measures
import drawings
import measure
import ours
import rasters
import summary

KINDS = ["rate", "speed", "errors", "levels", "cells"]
LEAST_SAMPLES = 150_000
"""Valid samples of a raster that gets charts."""


def measure_all(options):
    """Everything that the drawings need, as CSV under options.out, in place of what was there."""
    out = options.out
    for old in [path for kind in KINDS for path in out.glob(f"{kind}_*")]:
        old.unlink()
    options.csv = out / "measured.csv"
    options.chart, options.no_ours, options.no_peers, options.peers_from = True, False, False, None
    measure.run(options)
    kmb = ours.Kmb(options.kmb)
    for raster in rasters.load_all(options.data, options.only):
        if raster.valid_count < LEAST_SAMPLES or not raster.valid.all():
            continue
        bound = raster.unit["bounds"][1]
        print(f"levels and patch sizes of {raster.name}", flush=True)
        chart_measures.write(out / f"levels_{raster.name}.csv", chart_measures.all_levels(raster, bound, kmb))
        chart_measures.write(out / f"cells_{raster.name}.csv", chart_measures.all_cells(raster, bound, kmb, options))


def machine():
    """The processor's name and how many there are."""
    name = platform.machine()
    info = pathlib.Path("/proc/cpuinfo")
    if info.exists():
        names = [line.split(":")[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        name = names[0] if names else name
    return f"{os.cpu_count()} cores of {name}"


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--redraw", action="store_true", help="draws the last measurements again")
    parser.add_argument("--data", default=os.environ.get("DATA") or measure.REPOSITORY / "data")
    parser.add_argument("--only", help="pattern of the file names that count")
    parser.add_argument("--out", type=pathlib.Path, default=measure.REPOSITORY / "docs/charts")
    parser.add_argument("--kmb", default=measure.REPOSITORY / "target/release/kmb")
    parser.add_argument("--repeats", type=int, default=5, help="runs of which the median counts")
    parser.add_argument("--seconds", type=float, default=2, help="about the time for one speed")
    return parser.parse_args()


def main():
    options = arguments()
    out = options.out
    out.mkdir(parents=True, exist_ok=True)
    if not options.redraw:
        measure_all(options)
        (out / "machine.txt").write_text(machine() + "\n")
    rows = chart_measures.read([out / "measured.csv"])
    levels = chart_measures.read(sorted(out.glob("levels_*.csv")))
    units = {raster.name: raster.unit for raster in rasters.load_all(options.data, options.only)}
    units = {name: unit for name, unit in units.items() if any(row["raster"] == name for row in rows)}
    text = summary.page(rows, units, levels, (out / "machine.txt").read_text().strip())
    (out / "summary.md").write_text(text)
    for name in units:
        here = [row for row in rows if row["raster"] == name]
        if here[0]["valid_samples"] >= LEAST_SAMPLES:
            drawings.rate(out, name, here, units[name])
            drawings.speed(out, name, here, units[name])
            drawings.errors(out, name, here, units[name])
    drawings.levels(out, levels, units)
    drawings.cells(out, chart_measures.read(sorted(out.glob("cells_*.csv"))), units)
    if (out / "depth.csv").exists():
        drawings.depth(out, chart_measures.read([out / "depth.csv"]))


if __name__ == "__main__":
    main()
