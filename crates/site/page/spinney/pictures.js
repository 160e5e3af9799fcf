// Pictures, as the platform has them.

/** Pixels, as the platform's type if it has one; what is said of a part goes with them. */
export function picture(bytes, width, height, { level, cells, bounds } = {}) {
  const data = new Uint8ClampedArray(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const found = typeof ImageData === "undefined" ? { width, height, data } : new ImageData(data, width, height);
  return level === undefined ? found : Object.assign(found, { level, cells, bounds });
}

/** A picture as what can be sent to another thread without copying it. */
export function packed(found) {
  if (!(found?.data instanceof Uint8ClampedArray)) return found;
  const { width, height, data, level, cells, bounds } = found;
  return { isPicture: true, width, height, data, level, cells, bounds };
}
