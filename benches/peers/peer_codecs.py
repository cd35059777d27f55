"""The peers: each turns a raster into bytes and back, in process, on one thread.

Two ways to keep a maximum error E. "quantised": the samples become indices of steps of 2 E + 1 (integers) or 2 E (floats),
and a lossless codec codes the indices. "bound": the codec's own error bound; integers are rounded after decoding, so that
they may ask for E + 0.499. What says step and offset is not counted against a peer.
"""

from collections.abc import Callable
from dataclasses import dataclass

import imagecodecs
import numpy

ROUNDED = 0.499
"""The largest error that still rounds to the right integer, with a margin for the codec's arithmetic."""


@dataclass
class Trial:
    """One way in which one codec can code one raster at one bound."""

    codec: str
    mode: str
    array: numpy.ndarray
    """What the codec is given."""
    encode: Callable
    """array -> bytes"""
    decode: Callable
    """bytes -> array of the same shape"""
    restore: Callable
    """decoded array -> samples in the raster's unit"""


class TooWide(ValueError):
    """The indices do not fit into the 16 bits that image codecs have."""


def narrow(indices):
    """Indices from 0 upwards in the smallest unsigned type."""
    largest = int(indices.max())
    if largest > 65535:
        raise TooWide(f"{largest + 1} steps do not fit into 16 bits")
    return numpy.ascontiguousarray(indices.astype(numpy.uint8 if largest < 256 else numpy.uint16))


def output_bound(raster, bound):
    """The bound less the rounding to the raster's type."""
    if not raster.is_float:
        return bound
    largest = numpy.abs(raster.filled).max()
    return bound - 0.5 * float(numpy.spacing(largest))


def quantise(raster, bound):
    """Indices and the function that turns them back into samples."""
    low = raster.filled.min()
    if raster.is_float:
        low, step = float(low), 2 * output_bound(raster, bound)
        indices = numpy.rint((raster.filled.astype(numpy.float64) - low) / step)
    else:
        low, error = int(low), int(bound)
        step = 2 * error + 1
        indices = (raster.filled.astype(numpy.int64) - low + error) // step
    dtype = raster.samples.dtype

    def restore(decoded):
        samples = low + decoded.astype(numpy.float64) * step
        limits = (raster.filled.min(), raster.filled.max())
        return numpy.clip(samples, *limits).astype(dtype)

    return narrow(indices), restore


def rounded(restore):
    return lambda decoded: restore(numpy.rint(decoded))


def jpegxl(data):
    return imagecodecs.jpegxl_encode(data, lossless=True, effort=7, numthreads=1)


def jpeg2000(data):
    bits = max(int(data.max()).bit_length(), 1)
    return imagecodecs.jpeg2k_encode(
        data, level=0, codecformat="j2k", reversible=True, bitspersample=bits, numthreads=1
    )


LOSSLESS = {
    "JPEG XL e7": (jpegxl, lambda data: imagecodecs.jpegxl_decode(data, numthreads=1)),
    "JPEG-LS": (imagecodecs.jpegls_encode, imagecodecs.jpegls_decode),
    "JPEG 2000": (jpeg2000, lambda data: imagecodecs.jpeg2k_decode(data, numthreads=1)),
    "HTJ2K": (lambda data: imagecodecs.htj2k_encode(data, reversible=True), imagecodecs.htj2k_decode),
    "LERC": (lambda data: imagecodecs.lerc_encode(data, level=0), imagecodecs.lerc_decode),
    "LERC+zstd": (
        lambda data: imagecodecs.lerc_encode(data, level=0, compression="zstd"),
        imagecodecs.lerc_decode,
    ),
}


def sz3(shape, dtype, bound):
    return (
        lambda data: imagecodecs.sz3_encode(data, mode="abs", abs=bound),
        lambda data: imagecodecs.sz3_decode(data, shape, dtype),
    )


def sperr(_shape, _dtype, bound):
    return (
        lambda data: imagecodecs.sperr_encode(data, bound, "pwe", numthreads=1),
        lambda data: imagecodecs.sperr_decode(data, numthreads=1),
    )


def zfp(_shape, _dtype, bound):
    return (
        lambda data: imagecodecs.zfp_encode(data, level=bound, mode="accuracy", numthreads=1),
        lambda data: imagecodecs.zfp_decode(data, numthreads=1),
    )


FLOATING = {"SZ3": sz3, "SPERR": sperr, "zfp": zfp}
NAMES = [*LOSSLESS, *FLOATING]


def quantised_trials(raster, bound):
    """Every lossless codec, and the floating ones, on the indices."""
    indices, restore = quantise(raster, bound)
    trials = [
        Trial(name, "quantised", indices, encode, decode, restore)
        for name, (encode, decode) in LOSSLESS.items()
    ]
    floats = numpy.ascontiguousarray(indices.astype(numpy.float32))
    for name, codec in FLOATING.items():
        pair = codec(floats.shape, floats.dtype, ROUNDED)
        trials.append(Trial(name, "quantised", floats, *pair, rounded(restore)))
    return trials


def bound_trials(raster, bound):
    """The codecs that keep a bound of their own."""
    dtype = raster.samples.dtype
    data = numpy.ascontiguousarray(raster.filled)
    trials = []
    if raster.is_float:
        floats, own = data, output_bound(raster, bound)
    else:
        floats, own = numpy.ascontiguousarray(data.astype(numpy.float32)), int(bound) + ROUNDED

    def restore(decoded):
        return (decoded if raster.is_float else numpy.rint(decoded)).astype(dtype)

    for name, codec in FLOATING.items():
        trials.append(Trial(name, "bound", floats, *codec(floats.shape, floats.dtype, own), restore))
    for name, options in {"LERC": {}, "LERC+zstd": {"compression": "zstd"}}.items():

        def encode(data, options=options):
            return imagecodecs.lerc_encode(data, level=float(bound), **options)

        trials.append(Trial(name, "bound", data, encode, imagecodecs.lerc_decode, restore))
    return trials


def near_trials(raster, bound):
    """JPEG-LS with its own bound, NEAR, of 16-bit integers; floats are counted in units that make NEAR as large as it goes."""
    low = raster.filled.min()
    if raster.is_float:
        own = output_bound(raster, bound)
        span = float(raster.filled.max()) - float(low)
        near = int(min(255, (65535 * 2 * own / span - 1) // 2))
        unit = 2 * own / (2 * near + 1)
    else:
        near, unit = int(bound), 1
    if not 1 <= near <= 255:
        return []
    data = narrow(numpy.rint((raster.filled.astype(numpy.float64) - float(low)) / unit))
    if data.dtype == numpy.uint8 and near > 127:
        data = data.astype(numpy.uint16)
    limits = (low, raster.filled.max())

    def restore(decoded):
        samples = float(low) + decoded.astype(numpy.float64) * unit
        return numpy.clip(samples, *limits).astype(raster.samples.dtype)

    return [
        Trial(
            "JPEG-LS",
            "near",
            data,
            lambda data: imagecodecs.jpegls_encode(data, level=near),
            imagecodecs.jpegls_decode,
            restore,
        )
    ]


def trials(raster, bound):
    """All that peers can do with a raster at a bound, and what was skipped, as text."""
    found, skipped = [], []
    for kind in (quantised_trials, bound_trials, near_trials):
        try:
            found += kind(raster, bound)
        except TooWide as error:
            skipped.append(f"{kind.__name__}: {error}")
    return found, skipped
