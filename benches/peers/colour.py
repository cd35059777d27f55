"""Colour: a crop and the whole of an RGB image, lossless, and near-lossless against JPEG at equal PSNR, in one run.

    colour.py IMAGE --csv OUT.csv [--svg OUT.svg]
"""

import argparse
import math
import pathlib

import imagecodecs
import numpy
import tifffile

import chart_measures
import drawings
import measure
import ours
from svg import Axis, Chart, Style
from timing import median_seconds

CROP = 1025
BOUND = 10
BOUNDS = [2, 5, BOUND, 20]
STYLES = {
    **drawings.STYLES,
    "JPEG 444": Style("square", "6 3", False),
    "JPEG 420": Style("up", "2 3", False),
}
QUALITIES = [20, 40, 60, 75, 85, 92, 97]
SUBSAMPLINGS = ["444", "420"]

LOSSLESS = {
    "JPEG XL e7": (
        lambda image: imagecodecs.jpegxl_encode(image, lossless=True, effort=7, numthreads=1),
        lambda coded: imagecodecs.jpegxl_decode(coded, numthreads=1),
    ),
    "WebP": (
        lambda image: imagecodecs.webp_encode(image, lossless=True, method=6, numthreads=1),
        imagecodecs.webp_decode,
    ),
    "JPEG 2000": (
        lambda image: imagecodecs.jpeg2k_encode(image, level=0, codecformat="j2k", reversible=True, numthreads=1),
        lambda coded: imagecodecs.jpeg2k_decode(coded, numthreads=1),
    ),
    "PNG": (lambda image: imagecodecs.png_encode(image, level=9), imagecodecs.png_decode),
}


def psnr(image, decoded):
    """Of 8-bit samples, over all three components, in decibels; infinite when equal."""
    mean = numpy.mean((image.astype(numpy.float64) - decoded) ** 2)
    return 10 * math.log10(255**2 / mean) if mean else math.inf


def row(part, codec, mode, image, size, decoded, encode=0.0, decode=0.0):
    """One line: bits of the whole file a pixel, errors re-measured, speeds in Mpixels/s on one core (0: not measured)."""
    pixels = image.shape[0] * image.shape[1]
    difference = numpy.abs(image.astype(int) - decoded)
    return {
        "part": part,
        "codec": codec,
        "mode": mode,
        "bits_per_pixel": 8 * size / pixels,
        "max_error": int(difference.max()),
        "psnr": psnr(image, decoded),
        "encode_mpixels_per_s": pixels / 1e6 / encode if encode else 0.0,
        "decode_mpixels_per_s": pixels / 1e6 / decode if decode else 0.0,
        "bytes": size,
    }


def lossless_rows(part, image, options):
    for codec, (encode, decode) in LOSSLESS.items():
        encoding, coded = median_seconds(lambda: encode(image), options.repeats, options.seconds)
        decoding, decoded = median_seconds(lambda: decode(coded), options.repeats, options.seconds)
        yield row(part, codec, "lossless", image, len(coded), decoded, encoding, decoding)


def jpeg(image, quality, subsampling):
    coded = imagecodecs.jpeg8_encode(image, level=quality, subsampling=subsampling, optimize=True)
    return coded, imagecodecs.jpeg8_decode(coded)


def jpeg_rows(part, image):
    """The curve of JPEG: at each quality and both subsamplings."""
    for subsampling in SUBSAMPLINGS:
        for quality in QUALITIES:
            coded, decoded = jpeg(image, quality, subsampling)
            yield row(part, f"JPEG {subsampling}", f"quality {quality}", image, len(coded), decoded)


def jpeg_at(part, image, wanted):
    """The smallest JPEG with at least the wanted PSNR, or None."""
    found = []
    for subsampling in SUBSAMPLINGS:
        low, high = 1, 101
        while low < high:
            middle = (low + high) // 2
            good = psnr(image, jpeg(image, middle, subsampling)[1]) >= wanted
            low, high = (low, middle) if good else (middle + 1, high)
        if low <= 100:
            coded, decoded = jpeg(image, low, subsampling)
            mode = f"{subsampling} quality {low}, {wanted:.2f} dB wanted"
            found.append(row(part, "JPEG at equal PSNR", mode, image, len(coded), decoded))
    return min(found, key=lambda line: line["bytes"], default=None)


def our_row(part, image, kmb, bound, transform, entropy, options):
    source, file, output = (kmb.folder / name for name in ("image.png", "image.kmb", "image.tif"))
    source.write_bytes(imagecodecs.png_encode(image, level=1))

    def build():
        return kmb.build(source, file, ("--max-error", bound), transform, entropy, ("--colour",))

    encoding, _ = median_seconds(build, options.repeats, options.seconds)
    kmb.run("extract", file, "-o", output)
    decoded = tifffile.imread(output)
    mode = f"max error {bound}" if bound else "lossless"
    line = row(part, f"{transform}+{entropy}", mode, image, file.stat().st_size, decoded, encoding)
    speed = kmb.run("bench", file)["decode_msamples_per_s"] if options.repeats else 0.0
    return {**line, "decode_mpixels_per_s": speed}


def our_rows(part, image, kmb, options):
    """Lossless by every pair, near-lossless by `interpolating` at several bounds."""
    for transform, entropy in kmb.pairs:
        bounds = [0, *BOUNDS] if transform == "interpolating" else [0]
        for bound in bounds:
            try:
                yield our_row(part, image, kmb, bound, transform, entropy, options)
            except ours.Failed as error:
                print(f"  ours {transform}+{entropy} E {bound} failed: {error}", flush=True)


def colour_kmb(options):
    """The program, or None with a message while it has no colour."""
    if not pathlib.Path(options.kmb).exists():
        print(f"skipped ours: {options.kmb} is missing")
        return None
    if "--colour" not in ours.help_of(options.kmb, "build"):
        print("skipped ours: this kmb has no --colour")
        return None
    return ours.Kmb(options.kmb)


def measure_part(part, image, kmb, options):
    rows = [*lossless_rows(part, image, options), *jpeg_rows(part, image)]
    if kmb:
        mine = list(our_rows(part, image, kmb, options))
        rows += mine
        for line in mine:
            equal = jpeg_at(part, image, line["psnr"]) if line["mode"] == f"max error {BOUND}" else None
            rows += [equal] if equal else []
    for line in rows:
        shown = f"{line['bits_per_pixel']:7.3f} bits a pixel  max {line['max_error']:<4} {line['psnr']:6.2f} dB"
        speeds = f"{line['encode_mpixels_per_s']:.2f} / {line['decode_mpixels_per_s']:.2f} Mpixels/s"
        print(f"{part:6} {line['codec']:22} {line['mode']:28} {shown}  {speeds}", flush=True)
    return rows


def draw(rows, path):
    """PSNR against bits on the crop: JPEG's two curves and ours."""
    here = [line for line in rows if line["part"] == "crop" and line["mode"] != "lossless"]
    here = [line for line in here if line["codec"] != "JPEG at equal PSNR"]
    bits = [line["bits_per_pixel"] for line in here]
    x = Axis("bits a pixel, whole file", 0.9 * min(bits), 1.1 * max(bits), True)
    y = Axis("PSNR, decibels", min(line["psnr"] for line in here) - 1, max(line["psnr"] for line in here) + 1)
    subtitle = "higher is better; max error of each component promised by ours, none by JPEG"
    chart = Chart("Near-lossless colour against JPEG", subtitle, x, y)
    for codec in dict.fromkeys(line["codec"] for line in here):
        points = sorted((line["bits_per_pixel"], line["psnr"]) for line in here if line["codec"] == codec)
        chart.curve(points, codec, STYLES[codec])
    path.write_text(chart.render())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("image", type=pathlib.Path)
    parser.add_argument("--csv", type=pathlib.Path, required=True)
    parser.add_argument("--svg", type=pathlib.Path)
    parser.add_argument("--kmb", default=measure.REPOSITORY / "target/release/kmb")
    parser.add_argument("--repeats", type=int, default=3, help="runs of which the median counts; 0: no speeds")
    parser.add_argument("--seconds", type=float, default=2, help="about the time for one speed")
    options = parser.parse_args()
    image = imagecodecs.imread(options.image)
    if image.ndim != 3 or image.shape[2] < 3 or image.dtype != numpy.uint8:
        parser.error(f"{options.image}: not an 8-bit RGB image")
    image = numpy.ascontiguousarray(image[..., :3])
    top, left = (max(side - CROP, 0) // 2 for side in image.shape[:2])
    crop = numpy.ascontiguousarray(image[top : top + CROP, left : left + CROP])
    kmb = colour_kmb(options)
    rows = measure_part("crop", crop, kmb, options)
    if crop.shape != image.shape:
        rows += measure_part("whole", image, kmb, options)
    chart_measures.write(options.csv, rows)
    if options.svg:
        draw(rows, options.svg)


if __name__ == "__main__":
    main()
