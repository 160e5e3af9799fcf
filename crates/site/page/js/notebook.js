// The page embedded in another one, as in a notebook, which reads ranges of the file and receives
// drawn polygons.

const pending = new Map();
let next = 0;

addEventListener("message", ({ source, data }) => {
  if (source !== parent || !pending.has(data?.range)) return;
  const { resolve, reject } = pending.get(data.range);
  pending.delete(data.range);
  if (data.failure === undefined) resolve(new Uint8Array(data.bytes));
  else reject(new Error(data.failure));
});

/** Reads a range of the file. */
export function readFromParent(start, end) {
  return new Promise((resolve, reject) => {
    next += 1;
    pending.set(next, { resolve, reject });
    postToParent({ range: next, start, end });
  });
}

/** Sends a message to the enclosing page, if there is one. */
export function postToParent(message) {
  if (parent !== window) parent.postMessage({ spinney: message }, "*");
}
