"""Arrays that are built in shards: their layers, and the Dask chunks that these are read from."""

from __future__ import annotations

import itertools
from collections import OrderedDict
from typing import Any

import numpy as np

from ._files import MEMORY
from ._options import packing_of, refuse
from ._progress import memory_of
from ._stack import InputLayers, layers_of, one_layer, stack_layers
from ._times import text_of_time
from ._metadata import crs_text

#: Options of `spinney.build` for arrays, with their defaults.
_OPTIONS: dict[str, Any] = {
    **dict.fromkeys(("dims", "mask", "kind", "rule", "nodata", "transform", "crs", "depth", "names", "times")),
    **dict.fromkeys(("categories", "colormap", "descriptions", "scales", "offsets", "units", "tags")),
    **{"stack": False, "codec": "plain", "max_error": None},
}


def input_layers(source: Any, memory: int | str = MEMORY, **options: Any) -> InputLayers:
    """Returns the layers that `spinney.build` makes of arrays with these options, without reading
    them. Dask chunks are cached within the memory limit.
    """
    if unknown := sorted(options.keys() - _OPTIONS.keys()):
        raise TypeError(f"{', '.join(unknown)}: not supported for arrays that are built in shards")
    said = _OPTIONS | options
    packing = packing_of(said["codec"], said["max_error"])
    common = {name: said[name] for name in ("kind", "rule", "nodata", "depth")} | {"crs": crs_text(said["crs"])}
    common |= {"memory": memory_of(memory), "share": False, "packing": packing, "time": None}
    about = {name: said[name] for name in ("dims", "mask", "transform", "categories", "colormap", "descriptions", "scales", "offsets", "units", "tags")}
    about |= {"shape": None, "dtype": None}
    times = None if said["times"] is None else [time if isinstance(time, str) else text_of_time(time) for time in said["times"]]
    layers = layers_of(source, said["stack"], (said["names"], times), said["dims"], said["descriptions"])
    if layers is None:
        refuse("stacks", {"names": said["names"], "times": times})
        given = one_layer(source, common, about)
    else:
        given = stack_layers(layers, common, about)
    _keep_chunks(given, memory_of(memory) // 4)
    return given


def _keep_chunks(given: InputLayers, memory: int) -> None:
    """Has Dask arrays read chunk by chunk, with `memory` for the cached chunks of all layers."""
    each = memory // max(1, len(given.layers))
    for layer in given.layers:
        blocks = layer["read"].__self__
        for name in ("source", "mask"):
            array = getattr(blocks, name)
            array = array.data if hasattr(array, "dims") and hasattr(array, "data") and _is_dask(array.data) else array
            if _is_dask(array):
                setattr(blocks, name, Chunks(array, each // 2))


def chunks_of(given: InputLayers) -> list[Chunks]:
    """Returns the Dask arrays that layers are read from."""
    arrays = [getattr(layer["read"].__self__, name) for layer in given.layers for name in ("source", "mask")]
    return [array for array in arrays if isinstance(array, Chunks)]


def _dask() -> Any:
    """Returns the package dask, which is mostly untyped."""
    import dask

    return dask


def _is_dask(array: Any) -> bool:
    return hasattr(array, "chunks") and hasattr(array, "blocks") and hasattr(array, "compute")


class Chunks:
    """A Dask array whose chunks are computed on demand. All missing chunks of a request are
    computed together; the most recent ones are cached.

    `memory` is the limit, in bytes, of cached chunks that the current request does not need.
    `scheduler` computes them, by default that of the process.
    """

    def __init__(self, array: Any, memory: int) -> None:
        self.array, self.memory = array, memory
        self.shape, self.dtype = array.shape, array.dtype
        self.scheduler: Any = None
        #: The first cell of each chunk, and the end, along each axis.
        self.ends = [np.concatenate([[0], np.cumsum(lengths)]).astype(int).tolist() for lengths in array.chunks]
        self.kept: OrderedDict[tuple[int, ...], Any] = OrderedDict()

    def __dask_tokenize__(self) -> Any:
        return self.array.__dask_tokenize__()

    def __getitem__(self, key: tuple[slice, ...]) -> Any:
        parts = [cut.indices(length)[:2] for cut, length in zip(key, self.shape)]
        touched = [
            range(int(np.searchsorted(ends, first, "right")) - 1, int(np.searchsorted(ends, end, "left"))) for ends, (first, end) in zip(self.ends, parts)
        ]
        chunks = self._computed(list(itertools.product(*touched)))
        made: Any = None
        for place, chunk in chunks.items():
            starts = [ends[index] for ends, index in zip(self.ends, place)]
            inside = tuple(slice(max(first - start, 0), end - start) for start, (first, end) in zip(starts, parts))
            cut = chunk[inside]
            if len(chunks) == 1:
                return cut
            if made is None:
                like: Any = np.ma if any(isinstance(other, np.ma.MaskedArray) for other in chunks.values()) else np
                made = like.empty([end - first for first, end in parts], dtype=self.dtype)
            at = [max(start - first, 0) for start, (first, _) in zip(starts, parts)]
            made[tuple(slice(first, first + length) for first, length in zip(at, cut.shape))] = cut
        return made

    def _computed(self, positions: list[tuple[int, ...]]) -> dict[tuple[int, ...], Any]:
        """Returns chunks, computing those that are not cached."""
        missing = [place for place in positions if place not in self.kept]
        found = dict(zip(missing, _dask().compute(*(self.array.blocks[place] for place in missing), scheduler=self.scheduler)))
        for place in positions:
            if place in self.kept:
                self.kept.move_to_end(place)
                found[place] = self.kept[place]
        self.kept |= {place: found[place] for place in missing}
        while len(self.kept) > 1 and sum(chunk.nbytes for chunk in self.kept.values()) > self.memory:
            self.kept.popitem(last=False)
        return {place: found[place] for place in positions}
