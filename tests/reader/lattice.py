"""The diamonds of docs/design.md."""

import functools


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
