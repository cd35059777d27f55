"""The transforms of docs/design.md, from coefficients to heights on the next level.

Matrices are dictionaries by (i, j). `read(matrix, coded)` gives all coefficients of a matrix, 0 where `coded` is false; `mirrored` gives for every place of a matrix that ends at `last` the one whose height it has, itself where its half is present."""


def clamp(value, low, high):
    return max(low, min(high, value))


def wrap(value, bits=32):
    return (value + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)


NEAR = [(a, b) for a in (0, 1) for b in (0, 1)]
FAR = [(a, b) for a in range(-1, 3) for b in range(-1, 3) if (a in (0, 1)) != (b in (0, 1))]


def has_order_4(cells, i, j):
    return 1 <= i < cells - 1 and 1 <= j < cells - 1


def support(cells, i, j):
    """The places that the fixed rule looks at."""
    return [(i + a, j + b) for a, b in NEAR + (FAR if has_order_4(cells, i, j) else [])]


def fixed_rule(cells, vertices, i, j):
    near = sum(vertices[i + a, j + b] for a, b in NEAR)
    if has_order_4(cells, i, j):
        return 10 * near - sum(vertices[i + a, j + b] for a, b in FAR) + 16 >> 5
    return near + 2 >> 2


def interpolating(cells, quantiser, vertices, valid, coded, mirrored, read):
    coefficients = read(0, coded)
    heights = {at: quantiser.reconstruct(k, fixed_rule(cells, vertices, *at)) for at, k in coefficients.items()}
    return vertices, heights


def two_stage(cells, quantiser, vertices, valid, coded, mirrored, read):
    coefficients = read(0, coded)
    centres = interpolating(cells, quantiser, vertices, valid, coded, mirrored, lambda *_: coefficients)[1]
    centres = {at: centres[mirrored(*at, cells - 1)] for at in centres}
    known = {at: coded[mirrored(*at, cells - 1)] for at in centres}
    inner = {}
    for i, j in centres:
        is_inner = i > 0 and j > 0 and valid[i, j] and mirrored(i, j, cells) == (i, j)
        inner[i, j] = is_inner and all(known[at] for at in support(cells - 1, i - 1, j - 1))
    residuals, heights = read(1, inner), dict(vertices)
    for (i, j), is_coded in inner.items():
        if is_coded:
            prediction = clamp(fixed_rule(cells - 1, centres, i - 1, j - 1), *quantiser.range)
            heights[i, j] = quantiser.reconstruct(residuals[i, j], 2 * vertices[i, j] - prediction)
    return heights, centres


def lifted(cells, quantiser, vertices, valid, coded, mirrored, read):
    coefficients = read(0, coded)
    details = {at: wrap(coefficients[mirrored(*at, cells - 1)] * quantiser.step) for at in coefficients}
    known = {at: coded[mirrored(*at, cells - 1)] for at in coefficients}
    heights = dict(vertices)
    for j in range(1, cells):
        for i in range(1, cells):
            around = [at for at in ((i - 1, j - 1), (i, j - 1), (i - 1, j), (i, j)) if known[at]]
            if valid[i, j] and around:
                n = len(around)
                heights[i, j] = wrap(vertices[i, j] - (sum(details[at] for at in around) + n) // (2 * n))

    def mean(places):
        of = [heights[at] for at in places if valid[at]]
        return (2 * sum(of) + len(of)) // (2 * len(of)) if of else None

    def prediction(i, j):
        if not coded[i, j] or all(valid[at] for at in support(cells, i, j)):
            return clamp(fixed_rule(cells, heights, i, j), -(2**31), 2**31 - 1)
        for places in ([(i + a, j + b) for a, b in NEAR], heights):
            if mean(places) is not None:
                return mean(places)
        return 0

    return heights, {at: wrap(detail + prediction(*at)) for at, detail in details.items()}


TRANSFORMS = [interpolating, lifted, two_stage]
