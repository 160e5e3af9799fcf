"""Verification of Goblin files: checksums, redundant data, and what follows from the cells
(sections 6 to 13)."""

from __future__ import annotations

from typing import Any

import numpy as np
from basics import Code, check
from reader import NO_COUNTS, Goblin, Layer
from rules import Pyramid, same
from trees import CUT, INNER, LEAF, VOID, TreeHeader, Tree, raw_bits


def verify(file: Goblin) -> None:
    """Raises `CorruptFile` unless the whole file is valid."""
    for layer in file.layers:
        pyramid = verify_tree(layer)
        check(layer.meta["counts"] == pyramid.counts(), "counts of nodes per level")
        verify_directory(layer)
        verify_order(layer)
        verify_segments(layer, pyramid)


def verify_tree(tree: Tree) -> Pyramid:
    """Checks that nodes and representatives of all levels follow from the cells."""
    f = tree.form
    values, states = tree.window(f.depth)
    check((states <= LEAF).all(), "a cell that is INNER")
    outside = np.zeros(states.shape, bool)
    for axis, size in enumerate(f.extent[: f.axes][::-1]):
        outside[tuple([slice(None)] * axis + [slice(size, None)])] = True
    check((states[outside] == VOID).all(), "a cell beyond the extent")
    pyramid = Pyramid(f, values, states)
    for level, expected in enumerate(pyramid.levels):
        values, states = tree.window(level)
        check((states == expected.states).all(), f"states of level {level}")
        check((raw_bits(values) == raw_bits(expected.values)).all(), f"values of level {level}")
    return pyramid


def verify_directory(layer: Layer) -> None:
    """Checks that codes ascend, and that pages have copies of all ancestors of their first
    entries."""
    entries = layer.entries
    check(len(entries) == layer.segments, "segments")
    check(all(a.node.code < b.node.code for a, b in zip(entries, entries[1:])), "codes of the directory")
    end = layer.directory
    for number, place in layer.index():
        copies, own = layer.page(number, place)
        node = own[0].node
        before = enumerate(entries[: 128 * number])
        above = [(i, e.raw) for i, e in before if e.node.level < node.level and node.up(node.level - e.node.level) == e.node]
        check([(i, e.raw) for i, e in copies] == above, "copies in a page")
        check(place[1] == end, "pages are not consecutive")
        end += place[2]
    check(len(layer.levels) > 1 or end == len(layer.run), "bytes after the segment index")


def verify_order(layer: Layer) -> None:
    """Checks that segments are stored as section 7 specifies, without gaps: in postorder, the top
    levels last."""
    f = layer.form
    top_levels = max(f.depth - f.reach - 6, min(f.depth - f.reach, 3)) if f.depth > f.reach else 0

    def place(node: Code) -> tuple[bool, list[int]]:
        # In postorder a node follows its descendants: after every child number.
        return node.level < top_levels, [*node.path, f.children]

    end = start = 0
    for entry in sorted(layer.entries, key=lambda e: place(e.node)):
        check(entry.start == end, "segments are in another order, or have gaps")
        end += entry.size
        start = end if entry.node.level >= top_levels else start
    check(end == layer.directory, "bytes between the segments and the segment index")
    check(layer.top_levels == (start if top_levels else end), "the top levels are at another offset")


def owners(f: TreeHeader, pyramid: Pyramid) -> list[Code]:
    """Returns the nodes that own segments, by section 11."""
    root = [Code(0, (0,) * f.axes)] if pyramid.levels[0].states.flat[0] == INNER else []
    for level in range(f.depth - f.reach, 0, -f.stride):
        heavy = np.argwhere(pyramid.levels[level].nodes > f.heavy)
        root += [Code(level, tuple(int(v) for v in at[::-1])) for at in heavy]
    return sorted(root, key=lambda node: node.code)


def verify_segments(layer: Layer, pyramid: Pyramid) -> None:
    """Checks that the segments are those of section 11, byte by byte, with class counts and
    statistics."""
    check([e.node for e in layer.entries] == owners(layer.form, pyramid), "segments are those of other nodes")
    slots = 0
    for entry in layer.entries:
        check(same(entry.statistics, pyramid.statistics(entry.node)), "statistics of a segment")
        counts = pyramid.classes_of(entry.node) if layer.form.classes else []
        if len(counts) > 1024:
            check(entry.classes == NO_COUNTS, "class counts that there cannot be")
        else:
            check((layer.counts(entry) or []) == counts, "class counts of a segment")
        slots += entry.slots
        data = layer.records(entry).data
        check(data == Writer(layer.form, pyramid).segment(entry.node), "a segment is written in another way")
    check(slots == layer.slots, "slots of all segments")


class Writer:
    """The canonical form of a segment, or of an Autumnal run (section 11), computed only from the
    nodes."""

    def __init__(self, form: TreeHeader, pyramid: Pyramid) -> None:
        self.form, self.pyramid = form, pyramid

    def segment(self, node: Code) -> bytes:
        """Returns all records and dense blocks of a node's segment."""
        f = self.form
        candidates = [level for level in range(f.depth - f.reach, node.level, -f.stride) if level > 0]
        self.next, self.end = (min(candidates), node.level + f.reach) if candidates else (node.level, f.depth)
        return self._node(node, f.depth if not candidates else None)

    def run(self, node: Code, levels: int) -> bytes:
        """Returns the run of an Autumnal record."""
        return self._node(node, min(node.level + levels, self.form.depth))

    def _node(self, node: Code, bottom: int | None) -> bytes:
        f, levels = self.form, self.pyramid.levels
        if bottom is None and node.level == self.next:
            heavy = levels[node.level].nodes[node.at[::-1]] > f.heavy
            bottom = self.end if heavy else f.depth
        cube = tuple(slice(2 * v, 2 * v + 2) for v in reversed(node.at))
        below = levels[node.level + 1]
        states = [int(s) for s in below.states[cube].flat]
        if node.level + 1 == bottom:
            states = [CUT if s == INNER else s for s in states]
        inner = [tuple(2 * v + (i >> a & 1) for a, v in enumerate(node.at)) for i, s in enumerate(states) if s == INNER]
        records = b"".join(self._node(Code(node.level + 1, at), bottom) for at in inner)
        n = 1 + len(records) // f.record
        dense = self._dense(node, bottom - node.level, n) if bottom is not None else None
        mark, rows = dense or (0, records)
        last = 1 + len(rows) // f.record | mark << f.skips
        packed = sum(s << 2 * i for i, s in enumerate(states)) | last << (8 if f.axes == 2 else 32)
        head = below.values[cube].tobytes() + packed.to_bytes(4 if f.axes == 2 else 8, "little")
        return head + rows

    def _dense(self, node: Code, k: int, n: int) -> tuple[int, bytes] | None:
        """Returns mark and rows of a dense block, if that is smaller."""
        f = self.form
        if k > f.reach or k not in (range(3, 9) if f.axes == 2 else range(2, 5)):
            return None

        def cut(j: int) -> Any:
            return tuple(slice(v << j, v + 1 << j) for v in reversed(node.at))

        bottom = self.pyramid.levels[node.level + k].states[cut(k)]
        kinds = {(LEAF,): 1, (INNER,): 2, (VOID, LEAF): 3, (VOID, INNER): 4, (LEAF, INNER): 5}
        mark = kinds.get(tuple(np.unique(bottom).tolist()))
        if mark is None:
            return None
        rows = b"".join(self.pyramid.levels[node.level + j].values[cut(j)].tobytes() for j in range(2, k + 1))
        if mark > 2:
            rows += np.packbits(bottom == (LEAF if mark == 3 else INNER), bitorder="little").tobytes()
        rows += bytes(-len(rows) % f.record)
        return (mark, rows) if 1 + len(rows) // f.record < n + n // 8 else None
