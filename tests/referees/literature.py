#!/usr/bin/env python3
"""The worked examples and properties of docs/literature.md, computed by naive code (structures.py,
bodies.py) and by the program: of the papers' examples, and of random cells, lines, points and
solids. Other checks are in operations.py and solids.py.

    python tests/referees/literature.py PATH/TO/spinney [ITEM...]

Needs NumPy. Items that also need shapely or manifold3d are skipped, with a message, if these are
missing. Prints a line for each item with the number of its checks, and fails if a check does.
"""

import sys
from collections import Counter
from itertools import product
from math import floor

try:
    import numpy as np
except ImportError as missing:
    print(f"skipped: {missing}")
    sys.exit()

import structures as own
from harness import CLASSIC, DIRECTORY, build, cells_of, check_all, df, fresh, info, item, printed_df, rasters, run, same, transformed, write_off, write_table

# The tables of ten records.
GOBLIN = """-1 -1 1 -2 11; 1 -3 1 -3 5; 1 3 3 3 4; 3 3 1 2 5; -3 1 -2 -1 9
    3 1 3 3 7; 3 2 2 2 8; 1 1 2 2 9; 2 2 1 -1 11; 1 2 1 1 11"""
AUTUMNAL = """2 5 -1 9 1; -1 3 -1 4 1; -1 -3 -3 -3 3; -3 -3 -1 -2 3; 6 -1 7 8 1
    -3 -1 -3 -3 3; -3 -2 -2 -2 2; -1 -1 -2 -2 1; -2 -2 -1 10 2; -1 -2 -1 -1 1"""


def table(text):
    """Returns the rows of a dump; VOID is None."""
    return [[None if word == "." else int(word) for word in row.split()] for row in text.splitlines() if row]


def printed_table(text):
    """Returns the rows of a table above, numbered."""
    return [[number, *map(int, row.split())] for number, row in enumerate(text.replace("\n", ";").split(";"), 1)]


# The standard example of DF-expressions, with three letters that the print lacks.
STANDARD = "GWGWWBBGWGWBBBWBGBBGBBBWW"
OCTREE = "MVVVVFMVVVVVVVFFF"


# Slavík's survey: structures and codes.


@item("1 2 4 15 41: nodes, DF-expressions, merged neighbours")
def df_expressions():
    for text, axes, depth in ((STANDARD, 2, 3), (OCTREE, 3, 2)):
        tree = build(own.cells_of_df(text, depth, axes), kind="categorical" if axes == 2 else "continuous")
        # (B is printed in solids only, as F: as a class, black is the number 255.)
        same(printed_df(tree), text, text)
    same(np.count_nonzero(own.cells_of_df(OCTREE, 2, 3)), 25, "full cells of 64")
    for cells in [*rasters(1, 9), *rasters(2, 5, 3, 10), *rasters(3, 4, bound=70)]:
        same(printed_df(build(cells)), df(cells), "random", cells.tolist())
        # The same cells through the operation that condenses.
        same(printed_df(transformed("a.goblin")), df(cells), "condensed")


@item("5 6 7 8 9: codes of leaves")
def codes():
    def base_4(digits):
        return sum(digit * 4**place for place, digit in enumerate(reversed(digits)))

    def base_5(digits):
        return sum((digit + 1) * 5**place for place, digit in enumerate(reversed(digits)))

    same([base_4([1, 0, 2, 3]), base_4([0, 0, 0, 1, 0, 2, 3])], [75, 75], "base 4")
    same([base_5([1, 0, 2, 3]), base_5([0, 0, 0, 1, 0, 2, 3])], [294, 19669], "base 5")
    for digits in ([1, 0, 2, 3], [0, 0, 0, 1, 0, 2, 3]):
        depth = len(digits)
        x, y = (sum((digit >> axis & 1) << depth - 1 - place for place, digit in enumerate(digits)) for axis in (0, 1))
        cells = np.zeros((1 << depth, 1 << depth), np.uint8)
        cells[y, x] = 7
        path = "".join(map(str, digits))
        code = (75 << 63 - 2 * depth) | depth
        same(run("dump", build(cells), "--codes").split(), [f"/{path}", str(code), "7"], "code 75")
    figure = "000 100 110 120 130 200 210 211 212 213 220 230 300 310 320 321 322 323 330".split()
    rows = [row.split() for row in run("dump", build(own.cells_of_df(STANDARD, 3, 2)), "--codes").splitlines()]
    leaves = {row[0][1:].ljust(3, "0"): row[2] for row in rows}
    same(sorted(leaves), [path for path, letter in zip(figure, STANDARD.replace("G", "")) if letter == "B"], "black codes of the figure")
    for cells in [*rasters(4, 12, most=9), *rasters(5, 6, 3, 12)]:
        axes = cells.ndim
        leaves = [node for node in own.build(cells, "nearest").preorder() if not node.children and node.value]
        wanted = [[f"/{node.path}", str(own.fd_code(node.path, axes)), str(node.value)] for node in leaves]
        found = [row.split() for row in run("dump", build(cells), "--codes").splitlines() if row]
        same(found, wanted, "leaves", cells.tolist())
        numbers = [int(row[1]) for row in found]
        same(sorted(set(numbers)), numbers, "FD codes are in preorder")
        if axes == 2:
            fives = {}
            for path, _, _ in found:
                digits, k = [int(digit) for digit in path[1:]], len(path) - 1
                assert (5**k - 1) // 4 <= base_5(digits) <= 5**k - 1, path
                fives[base_5(digits)] = path
            same(len(fives), len(found), "codes in base 5 are unique")


@item("10: point quadtrees, point octrees, k-d trees")
def point_trees():
    rng = np.random.default_rng(10)
    for number, axes in product(range(6), (2, 3)):
        bound = (4, 30, 1000)[number % 3]
        points = [tuple(map(int, point)) for point in rng.integers(0, bound, (int(rng.integers(1, 80)), axes))]
        write_table("points.csv", "xyz"[:axes], points)
        run("build", "points.csv", "-o", fresh("p.goblin"), "--index", "points")
        for structure in ("k-d", "point-quadtree" if axes == 2 else "point-octree"):
            rows = [row.split("\t") for row in run("dump", "p.goblin", "--as", structure).splitlines()]
            read = [(int(depth), side, tuple(map(int, point.split(","))), int(count)) for depth, side, point, count in rows]
            same(Counter(dict((point, count) for _, _, point, count in read)), Counter(points), structure, "points")
            # Nodes that are inserted in preorder make the same tree.
            again = own.divided_points([point for _, _, point, count in read for _ in range(count)], structure == "k-d")
            same(read, again, structure)


def line_tree(edges):
    """Builds a tree of lines of two vertices each."""
    space = " Z" if len(edges[0][0]) == 3 else ""
    rows = [(f'"LINESTRING{space} ({", ".join(" ".join(map(str, end)) for end in edge)})"', number) for number, edge in enumerate(edges)]
    write_table("lines.csv", ["wkt", "n"], rows)
    run("build", "lines.csv", "-o", fresh("l.goblin"), "--index", "lines")
    return "l.goblin"


def compare_edge_trees(edges, depth, tree, rules):
    for rule in rules:
        options = ["--as", "bucket", "--leaf-size", rule[6:]] if rule.startswith("bucket") else ["--as", rule]
        expression, *rows = run("dump", tree, *options).splitlines()
        text, leaves = own.edge_tree(edges, depth, rule)
        same(expression, text, rule, edges)
        found = []
        for row in rows:
            corner, side, *ends = row.split("\t")
            pairs = {tuple(sorted(tuple(map(int, end.split(","))) for end in edge.split())) for edge in ends}
            found.append((tuple(map(int, corner.split(","))), int(side), pairs))
        same(found, leaves, rule, edges)


@item("11: PM1, PM2, PM3 and bucket quadtrees")
def edge_quadtrees():
    rng = np.random.default_rng(11)
    rules = ["pm1", "pm2", "pm3", "bucket1", "bucket2", "bucket5"]
    for depth in (2, 3, 4, 4, 5, 6, 7, 9):
        # Random edges and polylines, whose box is the space.
        vertices = [tuple(map(int, vertex)) for vertex in rng.integers(0, 1 << depth, (12, 2))]
        ends = [(0, 0), ((1 << depth) - 1,) * 2]
        vertices += ends
        edges = [(vertices[a], vertices[b]) for a, b in rng.integers(0, len(vertices), (7, 2)) if vertices[a] != vertices[b]]
        edges += [(ends[0], vertices[3]), (vertices[5], ends[1])]
        edges = [edge for edge in edges if edge[0] != edge[1]]
        compare_edge_trees(edges, depth, line_tree(edges), rules)
    # A fan: all edges of a vertex are in its leaf. A cross without a vertex is divided to the end.
    fan = [((8, 8), (end, 15)) for end in range(16)] + [((0, 0), (8, 8))]
    compare_edge_trees(fan, 4, line_tree(fan), rules)
    cross = [((0, 0), (15, 15)), ((0, 15), (15, 0))]
    compare_edge_trees(cross, 4, line_tree(cross), rules)


@item("12: octrees of edges")
def edge_octrees():
    rng = np.random.default_rng(12)
    for depth in (2, 3, 4, 5):
        vertices = [(0, 0, 0), ((1 << depth) - 1,) * 3] + [tuple(map(int, vertex)) for vertex in rng.integers(0, 1 << depth, (5, 3))]
        edges = [(a, b) for a, b in zip(vertices, vertices[1:]) if a != b]
        compare_edge_trees(edges, depth, line_tree(edges), ["pm1", "pm2", "pm3", "bucket3"])
    # The edges of a tetrahedron and of a box, as meshes.
    box = [tuple(7 * (number >> axis & 1) for axis in range(3)) for number in range(8)]
    box_faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    tetrahedron = [(0, 0, 0), (7, 1, 2), (2, 7, 3), (1, 3, 7)]
    for vertices, faces in ((box, box_faces), (tetrahedron, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])):
        edges = {tuple(sorted((vertices[a], vertices[b]))) for face in faces for a, b in zip(face, [*face[1:], face[0]])}
        write_off("mesh.off", vertices, faces)
        run("build", "mesh.off", "-o", fresh("l.goblin"), "--index", "lines")
        compare_edge_trees(sorted(edges), 3, "l.goblin", ["pm1"])


@item("13: bintrees, alternating and with the fewest nodes")
def bintrees():
    full = np.where(CLASSIC == 1, 255, 0)
    for cells in [CLASSIC, full, *rasters(13, 12, bound=17), *rasters(14, 6, 3, 9)]:
        tree = build(cells)
        head, symbols = run("dump", tree, "--as", "bintree").split()
        depth, size = own.depth_of(cells.shape), "x".join(map(str, cells.shape[::-1]))
        same(head, f"bintree:alternating:{'xyz'[: cells.ndim]}:{depth}:u8:{size}", "head")
        same(symbols, own.alternating_bintree(cells), "alternating", cells.tolist())
        head, symbols = run("dump", tree, "--as", "bintree", "--adaptive").split()
        space, count = own.cells_of_adaptive(symbols, depth, cells.ndim)
        same(space, own.padded(cells, depth), "cells of", symbols)
        same(count, own.fewest_nodes(cells), "nodes of", symbols)
    same(own.fewest_nodes(CLASSIC), 41, "nodes of the table")


@item("17: quadtrees of the pixels that lines and polygons touch", "shapely")
def touched():
    import shapely

    rng = np.random.default_rng(17)
    for number in range(10):
        vertices = np.round(rng.uniform(0.1, 15.9, (int(rng.integers(3, 7)), 2)), 3) + 1e-4
        if number % 2:
            shape = shapely.LineString(vertices)
        else:
            shape = shapely.convex_hull(shapely.MultiPoint(vertices))
        write_table("shapes.csv", ["wkt"], [(f'"{shape.wkt}"',)])
        run("build", "shapes.csv", "-o", fresh("a.goblin"), "--cell", 1, "--edge", "touch")
        found = cells_of("a.goblin")
        transform = info("a.goblin")["transform"]
        wanted = np.zeros(found.shape, np.uint8)
        for row, column in np.ndindex(wanted.shape):
            x, y = column * transform[0] + transform[2], row * transform[4] + transform[5]
            cut = shapely.intersection(shape, shapely.box(x, y - 1, x + 1, y))
            wanted[row, column] = (cut.length if number % 2 else cut.area) > 1e-9
        assert shapely.box(*np.ravel(info("a.goblin")["world"])).contains(shape)
        same(found, wanted, shape.wkt)
        same(printed_df("a.goblin"), df(wanted), "tree of", shape.wkt)


@item("18: chain codes")
def chain_codes():
    for cells in [CLASSIC, *rasters(18, 8, bound=24)]:
        tree = build(cells)
        if not cells.any():
            continue
        for directions, connect in ((4, 4), (8, 4), (4, 8), (8, 8)):
            run("export", tree, fresh("a.chain"), "--directions", directions, "--connect", connect)
            text = (DIRECTORY / "a.chain").read_text()
            same(own.cells_of_chains(text), cells, directions, "directions", connect, "neighbours", text)
            run("build", "a.chain", "-o", fresh("b.goblin"))
            same(run("dump", "b.goblin", "--codes"), run("dump", tree, "--codes"), "again", text)
        (DIRECTORY / "own.chain").write_text(own.crack_chains(cells))
        run("build", "own.chain", "-o", fresh("b.goblin"))
        same(run("dump", "b.goblin", "--codes"), run("dump", tree, "--codes"), "own chain", own.crack_chains(cells))
    rng = np.random.default_rng(19)
    tree = build(np.ones((20, 30), np.uint8))
    for _ in range(12):
        # Bresenham: in each column (or row, if it is steep), the cell with the nearest centre.
        (x0, y0), (x1, y1) = ((int(rng.integers(0, 30)), int(rng.integers(0, 20))) for _ in range(2))
        steps = max(abs(x1 - x0), abs(y1 - y0))
        along = [(x0 + (x1 - x0) * step / max(steps, 1), y0 + (y1 - y0) * step / max(steps, 1)) for step in range(steps + 1)]
        if steps == 0 or any(abs(at % 1 - 0.5) < 1e-9 for pair in along for at in pair):
            continue
        write_table("road.csv", ["wkt"], [(f'"LINESTRING ({x0 + 0.5} {y0 + 0.5}, {x1 + 0.5} {y1 + 0.5})"',)])
        run("export", tree, fresh("a.chain"), "--lines", "road.csv")
        wanted = np.zeros((20, 30), np.uint8)
        for x, y in along:
            wanted[floor(y + 0.5), floor(x + 0.5)] = 1
        same(own.cells_of_chains((DIRECTORY / "a.chain").read_text()), wanted, (x0, y0), (x1, y1))


@item("26 33 35: reads, levels")
def reads():
    goblin, autumnal = (table(run("dump", build(CLASSIC, "--rule", "dominant", to=name))) for name in ("a.goblin", "a.autumn"))
    levels = [row.split() for row in run("info", "a.goblin", "--levels").splitlines() if row.split()[0].isdigit()]
    inner = [int(row[3]) for row in levels if len(row) == 4 and int(row[0]) < 4][-4:]
    same(inner, [1, 3, 6, 0], "INNER nodes of levels")
    same([sum(inner[:level]) for level in (1, 2, 3)], [1, 4, 10], "Goblin's reads to show a level")
    same([sum(inner[: level + 1]) for level in (1, 2, 3)], [4, 10, 10], "Autumnal's reads")
    counts = {"goblin": [], "autumnal": []}
    for y, x in np.ndindex(8, 8):
        digits = [(x >> bit & 1) + 2 * (y >> bit & 1) for bit in (2, 1, 0)]
        record, read = 1, 1
        for digit in digits:
            fields = goblin[record - 1][1:]
            if fields[digit] > 0:
                same(fields[digit], CLASSIC[y, x], "cell by Goblin", x, y)
                break
            # The first INNER child is the next record, and links lead to the others.
            record += 1
            read += 1
            for field in fields[:digit]:
                if field < 0:
                    record, read = goblin[record - 1][5], read + 1
        counts["goblin"].append(read)
        record, read = 1, 1
        for digit in digits:
            field = autumnal[record - 1][1 + digit]
            if field < 0:
                same(-field, CLASSIC[y, x], "cell by Autumnal", x, y)
                break
            record, read = field, read + 1
        counts["autumnal"].append(read)
    same([(sum(all_reads) / 64, max(all_reads)) for all_reads in counts.values()], [(3.125, 6), (2.125, 3)], "reads to find a cell")
    run("convert", "a.goblin", fresh("b.autumn"))
    same(table(run("dump", "b.autumn")), autumnal, "Goblin as Autumnal")
    run("convert", "b.autumn", fresh("b.goblin"))
    same((DIRECTORY / "b.goblin").read_bytes(), (DIRECTORY / "a.goblin").read_bytes(), "and back")


@item("28 29 32: Goblin and Autumnal tables")
def tables():
    build(CLASSIC, "--rule", "dominant")
    same(table(run("dump", "a.goblin")), printed_table(GOBLIN), "the Goblin table")
    build(CLASSIC, "--rule", "dominant", to="a.autumn")
    same(table(run("dump", "a.autumn")), printed_table(AUTUMNAL), "the Autumnal table")
    compared = 0
    for rule in ("dominant", "majority", "nearest"):
        for cells in [*rasters(30, 8, most=5), *rasters(31, 5, 3, 9, most=5)]:
            try:
                tree = own.build(cells, rule)
            except own.UndefinedTie:
                continue
            compared += 1
            same(table(run("dump", build(cells, "--rule", rule))), own.goblin_table(tree), rule, cells.tolist())
            same(table(run("dump", build(cells, "--rule", rule, to="a.autumn"))), own.autumnal_table(tree), rule, cells.tolist())
    assert compared > 30, compared


@item("30 31 33: representatives, and levels of them")
def representatives():
    # Leaves A and B, and INNER nodes with the representatives B and C: A 3, B 5, C 2.
    a, b, c = 10, 20, 30
    example = np.array([[a, a, b, b], [a, a, b, b], [b, b, c, 0], [a, b, 0, 0]], np.uint8)
    tree = build(example, "--rule", "dominant")
    same(cells_of(tree, "--level", 0).item(), b, "the dominant value of the example")
    same(cells_of(tree, "--level", 1).tolist(), [[a, b], [b, c]], "its children")
    for values in ([1, 1, 2, 2], [2, 2, 1, 1]):
        tree = build(np.array(values, np.uint8).reshape(2, 2), "--rule", "dominant")
        same(cells_of(tree, "--level", 0).item(), values[0], "a tie goes to the first value")
    rng = np.random.default_rng(32)
    for rule in ("dominant", "majority", "nearest", "mean", "min", "max"):
        kind = "continuous" if rule in ("mean", "min", "max") else "categorical"
        for cells in [*rasters(33, 3, most=5), *rasters(34, 2, 3, 9, most=5)]:
            if kind == "continuous":
                cells = np.where(rng.random(cells.shape) < 0.2, rng.integers(0, 255, cells.shape), cells).astype(np.uint8)
            tree = build(cells, "--rule", rule, kind=kind)
            for level in range(own.depth_of(cells.shape) + 1):
                try:
                    wanted = own.level(cells, level, rule)
                except own.UndefinedTie:
                    continue
                same(cells_of(tree, "--level", level), wanted, rule, "level", level, cells.tolist())


@item("36 37: maketree, classify and subdivide")
def maketree():
    rng = np.random.default_rng(36)
    for _ in range(8):
        balls = [([round(float(at), 3) for at in rng.uniform(2, 14, 3)], round(float(rng.uniform(1, 5)), 3)) for _ in range(2)]
        low, high = ([int(at) for at in rng.integers(*bounds, 3)] for bounds in ((0, 6), (7, 16)))
        words = [f"ball({','.join(map(str, centre))}, {radius})" for centre, radius in balls]
        text = f"bounds(0,0,0, 16,16,16);\nunion(difference(block({','.join(map(str, low + high))}), {words[0]}), {words[1]});"
        (DIRECTORY / "solid.csg").write_text(text)
        run("build", "solid.csg", "-o", fresh("a.goblin"), "--cell", 1)
        found = info("a.goblin")
        same((found["size"], found["origin"]), ([16, 16, 16], [0, 0, 0]), "grid of", text)

        def is_full(x, y, z):
            at = np.array([x, y, z]) + 0.5
            in_ball = [np.linalg.norm(at - centre) <= radius for centre, radius in balls]
            return (all(low < at) and all(at < high) and not in_ball[0]) or in_ball[1]

        def subdivide(corner, side):
            """Returns the expression of a block; eight equal children are merged."""
            if side == 1:
                return "F" if is_full(*corner) else "V"
            half = side // 2
            parts = [subdivide((corner[0] + x, corner[1] + y, corner[2] + z), half) for z, y, x in product((0, half), repeat=3)]
            return parts[0] if len(parts[0]) == 1 and len(set(parts)) == 1 else "M" + "".join(parts)

        same(printed_df("a.goblin"), subdivide((0, 0, 0), 16), text)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    import operations  # noqa: F401 (registers its items, as the next one does)
    import solids  # noqa: F401

    if failed := check_all(sys.argv[2:]):
        sys.exit(f"checks that fail: {failed}")
