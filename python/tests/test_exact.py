"""Exact models, read by the letter of formats.md (sections 27 to 32) and by nothing else."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, run

VOID, FULL, INNER, CUT, LEAF = range(5)


def crc32c(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc = TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    return crc ^ 0xFFFFFFFF


def entry(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0x82F63B78 if byte & 1 else 0)
    return byte


TABLE = [entry(byte) for byte in range(256)]


def sign(number: int) -> int:
    return (number > 0) - (number < 0)


class Face:
    """A face in units of 2^-32 of the grid's."""

    def __init__(self, rings: list[np.ndarray]) -> None:
        self.rings = [[[int(at) << 32 for at in point] for point in ring] for ring in rings]
        first = [[int(at) for at in point - rings[0][0]] for point in rings[0]]
        pairs = list(zip(first, first[1:], strict=False))
        others = [(1, 2), (2, 0), (0, 1)]
        self.normal = [sum(p[j] * q[k] - p[k] * q[j] for p, q in pairs) for j, k in others]

    def side(self, point: list[int]) -> int:
        return sign(sum(n * (at - from_) for n, at, from_ in zip(self.normal, point, self.rings[0][0], strict=True)))

    def side_of_moved(self, point: list[int]) -> int:
        return self.side(point) or sign(next(n for n in self.normal if n))

    def edges(self) -> list[tuple[list[int], list[int]]]:
        return [edge for ring in self.rings for edge in zip(ring, ring[1:] + ring[:1], strict=True)]

    def is_met(self, axis: int, s: list[int]) -> bool:
        u, v = [other for other in range(3) if other != axis]
        met = False
        for g, h in self.edges():
            if (g[v] > s[v]) != (h[v] > s[v]):
                d = (h[u] - g[u]) * (s[v] - g[v]) - (h[v] - g[v]) * (s[u] - g[u])
                met ^= d > 0 if h[v] > s[v] else d < 0
        return met

    def has(self, point: list[int]) -> bool:
        if self.side(point):
            return False
        axis = max(range(3), key=lambda axis: abs(self.normal[axis]))
        u, v = [other for other in range(3) if other != axis]
        for g, h in self.edges():
            within = all(min(g[i], h[i]) <= point[i] <= max(g[i], h[i]) for i in (u, v))
            if within and (h[u] - g[u]) * (point[v] - g[v]) == (h[v] - g[v]) * (point[u] - g[u]):
                return True
        return self.is_met(axis, point)


class Model:
    def __init__(self, path: Path) -> None:
        self.data = data = path.read_bytes()
        assert data[:8] == b"\x93Goblin\n" and data[16] == 2
        assert crc32c(data[:56]) == struct.unpack_from("<I", data, 56)[0]
        length, checksum, magic = struct.unpack("<II8s", data[-16:])
        trailer = data[-16 - length : -16]
        assert magic == b"\nnilboG\x93" and crc32c(trailer) == checksum
        self.segments, self.nodes, size, count = struct.unpack_from("<QQQI", trailer, 40)
        assert size == len(data) and count == 4
        self.sections = {}
        for place in range(68, 68 + 24 * count, 24):
            tag, checksum, start, length = struct.unpack_from("<4sIQQ", trailer, place)
            self.sections[tag] = data[start : start + length]
            assert crc32c(self.sections[tag]) == checksum
        bits, *self.origin, self.step, self.divisor, self.faces = struct.unpack_from("<B7x3qddQ", self.sections[b"BREP"])
        self.counts = struct.unpack_from("<7Q", self.sections[b"BREP"], 56)
        self.bits, self.depth = bits, min(bits, 19)
        assert data[18] == self.depth and sum(self.counts) == self.nodes
        self.read_faces()
        self.directory = dict(self.pieces(b"DIRE"))
        assert len(self.directory) == self.segments and sorted(self.directory) == list(self.directory)

    def pieces(self, tag: bytes) -> list[tuple[int, bytes]]:
        pieces = []
        for key, start, length, checksum in struct.iter_unpack("<QQII", self.sections[tag]):
            pieces.append((key, self.data[start : start + length]))
            assert crc32c(pieces[-1][1]) == checksum
        return pieces

    def read_faces(self) -> None:
        self.face: list[Face] = []
        for first, block in self.pieces(b"FACE"):
            n, v, r, c, flags = struct.unpack_from("<5I", block)
            at = 20

            def take(kind: str, count: int, is_there: bool | int = True, block: bytes = block) -> np.ndarray:
                nonlocal at
                found = np.frombuffer(block, kind, count if is_there else 0, at)
                at += found.nbytes
                return found

            vertices = take("<u4", 3 * v).reshape(-1, 3).astype(np.int64)
            face_ends, ring_ends = take("<u4", n, not flags & 4), take("<u4", r, not flags & 4)
            take("<u4", n if flags & 8 else 1), take("<u8", n, flags & 16), take("u1", 3 * v, flags & 1)
            corners = vertices[take("<u4" if flags & 2 else "<u2", c)]
            assert at == len(block) and first == len(self.face) and (vertices < 1 << self.bits).all()
            if flags & 4:
                face_ends, ring_ends = np.arange(1, n + 1), np.arange(3, c + 1, 3)
            rings = np.split(corners, ring_ends[:-1])
            self.face += [Face(rings[a:b]) for a, b in zip([0, *face_ends], face_ends, strict=False)]
        assert len(self.face) == self.faces

    def segment(self, code: int) -> tuple[np.ndarray, np.ndarray, bytes]:
        bytes_ = self.directory[code]
        f, k, b = struct.unpack_from("<3I", bytes_)
        assert len(bytes_) == 12 + 4 * (f + k) + b
        return np.frombuffer(bytes_, "<u4", f, 12), np.frombuffer(bytes_, "<u4", k, 12 + 4 * f), bytes_[12 + 4 * (f + k) :]

    @staticmethod
    def leaf(faces: np.ndarray, leaves: bytes, at: int) -> tuple[int, list[int], int]:
        """Head, numbers of the faces in the model, and where the leaf ends."""

        def number() -> int:
            nonlocal at
            value = shift = 0
            while True:
                byte = leaves[at]
                at, value, shift = at + 1, value | (byte & 127) << shift, shift + 7
                if byte < 128:
                    return value

        head, at = leaves[at], at + 1
        own, numbers = -1, []
        for _ in range(number()):
            own += number() + 1
            numbers.append(int(faces[own]))
        return head, numbers, at

    def walk(self, code: int = 0) -> list[int]:
        """Counts nodes by state and kind; words and leaves have to stand in preorder."""
        faces, words, leaves = self.segment(code)
        counts = [0] * 7
        level = code & 31
        next_word, next_byte = 1, 0
        stack = [(0, code >> 5 << 5, level)]
        while stack:
            place, path, level = stack.pop()
            state, where = int(words[place]) & 7, int(words[place]) >> 3
            if state == INNER:
                assert where == next_word and level < self.depth
                next_word += 8
                counts[2] += 1
                stack += [(where + child, path | child << 60 - 3 * level, level + 1) for child in reversed(range(8))]
            elif state == CUT:
                assert place
                counts = [a + b for a, b in zip(counts, self.walk(path | level), strict=True)]
            elif state == LEAF:
                assert where == next_byte
                head, numbers, next_byte = self.leaf(faces, leaves, where)
                assert numbers and head < 32 and head >> 2 & 3 < 3
                counts[3 + (head & 3)] += 1
            else:
                counts[state] += 1
        assert (next_word, next_byte) == (len(words), len(leaves))
        return counts

    def place(self, world: np.ndarray, crossings: bool) -> str:
        """Where a point is, by a leaf's own rule or by crossings."""
        grid = world * self.divisor / self.step - self.origin
        point = [int(at) for at in np.rint(grid * 2.0**32)]
        from_wall = [at + (1 << 31) for at in point]
        if any(not 0 <= at < 1 << 32 + self.bits for at in from_wall):
            return "outside"
        faces, words, leaves = self.segment(0)
        word, path, level = int(words[0]), 0, 0
        while word & 7 == INNER:
            bit = 32 + self.bits - 1 - level
            child = sum((at >> bit & 1) << axis for axis, at in enumerate(from_wall))
            path |= child << 60 - 3 * level
            level += 1
            word = int(words[(word >> 3) + child])
            if word & 7 == CUT:
                faces, words, leaves = self.segment(path | level)
                word = int(words[0])
        if word & 7 != LEAF:
            return "inside" if word & 7 == FULL else "outside"
        head, numbers, _ = self.leaf(faces, leaves, word >> 3)
        cutting = [self.face[number] for number in numbers]
        if any(face.has(point) for face in cutting):
            return "boundary"
        rule = 2 if crossings else head >> 2 & 3
        if rule < 2:
            behind = [face.side(point) < 0 for face in cutting]
            return "inside" if (all, any)[rule](behind) else "outside"
        width = 32 + self.bits - level
        at = [(here >> width << width) - (1 << 31) for here in from_wall]
        winding = head >> 4 & 1
        for axis in range(3):
            to = at[:axis] + [point[axis]] + at[axis + 1 :]
            for face in cutting:
                side = face.side_of_moved(at) if face.normal[axis] else 0
                if side and side != face.side_of_moved(to) and face.is_met(axis, at):
                    winding += side
            at = to
        return "inside" if winding == 1 else "outside"


def off(points: list, faces: list) -> str:
    lines = [f"OFF\n{len(points)} {len(faces)} 0"]
    lines += [" ".join(map(str, point)) for point in points]
    lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    return "\n".join(lines) + "\n"


def torus() -> str:
    n, m = 60, 30
    u, v = np.indices((n, m)).reshape(2, -1) * np.array([[2 * np.pi / n], [2 * np.pi / m]])
    points = np.round(np.stack([(3 + np.cos(v)) * np.cos(u), (3 + np.cos(v)) * np.sin(u), np.sin(v)], 1), 4)
    i, j = np.indices((n, m)).reshape(2, -1)
    a, b, c, d = (x % n * m + y % m for x, y in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)])
    return off(points.tolist(), [*np.stack([a, b, c], 1).tolist(), *np.stack([a, c, d], 1).tolist()])


def frame() -> str:
    """A block with a tunnel; the tunnel's ends are holes, which bridges join to their faces."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    points = [(x * 8 - 3, y * 8, z * 4 + 100) for z in (0, 1) for x, y in square]
    points += [(x * 3 - 1, y * 3 + 2, z * 4 + 100) for z in (0, 1) for x, y in square]
    faces = [[0, 3, 2, 1, 0, 8, 9, 10, 11, 8], [4, 5, 6, 7, 4, 12, 15, 14, 13, 12]]
    for first, turn in [(0, 1), (8, -1)]:
        walls = [[first + i, first + (i + 1) % 4, first + 4 + (i + 1) % 4, first + 4 + i] for i in range(4)]
        faces += [wall[::turn] for wall in walls]
    return off(points, faces)


@pytest.mark.parametrize("boolean", [0, 12])
@pytest.mark.parametrize(("make", "options"), [(torus, []), (torus, ["--snap", "0.001"]), (frame, ["--snap", "1"])])
def test_foreign_reader(program: str, tmp_path: Path, make, options: list[str], boolean: int) -> None:
    mesh, path = tmp_path / "t.off", tmp_path / "t.goblin"
    mesh.write_text(make())
    run(program, "-q", "build", mesh, "-o", path, "--brep", *options, "--leaf-size", boolean)
    model = Model(path)
    assert model.walk() == list(model.counts)
    if make is frame:
        assert {len(face.rings) for face in model.face} == {1, 2}
    elif boolean == 0:
        assert model.segments > 1
    # Points anywhere, on corners, between them, and where many walls of cells are.
    random = np.random.default_rng(5)
    corners = np.array([face.rings[0][:3] for face in model.face], float).reshape(-1, 3) / 2.0**32
    near = random.choice(corners, 300)
    grids = [random.random((300, 3)) * corners.max(0), near, (near + random.choice(corners, 300)) / 2, near + 0.5]
    grid = np.concatenate([*grids, near + random.integers(-1, 2, near.shape), near + (0.5, -0.5, 0)])
    points = (grid + model.origin) * model.step / model.divisor
    text = "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in points.tolist())
    done = subprocess.run([program, "point", str(path)], input=text, capture_output=True, text=True, check=True)
    wanted = done.stdout.split()
    assert [model.place(point, False) for point in points] == wanted
    assert [model.place(point, True) for point in points] == wanted
    assert {"inside", "outside", "boundary"} == set(wanted)
