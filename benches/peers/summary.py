"""Where ours stands: the best peer and ours, raster by raster, bound by bound."""

import peer_codecs

LEAST_BITS = 0.2
LEAST_BYTES = 32 * 1024
COARSE_RATIO = 0.92
PREFERRED = ["interpolating+rans", "interpolating+gamma"]


def best_peer(rows):
    """The smallest file of a peer that keeps the bound, or None."""
    peers = [row for row in rows if row["codec"] in peer_codecs.NAMES and row["within"] == "yes"]
    return min(peers, key=lambda row: row["bytes"], default=None)


def our_row(rows):
    """`interpolating` with the better coder that there is, or None."""
    for codec in PREFERRED:
        for row in rows:
            if row["codec"] == codec:
                return row
    return None


def verdict(peer, our, coarse):
    """What the comparison says, in a few words."""
    if peer is None or our is None:
        return "-"
    if our["within"] == "no":
        return "ours breaks the bound"
    ratio = our["bytes"] / peer["bytes"]
    if peer["bits_per_sample"] < LEAST_BITS or peer["bytes"] < LEAST_BYTES:
        return "small: not counted"
    if ratio > 1:
        return "larger than the best peer"
    if coarse and ratio > COARSE_RATIO:
        return f"more than {COARSE_RATIO} of the best peer"
    return "met"


def comparisons(rows, units):
    """One dictionary for every raster and bound, in the order of the rows."""
    keys = list(dict.fromkeys((row["raster"], row["bound"]) for row in rows))
    for raster, bound in keys:
        here = [row for row in rows if (row["raster"], row["bound"]) == (raster, bound)]
        peer, our = best_peer(here), our_row(here)
        yield {
            "raster": raster,
            "bound": bound,
            "peer": peer,
            "our": our,
            "ratio": our["bytes"] / peer["bytes"] if peer and our else None,
            "verdict": verdict(peer, our, bound == units[raster]["coarse"]),
        }


def text(rows, units):
    """The comparisons as a Markdown table."""
    lines = [
        "| raster | max error | best peer | its bits | ours | our bits | ratio | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for item in comparisons(rows, units):
        peer, our, ratio = item["peer"], item["our"], item["ratio"]
        cells = [
            item["raster"],
            f"{item['bound']:g}",
            f"{peer['codec']} ({peer['mode']})" if peer else "-",
            f"{peer['bits_per_sample']:.3f}" if peer else "-",
            our["codec"] if our else "-",
            f"{our['bits_per_sample']:.3f}" if our else "-",
            f"{ratio:.3f}" if ratio else "-",
            item["verdict"],
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def speeds(rows, units):
    """Decoded and encoded Msamples/s of every codec at the second bound of each raster, as a Markdown table."""
    names = list(units)
    codecs = list(dict.fromkeys(row["codec"] for row in rows))
    lines = ["| decoded / encoded Msamples/s | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for codec in codecs:
        cells = [codec]
        for name in names:
            bound = units[name]["bounds"][1]
            row = find(rows, name, bound, codec)
            known = row and row["decode_msamples_per_s"] > 0
            cells.append(f"{row['decode_msamples_per_s']:.1f} / {row['encode_msamples_per_s']:.2f}" if known else "-")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def find(rows, raster, bound, codec):
    for row in rows:
        if (row["raster"], row["bound"], row["codec"]) == (raster, bound, codec):
            return row
    return None


def sizes(rows, units):
    """Bits of every codec, one line a raster and bound; the smallest that keeps the bound is bold, what breaks it is marked."""
    codecs = list(dict.fromkeys(row["codec"] for row in rows))
    lines = ["| raster | max error | " + " | ".join(codecs) + " |", "|---" * (len(codecs) + 2) + "|"]
    for name, unit in units.items():
        for bound in unit["bounds"]:
            here = [find(rows, name, bound, codec) for codec in codecs]
            kept = [row["bytes"] for row in here if row and row["within"] == "yes"]
            lines.append(f"| {name} | {bound:g} | " + " | ".join(size_cell(row, min(kept, default=0)) for row in here) + " |")
    return "\n".join(lines)


def size_cell(row, least):
    if row is None:
        return "-"
    text = f"{row['bits_per_sample']:.3f}"
    if row["within"] == "no":
        return f"{text} (breaks the bound: {row['max_error']:g})"
    if row["within"] == "not promised":
        return f"{text} (max {row['max_error']:.3g})"
    return f"**{text}**" if row["bytes"] == least else text


def against_papers(rows, units):
    """Ours against `two-stage` + `gamma`, the papers' codec, at equal max error; empty while it is not measured."""
    lines = []
    for name, unit in units.items():
        for bound in unit["bounds"]:
            here = [row for row in rows if (row["raster"], row["bound"]) == (name, bound)]
            our, paper = our_row(here), find(rows, name, bound, "two-stage+gamma")
            if our and paper:
                ratio = our["bytes"] / paper["bytes"]
                bits = f"{paper['bits_per_sample']:.3f} | {our['bits_per_sample']:.3f} | {ratio:.3f}"
                lines.append(f"| {name} | {bound:g} | {bits} |")
    if not lines:
        return ""
    head = ["| raster | max error | two-stage + gamma | ours | ratio |", "|---|---|---|---|---|"]
    return "\n".join(head + lines)


def levels_table(rows):
    """RMS distance of coarse levels to the full surface, one line a raster and spacing."""
    if not rows:
        return ""
    codecs = list(dict.fromkeys(row["codec"] for row in rows))
    lines = ["| raster | spacing | " + " | ".join(codecs) + " |", "|---" * (len(codecs) + 2) + "|"]
    for raster, spacing in dict.fromkeys((row["raster"], row["spacing"]) for row in rows):
        here = {row["codec"]: row for row in rows if (row["raster"], row["spacing"]) == (raster, spacing)}
        cells = [f"{here[codec]['surface_rms']:.4g}" if codec in here else "-" for codec in codecs]
        lines.append(f"| {raster} | {spacing:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def page(rows, units, levels, machine):
    """docs/charts/summary.md."""
    charted = [row for row in rows if row["bound"] in units[row["raster"]]["bounds"]]
    sections = [
        ("Ours against the best peer", text(charted, units)),
        ("Bits a valid sample, whole file", sizes(rows, units)),
        ("Speed at 1 m (10 dm; floats 0.1 m), one core", speeds(rows, units)),
        ("Ours against the papers' codec", against_papers(rows, units)),
        ("Coarse levels: RMS distance to the full surface", levels_table(levels)),
    ]
    head = [
        "# Measured figures",
        f"Written by `make chart`; the machine: {machine}. Max errors are in each raster's own unit and re-measured from the decoded"
        " bytes; speeds are those of warm runs in processor time, the median where `--repeats` asked for several, for ours of `kmb build` as a whole and the fastest"
        " of several `kmb bench`, which counts wall time."
        " All rows, with errors, are in `measured.csv`.",
    ]
    body = [f"## {title}\n\n{content}" for title, content in sections if content]
    return "\n\n".join(head + body) + "\n"
