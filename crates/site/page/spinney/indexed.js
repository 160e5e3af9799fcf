// Sources of an index: files that have its cells.

import * as engine from "./engine.js";
import { SpinneyError } from "./errors.js";
import { each } from "./ranges.js";
import { HttpSource, PARALLEL, Source, isNode } from "./sources.js";

/**
 * An open file, and its sources if it is an index. A query that reads cells of an index lacks
 * ranges of its sources. They are opened without a request, since the index has their lengths.
 */
export class IndexedFiles {
  /** Sources by name. */
  #sources = new Map();

  constructor(file) {
    this.file = file;
  }

  /** Fetches ranges, by the numbers of their files in the module. */
  async fetch(ranges, signal) {
    const total = { requests: 0, bytes: 0 };
    await each([...ranges], PARALLEL, async ([number, own]) => {
      const came = await (number === this.file.file ? this.file : this.#source(number))?.fetch(own, signal);
      total.requests += came?.requests ?? 0;
      total.bytes += came?.bytes ?? 0;
    });
    return total;
  }

  /** The source with a number in the module; none if the instance was replaced meanwhile. */
  #source(number) {
    const known = engine.describeSource(number);
    if (!known) return undefined;
    let source = this.#sources.get(known.name);
    if (!source) {
      source = this.#open(known);
      this.#sources.set(known.name, source);
    }
    return Object.assign(source, { file: number, instance: engine.instance(), length: known.length });
  }

  #open(known) {
    const { name } = known;
    const { file } = this;
    if (/^https?:/i.test(name)) {
      // (Headers may have a token, which is for the index's host alone.)
      const isNear = file instanceof HttpSource && new URL(name).origin === new URL(file.url).origin;
      return new HttpCells(file, known, isNear ? file.headers : undefined);
    }
    if (isNode && file.path !== undefined && !name.includes("://")) return new DiskCells(file, known);
    const scheme = /^([a-z][a-z0-9+.-]*):\/\//i.exec(name)?.[1];
    const advice = scheme
      ? `name it by its https:// URL in the index (--source-prefix ${scheme}://...=https://...)`
      : "open the index by its URL, with this file in the same place relative to it";
    throw new SpinneyError({
      code: "unsupported",
      message: `${file.name}: its cells are in the file ${name}, which cannot be read from here; ${advice}`,
      file: file.name,
      found: name,
      advice,
    });
  }

  close() {
    // (The module removes the sources of an index that is removed.)
    this.#sources.clear();
    this.file.close();
  }
}

/**
 * Warns that a source has another version than the indexed one, once. That is no failure: its
 * tiles are compared with the checksums in the index.
 */
function warn(source, what) {
  if (source.hasWarned) return;
  source.hasWarned = true;
  const text = `${source.name}: has another ${what} than when it was indexed; its tiles are compared with the checksums in the index`;
  source.index.warnings.push(text);
  console.warn(text);
}

/** The failure of a source that is shorter than the indexed one. */
function tooShort(source, end) {
  const advice = "update the index (`spinney index --update`)";
  return new SpinneyError({
    code: "changed",
    message: `${source.name}: has no bytes up to ${end}, which it had when it was indexed; ${advice}`,
    file: source.name,
    advice,
  });
}

/** A source on a server. */
class HttpCells extends HttpSource {
  /** All of its bytes, if the host serves no ranges. */
  #all;

  constructor(index, known, headers) {
    super(known.name, headers);
    Object.assign(this, { index, known });
  }

  accept(response, place, end) {
    if (response.status === 416 || place?.end < end) throw tooShort(this, end);
    this.check(response);
    const { tag } = this.known;
    const found = response.headers.get("etag");
    // (Without quotes it is a time: the host had no tags.)
    const isOther = tag?.includes('"') && found && found !== tag;
    if (isOther || (place && place.length !== this.length)) warn(this, "length or entity tag");
    if (response.status !== 206) throw NO_RANGES;
  }

  async read(start, end, signal) {
    if (!this.#all) {
      try {
        return await super.read(start, end, signal);
      } catch (error) {
        if (error !== NO_RANGES) throw error;
      }
    }
    this.#all ??= this.#readAll(signal);
    const bytes = await this.#all;
    if (end > bytes.length) throw tooShort(this, end);
    return bytes.subarray(start, end);
  }

  async #readAll(signal) {
    try {
      const why = "the host does not serve ranges of it";
      const response = await this.request(undefined, signal);
      this.check(response);
      const bytes = await this.body(response, why, signal);
      this.index.warnings.push(`${this.name}: ${why}: all of its ${bytes.length} bytes were read`);
      return bytes;
    } catch (error) {
      this.#all = undefined;
      throw error;
    }
  }
}

const NO_RANGES = new Error("the host serves no ranges");

/** A local source, under Node. It is open only while it is read: an index may have thousands. */
class DiskCells extends Source {
  constructor(index, known) {
    super(known.name);
    Object.assign(this, { index, known });
  }

  async read(start, end) {
    const { open } = (await import(/* webpackIgnore: true */ /* @vite-ignore */ "node:fs")).promises;
    let handle;
    try {
      handle = await open(this.name, "r");
      const { size, mtimeNs } = await handle.stat({ bigint: true });
      const { length, modified } = this.known;
      if (Number(size) !== length || (modified && modified !== String(mtimeNs))) warn(this, "length or modification time");
      if (Number(size) < end) throw tooShort(this, end);
      const bytes = new Uint8Array(end - start);
      for (let filled = 0; filled < bytes.length; ) {
        const { bytesRead } = await handle.read(bytes, filled, bytes.length - filled, start + filled);
        if (bytesRead === 0) throw tooShort(this, end);
        filled += bytesRead;
      }
      return bytes;
    } catch (error) {
      if (error instanceof SpinneyError) throw error;
      const code = error.code === "ENOENT" ? "not-found" : "io";
      throw new SpinneyError({ code, message: `${this.name}: cannot read: ${error.message}`, file: this.name }, { cause: error });
    } finally {
      await handle?.close();
    }
  }
}
