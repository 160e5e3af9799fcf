"""Reader of exact models, written from sections 27 to 36, 42 and 68 of formats.md."""

from __future__ import annotations

import json
import math
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Iterable, Iterator

from basics import Bytes, Code, CorruptFile, Header, Unknown, check, crc32c, metadata, trailer
from packed_models import unpack

Vector = tuple[int, int, int]
Box = list[tuple[int, int]]
LISTS = [b"FACE", b"EXAC", b"OBJE", b"FVAL", b"DIRE", b"LEVC", b"LEVF"]
# The block of a cluster without any, the replacement of one that nothing replaces, and the number
# of clusters of a table.
NO_BLOCK, NEVER, CLUSTERS = (1 << 32) - 1, 255, 1024
VOID, FULL, INNER, CUT, LEAF, NEAR_VOID, NEAR_FULL = range(7)


def sub(a: Any, b: Any) -> Any:
    return tuple(x - y for x, y in zip(a, b))


def dot(a: Any, b: Any) -> Any:
    return sum(x * y for x, y in zip(a, b))


def cross(a: Any, b: Any) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@dataclass
class Face:
    """A face as rings of vertices. Only exact faces have edge planes."""

    rings: list[list[Any]]
    normal: Vector
    part: int
    source: int
    is_proxy: bool = False
    colours: list[Any] | None = None
    product: int = 0

    @cached_property
    def edges(self) -> list[tuple[Any, Any]]:
        return [(a, b) for ring in self.rings for a, b in zip(ring, ring[1:] + ring[:1])]

    @cached_property
    def box(self) -> list[tuple[Any, Any]]:
        """Returns the minimum and maximum coordinates."""
        return [(min(v), max(v)) for v in zip(*self.rings[0])]


def rings_of(b: Bytes, n: int, r: int, c: int, triangles: bool) -> list[list[tuple[int, int]]]:
    """Returns, for each face, the range of each ring in the vertex list."""
    ends = [range(1, r + 1), range(3, 3 * r + 1, 3)] if triangles else [[b.get("I") for _ in range(k)] for k in (n, r)]
    for of, least, last in zip(ends, (1, 3), (r, c)):
        check(of[-1] == last and all(e - a >= least for a, e in zip([0, *of], of)), "ends of faces or rings")
    rings = list(zip([0, *ends[1]], ends[1]))
    return [rings[a:e] for a, e in zip([0, *ends[0]], ends[0])]


def block_of_faces(data: bytes, first: int, bits: int) -> list[Face]:
    """Returns a block of section 29."""
    b = Bytes(data)
    n, v, r, c, flags = b.get("5I")
    check(n and flags < 64 and 12 * v + 3 * c <= 4 * len(data), "the head of a block")
    check(not flags & 4 or (r, c) == (n, 3 * n), "triangles")
    vertices = [b.get("3I") for _ in range(v)]
    check(all(x < 1 << bits for vertex in vertices for x in vertex), "a vertex is not on the grid")
    rings = rings_of(b, n, r, c, bool(flags & 4))
    parts = [b.get("I") for _ in range(n)] if flags & 8 else [b.get("I")] * n
    sources = [b.get("Q") if flags & 16 else first + i for i in range(n)]
    proxies = int.from_bytes(b.take((n + 7) // 8), "little") if flags & 32 else 0
    check(proxies < 1 << n, "bits after the last face")
    colours = [b.get("3B") for _ in range(v)] if flags & 1 else None
    corners = [b.get("I" if flags & 2 else "H") for _ in range(c)]
    check(b.at == len(data) and all(i < v for i in corners), "bytes or corners of a block")
    faces = []
    for i in range(n):
        of = [[vertices[k] for k in corners[a:e]] for a, e in rings[i]]
        p = of[0][0]
        terms = [cross(sub(q, p), sub(s, p)) for q, s in zip(of[0], of[0][1:])]
        normal: Any = tuple(sum(t) for t in zip(*terms))
        of_colours = [[colours[k] for k in corners[a:e]] for a, e in rings[i]] if colours else None
        faces.append(Face(of, normal, parts[i], sources[i], bool(proxies >> i & 1), of_colours, dot(normal, p)))
    return faces


def block_of_exact_faces(data: bytes, bits: int) -> list[Face]:
    """Returns a block of section 34."""
    b = Bytes(data)
    n, p, g, v, r, c, flags, wa, wb, wx, ww = b.get("7I4B")
    check(n and flags < 8 and 0 < wa <= 8 and 0 < wb <= 16 and 0 < wx <= 25 and 0 < ww <= 22, "the head of a block")
    check(max(n, p, g, v, r, c) <= len(data), "the head of a block")
    whole = lambda size: int.from_bytes(b.take(size), "little", signed=True)  # noqa: E731
    index = "I" if flags & 2 else "H"
    planes = [(tuple(whole(wa) for _ in range(3)), whole(wb)) for _ in range(p)]
    check(all(any(m) and max(map(abs, m)) < 1 << 56 and abs(d) < 1 << 84 for m, d in planes), "a plane")
    vertices: list[Any] = [tuple(map(Fraction, b.get("3I"))) for _ in range(g)]
    check(all(x < 1 << bits for vertex in vertices for x in vertex), "a vertex is not on the grid")
    for _ in range(v):
        x, w = [whole(wx) for _ in range(3)], whole(ww)
        check(0 < w < 1 << 171, "a divisor")
        vertices.append(tuple(Fraction(k, w) for k in x))
    check(len(set(vertices[g:])) == v and all(-1 <= x <= 1 << bits for vertex in vertices for x in vertex), "vertices")
    of_faces = [b.get(index) for _ in range(n)]
    parts = [b.get("I") for _ in range(n)] if flags & 4 else [b.get("I")] * n
    sources = [b.get("Q") for _ in range(n)]
    rings = rings_of(b, n, r, c, False)
    corners = [b.get("2" + index) for _ in range(c)]
    colours = [b.get("3B") for _ in range(c)] if flags & 1 else None
    check(b.at == len(data), "bytes of a block")
    check(all(i < p for i in of_faces) and all(i < g + v and e < p for i, e in corners), "numbers of planes or vertices")
    faces = []
    for i in range(n):
        normal, d = planes[of_faces[i]]
        for a, e in rings[i]:
            for (k, edge), (following, _) in zip(corners[a:e], corners[a + 1 : e] + corners[a : a + 1]):
                check(edge != of_faces[i] and dot(normal, vertices[k]) == d, "a vertex is not on its face's plane")
                check(all(dot(planes[edge][0], vertices[q]) == planes[edge][1] for q in (k, following)), "an edge is not on its plane")
        of = [[vertices[k] for k, _ in corners[a:e]] for a, e in rings[i]]
        of_colours = [colours[a:e] for a, e in rings[i]] if colours else None
        faces.append(Face(of, normal, parts[i], sources[i], False, of_colours, d))
    return faces


@dataclass
class Node:
    """A node without children."""

    at: Code
    state: int
    faces: list[int]
    exact: list[int]
    kind: int = 0
    rule: int = 0
    corner: int = 0


class Segment:
    """A segment of section 30: words, and the contents of leaves."""

    def __init__(self, data: bytes, faces: int, exact: int) -> None:
        b = Bytes(data)
        f, e, k, size = b.get("4I")
        check(k % 8 == 1 and len(data) == 16 + 4 * (f + e + k) + size, "lists of a segment")
        self.faces, self.exact, self.words = ([b.get("I") for _ in range(n)] for n in (f, e, k))
        for numbers, most in ((self.faces, faces), (self.exact, exact)):
            check(len(set(numbers)) == len(numbers) and all(i < most for i in numbers), "faces of a segment")
        self.leaves = Bytes(b.take(size))
        check(self.words[0] & 7 != CUT, "word 0 is CUT")

    def numbers(self, of: list[int]) -> list[int]:
        """Converts segment-local face numbers to model numbers."""
        b = self.leaves
        found: list[int] = []
        count = b.leb(5)
        check(count, "a list of no faces")
        for i in range(count):
            found.append(b.leb(5) + (found[-1] + 1 if i else 0))
            check(found[-1] < len(of), "own numbers")
        return [of[i] for i in found]

    def walk(self, node: Code, depth: int, counts: Counter[int]) -> Iterator[Node]:
        """Yields all nodes without children, and CUT nodes; raises if data is not at its required
        position."""
        self.next = 1
        self.leaves.at = 0
        yield from self._walk(0, node, depth, counts)
        check(self.next == len(self.words) and self.leaves.at == len(self.leaves.data), "unused words or leaves")

    def _walk(self, word: int, node: Code, depth: int, counts: Counter[int]) -> Iterator[Node]:
        state, where = self.words[word] & 7, self.words[word] >> 3
        check(state < 7 and (node.level < depth or state not in (INNER, CUT)), "a state")
        if state == INNER:
            check(where == self.next and where + 8 <= len(self.words), "words are not in preorder")
            counts[INNER] += 1
            self.next += 8
            for i in range(8):
                at = tuple(2 * v + (i >> a & 1) for a, v in enumerate(node.at))
                yield from self._walk(where + i, Code(node.level + 1, at), depth, counts)
        elif state < LEAF:
            check(where == 0, "an offset in a word that has none")
            counts[state] += state != CUT
            yield Node(node, state, [], [])
        else:
            check(where == self.leaves.at, "leaves are not in preorder")
            if state > LEAF:
                counts[state - NEAR_VOID] += 1
                yield Node(node, state - NEAR_VOID, [], self.numbers(self.exact))
                return
            head = self.leaves.get("B")
            check(head < 64 and head >> 2 & 3 < 3, "the head of a leaf")
            counts[LEAF + (head & 3)] += 1
            faces = self.numbers(self.faces)
            yield Node(node, LEAF, faces, self.numbers(self.exact) if head & 32 else [], head & 3, head >> 2 & 3, head >> 4 & 1)


@dataclass
class Level:
    """A level of detail. Lengths are in grid units."""

    faces: int
    error: float
    bytes: int
    vanished: int
    diameter: float
    clusters: int


@dataclass
class Cluster:
    """Faces that are shown together."""

    error: float
    limit: float
    level: int
    replaced_at: int
    block: int
    first: int
    faces: int
    low: Vector
    high: Vector
    start: int
    end: int

    def in_level(self, level: int) -> bool:
        return self.level >= level and (self.replaced_at == NEVER or self.replaced_at < level)

    def in_error(self, error: float) -> bool:
        return self.error <= error < self.limit


class Model:
    """An exact model."""

    def __init__(self, data: bytes) -> None:
        self.data, header = data, Header.read(data)
        check(header.content == 2 and header.axes == 3 and header.layers == 0, "no exact model")
        self.sections = sections = trailer(data, header)
        if b"INST" in sections:
            raise Unknown("templates that are placed")
        b = Bytes(sections.get(b"BREP", b""))
        check(136 <= len(b.data) <= 4096 and sections.get(b"META") and b"FACE" in sections and sections.get(b"DIRE"), "sections")
        self.bits, self.far, self.codec, *origin = b.get("BBB5x3q")
        if self.codec > 1:
            raise Unknown("a codec of exact models")
        self.origin = tuple(origin)
        self.step, self.divisor = b.get("2d")
        self.count, *self.nodes, self.exact_count, self.proxy_count, self.parts_count = b.get("11Q")
        check(1 <= self.bits <= 26 and self.far < 2 and header.depth == min(self.bits, 19), "bits or depth")
        check(all(abs(v) <= 1 << 53 for v in origin) and max(self.nodes) <= 1 << 58, "origin or nodes")
        check(all(2.0**-1022 <= v < float("inf") for v in (self.step, self.divisor, self.step / self.divisor)), "step or divisor")
        check(max(self.count, self.exact_count, self.parts_count) < 1 << 32 and self.parts_count, "counts")
        check(self.proxy_count <= self.count, "the number of proxies")
        self.depth = header.depth
        check(len(sections[b"META"]) <= 1 << 24, "metadata are too large")
        self.meta = metadata(sections[b"META"])
        table = Bytes(data, len(data) - 16 - int.from_bytes(data[-16:-12], "little") + 36)
        starts = {tag: at for tag, _, at, _ in (table.get("4sIQQ") for _ in range(len(sections)))}
        self.first_list = min(starts[tag] for tag in LISTS if tag in starts and sections[tag])
        stored = {tag: self._list(sections.get(tag, b"")) for tag in LISTS}
        check(sum(len(block) for of in stored.values() for _, block in of) <= self.first_list - 24, "blocks are there twice")
        plain = unpack if self.codec else lambda _, block: block
        self.lists = {tag: [(key, plain(tag, block)) for key, block in stored[tag]] for tag in LISTS}
        self.faces = self._faces(b"FACE", self.count)
        self.exact = self._faces(b"EXAC", self.exact_count)
        check(all(f.part < self.parts_count for f in self.faces + self.exact), "parts of faces")
        check(sum(f.is_proxy for f in self.faces) == self.proxy_count, "the number of proxies")
        self.segments = {key: Segment(block, self.count, self.exact_count) for key, block in self.lists[b"DIRE"]}
        check(all(Code.of(key, 3).level <= self.depth for key in self.segments), "codes of segments")
        self.sums = self._sums(sections[b"SUMS"]) if b"SUMS" in sections else None
        self.levels = levels(sections.get(b"LEVS", b""))
        check(bool(self.levels) == bool(self.lists[b"LEVC"]) and (self.levels or not self.lists[b"LEVF"]), "sections of levels")
        self.clusters = self._clusters()
        self.formula = formula(sections[b"FORM"]) if b"FORM" in sections else None

    def _list(self, data: bytes) -> list[tuple[int, bytes]]:
        """Returns the keys and blocks of a list, checked."""
        b = Bytes(data)
        found: list[tuple[int, bytes]] = []
        check(len(data) % 24 == 0, "bytes of a list")
        while b.at < len(data):
            key, at, size, crc = b.get("QQII")
            check(24 <= at and at + size <= self.first_list and (not found or key > found[-1][0]), "an entry of a list")
            found.append((key, self.data[at : at + size]))
            check(crc32c(found[-1][1]) == crc, "checksum of a block")
        return found

    def _faces(self, tag: bytes, count: int) -> list[Face]:
        faces: list[Face] = []
        for key, block in self.lists[tag]:
            check(key == len(faces), "the key of a block")
            faces += block_of_faces(block, key, self.bits) if tag == b"FACE" else block_of_exact_faces(block, self.bits)
        check(len(faces) == count, "faces")
        return faces

    def _sums(self, data: bytes) -> tuple[int, list[int]]:
        """Returns the flags and numbers of sums (section 35)."""
        b = Bytes(data)
        flags = b.get("B")
        numbers = [int.from_bytes(b.take(b.get("B")), "little", signed=True) for _ in range(19 if flags & 2 else 13)]
        check(b.at == len(data) and flags < 4, "bytes of sums")
        box = numbers[1:7] if flags & 2 else []
        check(all(0 <= v < 1 << self.bits for v in box) and all(v <= w for v, w in zip(box[:3], box[3:])), "bounds of sums")
        return flags, numbers

    def world(self, g: Vector) -> tuple[float, ...]:
        """Returns the world position of a grid point."""
        return tuple(float(o + v) * self.step / self.divisor for o, v in zip(self.origin, g))

    @cached_property
    def leaves(self) -> list[Node]:
        """Returns all nodes without children, of all segments."""
        counts: Counter[int] = Counter()
        found: list[Node] = []
        todo, used = [Code(0, (0, 0, 0))], 0
        while todo:
            node = todo.pop()
            check(node.code in self.segments, "a CUT without a segment")
            used += 1
            for leaf in self.segments[node.code].walk(node, self.depth, counts):
                if leaf.state == CUT:
                    todo.append(leaf.at)
                else:
                    found.append(leaf)
        check(used == len(self.segments), "segments that nothing leads to")
        check(self.nodes == [counts[i] for i in (VOID, FULL, INNER, *range(LEAF, LEAF + 4))], "nodes of the octree")
        return found

    # Attributes of parts and values of faces (section 35).

    @cached_property
    def tables(self) -> dict[bytes, dict[int, dict[int, bytes]]]:
        """Returns the values of both tables, by column and row."""
        found: dict[bytes, dict[int, dict[int, bytes]]] = {b"OBJE": {}, b"FVAL": {}}
        for tag, table in found.items():
            for key, data in self.lists[tag]:
                column, b = table.setdefault(key >> 32, {}), Bytes(data)
                n, flags = b.get("II")
                check(n and flags < 4 and n <= len(data), "the head of a chunk")
                rows = [b.get("I") for _ in range(n)] if flags & 1 else [(key & 0xFFFFFFFF) + i for i in range(n)]
                ends = [b.get("I" if flags & 2 else "H") for _ in range(n)]
                check(rows[0] == key & 0xFFFFFFFF and all(r < s for r, s in zip(rows, rows[1:])), "rows of a chunk")
                check(rows[0] > max(column, default=-1) and all(e <= f for e, f in zip(ends, ends[1:])), "rows or ends of chunks")
                column.update((row, b.take(end - start)) for row, start, end in zip(rows, [0, *ends], ends))
                check(b.at == len(data), "bytes of a chunk")
        return found

    @cached_property
    def parts(self) -> list[tuple[str, dict[str, Any]]]:
        """Returns the name and attributes of each part."""
        table = self.tables[b"OBJE"]
        if not table:
            check(self.parts_count == 1, "parts without names")
            return [("mesh", {})]
        names = table[0]
        check(list(names) == list(range(self.parts_count)), "names of parts")
        order = [int.from_bytes(v, "little") for v in table.get(1, {}).values()]
        check(order == sorted(names, key=lambda part: (names[part], part)), "parts by their names")
        columns = [json.loads(v) for v in table.get(2, {}).values()]
        check(all(1 <= len(c) <= 2 and all(isinstance(t, str) for t in c) for c in columns), "names of columns")
        lists = []
        for value in table.get(3, {}).values():
            b, of = Bytes(value), []
            while b.at < len(value):
                of.append(b.leb())
            check(len(set(of)) == len(of) and all(i < len(columns) for i in of), "a list of columns")
            lists.append(of)
        said = []
        for part, name in names.items():
            about: dict[str, Any] = json.loads(table.get(5, {}).get(part, b"{}"))
            if part in table.get(4, {}):
                check(not about, "a part with a list, and an object as well")
                for i in lists[Bytes(table[4][part]).leb()]:
                    into = about.setdefault(columns[i][0], {}) if len(columns[i]) == 2 else about
                    into[columns[i][-1]] = json.loads(table[16 + i][part])
            said.append((name.decode(), about))
        return said

    # Levels of detail (section 68).

    def _clusters(self) -> list[Cluster]:
        found: list[Cluster] = []
        last = len(self.levels) - 1
        for i, (key, data) in enumerate(self.lists[b"LEVC"]):
            b = Bytes(data)
            check(key == CLUSTERS * i and len(data) % 64 == 0 and 64 <= len(data) <= 64 * CLUSTERS, "a table of clusters")
            while b.at < len(data):
                error, limit, level, replaced_at, block, first, faces = b.get("2f2B2x3I")
                cluster = Cluster(error, limit, level, replaced_at, block, first, faces, b.get("3i"), b.get("3i"), *b.get("2Q"))
                check(0 <= cluster.error <= cluster.limit and cluster.level <= last, "errors or the level of a cluster")
                check(cluster.replaced_at == NEVER or cluster.replaced_at < cluster.level, "a cluster that is replaced")
                check((cluster.replaced_at == NEVER) == (cluster.limit == float("inf")), "the limit of a cluster")
                is_exact = cluster.level == last
                check(cluster.block < len(self.lists[b"LEVF"]) or (is_exact and cluster.block == NO_BLOCK), "the block of a cluster")
                check(all(0 <= v <= w < 1 << self.bits for v, w in zip(cluster.low, cluster.high)), "the box of a cluster")
                found.append(cluster)
        return found

    def coarse_faces(self, number: int) -> list[Face]:
        """Returns the faces of a block of coarse faces."""
        if number not in self.coarse:
            key, data = self.lists[b"LEVF"][number]
            check(key == number, "the key of a block of coarse faces")
            self.coarse[number] = block_of_faces(data, 0, self.bits)
            check(all(face.part < self.parts_count for face in self.coarse[number]), "parts of coarse faces")
        return self.coarse[number]

    @cached_property
    def coarse(self) -> dict[int, list[Face]]:
        return {}

    @cached_property
    def curve(self) -> list[tuple[int, int]]:
        """Returns position and number of all faces that are no slivers, along the curve."""
        return sorted((self.position(face), i) for i, face in enumerate(self.faces) if any(face.normal))

    def position(self, face: Face) -> int:
        """Returns a face's position on the curve."""
        least = min(p for ring in face.rings for p in ring)
        return morton([v >> max(self.bits - 21, 0) for v in least])

    def is_exact(self, cluster: Cluster) -> bool:
        return cluster.level == len(self.levels) - 1

    def cluster_faces(self, cluster: Cluster) -> list[Face]:
        """Returns the faces of a cluster; slivers of an exact cluster are triangles."""
        if not self.is_exact(cluster):
            faces = self.coarse_faces(cluster.block)[cluster.first :][: cluster.faces]
            check(len(faces) == cluster.faces, "faces of a cluster outside its block")
            return faces
        slivers = [] if cluster.block == NO_BLOCK else self.coarse_faces(cluster.block)[: cluster.first]
        check(len(slivers) == (0 if cluster.block == NO_BLOCK else cluster.first), "slivers outside their block")
        first, end = (bisect_left(self.curve, (at, 0)) for at in (cluster.start, cluster.end))
        return [self.faces[i] for _, i in self.curve[first:end]] + slivers

    def at_level(self, level: int) -> list[Face]:
        """Returns the faces of a level's surface."""
        return [face for cluster in self.clusters if cluster.in_level(level) for face in self.cluster_faces(cluster)]

    def at_error(self, error: float) -> list[Face]:
        """Returns the faces of the surface for an error in grid units."""
        return [face for cluster in self.clusters if cluster.in_error(error) for face in self.cluster_faces(cluster)]

    def verify_levels(self) -> None:
        """Raises `CorruptFile` unless clusters, groups and levels are as section 68 specifies."""
        exact = [cluster for cluster in self.clusters if self.is_exact(cluster)]
        coarse = [cluster for cluster in self.clusters if not self.is_exact(cluster)]
        check(self.clusters == coarse + exact and all(a.level <= b.level for a, b in zip(coarse, coarse[1:])), "order of clusters")
        check([c.end for c in exact] == [*(c.start for c in exact[1:]), 1 << 63] and not exact[0].start, "positions of exact clusters")
        check(all(c.error == 0 and (c.block < NO_BLOCK or c.first == 0) for c in exact), "exact clusters")
        check(all(c.start == c.end == 0 for c in coarse), "positions of coarse clusters")
        blocks = [c.block for c in self.clusters if c.block != NO_BLOCK]
        check(list(dict.fromkeys(blocks)) == list(range(len(self.lists[b"LEVF"]))) and blocks == sorted(blocks), "order of blocks")
        ends = [0] * len(self.lists[b"LEVF"])
        for c in coarse:
            check(c.first == ends[c.block], "faces of a block that are in no cluster, or in two")
            ends[c.block] += c.faces
        for c in exact:
            if c.block != NO_BLOCK:
                check(ends[c.block] == 0, "a block of several exact clusters")
                ends[c.block] = c.first
        check(ends == [len(self.coarse_faces(i)) for i in range(len(ends))], "faces of blocks that are in no cluster")
        made = {(c.error, c.level) for c in coarse}
        check(all((c.limit, c.replaced_at) in made for c in self.clusters if c.replaced_at != NEVER), "groups without replacement")
        for c in self.clusters:
            faces = self.cluster_faces(c)
            flat = sum(not any(face.normal) for face in faces) if self.is_exact(c) else 0
            check(len(faces) == c.faces + (c.first if self.is_exact(c) else 0) and (not self.is_exact(c) or flat == c.first), "faces of a cluster")
            check(self.is_exact(c) or all(len(face.rings) == 1 and len(face.rings[0]) == 3 for face in faces), "coarse faces that are no triangles")
            box = list(zip(*(p for face in faces for ring in face.rings for p in ring)))
            check([min(v) for v in box] == list(c.low) and [max(v) for v in box] == list(c.high), "the box of a cluster")
        for number, level in enumerate(self.levels):
            own = [c for c in self.clusters if c.in_level(number)]
            check(level.clusters == len(own) and level.error == max(c.error for c in own), "clusters of a level")
            check(level.faces == sum(c.faces + (c.first if self.is_exact(c) else 0) for c in own), "faces of a level")
        for face in (self.faces[i] for _, i in self.curve):
            node = self.find(tuple(2 * v for v in min(p for ring in face.rings for p in ring)))
            check(node and node.state == LEAF and any(self.faces[i] is face for i in node.faces), "the leaf of a position")
            depth = min(self.bits, 21) - node.at.level if node else 0
            check(node and self.position(face) >> 3 * depth == morton(node.at.at), "positions of a leaf")

    # Geometry. Points are in half units, so that cell walls have integer coordinates.

    @cached_property
    def bounding(self) -> dict[int, Face]:
        """Returns the faces that bound something, by number, in half units."""
        numbers = [i for i, f in enumerate(self.faces) if any(f.normal)]
        return dict(zip(numbers, self.doubled(numbers)))

    def winding(self, p: Vector) -> int:
        """Returns the winding number at a point, perturbed as section 31 specifies, along a path
        from the root's minimum corner across all faces."""
        return self.far + crossings(list(self.bounding.values()), (-1, -1, -1), p)

    def find(self, p: Vector) -> Node | None:
        """Returns the node without children whose cell contains a point; None outside of the
        root."""
        if not all(-1 <= v < (2 << self.bits) - 1 for v in p):
            return None
        cells = (Code(level, tuple(v + 1 >> 1 + self.bits - level for v in p)) for level in range(self.depth + 1))
        return next(self.by_cell[cell] for cell in cells if cell in self.by_cell)

    @cached_property
    def by_cell(self) -> dict[Code, Node]:
        return {node.at: node for node in self.leaves}

    def inside(self, p: Vector) -> bool | None:
        """Whether a point is inside the solid, by the octree (section 31); None on the boundary."""
        node = self.find(p)
        if not node or node.state != LEAF:
            return bool(node.state if node else self.far)
        faces = self.doubled(node.faces)
        if any(on(face, p) for face in faces):
            return None
        if node.rule < 2:
            return (any if node.rule else all)(dot(f.normal, sub(p, f.rings[0][0])) < 0 for f in faces)
        width = 2 << self.bits - node.at.level
        least = tuple(v * width - 1 for v in node.at.at)
        return node.corner + crossings(faces, least, p) == 1

    def doubled(self, numbers: Iterable[int]) -> list[Face]:
        """Returns faces in half units."""
        of = (self.faces[i] for i in numbers)
        return [Face([[tuple(2 * v for v in p) for p in r] for r in f.rings], f.normal, 0, 0) for f in of]

    def verify_exact_surface(self) -> None:
        """Checks that the exact surface's edges cancel along each line."""
        check(is_closed([f for f in self.faces if not f.is_proxy] + self.exact), "the exact surface is not closed")

    def verify_sums(self) -> None:
        """Checks the sums over all faces and those of each part."""
        check(self.sums is None or self.sums == sums(self.faces, self.exact, self.bits), "sums over all faces")
        stored = self.tables[b"OBJE"].get(7, {})
        used = sorted({face.part for face in self.faces + self.exact}) if self.sums and self.parts_count > 1 else []
        check(list(stored) == used, "parts with sums")
        for part in used:
            faces, exact = ([face for face in all_faces if face.part == part] for all_faces in (self.faces, self.exact))
            check(self._sums(stored[part]) == sums(faces, exact, self.bits), "sums of a part")

    def verify(self) -> None:
        """Raises `CorruptFile` unless faces are planar and closed, and octree nodes are right."""
        edges: Counter[Any] = Counter()
        for face in self.faces:
            check(all(dot(face.normal, p) == face.product for r in face.rings for p in r), "a face that is not planar")
            for a, b in face.edges:
                edges[min(a, b), max(a, b)] += 1 if a < b else -1
        check(not any(n for (a, b), n in edges.items() if a != b), "the surface is not closed")
        check(sum(8 ** (self.depth - leaf.at.level) for leaf in self.leaves) == 8**self.depth, "cells are missing")
        self.verify_exact_surface()
        self.verify_sums()
        boxes = [[((2 * v + 1) // 2 - 1, (2 * w + 1) // 2 + 1) for v, w in f.box] for f in self.exact]
        for leaf in self.leaves:
            width = 2 << self.bits - leaf.at.level
            box = [(v * width - 1, (v + 1) * width - 1) for v in leaf.at.at]
            inside = self.winding(least_of(box))
            check(inside == (leaf.corner if leaf.state == LEAF else leaf.state), "a winding number")
            found = [i for i, face in self.bounding.items() if cuts(face, box)]
            check(found == sorted(leaf.faces), "faces of a node")
            if leaf.state == LEAF:
                planes = [[*self.faces[i].normal, -self.faces[i].product] for i in leaf.faces]
                check(leaf.kind == rank(planes) - 1, "kind of a leaf")
                self._rule(leaf, box)
            wide = [(low - 2, high + 2) for low, high in box]
            near = [
                i for i, f in enumerate(self.exact)
                if all(2 * v <= high and 2 * w >= low for (v, w), (low, high) in zip(boxes[i], box)) and meets(f, wide)
            ]
            check(near == sorted(leaf.exact), "exact faces near a node")
        check(len(self.parts) == self.parts_count, "parts")

    def _rule(self, leaf: Node, box: Box) -> None:
        """Checks that the leaf's rule classifies points of the cell as all faces together do."""
        for p in ((box[0][0] + 1, (box[1][0] + box[1][1]) // 2, box[2][1] - 1), tuple(high - 1 for _, high in box)):
            inside = self.inside(p)  # type: ignore[arg-type]
            check(inside is None or inside == (self.winding(p) == 1), "a point in a leaf")  # type: ignore[arg-type]


def morton(at: Iterable[int]) -> int:
    """Returns the Z order of a position, with x lowest."""
    return sum((v >> i & 1) << 3 * i + axis for axis, v in enumerate(at) for i in range(21))


def levels(data: bytes) -> list[Level]:
    """Returns the summary of levels, the coarsest first."""
    check(len(data) % 48 == 0 and len(data) <= 64 * 48, "bytes of levels")
    b, most = Bytes(data), 3.4028234663852886e38
    found = [Level(*b.get("QdQQdQ")) for _ in range(len(data) // 48)]
    check(all(level.faces < 1 << 40 and 0 <= level.error <= most and 0 <= level.diameter <= most for level in found), "a level")
    check(all(a.error >= b.error for a, b in zip(found, found[1:])), "errors of levels ascend")
    return found


def least_of(box: Box) -> Vector:
    return box[0][0], box[1][0], box[2][0]


def on(face: Face, p: Vector) -> bool:
    """Whether a point is on a face, including edges and vertices."""
    if dot(face.normal, sub(p, face.rings[0][0])):
        return False
    for a, b in face.edges:
        if not any(cross(sub(b, a), sub(p, a))) and all(min(x, y) <= v <= max(x, y) for x, y, v in zip(a, b, p)):
            return True
    return within(face, p)


def within(face: Face, p: Any) -> bool:
    """Whether a point in a face's plane, not on an edge, is between the rings."""
    u, v = sorted(range(3), key=lambda axis: abs(face.normal[axis]))[:2]
    met = 0
    for g, h in face.edges:
        if (g[v] > p[v]) != (h[v] > p[v]):
            met += g[u] + (p[v] - g[v]) * Fraction(h[u] - g[u], h[v] - g[v]) > p[u]
    return met % 2 == 1


def side(face: Face, q: Any) -> int:
    found = dot(face.normal, sub(q, face.rings[0][0])) or next(v for v in face.normal if v)
    return 1 if found > 0 else -1


def crossings(faces: list[Face], start: Any, end: Any) -> int:
    """Returns the change of the winding number along x, y and z."""
    change, s = 0, start
    for a in range(3):
        t = (*end[: a + 1], *start[a + 1 :])
        u, v = [b for b in range(3) if b != a]
        for face in faces:
            if not face.normal[a] or face.box[v][1] <= s[v] or face.box[u][1] < s[u] or face.box[v][0] > s[v]:
                continue
            if (of := side(face, s)) == side(face, t):
                continue
            met = 0
            for g, h in face.edges:
                if (g[v] > s[v]) != (h[v] > s[v]):
                    d = (h[u] - g[u]) * (s[v] - g[v]) - (h[v] - g[v]) * (s[u] - g[u])
                    met += d > 0 if h[v] > s[v] else d < 0
            change += of * (met % 2)
        s = t
    return change


def meets(face: Face, box: Box) -> bool:
    """Whether the plane of an exact face meets a closed box, given in half units."""
    ends = [sorted((n * low, n * high)) for n, (low, high) in zip(face.normal, box)]
    return sum(e[0] for e in ends) <= 2 * face.product <= sum(e[1] for e in ends)


def cuts(face: Face, box: Box) -> bool:
    """Whether a face meets the interior of a box."""
    if any(least >= high or most <= low for (least, most), (low, high) in zip(face.box, box)):
        return False
    n, d = face.normal, dot(face.normal, face.rings[0][0])
    ends = [(low, high) if k > 0 else (high, low) for k, (low, high) in zip(n, box)]
    a, b = (tuple(e[i] for e in ends) for i in (0, 1))
    if not dot(n, a) < d < dot(n, b):
        return False
    if any(enters(p, q, box) for p, q in face.edges):
        return True
    # No edge is in the box, so the face contains all of the plane in it, or nothing: testing one
    # point of the box's diagonal suffices.
    t = Fraction(d - dot(n, a), dot(n, b) - dot(n, a))
    p = [x + t * (y - x) for x, y in zip(a, b)]
    return within(face, p)


def enters(p: Any, q: Any, box: Box) -> bool:
    """Whether an edge has a point inside a box."""
    first, last = Fraction(-1), Fraction(2)
    for x, y, (low, high) in zip(p, q, box):
        if x == y:
            if not low < x < high:
                return False
        else:
            one, other = sorted((Fraction(low - x, y - x), Fraction(high - x, y - x)))
            first, last = max(first, one), min(last, other)
    return first < last and first < 1 and last > 0


def rank(rows: list[list[int]]) -> int:
    """Returns the rank of an integer matrix."""
    found, rows = 0, [row[:] for row in rows]
    for column in range(4):
        pivot = next((row for row in rows[found:] if row[column]), None)
        if pivot is None:
            continue
        rows.remove(pivot)
        rows.insert(found, pivot)
        found += 1
        rows[found:] = [[pivot[column] * v - row[column] * w for v, w in zip(row, pivot)] for row in rows[found:]]
    return found


def is_closed(faces: list[Face]) -> bool:
    """Whether the faces' edges cancel along each line."""
    ends: Counter[Any] = Counter()
    for face in faces:
        for a, b in face.edges:
            if a != b:
                way = [Fraction(v) for v in sub(b, a)]
                first = next(v for v in way if v)
                way = [v / first for v in way]
                line = tuple(way), cross(a, way)
                ends[line, tuple(a)] += 1
                ends[line, tuple(b)] -= 1
    return not any(ends.values())


def sums(faces: list[Face], exact: list[Face], bits: int) -> tuple[int, list[int]]:
    """Returns the flags and numbers of the sums over faces (section 35)."""
    volume, area, fine, first, second = 0, 0, 0, [0] * 3, [0] * 6
    for face in faces:
        normal: Any = (0, 0, 0)
        for ring in face.rings:
            for a, b, c in ((ring[0], b, c) for b, c in zip(ring[1:], ring[2:])):
                n = cross(sub(b, a), sub(c, a))
                v, s = dot(a, n), [sum(of) for of in zip(a, b, c)]
                volume += v
                normal = tuple(x + y for x, y in zip(normal, n))
                first = [m + v * x for m, x in zip(first, s)]
                pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
                second = [m + v * sum(p[i] * p[j] for p in (a, b, c, s)) for m, (i, j) in zip(second, pairs)]
        area += int(math.sqrt(float(dot(normal, normal))) * 2.0**40)
    for sign, face in [(-1, f) for f in faces if f.is_proxy] + [(1, f) for f in exact]:
        for ring in face.rings:
            p = [[math.floor(v * 2 ** (58 - bits)) for v in vertex] for vertex in ring]
            fine += sign * sum(dot(p[0], cross(b, c)) for b, c in zip(p[1:], p[2:]))
    boxes = [[(min(v), max(v)) for v in zip(*(p for ring in f.rings for p in ring))] for f in faces if any(f.normal)]
    bounds = [min(box[a][0] for box in boxes) for a in range(3)] + [max(box[a][1] for box in boxes) for a in range(3)] if boxes else []
    closed = is_closed([f for f in faces if not f.is_proxy] + exact)
    return closed + 2 * bool(boxes), [len(faces), *bounds, volume, *first, *second, area, fine]


def formula(data: bytes) -> Any:
    """Returns the formula of section 36: a name, an operation's number and its operands, or the
    coefficients of a map and its operand."""
    check(len(data) <= 1 << 20, "a formula is too long")
    text = data.decode()

    def operand(at: int) -> tuple[Any, int]:
        if text[at : at + 5] == "(map ":
            *numbers, _ = text[at + 5 :].split(" ", 12)
            check(len(numbers) == 12, "a map of other than twelve numbers")
            part, at = operand(at + 5 + sum(len(number) + 1 for number in numbers))
            check(text[at : at + 1] == ")", "a formula that does not end")
            return [[float(number) for number in numbers], part], at + 1
        if text[at : at + 3] != "(op":
            found, at = json.JSONDecoder().raw_decode(text, at)
            return found, at
        at = end = at + 3
        while text[end : end + 1].isdigit():
            end += 1
        found, at = [int(text[at:end])], end
        while text[at : at + 1] == " ":
            part, at = operand(at + 1)
            found.append(part)
        check(text[at : at + 1] == ")", "a formula that does not end")
        return found, at + 1

    try:
        found, end = operand(0)
    except ValueError:
        raise CorruptFile("a formula that is none") from None
    check(end == len(text), "bytes after a formula")
    return found
