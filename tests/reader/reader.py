"""A second reader of repositories of heights, after docs/format.md and docs/design.md alone. Slow, checks nothing, and needs
nothing but Python 3.

    python3 reader.py FILE.kmb SAMPLES.f64

writes the decoded samples row by row as little-endian doubles, NaN where void, and where the finer detail is missing
that a sample needs."""

import struct
import sys

from lattice import Lattice
from transforms import TRANSFORMS, clamp, wrap


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


class Header:
    def __init__(self, data):
        assert data[:8] == b"\x89KMB\r\n\x1a\n"
        assert tuple(data[16:18]) == (0, 0), "only planar heights"
        self.transform, self.is_rans = data[18], data[19] == 1
        self.n, self.levels, self.sample_type = data[20], data[21], data[22]
        self.unit_length = data[26]
        self.width, self.height, self.bound, low, high = struct.unpack_from("<IIIii", data, 28)
        self.range = (-(2**31), 2**31 - 1) if self.transform == 1 else (low, high)
        self.scale, self.offset, self.low, self.high = struct.unpack_from("<4d", data, 48)
        self.voids, self.blocks = struct.unpack_from("<2Q", data, 184)
        sections = [struct.unpack_from("<2Q", data, 208 + 16 * k) for k in range(5)]
        _, self.roots, self.tables, self.index, self.payload = [data[a : a + n] for a, n in sections]

    def block(self, rank):
        page = self.index[364 * (rank // 64) :]
        count = min(64, self.blocks - rank // 64 * 64)
        base = struct.unpack_from("<Q", page)[0]
        stored = struct.unpack_from(f"<{count}H", page, 8)
        if stored[rank % 64] == 0xFFFF:
            return None
        lengths = [self.unit_length * n % (0xFFFF * self.unit_length) for n in stored]
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
    """Weights and tables of each matrix on each level."""

    def __init__(self, data, levels, matrices):
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
        group = [(prediction, [16] * 11 + [64], 40, None)] * matrices
        for level in range(levels):
            if level == 0 or flag():
                group = [self.read_matrix(known, decisions, contexts, number) for known in group]
            self.levels.append(group)

    def read_matrix(self, known, decisions, contexts, number):
        prediction, activity, first, _ = known
        prediction = [row[:] for row in prediction]
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
        return prediction, activity, first, tables


def slots_of(frequencies):
    slots, first = [], 0
    for symbol, frequency in enumerate(frequencies):
        slots += [(symbol, frequency, first)] * frequency
        first += frequency
    return slots


# Coefficients.


def bits(source, count):
    """The next bits of a list of bytes and place, high bit of each byte first."""
    data, start = source
    source[1] += count
    padded = data[start // 8 : (start + count + 7) // 8 + 1].ljust(8, b"\0")
    word = int.from_bytes(padded, "big")
    return word >> 8 * len(padded) - start % 8 - count & (1 << count) - 1


class Symbols:
    """The coefficients of a block in the order of their entries, coded or not."""

    def __init__(self, block):
        self.lanes = 8 if len(block) >= 448 else 4 if len(block) >= 256 else 2
        self.head, self.raw, self.block = [block, 0], [block[::-1], 0], block
        lengths = ((bits(self.head, 4) + 11) for _ in range(self.lanes))
        self.states = [1 << n | bits(self.head, n) for n in lengths]
        self.word, self.entry = (self.head[1] + 7) // 8, 0

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
            return wrap(bits(self.raw, 32))
        count = (symbol - 31) // 8 + 2
        magnitude = 4 + (symbol - 31) // 2 % 4 << count | bits(self.raw, count)
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
        self.missed, self.missed_twice, self.companion, self.above = zeros, zeros, zeros, None

    def relative(self, height):
        return clamp(height - self.base >> self.shift, -self.reach, self.reach)

    def sat(self, value):
        return clamp(value, -self.limit - 1, self.limit)

    def total(self, value):
        return wrap(value) if self.narrow else value

    def look(self, i, j):
        """Context, predicted height, what order 4 expects in quarters, and a predicted detail in units times 2^10."""
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
        parts += [summed(map(size, [twice(0), twice(-1), twice(1), missed(-2), missed(2)]))]
        parts += [self.companion[i + 2], summed([self.companion[i + 1], self.companion[i + 3]]), 16]

        prediction, weights, first, _ = self.group
        activity = self.total(sum(part * weight for part, weight in zip(parts, weights)))
        activity = clamp(activity, 1, 2**31 - 1)
        quarter = (struct.unpack("<I", struct.pack("<f", activity))[0] >> 21) - 508
        context = clamp(quarter - first, 0, 31)
        higher = sum(f * row[context // 4] for f, row in zip(features, prediction))
        predicted = wrap(self.base + (self.total((s << 10) + 2048 + higher) >> 12 << self.shift))
        return context, predicted, sat(s + bend), self.total(higher) << self.shift >> 2

    def complete(self, heights, expected):
        self.above = [self.relative(height) for height in heights]
        self.push([self.sat(4 * h - x) for h, x in zip(self.above, expected)])

    def residuals(self, coefficients, step):
        return [clamp(4 * k * step >> self.shift, -self.limit, self.limit) for k in coefficients]

    def accompany(self, coefficients, step):
        self.companion = [0, 0, *map(abs, self.residuals(coefficients, step)), 0, 0]

    def complete_coefficients(self, coefficients, step):
        self.above = [0] * self.cells
        self.push(self.residuals(coefficients, step))

    def push(self, missed):
        self.missed, self.missed_twice = [0, 0, *missed, 0, 0], self.missed


def trained_centres(cells, quantiser, group, vertices, coded, block):
    """Heights of the N^2 centres by trained prediction; `coded` says which have coefficients."""
    surroundings, symbols = Surroundings(cells, vertices, group), Symbols(block) if block else None
    centres = {}
    for j in range(cells):
        looks = [surroundings.look(i, j) for i in range(cells)]
        row = [0] * cells
        for i, look in enumerate(looks if symbols else ()):
            row[i] = symbols.next(group[3][look[0]]) if coded[i, j] else symbols.skip()
        heights = [quantiser.reconstruct(k, look[1]) for k, look in zip(row, looks)]
        centres.update(((i, j), height) for i, height in enumerate(heights))
        surroundings.complete(heights, [look[2] for look in looks])
    return centres


def coefficients_of(cells, step, adaptive, groups, vertices, block):
    """What reads the matrices of a block in contexts, one after the other."""
    symbols, residuals = Symbols(block) if block else None, {}

    def read(matrix, coded):
        surroundings, entries = Surroundings(cells, vertices, groups[matrix]), {}
        for j in range(cells):
            if matrix == 1:
                surroundings.accompany([residuals[i, j] for i in range(cells)], step)
            row = [0] * cells
            for i in range(cells):
                context, _, _, detail = surroundings.look(i, j)
                residual = 0
                if symbols:
                    residual = symbols.next(groups[matrix][3][context]) if coded[i, j] else symbols.skip()
                if matrix == 0:
                    residuals[i, j] = residual
                if coded[i, j]:
                    row[i] = wrap(residual + ((detail + 512 * step) // (1024 * step) if adaptive else 0))
            surroundings.complete_coefficients(row, step)
            entries.update(((i, j), k) for i, k in enumerate(row))
        return entries

    return read


def gamma_of(cells, block):
    """What reads the matrices of a block of gamma codes, one after the other."""
    source = [block, 0]

    def entry():
        length = 0
        while bits(source, 1) == 0:
            length += 1
        return signed(1 << length | bits(source, length))

    def quadrant(entries, coded, x, y, side):
        places = [(x + i, y + j) for j in range(side) for i in range(side)]
        if not any(coded[at] for at in places) or bits(source, 1) == 0:
            return
        if side == 2:
            entries.update((at, entry()) for at in places if coded[at])
            return
        for j in (0, side // 2):
            for i in (0, side // 2):
                quadrant(entries, coded, x + i, y + j, side // 2)

    def read(matrix, coded):
        entries = dict.fromkeys(coded, 0)
        if block:
            quadrant(entries, coded, 0, 0, cells)
        return entries

    return read


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


class Terrain:
    """All heights of a repository, level by level."""

    def __init__(self, data):
        self.header = header = Header(data)
        self.lattice, self.cells = Lattice(header), 1 << header.n
        matrices = 2 if header.transform == 2 else 1
        self.model = Model(header.tables, header.levels, matrices) if header.is_rans else None
        self.quantiser = Quantiser(header.bound, header.range, self.model.listed if self.model else None)
        scale = 1 << header.levels // 2
        root, valid = decode_root(header, lambda i, j: self.in_raster(2 * i * scale, 2 * j * scale))
        # Heights by place in doubled samples, and the places of samples that are not void.
        self.heights = {(2 * i * scale, 2 * j * scale): height for (i, j), height in root.items()}
        self.known = {(2 * i * scale, 2 * j * scale) for i, j in valid}
        rank = 0
        for level in range(header.levels):
            found = {}
            for x, y in self.lattice.diamonds(level):
                found.update(self.refine(level, x, y, header.block(rank)))
                rank += 1
            self.heights.update(found)

    def in_raster(self, x, y):
        return 0 <= x < 2 * self.header.width and 0 <= y < 2 * self.header.height

    def refine(self, level, x, y, block):
        """Heights on the next level of a diamond's inner vertices and centres, by place."""
        cells, halves = self.cells, self.lattice.halves(level, x, y)
        (ox, oy), ax, ay = self.lattice.placement(level, x, y)
        place = lambda i, j: (ox + i * ax[0] + j * ay[0], oy + i * ax[1] + j * ay[1])
        middle = lambda i, j: tuple(p + (q + r) // 2 for p, q, r in zip(place(i, j), ax, ay))
        present = lambda i, j, last: any(here and holds(i, j, last) for here, holds in halves)
        has_main_hypotenuse = halves[0][1](cells, 0, cells) and halves[0][1](cells, cells, cells)

        def mirrored(i, j, last):
            if present(i, j, last):
                return i, j
            return (j, i) if has_main_hypotenuse else (last - j, last - i)

        corners = [(i, j) for j in range(cells + 1) for i in range(cells + 1)]
        matrix = [(i, j) for j in range(cells) for i in range(cells)]
        # Without its block, or without that of a parent.
        if block is None or any(place(*mirrored(*at, cells)) not in self.heights for at in corners):
            return {}
        vertices = {at: self.heights[place(*mirrored(*at, cells))] for at in corners}
        valid = {at: place(*mirrored(*at, cells)) in self.known for at in corners}
        codable = {at: present(*at, cells - 1) and self.in_raster(*middle(*at)) for at in matrix}
        voids, block = self.voids(valid, codable, block)
        coded = {at: codable[at] and at not in voids for at in matrix}
        vertices, centres = self.heights_of(level, vertices, valid, coded, mirrored, block)
        inner = [(i, j) for i, j in corners if 0 < i < cells and 0 < j < cells and present(i, j, cells)]
        found = {place(*at): vertices[at] for at in inner}
        found.update((middle(*at), centres[at]) for at in matrix if present(*at, cells - 1))
        self.known.update(middle(*at) for at in matrix if coded[at])
        return found

    def voids(self, valid, codable, block):
        """Which centres are void, and what else the block has."""
        if not self.header.voids:
            return set(), block
        if not block:
            return set() if any(valid.values()) else set(codable), block
        mask, block = split_mask(block)
        return set() if mask is None else decode_mask(self.cells, valid, codable, mask), block

    def heights_of(self, level, vertices, valid, coded, mirrored, block):
        """The vertices and centres on the next level."""
        cells, quantiser, read = self.cells, self.quantiser, gamma_of(self.cells, block)
        if self.model:
            groups = self.model.levels[level]
            if self.model.adaptive and self.header.transform == 0:
                return vertices, trained_centres(cells, quantiser, groups[0], vertices, coded, block)
            read = coefficients_of(cells, quantiser.step, self.model.adaptive, groups, vertices, block)
        transform = TRANSFORMS[self.header.transform]
        return transform(cells, quantiser, vertices, valid, coded, mirrored, read)

    def samples(self):
        """Row by row; NaN where void."""
        places = [(2 * c, 2 * r) for r in range(self.header.height) for c in range(self.header.width)]
        return [to_sample(self.header, self.heights[at]) if at in self.known else float("nan") for at in places]


def to_sample(header, unit):
    sample = clamp(unit * header.scale + header.offset, header.low, header.high)
    return struct.unpack("<f", struct.pack("<f", sample))[0] if header.sample_type == 6 else sample


if __name__ == "__main__":
    with open(sys.argv[1], "rb") as file:
        decoded = Terrain(file.read()).samples()
    with open(sys.argv[2], "wb") as file:
        file.write(struct.pack(f"<{len(decoded)}d", *decoded))
