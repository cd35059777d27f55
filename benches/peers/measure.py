"""Measures peers and ours on the same rasters at the same bounds, in one run, and says where ours loses.

    measure.py [--data FOLDER] [--only PATTERN] [--no-ours | --no-peers | --peers-from OLD.csv] --csv OUT.csv
"""

import argparse
import csv
import os
import pathlib
import sys
from dataclasses import asdict, dataclass, fields

import chart_measures
import ours
import peer_codecs
import rasters
import summary
from timing import median_seconds

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


@dataclass
class Row:
    """One line of the CSV. Bits are of the whole file (a peer's mask of voids included) a valid sample; errors are
    re-measured from the decoded bytes; speeds count all samples, in millions a second, on one core."""

    raster: str
    codec: str
    mode: str
    bound: float
    bits_per_sample: float
    max_error: float
    rms_error: float
    within: str
    """yes; no: the bound is broken; not promised: the codec has no bound"""
    encode_msamples_per_s: float
    decode_msamples_per_s: float
    bytes: int
    valid_samples: int


def within(max_error, bound):
    return "yes" if max_error <= bound else "no"


def peer_size(raster, trial, bound):
    """Codes once: the row without speeds, and the bytes."""
    coded = trial.encode(trial.array)
    max_error, rms_error = raster.errors(trial.restore(trial.decode(coded)))
    size = len(coded) + raster.mask_bytes
    bits = 8 * size / raster.valid_count
    row = Row(
        raster.name, trial.codec, trial.mode, bound, bits, max_error, rms_error,
        within(max_error, bound), 0.0, 0.0, size, raster.valid_count,
    )  # fmt: skip
    return row, coded


def peer_row(raster, found, bound, options):
    """The row of one codec: its smallest trial that keeps the bound, timed."""
    sized = []
    for trial in found:
        try:
            sized.append((*peer_size(raster, trial, bound), trial))
        except Exception as error:  # a codec that fails is a finding, not the end of the run
            print(f"  {trial.codec} ({trial.mode}) failed: {error}", flush=True)
    if not sized:
        return None
    row, coded, trial = min(sized, key=lambda item: (item[0].within != "yes", item[0].bytes))
    samples = raster.samples.size / 1e6
    if options.repeats:
        budget = options.seconds
        seconds, _ = median_seconds(lambda: trial.encode(trial.array), options.repeats, budget)
        row.encode_msamples_per_s = samples / seconds
        seconds, _ = median_seconds(lambda: trial.decode(coded), options.repeats, budget)
        row.decode_msamples_per_s = samples / seconds
    return row


def peer_rows(raster, bound, options):
    trials, skipped = peer_codecs.trials(raster, bound)
    for line in skipped:
        print(f"  skipped {line}", flush=True)
    for name in peer_codecs.NAMES:
        found = [trial for trial in trials if trial.codec == name]
        row = peer_row(raster, found, bound, options) if found else None
        if row:
            yield row


def show(row):
    print(
        f"{row.raster:32} {row.codec:24} {row.mode:10} E {row.bound:<6g} {row.bits_per_sample:7.3f} bits  "
        f"max {row.max_error:<9.5g} rms {row.rms_error:<9.4g} {row.within:12} "
        f"{row.encode_msamples_per_s:7.2f} / {row.decode_msamples_per_s:7.2f} Msamples/s",
        flush=True,
    )


def write_row(file, row):
    """Full precision for what is compared with a bound, six digits for the rest."""
    values = asdict(row)
    for name in ("bits_per_sample", "rms_error", "encode_msamples_per_s", "decode_msamples_per_s"):
        values[name] = f"{values[name]:.6g}"
    csv.DictWriter(file, values.keys(), lineterminator="\n").writerow(values)
    file.flush()


def run(options):
    found = rasters.load_all(options.data, options.only)
    kmb = None if options.no_ours else ours.Kmb(options.kmb)
    rows = []
    with open(options.csv, "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow([field.name for field in fields(Row)])
        for raster in found:
            for bound in raster.unit["chart" if options.chart else "bounds"]:
                sources = [] if options.no_peers or options.peers_from else [peer_rows(raster, bound, options)]
                if kmb:
                    sources.append(Row(**values) for values in kmb.rows(raster, bound, options))
                for source in sources:
                    for row in source:
                        show(row)
                        write_row(file, row)
                        rows.append(row)
    return [asdict(row) for row in rows], {raster.name: raster.unit for raster in found}


def earlier_peers(path, units):
    """The peers' rows of an earlier run, for the rasters and bounds of this one."""
    for row in chart_measures.read([path]):
        if row["codec"] in peer_codecs.NAMES and row["bound"] in units.get(row["raster"], {}).get("bounds", []):
            yield row


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", default=os.environ.get("DATA") or REPOSITORY / "data", help="folder of rasters")
    parser.add_argument("--only", help="pattern of the file names that count")
    parser.add_argument("--csv", required=True)
    parser.add_argument("--kmb", default=REPOSITORY / "target/release/kmb")
    parser.add_argument("--chart", action="store_true", help="the bounds of the curves")
    parser.add_argument("--no-ours", action="store_true")
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--peers-from", help="takes the peers from the CSV of an earlier run, to be quick")
    parser.add_argument("--repeats", type=int, default=5, help="runs of which the median counts; 0: no speeds")
    parser.add_argument("--seconds", type=float, default=2, help="about the time for one speed")
    return parser.parse_args()


def main():
    options = arguments()
    rows, units = run(options)
    if options.peers_from:
        rows += earlier_peers(options.peers_from, units)
    broken = [row for row in rows if row["within"] == "no"]
    for row in broken:
        print(f"BOUND BROKEN: {row['raster']} {row['codec']} {row['mode']} E {row['bound']:g}: {row['max_error']:g}")
    print(summary.text(rows, units))
    return 0


if __name__ == "__main__":
    sys.exit(main())
