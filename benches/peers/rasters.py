"""Height rasters: finding them, reading them, their voids and the maximum errors at which they are measured."""

import fnmatch
import pathlib
import tomllib
from dataclasses import dataclass

import imagecodecs
import numpy
import scipy.ndimage
import tifffile

SUFFIXES = {".tif", ".tiff", ".png"}
BOUNDS = pathlib.Path(__file__).with_name("bounds.toml")


@dataclass
class Raster:
    """One raster, shape (rows, columns), in its own unit."""

    path: pathlib.Path
    samples: numpy.ndarray
    """As read, in the file's type."""
    valid: numpy.ndarray
    """False where the file has no data."""
    filled: numpy.ndarray
    """The samples with each void replaced by the nearest valid one."""
    mask_bytes: int
    """What the mask costs a peer: one bit a sample, packed, by Zstandard; 0 without voids."""
    unit: dict
    """Its table of bounds.toml."""

    @property
    def name(self):
        return self.path.stem

    @property
    def is_float(self):
        return self.samples.dtype.kind == "f"

    @property
    def valid_count(self):
        return int(self.valid.sum())

    def errors(self, decoded):
        """Max and RMS of |decoded - input| over the valid samples."""
        difference = decoded.astype(numpy.float64) - self.samples.astype(numpy.float64)
        difference = difference[self.valid]
        return float(numpy.abs(difference).max()), float(numpy.sqrt(numpy.mean(difference**2)))


def read_samples(path):
    """The samples and the value that means no data, or None."""
    if path.suffix.lower() == ".png":
        return imagecodecs.png_decode(path.read_bytes()), None
    with tifffile.TiffFile(path) as file:
        page = file.pages[0]
        tag = page.tags.get("GDAL_NODATA")
        nodata = None if tag is None else float(str(tag.value).strip("\0 "))
        return page.asarray(), nodata


def load(path):
    """Reads a height raster; ValueError when it is not one."""
    samples, nodata = read_samples(path)
    if samples.ndim != 2:
        raise ValueError(f"{samples.shape[-1]} bands, not heights")
    if samples.dtype.kind not in "iuf":
        raise ValueError(f"samples of type {samples.dtype}")
    samples = samples.astype(samples.dtype.newbyteorder("="))
    valid = numpy.isfinite(samples)
    if nodata is not None:
        valid &= samples != samples.dtype.type(nodata)
    if not valid.any():
        raise ValueError("nothing but voids")
    filled, mask_bytes = samples, 0
    if not valid.all():
        nearest = scipy.ndimage.distance_transform_edt(~valid, return_distances=False, return_indices=True)
        filled = samples[tuple(nearest)]
        mask_bytes = len(imagecodecs.zstd_encode(numpy.packbits(valid).tobytes(), level=19))
    kind = "float" if samples.dtype.kind == "f" else "integer"
    return Raster(path, samples, valid, filled, mask_bytes, unit_of(path, kind))


def unit_of(path, kind):
    """The table of bounds.toml for a file of "integer" or "float" samples."""
    for unit in tomllib.loads(BOUNDS.read_text())["unit"]:
        if unit["kind"] == kind and fnmatch.fnmatch(path.name, unit["pattern"]):
            return unit
    raise ValueError("no table of bounds.toml fits")


def load_all(folder, only=None):
    """The height rasters of a folder by size; prints what it skips. `only`: a pattern of file names."""
    rasters = []
    for path in sorted(pathlib.Path(folder).iterdir()):
        if path.suffix.lower() not in SUFFIXES or (only and not fnmatch.fnmatch(path.name, only)):
            continue
        try:
            rasters.append(load(path))
        except ValueError as error:
            print(f"skipped {path.name}: {error}", flush=True)
    return sorted(rasters, key=lambda raster: raster.samples.size)
