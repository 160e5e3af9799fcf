// Error classes.

/** A failure: the file, what was found there, what was expected, and advice. */
export class SpinneyError extends Error {
  /**
   * @param {{code?: string, message: string, file?: string, place?: string, found?: string,
   * expected?: string, advice?: string}} parts
   */
  constructor(parts, options) {
    super(parts.message, options);
    this.name = "SpinneyError";
    this.code = parts.code ?? "other";
    for (const name of ["file", "place", "found", "expected", "advice"]) {
      if (parts[name] !== undefined && parts[name] !== null) this[name] = parts[name];
    }
  }
}

/** The module ended unexpectedly. It has been replaced: the next query works. */
export class PanicError extends SpinneyError {
  constructor(parts, options) {
    super({ code: "panic", ...parts }, options);
    this.name = "PanicError";
  }
}

/** The properties of an error, to be sent to another thread. */
export function toParts(error) {
  if (error instanceof SpinneyError) {
    const { name, message, code, file, place, found, expected, advice } = error;
    return { name, message, code, file, place, found, expected, advice };
  }
  return { name: error?.name ?? "Error", message: String(error?.message ?? error) };
}

/** The error with these properties. */
export function fromParts(parts) {
  if (parts.name === "PanicError") return new PanicError(parts);
  if (parts.name === "SpinneyError") return new SpinneyError(parts);
  if (parts.name === "AbortError") return new DOMException(parts.message, "AbortError");
  if (parts.name === "TypeError") return new TypeError(parts.message);
  const error = new Error(parts.message);
  error.name = parts.name;
  return error;
}
