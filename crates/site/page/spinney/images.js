// Images in the platform's type.

/** Pixels, in the platform's type if there is one, with the level and bounds of a region. */
export function image(bytes, width, height, { level, cells, bounds } = {}) {
  const data = new Uint8ClampedArray(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const found = typeof ImageData === "undefined" ? { width, height, data } : new ImageData(data, width, height);
  return level === undefined ? found : Object.assign(found, { level, cells, bounds });
}

/** An image in a form that can be sent to another thread without copying. */
export function packed(found) {
  if (!(found?.data instanceof Uint8ClampedArray)) return found;
  const { width, height, data, level, cells, bounds } = found;
  return { isImage: true, width, height, data, level, cells, bounds };
}
