"""Unpacks packed components of exact models (sections 42 and 68 of formats.md)."""

from __future__ import annotations

import struct

from basics import check, crc32c
from coder import Coder, context_of

REMEMBERED, RECENT, LEVELS = 4, 128, 20
VOID, FULL, INNER, CUT, LEAF, NEAR_VOID, NEAR_FULL = range(7)
U32 = 1 << 32


def signed(n: int, bits: int) -> int:
    """Returns the signed number with the same `bits` bits."""
    n &= (1 << bits) - 1
    return n - (1 << bits) if n >> bits - 1 else n


class Columns(Coder):
    """The codes that section 42 adds to section 37."""

    def __init__(self, packed: bytes) -> None:
        self.sizes: dict[object, int] = {}
        # As in a segment, without a model number.
        super().__init__(packed[1:5] + b"\0" + packed[9:])

    def near(self, *context: object) -> int:
        size = self.sizes.get(context, 0)
        found = self.residual(context, context_of(size))
        self.sizes[context] = size - size // 8 + 4 * min(abs(found), 1 << 40)
        return found

    def count(self, *context: object) -> int:
        n = self.near(*context)
        return 2 * n if n >= 0 else -2 * n - 1

    def ends(self, context: str, least: int, count: int) -> list[int]:
        found = [0]
        for _ in range(count):
            found.append((found[-1] + least + self.count(context)) % U32)
        return found[1:]

    def sums(self, context: str, bits: int, count: int) -> list[int]:
        """Returns numbers coded as differences."""
        found = [0]
        for _ in range(count):
            found.append((found[-1] + self.near(context)) % (1 << bits))
        return found[1:]


def unpack(tag: bytes, packed: bytes) -> bytes:
    """Unpacks a block or segment of a list to a plain one, given its bytes in the file."""
    check(packed and packed[0] < 2, "the first byte of a chunk")
    if not packed[0]:
        return packed[1:]
    check(len(packed) >= 25, "a packed chunk is too short")
    crc, size = struct.unpack("<II", packed[1:9])
    check(size <= min(1 << 26, 65536 + 4096 * len(packed)), "an unpacked chunk is too long")
    columns = Columns(packed)
    if tag in (b"FACE", b"LEVF"):
        plain = Faces(columns, size).plain
    elif tag == b"DIRE":
        plain = Segment(columns, size).plain
    else:
        check(size <= 1 << 20, "a table, or block of exact faces, that is packed and too long")
        plain = Exact(columns, size).plain if tag == b"EXAC" else of_bytes(columns, size)
    columns.finish()
    check(len(plain) == size and crc32c(plain) == crc, "checksum or bytes of what was unpacked")
    return plain


def of_bytes(c: Columns, size: int) -> bytes:
    found, at, alike = bytearray(), 0, 0
    last: dict[int, int] = {}
    for i in range(size):
        if i >= 4:
            key = int.from_bytes(found[i - 4 : i], "little") * 0x9E3779B1 % U32 >> 16
            if not at:
                at = last.get(key, 0)
            last[key] = i
        if at:
            if c.bit(("expected", alike)):
                found.append(found[at])
                at, alike = at + 1, min(alike + 1, 31)
                continue
            at, alike = 0, 0
        found.append(c.tree(("byte", found[-1] if found else 0), 8))
    return bytes(found)


class Corners:
    """Vertices of rings, numbered in decoding order."""

    def __init__(self, c: Columns, vertices: int) -> None:
        self.c, self.vertices = c, vertices
        self.into: dict[int, list[tuple[int, int]]] = {}
        self.out: dict[int, list[int]] = {}
        self.next, self.last, self.was = 0, 0, "new"
        self.before: list[int] = []

    def ring(self, count: int) -> list[int]:
        ring: list[int] = []
        for i in range(count):
            found = self._candidate(ring, i == count - 1)
            if found is None:
                place = "first" if i == 0 else "last" if i == count - 1 else "other"
                if self.c.bit(("new", place, self.was)):
                    found, self.was = self.next, "new"
                    self.next += 1
                    check(found < self.vertices, "vertices of a packed block")
                else:
                    self.last = (self.last + self.c.near("corner", i == 0)) % U32
                    found, self.was = self.last, "neither"
                    check(found < self.next, "a corner that has not been there")
            else:
                self.last, self.was = found, "candidate"
            ring.append(found)
        return ring

    def _candidate(self, ring: list[int], is_last: bool) -> int | None:
        if not ring:
            return next((v for i, v in enumerate(self.before[:3]) if self.c.bit(("again", i))), None)
        into = [u for u, _ in self.into.get(ring[-1], [])]
        out = self.out.get(ring[0], []) if is_last else []
        candidates = [(u, "both" if u in out else "into") for u in into] + [(u, "out") for u in out if u not in into]
        no = {ring[0], *ring[-2:-1]}
        for rank, (u, kind) in enumerate([pair for pair in candidates if pair[0] not in no]):
            if self.c.bit(("candidate", is_last, kind, min(rank, 3))):
                return u
        return None

    def join(self, ring: list[int]) -> None:
        for i in range(len(ring)):
            u, w, x = (ring[(i + k) % len(ring)] for k in range(3))
            at = next((k for k, (v, _) in enumerate(self.into.get(u, [])) if v == w), None)
            if at is not None:
                del self.into[u][at]
                if u in self.out.get(w, []):
                    self.out[w].remove(u)
            else:
                self.into[w] = [(u, x), *self.into.get(w, [])][:REMEMBERED]
                self.out[u] = [w, *self.out.get(u, [])][:REMEMBERED]
        self.before = ring


class Faces:
    """A block of faces."""

    def __init__(self, c: Columns, size: int) -> None:
        self.c = c
        n, v, r, corners, flags = head = [c.number() for _ in range(5)]
        triangles, wide = flags & 4, 4 if flags & 2 else 2
        sizes = [12 * v, 0 if triangles else 4 * (n + r), 4 * n if flags & 8 else 4, 8 * n if flags & 16 else 0]
        sizes += [(n + 7) // 8 if flags & 32 else 0, 3 * v if flags & 1 else 0, wide * corners]
        check(20 + sum(sizes) == size and (not triangles or (r, corners) == (n, 3 * n)), "lists of a packed block")
        face_ends = [] if triangles else c.ends("rings", 1, n)
        ring_ends = list(range(3, 3 * n + 1, 3)) if triangles else c.ends("ring", 3, r)
        parts = c.sums("part", 32, n if flags & 8 else 1)
        sources = c.sums("source", 64, n if flags & 16 else 0)
        proxies, before = 0, 0
        for i in range(8 * sizes[4]):
            before = c.bit(("proxy", before))
            proxies |= before << i
        steps = [(c.number(), c.number()) for _ in range(3)]
        check(all(max(step) < U32 for step in steps), "steps of a packed block")
        self.steps = [(max(s, 1), f) for s, f in steps]
        self.vertices: list[list[int]] = []
        self.colours: list[list[int]] = []
        self.has_colours = flags & 1
        self.corners = Corners(c, v)
        all_corners: list[int] = []
        for start, end in zip([0, *ring_ends], ring_ends):
            check(start <= end <= corners, "ends of rings")
            ring = self.corners.ring(end - start)
            for i in range(len(ring)):
                if ring[i] == len(self.vertices):
                    self._place(ring, i)
            self.corners.join(ring)
            all_corners += ring
        # Vertices without a ring are 0.
        self.vertices += [[0, 0, 0]] * (v - len(self.vertices))
        self.colours += [[0, 0, 0]] * (v - len(self.colours) if flags & 1 else 0)
        all_corners += [0] * (corners - len(all_corners))
        words = [x % U32 for place in self.vertices for x in place] + face_ends + ([] if triangles else ring_ends) + parts
        self.plain = b"".join(
            [
                struct.pack(f"<5I{len(words)}I", *head, *words),
                struct.pack(f"<{len(sources)}Q", *sources),
                proxies.to_bytes(sizes[4], "little"),
                bytes(x for colour in self.colours for x in colour),
                struct.pack(f"<{corners}{'I' if flags & 2 else 'H'}", *all_corners),
            ]
        )

    def _place(self, ring: list[int], i: int) -> None:
        new, n = len(self.vertices), len(ring)
        p, q, opposite = ring[i - 1], ring[(i + 1) % n], ring[(i + 2) % n]
        known = [k for k in (p, q) if k < new]
        way, o = 2, None
        if len(known) == 2 and n == 3:
            o = next((x for u, x in self.corners.into.get(q, []) if u == p), None)
            way = 2 if o is None else 0
        elif len(known) == 2 and n == 4 and opposite < new:
            way, o = 1, opposite
        if o is not None:
            expected = [a + b - d for a, b, d in zip(*(self.vertices[k] for k in (p, q, o)))]
        elif len(known) == 2:
            expected = [a + b >> 1 for a, b in zip(self.vertices[p], self.vertices[q])]
        else:
            way = 3 if known else 4
            expected = self.vertices[known[0]] if known else self.vertices[new - 1] if new else [0, 0, 0]
        place: list[int] = []
        same: tuple[int, ...] = ()
        for axis, (s, f) in enumerate(self.steps):
            x = (expected[axis] - f) // s
            is_same = self.c.bit(("same", way, axis, same))
            same += (is_same,)
            x += 0 if is_same else self.c.near("place", way, axis)
            place.append(signed(x * s + f, 32))
        self.vertices.append(place)
        if self.has_colours:
            near = self.colours[known[0]] if known else self.colours[new - 1] if new else [0, 0, 0]
            self.colours.append([(near[k] + self.c.near("colour", k)) % 256 for k in range(3)])


class Exact:
    """A block of exact faces."""

    def __init__(self, c: Columns, size: int) -> None:
        self.c = c
        head = [c.number() for _ in range(8)]
        check(max(head) < U32, "the head of a packed block")
        n, p, g, v, r, corners, flags, widths = head
        wa, wb, wx, ww = widths.to_bytes(4, "little")
        check(flags < 8 and 0 < wa <= 8 and 0 < wb <= 16 and 0 < wx <= 25 and 0 < ww <= 22, "the head of a packed block")
        wide = 4 if flags & 2 else 2
        sizes = [(3 * wa + wb) * p, 12 * g, (3 * wx + ww) * v, wide * n, 4 * n if flags & 4 else 4, 12 * n, 4 * r, 2 * wide * corners]
        check(32 + sum(sizes) + (3 * corners if flags & 1 else 0) == size, "lists of a packed block")
        face_ends, ring_ends = c.ends("rings", 1, n), c.ends("ring", 3, r)
        parts, sources = c.sums("part", 32, n if flags & 4 else 1), c.sums("source", 64, n)
        self.planes_count, self.next_plane, self.previous_plane = p, 0, [0, 0]
        self.counts, self.next, self.was_on_grid = (g, v), [0, 0], 1
        self.corners = Corners(c, g + v)
        self.order: list[int] = []
        self.edges: dict[tuple[int, int], tuple[int, int]] = {}
        of_faces: list[int] = []
        all_corners: list[tuple[int, int]] = []
        # A grid point in each plane, an edge between two with its face's plane, and planes of other
        # vertices.
        points: dict[int, int] = {}
        ends: dict[int, tuple[int, int, int]] = {}
        meeting: dict[int, tuple[int, int, int]] = {}
        for a, e in zip([0, *face_ends], face_ends):
            of_faces.append(plane := self._plane(0))
            check(a <= e <= r, "ends of faces")
            for end in ring_ends[a:e]:
                check(len(all_corners) <= end <= corners, "ends of rings")
                ring = self._ring(plane, end - len(all_corners))
                all_corners += ring
                for i, (vertex, line) in enumerate(ring):
                    around, to = (plane, ring[i - 1][1], line), ring[(i + 1) % len(ring)][0]
                    if vertex >= g:
                        meeting.setdefault(vertex - g, around)
                        continue
                    for k in around:
                        points.setdefault(k, vertex)
                    if to < g:
                        ends.setdefault(line, (vertex, to, plane))
        all_corners += [(0, 0)] * (corners - len(all_corners))
        colours = [[0, 0, 0]]
        for _ in range(corners if flags & 1 else 0):
            colours.append([(x + c.near("colour", k)) % 256 for k, x in enumerate(colours[-1])])
        grid = [[0, 0, 0]]
        for _ in range(g):
            grid.append([(x + c.near("coordinate", k)) % U32 for k, x in enumerate(grid[-1])])
        grid = grid[1:]
        planes: list[tuple[list[int], int]] = []
        for k in range(p):
            normal = self._normal(planes, grid, ends.get(k))
            check(all(abs(x) < 1 << 56 for x in normal), "a normal")
            product = sum(x * y for x, y in zip(normal, grid[points[k]])) if k in points else None
            if product is None or not c.bit("product"):
                sign = c.bit("sign")
                product = (c.number() | c.number() << 64) * (-1 if sign else 1)
            check(abs(product) < 1 << 84, "a product")
            planes.append((normal, product))
        vertices = [self._vertex(planes, meeting.get(k), wx, ww) for k in range(v)]
        whole = lambda x, width: (x % (1 << 8 * width)).to_bytes(width, "little")  # noqa: E731
        letter = "I" if flags & 2 else "H"
        self.plain = b"".join(
            [
                struct.pack("<8I", *head),
                *(b"".join(whole(x, wa) for x in normal) + whole(d, wb) for normal, d in planes),
                struct.pack(f"<{3 * g}I", *(x for place in grid for x in place)),
                *(b"".join(whole(x, wx) for x in at) + whole(w, ww) for at, w in vertices),
                struct.pack(f"<{n}{letter}", *of_faces),
                struct.pack(f"<{len(parts)}I{n}Q{n}I{r}I", *parts, *sources, *face_ends, *ring_ends),
                struct.pack(f"<{2 * corners}{letter}", *(x for corner in all_corners for x in corner)),
                bytes(x for colour in colours[1:] for x in colour),
            ]
        )

    def _plane(self, kind: int) -> int:
        if self.c.bit(("new plane", kind)):
            self.next_plane += 1
            check(self.next_plane <= self.planes_count, "planes of a packed block")
            return self.next_plane - 1
        self.previous_plane[kind] = (self.previous_plane[kind] + self.c.near("plane", kind)) % U32
        check(self.previous_plane[kind] < self.next_plane, "a plane that has not been there")
        return self.previous_plane[kind]

    def _ring(self, plane: int, count: int) -> list[tuple[int, int]]:
        ring = self.corners.ring(count)
        for vertex in ring:
            if vertex == len(self.order):
                self.was_on_grid = self.c.bit(("on grid", self.was_on_grid))
                kind = 1 - self.was_on_grid
                self.order.append(self.next[kind] + kind * self.counts[0])
                self.next[kind] += 1
                check(self.next[kind] <= self.counts[kind], "vertices of a packed block")
        self.corners.join(ring)
        found = []
        for edge in zip(ring, ring[1:] + ring[:1]):
            line = next((k for i, k in enumerate(self.edges.get(edge[::-1], ())) if self.c.bit(("other", i))), None)
            line = self._plane(1) if line is None else line
            self.edges[edge] = (line, plane)
            found.append((self.order[edge[0]], line))
        return found

    def _normal(self, planes: list[tuple[list[int], int]], grid: list[list[int]], ends: tuple[int, int, int] | None) -> list[int]:
        c = self.c
        if ends and ends[2] < len(planes) and any(planes[ends[2]][0]):
            sizes = [abs(x) for x in planes[ends[2]][0]]
            axis = max(range(3), key=lambda k: (sizes[k], k))
            u, w = (axis + 1) % 3, (axis + 2) % 3
            a, b = grid[ends[0]], grid[ends[1]]
            along = [0, 0, 0]
            along[u], along[w] = a[w] - b[w], b[u] - a[u]
            if c.bit("along"):
                return along
        normal: list[int] = []
        for axis in range(3):
            zero = c.bit(("zero", axis, *(x == 0 for x in normal)))
            normal.append(0 if zero else c.near("normal", axis))
        return normal

    def _vertex(self, planes: list[tuple[list[int], int]], of: tuple[int, int, int] | None, wx: int, ww: int) -> tuple[list[int], int]:
        c = self.c
        if not c.bit("common"):
            read = lambda size: b"".join(c.number().to_bytes(8, "little")[: min(8, size - k)] for k in range(0, size, 8))  # noqa: E731
            *at, weight = (int.from_bytes(read(size), "little", signed=True) for size in (wx, wx, wx, ww))
            return at, weight
        times = c.number()
        check(times and of, "a point of no planes")
        (l, i), (m, j), (n, k) = (planes[number] for number in of or ())
        crosses = cross(m, n), cross(n, l), cross(l, m)
        weight = sum(x * y for x, y in zip(l, crosses[0]))
        check(weight, "planes without a point")
        sign = 1 if weight > 0 else -1
        at = [sign * (i * crosses[0][a] + j * crosses[1][a] + k * crosses[2][a]) for a in range(3)]
        return [abs(x) // times * (1 if x > 0 else -1) for x in at], abs(weight) // times


def cross(a: list[int], b: list[int]) -> list[int]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Segment:
    """A segment of the octree."""

    def __init__(self, c: Columns, size: int) -> None:
        self.c = c
        self.f, self.e, self.k, self.capacity = head = [c.number() for _ in range(4)]
        check(self.k and 16 + 4 * (self.f + self.e + self.k) + self.capacity == size, "lists of a packed segment")
        self.words, self.leaves, self.next, self.inside = [0] * self.k, bytearray(), 1, 0
        # For both kinds of faces: model numbers, and recent ones with their cells, the newest
        # first.
        self.numbers: list[list[int]] = [[], []]
        self.recent: list[list[tuple[int, list[tuple[int, ...]]]]] = [[], []]
        self._node(0, (0, 0, 0, 1 << LEVELS), [5, 5, 5])
        check(self.next == self.k and len(self.leaves) == self.capacity, "words or leaves of a packed segment")
        check([len(n) for n in self.numbers] == [self.f, self.e], "faces of a packed segment")
        words = self.numbers[0] + self.numbers[1] + self.words
        self.plain = struct.pack(f"<4I{len(words)}I", *head, *words) + bytes(self.leaves)

    def _node(self, word: int, cell: tuple[int, ...], siblings: list[int]) -> None:
        state = self.c.tree(("state", *siblings), 3)
        check(state < 7, "a state of a packed segment")
        where = self.next if state == INNER else len(self.leaves) if state >= LEAF else 0
        self.words[word] = where << 3 | state
        if state == INNER:
            self.next += 8
            check(self.next <= self.k and cell[3] > 1, "words of a packed segment")
            half = cell[3] // 2
            for i in range(8):
                below = tuple(cell[a] + (i >> a & 1) * half for a in range(3))
                before = [self.words[where + i - (1 << a)] & 7 if i >> a & 1 else None for a in range(3)]
                of = [5 if s is None else {NEAR_VOID: VOID, NEAR_FULL: FULL}.get(s, s) for s in before]
                self._node(where + i, (*below, half), of)
        elif state == LEAF:
            at = len(self.leaves)
            self.leaves.append(0)
            count = self._list(0, cell)
            kind = self.c.tree(("kind", min(count, 7)), 2)
            rule = self.c.tree(("rule", kind, min(count, 3)), 2)
            self.inside = self.c.bit(("inside", *(min(s, 2) for s in siblings), self.inside))
            near = self.c.bit("near") if self.e else 0
            self.leaves[at] = kind | rule << 2 | self.inside << 4 | near << 5
            if near:
                self._list(1, cell)
        elif state > LEAF:
            self._list(1, cell)

    def _list(self, kind: int, cell: tuple[int, ...]) -> int:
        c, numbers, newest = self.c, self.numbers[kind], self.recent[kind][:RECENT]
        found: dict[int, list[tuple[int, ...]]] = {}
        expected = None
        for rank, (face, cells) in enumerate(newest):
            last, before = place_of(cell, cells[0]), place_of(cell, cells[1]) if len(cells) > 1 else 0
            if last and c.bit(("again", kind, last, before, rank.bit_length())):
                found[face] = cells
                expected = numbers[face] if expected is None else expected
        known = top = len(numbers)
        for _ in range(c.count("far", kind)):
            top -= 1 + c.count("far number", kind)
            check(top >= 0 and top not in found, "own numbers of a packed segment")
            found[top] = dict(newest).get(top, [])
        new = c.count("new", kind)
        check(known + new <= (self.f, self.e)[kind], "new faces of a packed segment")
        for i in range(new):
            base = expected if i == 0 and expected is not None else numbers[-1] if numbers else 0
            numbers.append((base + c.near("next" if i else "first", kind)) % U32)
            found[known + i] = []
        check(found, "a list of no faces")
        self.leaves += leb(len(found))
        before = -1
        for face in sorted(found):
            self.leaves += leb(face - before - 1)
            before = face
        check(len(self.leaves) <= self.capacity, "leaves of a packed segment")
        now = [(face, [cell, *found[face][:1]]) for face in sorted(found, reverse=True)]
        self.recent[kind] = (now + [item for item in newest if item[0] not in found])[:RECENT]
        return len(found)


def place_of(cell: tuple[int, ...], other: tuple[int, ...]) -> int:
    """Returns the relation of two cells: 0 disjoint, 1 a common edge or corner, 2 to 4 a common
    wall."""
    walls = []
    for axis in range(3):
        a, b = (cell[axis], cell[axis] + cell[3]), (other[axis], other[axis] + other[3])
        if a[0] > b[1] or b[0] > a[1]:
            return 0
        if a[0] == b[1] or b[0] == a[1]:
            walls.append(axis)
    return 2 + walls[0] if len(walls) == 1 else 1


def leb(n: int) -> bytes:
    found = bytearray()
    while n >= 0x80:
        found.append(n & 0x7F | 0x80)
        n >>= 7
    return bytes([*found, n])
