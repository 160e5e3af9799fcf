"""Remote files: on web servers, in buckets, in fsspec file systems, and files that Python reads."""

from __future__ import annotations

import hashlib
import json
import os
import re
import threading
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from . import _native

# Length of a file, the function that reads its ranges, the object that copies are made from, and
# its version with a function that returns the current one.
PythonFile = tuple[int, Callable[[list[int], list[int]], list[bytes]], Any, tuple[str, Callable[[], str]] | None]

# Options of the store; a file that Python reads; whether remote and external files are refused.
RemoteAccess = tuple[list[tuple[str, str]], PythonFile | None, tuple[bool, bool]]

#: Schemes of URLs that the native module reads itself, by the protocols of fsspec.
_SCHEMES = {"http": "", "https": "", "s3": "s3://", "s3a": "s3://", "gs": "gs://", "gcs": "gs://", "az": "az://", "abfs": "az://", "abfss": "az://"}


def remote_access_of(
    path: Any, storage_options: Mapping[str, Any] | None, no_remote: bool = False, no_external: bool = False
) -> tuple[str, RemoteAccess]:
    """Returns the name of a file, and how it is read if it is not local."""
    refused = (bool(no_remote), bool(no_external))
    if _is_chained(path):
        path, storage_options = _opened(path, storage_options), None
    name, file = _file_of(path)
    if file is None:
        return name, (storage_of(name, storage_options), None, refused)
    if storage_options:
        raise ValueError("storage_options: the file has a file system already, which has its own")
    return name, (storage_of(name, None), file, refused)


def path_of(path: Any, name: str = "path") -> str:
    """Returns the name of a file for functions that open it themselves: a path, a URL, or an fsspec
    file that is local or has a URL that the native module reads.
    """
    system, within = _system_of(path)
    if system is None:
        if hasattr(path, "read"):
            raise TypeError(f"{name}: got an open file, {type(path).__name__}; expected the name of a file")
        return os.fsdecode(os.fspath(path))
    protocol = _protocol(system)
    if _is_local(system):
        return str(within)
    if protocol not in _SCHEMES:
        raise ValueError(f"{name}: is a file of fsspec's {protocol!r}, which only Python reads; copy it to a local file first (fs.get)")
    if getattr(system, "storage_options", None):
        raise ValueError(f"{name}: is in a file system with options; give the URL, with credentials in the environment (docs/remote.md)")
    url = str(system.unstrip_protocol(within)) if _SCHEMES[protocol] == "" else _SCHEMES[protocol] + str(within)
    return url


def is_path(path: Any) -> bool:
    """Returns whether an object names a file: a path, a URL, or an fsspec file."""
    return isinstance(path, str | os.PathLike) or _system_of(path)[0] is not None


def kept_name(path: Any, file: Any) -> str:
    """Returns the name by which any process can open the file again."""
    name = str(path) if file is not None else path_of(path)
    return name if file is not None or "://" in name else os.path.abspath(name)


def access_again(file: Any, storage: list[tuple[str, str]] | None, refused: tuple[bool, bool] = (False, False)) -> RemoteAccess:
    """Returns how a file is read that was opened before."""
    given = None if file is None else _file_of(file)[1]
    return storage or [], given, refused


@contextmanager
def restricted(*, no_remote: bool = False, no_external: bool = False) -> Iterator[None]:
    """Refuses files in a `with` block, as the program's options `--no-remote` and `--no-external`
    do. Use it for untrusted input.

    With `no_remote` any use of a remote file is an error; with `no_external` virtual rasters (VRT),
    NRRD headers, `.views` files and manifests whose data are in other files are. This applies to
    the calling thread within the block, and to files that it opens there::

        with spinney.restricted(no_remote=True, no_external=True):
            spinney.build(upload, "upload.goblin")
    """
    before = _native.refuse(False, False)
    _native.refuse(before[0] or no_remote, before[1] or no_external)
    try:
        yield
    finally:
        _native.refuse(*before)


def _file_of(path: Any) -> tuple[str, PythonFile | None]:
    """Returns the name of a file, and how Python reads it if it does."""
    system, within = _system_of(path)
    if system is not None:
        if getattr(path, "compression", None):
            raise ValueError(f"path: got a file of fsspec with compression={path.compression!r}, whose ranges cannot be read; decompress it first")
        if _is_local(system):
            return str(within), None
        return f"{_protocol(system)}::{within}", _file_of_system(system, within, path)
    if hasattr(path, "read") and hasattr(path, "seek"):
        return _open_file(path)
    return os.fsdecode(os.fspath(path)), None


def _is_chained(path: Any) -> bool:
    """Returns whether a string is a URL that only fsspec knows, such as `github://` or
    `simplecache::s3://`.
    """
    if not isinstance(path, str):
        return False
    found = re.match(r"([a-z][a-z0-9+-]*)(::|://)", path)
    return found is not None and (found[2] == "::" or found[1] not in (*_SCHEMES, "adl", "azure", "memory", "file"))


def _opened(path: str, storage_options: Mapping[str, Any] | None) -> Any:
    """Opens a URL with fsspec."""
    try:
        import fsspec  # type: ignore[import-untyped,unused-ignore]
    except ImportError:
        raise ValueError(f"{_native.shown(path)}: is a URL for fsspec, which is not installed (pip install fsspec)") from None
    return fsspec.open(path, "rb", **(storage_options or {}))


def _system_of(path: Any) -> tuple[Any, Any]:
    """Returns the fsspec file system and the path in it, also for universal_pathlib."""
    system, within = getattr(path, "fs", None), getattr(path, "path", None)
    return (system, within) if within is not None and hasattr(system, "cat_ranges") else (None, None)


def _file_of_system(system: Any, name: Any, path: Any) -> PythonFile:
    def fetch(starts: list[int], ends: list[int]) -> list[bytes]:
        parts = system.cat_ranges([name] * len(starts), starts, ends, on_error="raise")
        return [bytes(part) for part in parts]

    def present() -> str:
        # (Cached directory listings may be outdated.)
        if hasattr(system, "invalidate_cache"):
            system.invalidate_cache()
        return _version_of(system.info(name)) or ""

    info = system.info(name)
    version = _version_of(info)
    length = info.get("size")
    return int(system.size(name) if length is None else length), fetch, path, None if version is None else (version, present)


#: Properties in fsspec file information that change with the content.
_VERSIONS = ("ETag", "etag", "e_tag", "md5Hash", "content_md5", "Content-MD5", "checksum", "generation", "mtime", "LastModified", "last_modified", "modified", "updated", "created")


def _version_of(info: Mapping[str, Any]) -> str | None:
    """Returns a file's version from the information of its file system; None if that does not
    distinguish versions.
    """
    found = {name: str(info[name]) for name in _VERSIONS if info.get(name) is not None}
    return json.dumps(found | {"size": str(info.get("size"))}, sort_keys=True) if found else None


def _open_file(file: Any) -> tuple[str, PythonFile]:
    """Returns how an open binary file, or bytes in memory, is read: by copying, whatever its
    position.
    """
    lock = threading.Lock()
    with lock:
        at = file.tell()
        length = file.seek(0, os.SEEK_END)
        length = file.tell() if length is None else length
        file.seek(0)
        if not isinstance(file.read(0), bytes | bytearray | memoryview):
            raise TypeError(f"path: got a text file, {file!r}; open it with mode 'rb'")
        file.seek(at)

    def fetch(starts: list[int], ends: list[int]) -> list[bytes]:
        with lock:
            at = file.tell()
            try:
                return [_part(file, start, end) for start, end in zip(starts, ends, strict=True)]
            finally:
                file.seek(at)

    label = getattr(file, "name", None)
    return f"{type(file).__name__}::{label if isinstance(label, str) else 'memory'}", (int(length), fetch, file, None)


def _part(file: Any, start: int, end: int) -> bytes:
    file.seek(start)
    parts, missing = [], end - start
    while missing:
        part = file.read(missing)
        if not part:
            raise OSError(f"the file ends at byte {end - missing}, expected {end}")
        parts.append(bytes(part))
        missing -= len(part)
    return b"".join(parts)


def token_of(opened: Any) -> Any:
    """Returns a Dask token for an open file of points, lines or faces, from its path and current
    version. Remote files get a new token each time, so that nothing is computed from an earlier
    version.
    """
    _, file, _ = opened._remote
    if file is not None:
        return str(opened.path), content_token(file[2]) or uuid.uuid4().hex
    try:
        found = os.stat(os.fspath(opened.path))
    except OSError:
        return str(opened.path), uuid.uuid4().hex
    return str(opened.path), found.st_ino, found.st_size, found.st_mtime_ns


def content_token(file: Any) -> str | None:
    """Returns a Dask token for bytes in memory, which have no version."""
    if not hasattr(file, "getbuffer"):
        return None
    with file.getbuffer() as buffer:
        return hashlib.sha256(buffer).hexdigest()


def _protocol(system: Any) -> str:
    protocol = system.protocol
    return str(protocol if isinstance(protocol, str) else protocol[0])


def _is_local(system: Any) -> bool:
    protocol = system.protocol
    return bool({"file", "local"} & set([protocol] if isinstance(protocol, str) else protocol))


#: Options of s3fs, gcsfs and adlfs, with their names in the native module's store library.
_OPTIONS = {
    "s3": {"key": "access_key_id", "secret": "secret_access_key", "token": "session_token", "anon": "skip_signature", "endpoint_url": "endpoint",
           "region_name": "region", "requester_pays": "request_payer"},
    "gs": {"endpoint_url": "google_base_url"},
    "az": {"anon": "skip_signature", "sas_token": "sas_token", "tenant_id": "tenant_id", "client_id": "client_id", "client_secret": "client_secret"},
}  # fmt: skip

#: Options of fsspec that do not affect reads here.
_WITHOUT_EFFECT = ("asynchronous", "batch_size", "cache_regions", "cache_type", "consistency", "default_block_size", "default_cache_type", "default_fill_cache", "project", "session_kwargs", "skip_instance_cache",
                   "use_listings_cache", "listings_expiry_time", "max_paths", "max_concurrency", "blocksize", "block_size", "version_aware", "protocol", "access")  # fmt: skip


def storage_of(url: str, options: Mapping[str, Any] | None) -> list[tuple[str, str]]:
    """Returns a store's options, given by their own names or by those of fsspec (s3fs, gcsfs,
    adlfs).
    """
    scheme = url.split("://", 1)[0].lower() if "://" in url else ""
    store = {"s3a": "s3", "gcs": "gs", "abfs": "az", "abfss": "az", "adl": "az", "azure": "az"}.get(scheme, scheme)
    given: dict[str, str] = {}
    for key, value in (options or {}).items():
        if value is not None and key not in _WITHOUT_EFFECT:
            given |= _translated(store, str(key), value)
    return list(given.items())


def _translated(store: str, key: str, value: Any) -> dict[str, str]:
    """Returns an option under the store's name."""
    match store, key:
        case _, "client_kwargs" | "config_kwargs" | "s3_additional_kwargs" if not isinstance(value, Mapping):
            raise TypeError(f"storage_options: {key}: expected a mapping, got {type(value).__name__}")
        case "s3", "client_kwargs":
            inner = {name: own for name, own in value.items() if own is not None}
            if unknown := sorted(inner.keys() - {"endpoint_url", "region_name"}):
                raise ValueError(f"storage_options: client_kwargs: got {', '.join(unknown)}; expected endpoint_url and region_name")
            return {found: text for name, own in inner.items() for found, text in _translated("s3", name, own).items()}
        case _, "client_kwargs" | "config_kwargs" | "s3_additional_kwargs":
            if value:
                raise ValueError(f"storage_options: {key}: is unknown for {store or 'local'} files; see docs/remote.md, or pass a file of fsspec")
            return {}
        case "s3", "endpoint_url":
            return {"endpoint": _text(value), **({"allow_http": "true"} if str(value).startswith("http://") else {})}
        case "s3", "use_ssl":
            return {} if value else {"allow_http": "true"}
        case "s3", "profile":
            raise ValueError("storage_options: profile: is read from the environment; set AWS_PROFILE")
        case "gs", "token":
            return _google_token(value)
        case "az", "connection_string":
            names = {"AccountName": "account_name", "AccountKey": "account_key", "SharedAccessSignature": "sas_token", "BlobEndpoint": "endpoint"}
            fields = dict(part.split("=", 1) for part in str(value).split(";") if "=" in part)
            return {names[name]: text for name, text in fields.items() if name in names}
        case _:
            return {_OPTIONS.get(store, {}).get(key, key): _text(value)}


def _google_token(value: Any) -> dict[str, str]:
    """Converts credentials in the form of gcsfs."""
    if isinstance(value, Mapping):
        return {"google_service_account_key": json.dumps(dict(value))}
    text = os.fspath(value)
    if text == "anon":
        return {"skip_signature": "true"}
    # (The store library finds these itself.)
    if text in ("google_default", "cloud", "cache"):
        return {}
    if text == "browser":
        raise ValueError("storage_options: token: 'browser' is interactive; expected 'anon', 'google_default', the path of a file of credentials, or its content")
    return {"google_service_account": text}


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
