"""What the charts need beyond measure.py: coarse levels against the true surface, and speed against patch size."""

import csv

import numpy

CELLS = [16, 32, 64, 128]
NAMES = ("raster", "codec", "mode", "within")
PLAIN = "input, every n-th sample"
LEAST_COARSE = 5
"""Samples along the shorter side of the coarsest level that is measured."""


def write(path, rows):
    """Dictionaries with equal keys as CSV; floats with six digits."""
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})


def read(paths):
    """The rows of several files as `write` left them; all columns but those of names are floats."""
    rows = []
    for path in paths:
        with open(path, newline="") as file:
            rows += [{k: v if k in NAMES else float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    return rows


def upsampled(coarse, step):
    """Bilinear interpolation of samples `step` apart, shape (r, c), at all ((r - 1) step + 1, (c - 1) step + 1) posts."""

    def along_rows(samples):
        posts = numpy.arange((samples.shape[0] - 1) * step + 1)
        first = numpy.minimum(posts // step, samples.shape[0] - 2)
        share = (posts / step - first)[:, None]
        return samples[first] * (1 - share) + samples[first + 1] * share

    return along_rows(along_rows(coarse.astype(numpy.float64)).T).T


def surface_rms(coarse, samples, step):
    """RMS distance of the surface through a level's samples to the input's samples."""
    surface = upsampled(coarse, step)
    true = samples[: surface.shape[0], : surface.shape[1]].astype(numpy.float64)
    return float(numpy.sqrt(numpy.mean((surface - true) ** 2)))


def level_rows(raster, codec, file, kmb):
    """One row for each even level coarser than the finest, of a raster without voids. `posts_rms`: the level's samples
    against the input's at the same posts; `surface_rms`: against all of the input."""
    levels = kmb.run("info", file)["levels"]
    for level in range(int(levels) - 2, -1, -2):
        step = 2 ** ((int(levels) - level) // 2)
        true = raster.samples[::step, ::step]
        if min(true.shape) < LEAST_COARSE:
            return
        coarse, _ = kmb.extract(file, level)
        difference = coarse.astype(numpy.float64) - true.astype(numpy.float64)
        yield {
            "raster": raster.name,
            "codec": codec,
            "spacing": step,
            "posts_rms": float(numpy.sqrt(numpy.mean(difference**2))),
            "posts_max": float(numpy.abs(difference).max()),
            "surface_rms": surface_rms(coarse, raster.samples, step),
        }


def rates(kmb, bound, rms):
    """For each pair of transform and coder how it is asked for the bound: `lifted` by the RMS error that `interpolating` has."""
    for pair in kmb.pairs:
        yield pair, ("--rms", rms) if pair[0] == "lifted" else ("--max-error", bound)


def rms_of_interpolating(raster, bound, kmb):
    file = kmb.folder / "reference.kmb"
    kmb.build(raster.path, file, ("--max-error", bound), "interpolating", kmb.entropies()[-1])
    return raster.errors(kmb.extract(file)[0])[1]


def all_levels(raster, bound, kmb):
    """Levels of every transform, with one coder: coders do not change a sample."""
    file, rows, seen = kmb.folder / "levels.kmb", [], set()
    for (transform, entropy), rate in rates(kmb, bound, rms_of_interpolating(raster, bound, kmb)):
        if transform in seen:
            continue
        seen.add(transform)
        kmb.build(raster.path, file, rate, transform, entropy)
        rows += level_rows(raster, transform, file, kmb)
    for step in sorted({row["spacing"] for row in rows}):
        true = raster.samples[::step, ::step]
        rms = surface_rms(true, raster.samples, step)
        rows.append({"raster": raster.name, "codec": PLAIN, "spacing": step,
                     "posts_rms": 0.0, "posts_max": 0.0, "surface_rms": rms})  # fmt: skip
    return rows


def all_cells(raster, bound, kmb, options):
    """Speed and size of every pair at every patch size."""
    rows, rms = [], rms_of_interpolating(raster, bound, kmb)
    for cells in CELLS:
        for pair, rate in rates(kmb, bound, rms):
            row = kmb.measure(raster, bound, rate, pair, options, ("--cells", cells))
            keys = ("raster", "codec", "bits_per_sample", "decode_msamples_per_s", "encode_msamples_per_s")
            rows.append({"cells": cells, **{key: row[key] for key in keys}})
    return rows
