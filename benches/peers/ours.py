"""Ours, by its command line. What the built `kmb` does not know is found by asking it, and skipped with a message."""

import json
import pathlib
import subprocess
import tempfile

import numpy
import tifffile

from timing import median_seconds

TRANSFORMS = ["interpolating", "lifted", "two-stage"]
ENTROPIES = ["gamma", "rans"]
BAD_USAGE = 2


class Failed(RuntimeError):
    """A command ended with an error; its line is the text."""

    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


def help_of(program, command):
    """What a command of the program says of itself."""
    return subprocess.run([program, command, "--help"], capture_output=True, text=True).stdout


class Kmb:
    """The program, a folder for its files, and the pairs of transform and coder that it accepts."""

    def __init__(self, program):
        self.program = pathlib.Path(program)
        if not self.program.exists():
            raise SystemExit(f"{program} is missing: cargo build --release")
        self._folder = tempfile.TemporaryDirectory(prefix="kmb-peers-")
        self.folder = pathlib.Path(self._folder.name)
        self.pairs = [(t, e) for t in TRANSFORMS for e in ENTROPIES if self._accepts(t, e)]

    def entropies(self):
        """The coders that `interpolating` accepts, the better last."""
        return [entropy for transform, entropy in self.pairs if transform == "interpolating"]

    def run(self, *arguments):
        """The JSON of a command."""
        command = [self.program, *map(str, arguments), "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise Failed(done.returncode, done.stderr.strip())
        return json.loads(done.stdout)

    def build(self, source, output, rate, transform, entropy, extra=()):
        """Builds on one thread; `rate` is ("--max-error", E) or ("--rms", R)."""
        how = ["--transform", transform, "--entropy", entropy, "--threads", 1]
        return self.run("build", source, "-o", output, *rate, *how, *extra)

    def _accepts(self, transform, entropy):
        tiny = self.folder / "tiny.tif"
        tifffile.imwrite(tiny, (numpy.arange(65 * 65) % 251).astype(numpy.int16).reshape(65, 65))
        try:
            self.build(tiny, self.folder / "tiny.kmb", ("--max-error", 0), transform, entropy)
            return True
        except Failed as error:
            reason = "does not know it" if error.code == BAD_USAGE else f"failed: {error}"
            print(f"skipped ours {transform}+{entropy}: kmb {reason}", flush=True)
            return False

    def extract(self, file, level=None):
        """The samples of an even level, the finest by default, and where they are valid."""
        output = self.folder / "extracted.tif"
        self.run("extract", file, "-o", output, *(["--level", level] if level is not None else []))
        with tifffile.TiffFile(output) as tiff:
            samples = tiff.pages[0].asarray()
            tag = tiff.pages[0].tags.get("GDAL_NODATA")
        valid = numpy.isfinite(samples)
        if tag is not None:
            valid &= samples != samples.dtype.type(float(str(tag.value).strip("\0 ")))
        return samples, valid

    def decode_speed(self, file, repeats):
        """The fastest of several runs: `kmb bench` counts wall time, and its fastest run is nearest to processor time."""
        return max(self.run("bench", file)["decode_msamples_per_s"] for _ in range(max(repeats, 1)))

    def measure(self, raster, bound, rate, pair, options, extra=()):
        """A row, as the fields of measure.Row, of one build."""
        transform, entropy = pair
        file = self.folder / "measured.kmb"

        def build():
            return self.build(raster.path, file, rate, transform, entropy, extra)

        seconds, _ = median_seconds(build, options.repeats, options.seconds)
        samples, valid = self.extract(file)
        max_error, rms_error = raster.errors(samples)
        kept = max_error <= bound and bool((valid == raster.valid).all())
        return {
            "raster": raster.name,
            "codec": f"{transform}+{entropy}",
            "mode": rate[0].lstrip("-"),
            "bound": bound,
            "bits_per_sample": 8 * file.stat().st_size / raster.valid_count,
            "max_error": max_error,
            "rms_error": rms_error,
            "within": ("yes" if kept else "no") if rate[0] == "--max-error" else "not promised",
            "encode_msamples_per_s": raster.samples.size / 1e6 / seconds,
            "decode_msamples_per_s": self.decode_speed(file, options.repeats) if options.repeats else 0.0,
            "bytes": file.stat().st_size,
            "valid_samples": raster.valid_count,
        }

    def rows(self, raster, bound, options):
        """Every pair at one bound. `lifted` has no bound but 0: above, it gets the RMS error that `interpolating` had."""
        rms = None
        for pair in self.pairs:
            rate = ("--max-error", bound)
            if pair[0] == "lifted" and bound > 0:
                if not rms:
                    continue
                rate = ("--rms", rms)
            try:
                row = self.measure(raster, bound, rate, pair, options)
            except Failed as error:
                print(f"  ours {'+'.join(pair)} E {bound:g} failed: {error}", flush=True)
                continue
            if pair[0] == "interpolating":
                rms = row["rms_error"]
            yield row
