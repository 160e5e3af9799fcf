"""Naive structures of the literature: quadtrees, octrees, bintrees, trees of edges and points,
chain codes. Each follows the text of its paper, with pointers and recursion.

Cells are arrays of integers, by rows from the north (y, x), or by sections (z, y, x). VOID is 0.
Child numbers have x in the lowest bit: NW, NE, SW, SE.
"""

from collections import Counter
from fractions import Fraction
from itertools import product
from math import floor

import numpy as np

VOID, FULL = 0, 255


class UndefinedTie(Exception):
    """The literature does not define this representative, and neither does the documentation."""


class Node:
    """Block: of one value, or divided, with a representative value."""

    def __init__(self, value, children=(), path=""):
        self.value, self.children, self.path = int(value), children, path

    def preorder(self):
        yield self
        for child in self.children:
            yield from child.preorder()


def depth_of(shape):
    return max(int(max(shape) - 1).bit_length(), 0)


def padded(cells, depth):
    space = np.zeros((1 << depth,) * cells.ndim, cells.dtype)
    space[tuple(slice(0, size) for size in cells.shape)] = cells
    return space


def parts(block):
    """Returns the quarters or octants of a block, in child order."""
    half = block.shape[0] // 2
    return [block[tuple(slice(bit * half, (bit + 1) * half) for bit in bits)] for bits in product((0, 1), repeat=block.ndim)]


def build(cells, rule="majority", depth=None):
    """Builds the quadtree or octree with the fewest nodes."""

    def node(block, path):
        if (block == block.flat[0]).all():
            return Node(block.flat[0], path=path)
        children = [node(part, f"{path}{number}") for number, part in enumerate(parts(block))]
        return Node(representative(block, children, rule), children, path)

    return node(padded(cells, depth_of(cells.shape) if depth is None else depth), "")


def representative(block, children, rule):
    inside = block[block != VOID].astype(np.int64)
    filled = [child for child in children if child.value != VOID]
    if rule == "mean":
        return floor(Fraction(int(inside.sum()), len(inside)) + Fraction(1, 2))
    if rule == "occupancy":
        return floor(Fraction(int(block.astype(np.int64).sum()), block.size) + Fraction(1, 2))
    if rule in ("min", "max"):
        return getattr(inside, rule)()
    if rule == "nearest":
        return filled[0].value
    if rule == "dominant":
        votes = Counter()
        for child in filled:
            votes[child.value] += 2 if child.children else 3
    else:
        votes = Counter(inside.tolist())
    best = max(votes.values())
    tied = [value for value, count in votes.items() if count == best]
    if len(tied) == 1:
        return tied[0]
    for child in filled:
        if child.value in tied:
            return child.value
    raise UndefinedTie


def level(cells, number, rule, depth=None):
    """Returns the values of a level's blocks, over the extent of the cells."""
    depth = depth_of(cells.shape) if depth is None else depth
    side = 1 << depth - number
    space = np.zeros((1 << number,) * cells.ndim, int)

    def fill(node, corner, width):
        if not node.children or width == 1:
            space[tuple(slice(at, at + width) for at in corner)] = node.value
            return
        half = width // 2
        for bits, child in zip(product((0, 1), repeat=cells.ndim), node.children):
            fill(child, [at + bit * half for at, bit in zip(corner, bits)], half)

    fill(build(cells, rule, depth), [0] * cells.ndim, 1 << number)
    return space[tuple(slice(0, -(-size // side)) for size in cells.shape)]


def symbol(value, black, white):
    if value in (VOID, FULL):
        return white if value == VOID else black
    return str(value) if value < 10 else f"[{value}]"


def df_expression(tree, axes):
    inner, black, white = ("G", "B", "W") if axes == 2 else ("M", "F", "V")
    return "".join(inner if node.children else symbol(node.value, black, white) for node in tree.preorder())


def cells_of_df(text, depth, axes):
    """Returns the cells of a DF-expression with one letter for each node."""
    symbols = iter(text)
    space = np.zeros((1 << depth,) * axes, np.uint8)

    def node(block):
        letter = next(symbols)
        if letter in "GM":
            for part in parts(block):
                node(part)
        else:
            block[...] = FULL if letter in "BF" else VOID if letter in "WV" else int(letter)

    node(space)
    assert next(symbols, None) is None, text
    return space


def fd_code(path, axes):
    """Returns path bits from bit 62 down, with the level in the lowest five bits."""
    code = 0
    for number, digit in enumerate(path, 1):
        code |= int(digit) << 63 - axes * number
    return code | len(path)


def goblin_table(tree):
    """Returns records of children's values (INNER ones negative, VOID None), and the link: the
    record that follows the node's detail."""
    inner = [node for node in tree.preorder() if node.children]
    rows = []
    for number, node in enumerate(inner, 1):
        below = sum(bool(other.children) for other in node.preorder())
        values = [-child.value if child.children else child.value or None for child in node.children]
        rows.append([number, *values, number + below])
    return rows


def autumnal_table(tree):
    """Returns records of children (record numbers, or LEAF values, negative), and the node's own
    value."""
    inner = [node for node in tree.preorder() if node.children]
    numbers = {id(node): number for number, node in enumerate(inner, 1)}
    rows = []
    for node in inner:
        fields = [numbers[id(child)] if child.children else -child.value or None for child in node.children]
        rows.append([numbers[id(node)], *fields, node.value])
    return rows


# Bintrees.


def alternating_bintree(cells):
    """Returns symbols in preorder: blocks are halved along x, y (z) and x again."""
    inner, black, white = ("G", "B", "W") if cells.ndim == 2 else ("M", "F", "V")

    def node(block, turn):
        if (block == block.flat[0]).all():
            return symbol(int(block.flat[0]), black, white)
        halves = np.split(block, 2, axis=cells.ndim - 1 - turn)
        return inner + "".join(node(half, (turn + 1) % cells.ndim) for half in halves)

    return node(padded(cells, depth_of(cells.shape)), 0)


def fewest_nodes(cells):
    """Returns the number of nodes of the smallest bintree, by dynamic programming on all blocks."""
    known = {}

    def nodes(block, key):
        if key not in known:
            if (block == block.flat[0]).all():
                known[key] = 1
            else:
                counts = []
                for axis in range(cells.ndim):
                    if block.shape[axis] > 1:
                        low, size = key[axis]
                        halves = np.split(block, 2, axis=axis)
                        keys = [(*key[:axis], (low + number * size // 2, size // 2), *key[axis + 1 :]) for number in (0, 1)]
                        counts.append(1 + sum(map(nodes, halves, keys)))
                known[key] = min(counts)
        return known[key]

    space = padded(cells, depth_of(cells.shape))
    return nodes(space, tuple((0, size) for size in space.shape))


def cells_of_adaptive(symbols, depth, axes):
    """Returns the cells of a bintree whose inner nodes are named for their axes, and its number of
    nodes."""
    space, at = np.zeros((1 << depth,) * axes, np.uint8), 0

    def node(block):
        nonlocal at
        letter = symbols[at]
        at += 1
        if letter in "XYZ":
            halves = np.split(block, 2, axis=axes - 1 - "XYZ".index(letter))
            return 1 + sum(map(node, halves))
        if letter == "[":
            end = symbols.index("]", at)
            block[...], at = int(symbols[at:end]), end + 1
        else:
            block[...] = FULL if letter in "BF" else VOID if letter in "WV" else int(letter)
        return 1

    count = node(space)
    assert at == len(symbols), symbols
    return space, count


# Trees of edges.


def meets(edge, corner, side):
    """Returns whether an edge has a point in a block, which includes its minimum sides only."""
    low, high, low_open, high_open = Fraction(0), Fraction(1), False, False
    for a, b, least in zip(*edge, corner):
        if a == b:
            if not least <= a < least + side:
                return False
            continue
        enter, leave = Fraction(least - a, b - a), Fraction(least + side - a, b - a)
        enter_open, leave_open = False, True
        if b < a:
            enter, leave, enter_open, leave_open = leave, enter, True, False
        if (enter, enter_open) > (low, low_open):
            low, low_open = enter, enter_open
        if (leave, not leave_open) < (high, not high_open):
            high, high_open = leave, leave_open
    return low < high or (low == high and not low_open and not high_open)


def may_stay(rule, edges, corner, side):
    """Returns whether a block with these edges needs no division (Samet and Webber)."""

    def is_inside(vertex):
        return all(least <= at < least + side for at, least in zip(vertex, corner))

    vertices = {vertex for edge in edges for vertex in edge if is_inside(vertex)}
    common = set.intersection(*map(set, edges)) if edges else set()
    is_one_fan = len(vertices) == 1 and vertices <= common
    if rule.startswith("bucket"):
        return len(edges) <= int(rule[6:]) or is_one_fan
    if rule == "pm3" or not edges:
        return len(vertices) <= 1
    if vertices:
        return is_one_fan
    return len(edges) == 1 or (rule == "pm2" and bool(common))


def edge_tree(edges, depth, rule):
    """Returns the DF-expression, and the leaves with edges: corner, side, set of edges."""
    axes = len(edges[0][0])
    inner, black, white = ("G", "B", "W") if axes == 2 else ("M", "F", "V")
    text, leaves = [], []

    def node(edges, corner, side):
        edges = [edge for edge in edges if meets(edge, corner, side)]
        if side > 1 and not may_stay(rule, edges, corner, side):
            text.append(inner)
            for bits in product((0, side // 2), repeat=axes):
                node(edges, tuple(at + bit for at, bit in zip(corner, reversed(bits))), side // 2)
            return
        text.append(black if edges else white)
        if edges:
            leaves.append((corner, side, {tuple(sorted(edge)) for edge in edges}))

    node(sorted({tuple(sorted(edge)) for edge in edges}), (0,) * axes, 1 << depth)
    return "".join(text), leaves


# Trees of points.

QUARTERS = ["NW", "NE", "SW", "SE"]
OCTANTS = [f"{quarter} {height}" for height in ("below", "above") for quarter in QUARTERS]
HALVES = [("W", "E"), ("N", "S"), ("below", "above")]


def divided_points(points, is_k_d):
    """Inserts points in their order (Finkel and Bentley; Bentley); returns rows of depth, side,
    point and count, in preorder."""
    root, axes = None, len(points[0])

    def side(depth, node, point):
        # (A point on a dividing line is in the east, in the north or above.)
        bits = [point[0] >= node[0], point[1] < node[1], *(a >= b for a, b in zip(point[2:], node[2:]))]
        return int(bits[depth % axes]) if is_k_d else sum(bit << axis for axis, bit in enumerate(bits))

    for point in points:
        if root is None:
            root = [point, 1, {}]
            continue
        node, depth = root, 0
        while node[0] != point:
            number = side(depth, node[0], point)
            node, depth = node[2].setdefault(number, [point, 0, {}]), depth + 1
        node[1] += 1

    def rows(node, depth, name):
        yield depth, name, node[0], node[1]
        for number in sorted(node[2]):
            names = HALVES[depth % axes] if is_k_d else QUARTERS if axes == 2 else OCTANTS
            yield from rows(node[2][number], depth + 1, names[number])

    return list(rows(root, 0, "root"))


# Components and chain codes.


def components(cells, corners):
    """Returns the number of each cell's component, from 1, in the order of their first cells in
    child order; cells are neighbours across sides, or also across corners."""
    steps = [step for step in product((-1, 0, 1), repeat=cells.ndim) if any(step) and (corners or sum(map(abs, step)) == 1)]
    labels = np.zeros(cells.shape, int)
    depth = depth_of(cells.shape)

    def order(cell):
        return sum((at >> bit & 1) << cells.ndim * bit + axis for axis, at in enumerate(reversed(cell)) for bit in range(depth))

    count = 0
    for start in sorted(np.ndindex(cells.shape), key=order):
        if cells[start] == VOID or labels[start]:
            continue
        count += 1
        labels[start], pending = count, [start]
        while pending:
            cell = pending.pop()
            for step in steps:
                other = tuple(a + b for a, b in zip(cell, step))
                if all(0 <= at < size for at, size in zip(other, cells.shape)) and not labels[other] and cells[other] == cells[start]:
                    labels[other] = count
                    pending.append(other)
    return labels


FOUR = [(1, 0), (0, -1), (-1, 0), (0, 1)]
EIGHT = [(1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1)]


def cells_of_chains(text):
    """Returns the cells of a chain code file, each chain by its definition."""
    words = text.split()
    directions = FOUR if words[words.index("directions") + 1] == "4" else EIGHT
    at = words.index("size")
    columns, rows = int(words[at + 1]), int(words[at + 2])
    cells = np.zeros((rows, columns), np.uint8)
    begin = min(words.index(word) for word in ("region", "line", "end") if word in words)
    chains, keyword = [], None
    for word in words[begin:]:
        if word.isalpha():
            keyword = [word]
            chains.append(keyword)
        else:
            keyword.append(word)
    inside, value, on = None, None, None

    def paint():
        if inside is not None:
            cells[inside | on] = value

    for word, *numbers in chains:
        if word in ("region", "line", "end"):
            paint()
            if word == "end":
                break
            value, numbers = int(numbers[0]), numbers[1:]
            inside, on = np.zeros(cells.shape, bool), np.zeros(cells.shape, bool)
        x, y = int(numbers[0]), int(numbers[1])
        path = [(x, y)]
        for digit in "".join(numbers[2:]):
            dx, dy = directions[int(digit)]
            x, y = x + dx, y + dy
            path.append((x, y))
        if directions is EIGHT:
            for column, row in path:
                on[row, column] = True
        assert word == "line" or path[0] == path[-1], "a chain that is not closed"
        if word != "line":
            # Rays to the west, along the middles of cells or slightly below rows of centres.
            shift = 0.5 if directions is FOUR else 1e-3
            for (x0, y0), (x1, y1) in zip(path, path[1:]):
                if y0 != y1:
                    row = min(y0, y1)
                    if row < rows:
                        cross = x0 + (x1 - x0) * abs(row + shift - y0)
                        inside[row, [column + (0.5 if directions is FOUR else 0) > cross for column in range(columns)]] ^= True
    return cells


def crack_chains(cells):
    """Returns a chain code file with 4 directions: the sides of each region, with it on the
    left."""
    labels = components(cells, False)
    lines = ["freeman-chain-code 1", "directions 4", f"size {cells.shape[1]} {cells.shape[0]}"]
    for label in range(1, labels.max() + 1):
        own = np.pad(labels == label, 1)
        sides = {}
        for row, column in zip(*np.nonzero(own)):
            x, y = int(column) - 1, int(row) - 1
            for digit, start, (dx, dy) in ((0, (x, y + 1), (0, 1)), (1, (x + 1, y + 1), (1, 0)), (2, (x + 1, y), (0, -1)), (3, (x, y), (-1, 0))):
                if not own[row + dy, column + dx]:
                    sides.setdefault(start, []).append(digit)
        loops = []
        while sides:
            start = min(sides, key=lambda corner: (corner[1], corner[0]))
            at, digit, chain, area = start, sides[start][0], "", 0
            while True:
                here = sides[at]
                # At a corner with two sides, the left turn stays at the same cell.
                digit = next(turn for turn in ((digit + 1) % 4, digit, (digit + 3) % 4) if turn in here) if chain else here[0]
                here.remove(digit)
                if not here:
                    del sides[at]
                dx, dy = FOUR[digit]
                area += at[1] * dx
                at, chain = (at[0] + dx, at[1] + dy), chain + str(digit)
                if at == start and not (at in sides and (int(chain[-1]) + 1) % 4 in sides[at]):
                    break
            loops.append((area < 0, start, chain))
        value = int(cells[labels == label][0])
        for is_hole, (x, y), chain in sorted(loops, key=lambda loop: loop[0]):
            lines.append(f"{'hole' if is_hole else f'region {value}'} {x} {y}\n{chain}")
    return "\n".join([*lines, "end"]) + "\n"
