"""A second reader of repositories, after docs/format.md and docs/design.md alone: heights, transform interpolating,
entropy coder rans. Slow, checks nothing, and needs nothing but Python 3.

    python3 reader.py FILE.kmb SAMPLES.f64

writes the decoded samples row by row as little-endian doubles, NaN where void."""

import functools
import struct
import sys


class Decisions:
    """Adaptive binary decisions; a context is a list of its probability and count."""

    def __init__(self, data):
        self.data = iter(data)
        self.range, self.offset = 2**32 - 1, 0
        for _ in range(4):
            self.offset = self.offset << 8 | next(self.data, 0)

    def decide(self, context):
        q, seen = context
        split = self.range * q >> 16
        rate = (seen + 2).bit_length() - 1
        answer = self.offset < split
        if answer:
            self.range = split
            context[0] = q + (65536 - q >> rate)
        else:
            self.offset -= split
            self.range -= split
            context[0] = q - (q >> rate)
        context[1] = min(seen + 1, 62)
        while self.range < 2**24:
            self.range <<= 8
            self.offset = self.offset << 8 | next(self.data, 0)
        return answer

    def bit(self):
        return int(self.decide([32768, 0]))


class Contexts(dict):
    """Contexts by any key, each new at first."""

    def __missing__(self, key):
        self[key] = [32768, 0]
        return self[key]


def signed(m):
    """m = 1, 2, 3, ... to 0, -1, 1, ..."""
    return m - 1 >> 1 ^ -(m - 1 & 1)


def integer(decisions, contexts, name, last):
    """An integer in the context of `last`, and its bit length less one."""
    length = 0
    while length < 32 and decisions.decide(contexts[name, "length", last, length]):
        length += 1
    m = 1
    for place in range(length):
        m = m << 1 | (int(decisions.decide(contexts[name, "leading", length])) if place == 0 else decisions.bit())
    return signed(m), length


def clamp(value, low, high):
    return max(low, min(high, value))


def wrap(value, bits=32):
    return (value + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)


class Header:
    def __init__(self, data):
        assert data[:8] == b"\x89KMB\r\n\x1a\n"
        assert tuple(data[16:20]) == (0, 0, 0, 1), "only planar heights, interpolating, rans"
        self.n, self.levels, self.sample_type = data[20], data[21], data[22]
        self.unit_length = data[26]
        self.width, self.height, self.bound, low, high = struct.unpack_from("<IIIii", data, 28)
        self.range = (low, high)
        self.scale, self.offset, self.low, self.high = struct.unpack_from("<4d", data, 48)
        self.voids, self.blocks = struct.unpack_from("<2Q", data, 184)
        sections = [struct.unpack_from("<2Q", data, 208 + 16 * k) for k in range(5)]
        _, self.roots, self.tables, self.index, self.payload = [data[a : a + n] for a, n in sections]

    def block(self, rank):
        page = self.index[364 * (rank // 64) :]
        count = min(64, self.blocks - rank // 64 * 64)
        base = struct.unpack_from("<Q", page)[0]
        lengths = [self.unit_length * n for n in struct.unpack_from(f"<{count}H", page, 8)]
        start = base + sum(lengths[: rank % 64])
        return self.payload[start : start + lengths[rank % 64]]


class Quantiser:
    def __init__(self, bound, span, listed=None):
        self.bound, self.step, self.range, self.listed = bound, 2 * bound + 1, span, listed
        if listed:
            self.range = (listed[0], listed[-1])
            self.rank = {}
            for place, (below, height) in enumerate(zip([listed[0] - 1] + listed, listed)):
                self.rank.update((h, place) for h in range(below + 1, height + 1))

    def reconstruct(self, k, prediction):
        prediction = clamp(prediction, *self.range)
        if self.listed:
            return self.listed[clamp(self.rank[prediction] + k, 0, len(self.listed) - 1)]
        height = prediction + k * self.step
        return clamp(wrap(height) if self.bound == 0 else height, *self.range)


# Roots.


def root_order(cells):
    """Every vertex with its 4 nearest, in opposite pairs, and its 8 next nearest."""
    for i, j in ((0, 0), (cells, 0), (0, cells), (cells, cells)):
        yield i, j, None, None
    h = cells // 2
    while h:
        at = lambda i, j, steps: [(i + a * h, j + b * h) for a, b in steps]
        for j in range(h, cells, 2 * h):
            for i in range(h, cells, 2 * h):
                far = [(a, b) for a in (-3, -1, 1, 3) for b in (-3, -1, 1, 3) if abs(a) != abs(b)]
                yield i, j, at(i, j, [(-1, -1), (1, 1), (1, -1), (-1, 1)]), at(i, j, far)
        for j in range(0, cells + 1, h):
            for i in range(0, cells + 1, h):
                if (i + j) // h % 2:
                    far = [(a, b) for a in (-2, -1, 1, 2) for b in (-2, -1, 1, 2) if abs(a) != abs(b)]
                    yield i, j, at(i, j, [(-1, 0), (1, 0), (0, -1), (0, 1)]), at(i, j, far)
        h //= 2


def root_prediction(near, far, last):
    known = [height for height in near if height is not None]
    if len(known) == 4:
        if None not in far:
            return 10 * sum(near) - sum(far) + 16 >> 5
        return sum(near) + 2 >> 2
    for one, other in (near[:2], near[2:]):
        if one is not None and other is not None:
            return one + other + 1 >> 1
    return (sum(known) + len(known) // 2) // len(known) if known else last


def decode_root(header, in_raster):
    """Height and validity of each root vertex."""
    cells, quantiser = 1 << header.n, Quantiser(header.bound, header.range)
    decisions, contexts = Decisions(header.roots), Contexts()
    middle = sum(header.range) >> 1
    valid, last = {}, middle
    for i, j, near, far in root_order(cells):
        if not in_raster(i, j):
            continue
        near = [valid.get(at) for at in near] if near else [None] * 4
        far = [valid.get(at) for at in far] if far else [None]
        known = [height for height in near if height is not None]
        if decisions.decide(contexts["void", 4 - len(known)]):
            continue
        context = 35
        if len(known) >= 2:
            context = min((2 * (max(known) - min(known)) // quantiser.step).bit_length(), 34)
        k, _ = integer(decisions, contexts, "root", context)
        last = valid[i, j] = quantiser.reconstruct(k, root_prediction(near, far, last))
    grid = {}
    for j in range(cells + 1):
        for i in range(cells + 1):
            distance = lambda at: ((at[0] - i) ** 2 + (at[1] - j) ** 2, at[1], at[0])
            grid[i, j] = valid[min(valid, key=distance)] if valid else middle
    return grid, set(valid)


# Tables.


def read_frequencies(decisions, contexts):
    def symbol():
        node = 1
        for _ in range(8):
            node = node << 1 | int(decisions.decide(contexts["symbol", node]))
        return node & 255

    mode, end = symbol(), symbol()
    coarse = decisions.decide(contexts["coarse"])
    frequencies, lengths = [0] * 256, (11, 11)
    for s in [*range(end), 255]:
        if s == mode:
            lengths = (11, lengths[0])
            continue
        mean, length = (sum(lengths) + 1) // 2, 0
        while length < 12 and decisions.decide(contexts["frequency", mean, length]):
            length += 1
        lengths = (length, lengths[0])
        bits, below = min(length, 1), max(length - 1, 0)
        kept = min(below, 3) if coarse else below
        for place in range(kept):
            leading = decisions.decide(contexts["second", length]) if place == 0 else decisions.bit()
            bits = bits << 1 | int(leading)
        frequencies[s] = bits << below - kept
    frequencies[mode] = 2048 - sum(frequencies)
    return frequencies


class Model:
    """Weights and tables of each level, of one matrix."""

    def __init__(self, data, levels):
        decisions, contexts = Decisions(data), Contexts()
        flag = lambda: decisions.decide(contexts["flag"])
        last = {"weight": 0, "number": 0}

        def number(kind):
            value, last[kind] = integer(decisions, contexts, kind, last[kind])
            return value

        self.adaptive, self.listed, self.levels = flag(), None, []
        if flag():
            least, count = number("number"), number("number")
            before, self.listed = 0, []
            for height in range(least, least + count):
                present = decisions.decide(contexts["listed", before])
                before = (2 * before + present) % 1024
                self.listed += [height] * present
        prediction = [[-128 if feature < 2 else 0] * 8 for feature in range(16)]
        activity, first = [16] * 11 + [64], 40
        for level in range(levels):
            if level == 0 or flag():
                if self.adaptive:
                    for row in prediction:
                        for c in range(8):
                            row[c] = wrap((row[c - 1] if c else row[0]) + 8 * number("weight"), 16)
                activity = [wrap(weight + number("weight"), 16) for weight in activity]
                first = clamp(first + number("number"), 0, 128)
                tables = []
                for context in range(32):
                    if context == 0 or not decisions.decide(contexts["same"]):
                        tables.append(slots_of(read_frequencies(decisions, contexts)))
                    else:
                        tables.append(tables[-1])
                group = [row[:] for row in prediction], activity, first, tables
            self.levels.append(group)


def slots_of(frequencies):
    slots, first = [], 0
    for symbol, frequency in enumerate(frequencies):
        slots += [(symbol, frequency, first)] * frequency
        first += frequency
    return slots


# Coefficients.


class Symbols:
    """The coefficients of a block in the order of their entries, coded or not."""

    def __init__(self, block):
        self.lanes = 8 if len(block) >= 448 else 4 if len(block) >= 256 else 2
        self.head, self.raw, self.block = [block, 0], [block[::-1], 0], block
        lengths = ((self.bits(self.head, 4) + 11) for _ in range(self.lanes))
        self.states = [1 << n | self.bits(self.head, n) for n in lengths]
        self.word, self.entry = (self.head[1] + 7) // 8, 0

    @staticmethod
    def bits(source, count):
        data, start = source
        source[1] += count
        padded = data[start // 8 : (start + count + 7) // 8 + 1].ljust(8, b"\0")
        word = int.from_bytes(padded, "big")
        return word >> 8 * len(padded) - start % 8 - count & (1 << count) - 1

    def skip(self):
        self.entry += 1
        return 0

    def next(self, slots):
        lane = self.entry % self.lanes
        self.entry += 1
        x = self.states[lane]
        symbol, frequency, first = slots[x & 2047]
        x = frequency * (x >> 11) + (x & 2047) - first
        if x < 2048:
            x = x << 16 | int.from_bytes(self.block[self.word : self.word + 2], "little")
            self.word += 2
        self.states[lane] = x
        if symbol < 31:
            return signed(symbol + 1)
        if symbol == 255:
            return wrap(self.bits(self.raw, 32))
        count = (symbol - 31) // 8 + 2
        magnitude = 4 + (symbol - 31) // 2 % 4 << count | self.bits(self.raw, count)
        return -magnitude if (symbol - 31) % 2 else magnitude


class Surroundings:
    """What is known of a diamond's centres, row by row."""

    def __init__(self, cells, vertices, group):
        self.cells, self.group = cells, group
        low, high = min(vertices.values()), max(vertices.values())
        self.narrow = high - low <= 16382
        self.reach, self.limit = (8191, 32767) if self.narrow else (2**26 - 1, 2**28 - 1)
        self.base, self.shift = low + high >> 1, 0
        while high - low >> self.shift > 2 * self.reach:
            self.shift += 1
        inside = lambda k: clamp(k, 0, cells)
        around = [(i, j) for j in range(-1, cells + 2) for i in range(-1, cells + 2)]
        self.v = {(i, j): self.relative(vertices[inside(i), inside(j)]) for i, j in around}
        zeros = [0] * (cells + 4)
        self.missed, self.missed_twice, self.above = zeros, zeros, None

    def relative(self, height):
        return clamp(height - self.base >> self.shift, -self.reach, self.reach)

    def sat(self, value):
        return clamp(value, -self.limit - 1, self.limit)

    def total(self, value):
        return wrap(value) if self.narrow else value

    def look(self, i, j):
        """Context, prediction, and what order 4 expects in quarters."""
        v, sat = self.v, self.sat
        at = lambda row, column: v[i - 1 + column, j - 1 + row]
        a, b, d, e = at(1, 1), at(1, 2), at(2, 1), at(2, 2)
        s = a + b + d + e
        beside = sat(at(1, 0) + at(2, 0) + at(1, 3) + at(2, 3) - s)
        over = sat(at(0, 1) + at(0, 2) + at(3, 1) + at(3, 2) - s)
        corners = sat(at(0, 0) + at(0, 3) + at(3, 0) + at(3, 3) - s)
        diagonal = a + e - b - d
        outer = sat(at(0, 0) + at(3, 3) - at(0, 3) - at(3, 0))
        ring = sat(beside + over)
        bend = -(ring >> 3)
        low, high = min(a, b, d, e), max(a, b, d, e)
        lowest, highest = sat(4 * low - s), sat(4 * high - s)
        one, other = abs(a - e), abs(b - d)
        sign = (other > one) - (other < one)
        missed = lambda back: self.missed[i + 2 + back]
        twice = lambda back: self.missed_twice[i + 2 + back]
        step = followed = 0
        if self.above:
            centre = sat(4 * self.above[i] - s)
            ends = sat(4 * max(min(a, b), min(d, e)) - s), sat(4 * min(max(a, b), max(d, e)) - s)
            step, followed = clamp(centre, min(ends), max(ends)), clamp(centre, lowest, highest)
        features = [beside, over, corners, diagonal, outer, missed(-1), missed(0), missed(1), twice(0)]
        features += [sat(s - 2 * (low + high)), diagonal * sign, clamp(bend, -abs(diagonal), abs(diagonal))]
        features += [clamp(bend, lowest, highest), step, followed, sat(missed(-2) + missed(2))]

        size = lambda value: min(abs(value), self.limit)
        summed = lambda values: min(sum(values), self.limit)
        pairs = [(a, at(1, 0)), (d, at(2, 0)), (b, at(1, 3)), (e, at(2, 3))]
        pairs += [(a, at(0, 1)), (b, at(0, 2)), (d, at(3, 1)), (e, at(3, 2))]
        bends = [at(1, 0) + at(1, 3) - a - b, at(2, 0) + at(2, 3) - d - e]
        bends += [at(0, 1) + at(3, 1) - a - d, at(0, 2) + at(3, 2) - b - e]
        parts = [one, other, abs(diagonal), size(ring), summed([abs(p - q) for p, q in pairs])]
        parts += [summed(map(size, bends)), size(missed(0)), summed([size(missed(-1)), size(missed(1))])]
        parts += [summed(map(size, [twice(0), twice(-1), twice(1), missed(-2), missed(2)])), 0, 0, 16]

        prediction, weights, first, _ = self.group
        activity = self.total(sum(part * weight for part, weight in zip(parts, weights)))
        activity = clamp(activity, 1, 2**31 - 1)
        quarter = (struct.unpack("<I", struct.pack("<f", activity))[0] >> 21) - 508
        context = clamp(quarter - first, 0, 31)
        total = (s << 10) + 2048 + sum(f * row[context // 4] for f, row in zip(features, prediction))
        predicted = wrap(self.base + (self.total(total) >> 12 << self.shift))
        return context, predicted, sat(s + bend)

    def complete(self, heights, expected):
        self.above = [self.relative(height) for height in heights]
        self.push([self.sat(4 * h - x) for h, x in zip(self.above, expected)])

    def complete_coefficients(self, coefficients, step):
        sizes = (4 * k * step >> self.shift for k in coefficients)
        self.push([clamp(size, -self.limit, self.limit) for size in sizes])

    def push(self, missed):
        self.missed, self.missed_twice = [0, 0, *missed, 0, 0], self.missed


def fixed_rule(cells, vertices, i, j):
    near = sum(vertices[i + a, j + b] for a in (0, 1) for b in (0, 1))
    far = [(a, b) for a in range(-1, 3) for b in range(-1, 3) if (a in (0, 1)) != (b in (0, 1))]
    if 1 <= i < cells - 1 and 1 <= j < cells - 1:
        return 10 * near - sum(vertices[i + a, j + b] for a, b in far) + 16 >> 5
    return near + 2 >> 2


def decode_centres(cells, quantiser, adaptive, group, vertices, coded, block):
    """Heights of the N^2 centres; `coded` says which have coefficients."""
    surroundings, symbols = Surroundings(cells, vertices, group), Symbols(block) if block else None
    centres = {}
    for j in range(cells):
        looks = [surroundings.look(i, j) for i in range(cells)]
        row = [0] * cells
        for i, (context, _, _) in enumerate(looks if symbols else ()):
            row[i] = symbols.next(group[3][context]) if coded[i, j] else symbols.skip()
        predicted = [look[1] if adaptive else fixed_rule(cells, vertices, i, j) for i, look in enumerate(looks)]
        heights = [quantiser.reconstruct(k, p) for k, p in zip(row, predicted)]
        centres.update(((i, j), height) for i, height in enumerate(heights))
        if adaptive:
            surroundings.complete(heights, [look[2] for look in looks])
        else:
            surroundings.complete_coefficients(row, quantiser.step)
    return centres


def split_mask(block):
    """The bytes of the void mask, if there is one, and the rest."""
    length, place = 0, 0
    while True:
        length |= (block[place] & 127) << 7 * place
        place += 1
        if block[place - 1] < 128:
            break
    if length == 0:
        return None, block[place:]
    return block[place : place + length - 1], block[place + length - 1 :]


def decode_mask(cells, valid, codable, data):
    """Which centres are void."""
    decisions, contexts, voids = Decisions(data), Contexts(), set()
    for j in range(cells):
        for i in range(cells):
            if codable[i, j]:
                corners = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)]
                before = [(i - 1, j), (i, j - 1), (i + 1, j - 1)]
                bits = [not valid[at] for at in corners] + [at in voids for at in before]
                if decisions.decide(contexts[tuple(bits)]):
                    voids.add((i, j))
    return voids


# The lattice.


class Lattice:
    """In samples. A diamond is (level, x, y) with the centre's coordinates doubled, as they may be halves."""

    def __init__(self, header):
        self.cells, self.levels = 1 << header.n, header.levels
        self.last = (2 * (header.width - 1), 2 * (header.height - 1))
        self.side = 2 * self.cells << self.levels // 2

    def half(self, level):
        return self.side >> level // 2 + 1

    def exists(self, level, x, y):
        if not (0 <= x <= self.side and 0 <= y <= self.side):
            return False
        beyond = max(x - self.last[0], 0), max(y - self.last[1], 0)
        if level % 2:
            return sum(beyond) < self.half(level) and not (x % self.side == 0 and y % self.side == 0)
        return max(beyond) < self.half(level)

    @functools.cache
    def diamonds(self, level):
        half = self.half(level)
        count = self.side // half
        if level % 2:
            places = [(x, y) for y in range(count + 1) for x in range(count + 1) if (x + y) % 2]
            centres = {(x, y): (x * half, y * half) for x, y in places}
        else:
            places = [(x, y) for y in range(count // 2) for x in range(count // 2)]
            centres = {(x, y): ((2 * x + 1) * half, (2 * y + 1) * half) for x, y in places}
        morton = lambda at: sum((at[0] >> k & 1) << 2 * k | (at[1] >> k & 1) << 2 * k + 1 for k in range(32))
        return [centres[at] for at in sorted(places, key=morton) if self.exists(level, *centres[at])]

    def placement(self, level, x, y):
        """Origin and steps of the vertex matrix, doubled."""
        a = 2 * self.half(level)
        if level % 2:
            step = a // (2 * self.cells)
            return (x - a // 2, y), (step, -step), (step, step)
        step = a // self.cells
        return (x - a // 2, y - a // 2), (step, 0), (0, step)

    def halves(self, level, x, y):
        """For each half: whether it is present, and a test of (i, j) in a matrix that ends at `last`."""
        n = self.cells
        origin, ax, ay = self.placement(level, x, y)
        corner = lambda i, j: tuple(o + i * n * p + j * n * q for o, p, q in zip(origin, ax, ay))
        sides = {
            (0, 0): lambda i, j, last: i + j <= last,
            (1, 1): lambda i, j, last: i + j >= last,
            (1, 0): lambda i, j, last: i >= j,
            (0, 1): lambda i, j, last: j >= i,
        }
        if level == 0:
            return [(True, sides[1, 0]), (True, sides[0, 1])]
        is_apex = self.level_of(corner(0, 0)) == level - 1
        apexes = [(0, 0), (1, 1)] if is_apex else [(1, 0), (0, 1)]
        return [(self.exists(level - 1, *corner(*apex)), sides[apex]) for apex in apexes]

    def level_of(self, at):
        zeros = [((c & -c).bit_length() - 1) if c else 99 for c in at]
        finest = self.side.bit_length() - 2 - min(zeros)
        return 2 * finest + (zeros[0] != zeros[1])


def decode(data):
    """Samples by (column, row), None where void."""
    header = Header(data)
    lattice, model = Lattice(header), Model(header.tables, header.levels)
    cells, side = lattice.cells, (1 << header.n) + 1
    listed = Quantiser(header.bound, header.range, model.listed)
    scale = 1 << header.levels // 2
    in_raster = lambda i, j: 0 <= i < header.width and 0 <= j < header.height
    root, valid = decode_root(header, lambda i, j: in_raster(i * scale, j * scale))
    # Heights by doubled place, and which places are valid.
    heights = {(2 * i * scale, 2 * j * scale): height for (i, j), height in root.items()}
    known = {(2 * i * scale, 2 * j * scale) for i, j in valid}
    rank = 0
    for level in range(header.levels):
        group, found = model.levels[level], {}
        for x, y in lattice.diamonds(level):
            halves = lattice.halves(level, x, y)
            (ox, oy), ax, ay = lattice.placement(level, x, y)
            place = lambda i, j: (ox + i * ax[0] + j * ay[0], oy + i * ax[1] + j * ay[1])
            middle = lambda i, j: tuple(p + (q + r) // 2 for p, q, r in zip(place(i, j), ax, ay))
            present = lambda i, j, last: any(here and holds(i, j, last) for here, holds in halves)
            main = halves[0][1](cells, 0, cells) and halves[0][1](cells, cells, cells)
            vertices, validity = {}, {}
            for j in range(side):
                for i in range(side):
                    mirrored = (j, i) if main else (cells - j, cells - i)
                    at = place(i, j) if present(i, j, cells) else place(*mirrored)
                    vertices[i, j], validity[i, j] = heights[at], at in known
            inside = lambda i, j: in_raster(*(c / 2 for c in middle(i, j)))
            matrix = [(i, j) for j in range(cells) for i in range(cells)]
            codable = {at: present(*at, cells - 1) and inside(*at) for at in matrix}
            block, voids = header.block(rank), set()
            rank += 1
            if header.voids and block:
                mask, block = split_mask(block)
                voids = decode_mask(cells, validity, codable, mask) if mask is not None else set()
            elif header.voids and not any(validity.values()):
                voids = set(matrix)
            coded = {at: codable[at] and at not in voids for at in matrix}
            centres = decode_centres(cells, listed, model.adaptive, group, vertices, coded, block)
            for at, height in centres.items():
                if present(*at, cells - 1):
                    found[middle(*at)] = height
                    if coded[at]:
                        known.add(middle(*at))
        heights.update(found)
    samples = []
    for row in range(header.height):
        for column in range(header.width):
            at = 2 * column, 2 * row
            samples.append(to_sample(header, heights[at]) if at in known else float("nan"))
    return samples


def to_sample(header, unit):
    sample = clamp(unit * header.scale + header.offset, header.low, header.high)
    return struct.unpack("<f", struct.pack("<f", sample))[0] if header.sample_type == 6 else sample


if __name__ == "__main__":
    with open(sys.argv[1], "rb") as file:
        decoded = decode(file.read())
    with open(sys.argv[2], "wb") as file:
        file.write(struct.pack(f"<{len(decoded)}d", *decoded))
